"""Runs of what targets wrote, and what they show beside a bundle's own engine: the runner of all targets."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from dse.base.records import Array, Ints, Network
from dse.deploy.classifier import BundleError
from dse.deploy.form import Net
from dse.deploy.reference import Reference, Run
from dse.deploy.verdict import KINDS, Verdict


class TargetError(BundleError):
    """A target cannot be written or run on this machine, such as for want of a compiler; one line."""


@dataclass(frozen=True)
class Engine:
    """What ran the files of a target, and what it did.

    by: its names with versions; of one that cannot run here, a sentence that says so.
    run: None where it cannot run here.
    figures: column -> number that the run has measured.
    compiler: of the code that was run, where there is one.
    has_same_input: whether the input spikes that it made were those of the reference.
    """

    by: tuple[str, ...]
    run: Run | None = None
    figures: Mapping[str, float] = field(default_factory=dict)
    compiler: str = ""
    has_same_input: bool = True

    def verdict(self, reference: Reference) -> Verdict:
        """Return what its run has shown."""
        assert self.run is not None
        verdict = compare(reference, self.run, self.figures, self.compiler, self.by)
        if verdict.kind == "faithful" and not self.has_same_input:
            return dataclasses.replace(verdict, kind="equivalent", reason="the input spikes differ")
        return verdict


def verdict_of(reference: Reference, engines: Sequence[Engine]) -> Verdict:
    """Return the verdict of a target: that of the engine that strays most, with what all have measured."""
    verdicts = {id(x): x.verdict(reference) for x in engines if x.run is not None}
    if not verdicts:
        return Verdict("not verified", " and ".join(", ".join(x.by) for x in engines))
    worst = max(verdicts.values(), key=lambda x: (KINDS.index(x.kind), x.decisions_differ, x.spikes_differ))
    if worst.n_recordings == 0 or len(engines) == 1:
        return worst
    findings = [", ".join(x.by) for x in engines]
    for k, engine in enumerate(engines):
        if engine.run is not None:
            findings[k] += f": {verdicts[id(engine)].reason or 'all decisions and spikes are equal'}"
    return dataclasses.replace(
        worst,
        reason="" if worst.kind == "faithful" else "; ".join(findings),
        figures={name: value for x in engines for name, value in x.figures.items()},
        run_by=tuple(name for x in engines if x.run is not None for name in x.by),
    )


def compare(
    reference: Reference,
    run: Run,
    figures: Mapping[str, float] | None = None,
    compiler: str = "",
    run_by: Sequence[str] = (),
) -> Verdict:
    """Return the verdict of a run.

    Args:
        reference: what the bundle's own engine does.
        run: what the target does on the same recordings.
        figures: column -> number that the run has measured.
        compiler: of the code that was run, where there is one.
        run_by: what ran the files, names with versions.

    Raises:
        ValueError: the run has other numbers of recordings or layers.
    """
    n = reference.n_recordings
    for name in ("label", "time_ms", "decided"):
        if len(getattr(run, name)) != n:
            raise ValueError(f"{name} must have {n} recordings, got {len(getattr(run, name))}")
    if len(run.fired) != len(reference.fired):
        raise ValueError(f"fired must have {len(reference.fired)} layers, got {len(run.fired)}")
    if n == 0:
        return Verdict("not verified", "there are no recordings")
    other = (
        (np.asarray(run.label) != reference.label)
        | ~np.isclose(run.time_ms, reference.time_ms, rtol=1e-9, atol=0)
        | (np.asarray(run.decided) != reference.decided)
    )
    strayed = np.zeros(n, bool)
    for of_run, of_reference in zip(run.fired, reference.fired, strict=True):
        a, b = (np.asarray(x, np.int64).reshape(-1, 3) for x in (of_run, of_reference))
        if not np.array_equal(a, b):
            spikes, surplus = _surplus(a, b)
            strayed[spikes[surplus != 0, 0]] = True
    reasons = []
    if other.any() or strayed.any():
        reasons.append(
            f"{int(other.sum())} of {n} recordings decide and {int(strayed.sum())} spike otherwise"
        )
    largest, f1 = 0, None
    if reference.fired:
        counted = [_counted(x[-1], reference.n_steps) for x in (run.fired, reference.fired)]
        surplus = _surplus(*(x[:, ::2] for x in counted))[1]  # in recordings, of outputs
        largest, f1 = int(np.abs(surplus).max(initial=0)), _f1(*counted)
        if strayed.any():
            reasons.append(f"output F1 {f1:.3f} within one step, class counts differ by {largest} at most")
    return Verdict(
        "approximate" if other.any() else "equivalent" if strayed.any() else "faithful",
        "; ".join(reasons),
        n_recordings=n,
        decisions_differ=float(other.mean()),
        spikes_differ=float(strayed.mean()),
        largest_difference=largest,
        figures=dict(figures or {}),
        compiler=compiler,
        output_f1=f1,
        run_by=tuple(run_by),
    )


def _surplus(first: Ints, second: Ints) -> tuple[Ints, Ints]:
    """Return the rows of two lists, each once, and how much more often they are in the first one."""
    rows, places = np.unique(np.concatenate([first, second]), axis=0, return_inverse=True)
    signs = np.repeat([1, -1], [len(first), len(second)])
    return rows, np.rint(np.bincount(places.ravel(), signs)).astype(np.int64)


def _counted(fired: Ints, n_steps: int) -> Ints:
    """Return the output spikes that a decision can count: nobody receives those of the last step."""
    spikes = np.asarray(fired, np.int64).reshape(-1, 3)
    return spikes[spikes[:, 1] < n_steps - 1]


def _f1(first: Ints, second: Ints) -> float:
    """Return the F1 score of spikes, each matched with at most one that is up to a step away."""
    both = np.concatenate([first, second])
    if not len(both):
        return 1.0
    _, trains = np.unique(both[:, ::2], axis=0, return_inverse=True)
    times = trains.ravel() * (both[:, 1].max() + 2) + both[:, 1]  # trains lie more than a step apart
    a, b = (np.sort(x).tolist() for x in np.split(times, [len(first)]))
    i = j = matched = 0
    while i < len(a) and j < len(b):
        gap = a[i] - b[j]
        matched += abs(gap) <= 1
        i, j = i + (gap <= 1), j + (gap >= -1)
    return 2 * matched / len(both)


def require(package: str, extra: str) -> None:
    """Check that a package is installed."""
    if find_spec(package) is None:
        raise TargetError(f"{package} is not installed: pip install 'dse-spiking[{extra}]'")


def interpreter(package: str, *others: str) -> Path | None:
    """Return the Python that has some packages: this one, or that of `make peers` for the first; or None."""
    if all(find_spec(name) is not None for name in (package, *others)):
        return Path(sys.executable)
    python = Path(sys.prefix) / "peers" / package / "bin" / "python"
    return python if python.is_file() else None


def of_script(
    python: str | Path,
    script: Path,
    arguments: Sequence[str | Path],
    network: Network | Net,
    reference: Reference,
) -> tuple[list[Ints], Mapping[str, Array]]:
    """Run a script on the input spikes of a reference; return what each layer fired, and all that it wrote.

    Args:
        python: interpreter; nothing but the standard path and its own packages are visible to it.
        script: takes ARGUMENTS SPIKES FIRED: two .npz files (docstrings of the scripts).
        arguments: what comes before the two files.
        network: its inputs and layers.
        reference: the recordings.
    """
    with tempfile.TemporaryDirectory() as folder:
        spikes, fired = Path(folder) / "spikes.npz", Path(folder) / "fired.npz"
        n, t, arriving = reference.n_recordings, reference.n_steps, reference.arriving(network)
        np.savez(spikes, spikes=arriving.listed(), n_recordings=n, n_steps=t)
        command = [str(x) for x in (python, "-I", script, *arguments, spikes, fired)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            last = (done.stderr.strip() or f"it ends with code {done.returncode}").splitlines()[-1]
            raise TargetError(f"{script.name} cannot run {' '.join(map(str, arguments))}: {last}")
        with np.load(fired) as file:
            written = dict(file)
    return [written[f"fired_{k}"] for k in range(len(network.layers))], written
