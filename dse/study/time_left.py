"""The estimated time left of a study, available after enough runs have ended."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dse.records import Floats

_MIN_BURSTS = 4
_MAX_SPREAD = 0.25  # standard error of the time per work, relative to it
_MAX_DRIFT = 1.5  # between the earlier and the later half


class TimeLeft:
    """An estimate of the time left from the runs that have ended.

    Args:
        n_workers: workers that train at a time.
        began_s: start of the study, on any clock.
    """

    def __init__(self, n_workers: int, began_s: float) -> None:
        self._n_workers = n_workers
        self._began_s = began_s
        self._ended_s: list[float] = []
        self._work: list[float] = []
        self._n_expected = 0
        self._n_planned = 0
        self._planned = 0.0

    @property
    def n_ended(self) -> int:
        """Number of runs that have ended."""
        return len(self._ended_s)

    @property
    def n_expected(self) -> int:
        """Number of all expected runs, including ended ones."""
        return self._n_expected

    def expect(self, n_runs: int) -> None:
        """Raise the number of runs that are expected."""
        self._n_expected += n_runs

    def plan(self, work: Sequence[float]) -> None:
        """Add the estimated work of runs that are about to be trained, in any unit."""
        self._n_planned += len(work)
        self._planned += sum(work)

    def end(self, at_s: float, work: float) -> None:
        """Add a run that has ended, with the work that was planned; 0 if it was never trained."""
        self._ended_s.append(at_s)
        self._work.append(work)

    def seconds(self, now_s: float) -> float | None:
        """Return the estimated time left, None before there is an estimate (`seconds_left`).

        Runs that are expected and not planned yet count as the mean of the planned ones.
        """
        untrained = self._work.count(0.0)
        unplanned = max(0, self._n_expected - self._n_planned - untrained)
        mean = self._planned / self._n_planned if self._n_planned else 1.0
        missing = max(0.0, self._planned - sum(self._work)) + unplanned * mean
        return seconds_left(self._ended_s, self._work, missing, self._n_workers, self._began_s, now_s)


def seconds_left(
    ended_s: Sequence[float],
    work: Sequence[float],
    missing: float,
    n_workers: int,
    began_s: float,
    now_s: float,
) -> float | None:
    """Return the estimated time until the missing work is done, or None while there is no estimate.

    The runs of a cohort end together, so the time per work is measured between bursts: runs that follow one
    another by less than half the mean interval. There is an estimate once

    1. as many bursts have ended as there are workers: what the first jobs took includes preparing the data
       and compiling, so these are not measured;
    2. four more bursts have ended, and another has begun;
    3. the standard error of the time per work, as of a ratio of means, is at most a quarter of it;
    4. the earlier and the later half of these bursts differ in it by a factor of at most 1.5.

    Args:
        ended_s: when runs ended, rising.
        work: of each of these runs, in any unit.
        missing: work of the runs that have not ended, in the same unit.
        n_workers: workers that train at a time.
        began_s: start of the study, or of its latest run after an interruption.
        now_s: the present, on the same clock.
    """
    if not len(ended_s) or missing <= 0:
        return None
    ends_s, done = _bursts(np.asarray(ended_s, np.float64), np.cumsum(work), began_s)
    if len(ends_s) < n_workers + _MIN_BURSTS:
        return None
    took_s, worked = np.diff(ends_s)[n_workers - 1 :], np.diff(done)[n_workers - 1 :]
    n = len(took_s)
    half = n // 2
    if min(worked[:half].sum(), worked[half:].sum()) <= 0:
        return None
    per_work = took_s.sum() / worked.sum()
    error = np.sqrt(n / (n - 1) * ((took_s - per_work * worked) ** 2).sum()) / worked.sum()
    drift = took_s[:half].sum() / worked[:half].sum() / (took_s[half:].sum() / worked[half:].sum())
    if error > _MAX_SPREAD * per_work or not 1 / _MAX_DRIFT <= drift <= _MAX_DRIFT:
        return None
    since_s = now_s - ends_s[-1]
    left_s = float(per_work * (missing + sum(work) - done[-1]) - since_s)
    return left_s if left_s > 0 else None  # a job takes longer than any so far


def _bursts(ended_s: Floats, done: Floats, began_s: float) -> tuple[Floats, Floats]:
    """Return the end of each burst but the newest, which may continue, and the work done until then."""
    gaps_s = np.diff(ended_s, prepend=began_s)
    begins = gaps_s[1:] > (ended_s[-1] - began_s) / len(ended_s) / 2
    last = np.flatnonzero(begins)
    return ended_s[last], done[last]
