"""A classifier trained once more from what its bundle states: the same bits, or the first that differ.

What it follows from, by the bundle: the sections of the design, the hash of the recordings, the axes, seed
and repeat of the training, the parts of the split, the bits of its weights. Nothing is fetched.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from dse import store
from dse.base.records import Array, Network
from dse.base.registry import param
from dse.config import Sections
from dse.config.contracts import PLACES
from dse.config.values import read_object, refuse
from dse.data.recordings import RecordingError
from dse.deploy.bundle import Bundle, BundleError, read, weights
from dse.deploy.export import bundle_of
from dse.deploy.statement import digest
from dse.models.snn.quantise import rounded
from dse.study.claim import describe
from dse.study.jobs import trained_alone
from dse.study.results import open as open_study

TOLERANCE = 1e-6
"""Of the largest number of an array: families that compute in floating point may differ by it elsewhere."""


@dataclass(frozen=True, kw_only=True)
class _Precision:
    weight_bits: int
    pruned: float = param(low=0, high=1)


@dataclass(frozen=True, kw_only=True)
class _Evidence:
    """What of a bundle's evidence the training follows from."""

    seed: int = param(low=0)
    design: Mapping[str, Any]
    repeat: int = param(low=0)
    recordings: str
    refit: tuple[Literal["train", "validation", "test"], ...] = ()
    precision: _Precision | None = None


@dataclass(frozen=True)
class Reproduced:
    """What came out.

    kind: identical, close (no number differs by more than `TOLERANCE` of the largest in its array), or
        different.
    first: array and place of the first number that differs, and both numbers; '' if none does.
    largest_difference: in the largest number of its array.
    sha256: of the arrays of the bundle (`digest`). train_s: time of preparing and training.
    changed: packages and interpreter, as stated and now, where they differ.
    """

    kind: Literal["identical", "close", "different"]
    first: str
    largest_difference: float
    sha256: str
    train_s: float
    changed: tuple[str, ...]


def reproduce(
    bundle: str | Path | Bundle, data: str | Path | None = None, trial: int | None = None
) -> Reproduced:
    """Train the classifier of a bundle once more, and compare every number.

    Args:
        bundle: its folder, that of a study, or a bundle as `Choice.bundle` returns it.
        data: the recordings, or the folder that they are named relative to; None: they are looked up in this
            folder, in that of the bundle and in those above it.
        trial: of a study; None: that of most accuracy.

    Raises:
        BundleError: the bundle does not state what it takes, or is damaged; the study has no such trial.
        RecordingError: the recordings are not found, or are others.
        TrainingDiverged: it does not learn.

    >>> reproduce("small").kind
    'identical'
    """
    stated = bundle if isinstance(bundle, Bundle) else _stated(Path(bundle), trial)
    where = f"{bundle}: " if isinstance(bundle, str | Path) else ""
    try:
        evidence = read_object(_Evidence, store.plain(stated.evidence), (), refuse, also=stated.evidence)
        assert evidence is not None  # a mistake raises
    except ValueError as error:
        again = "an earlier version of dse wrote it, or did not find its recordings; export the design again"
        raise BundleError(f"{where}what it follows from is not stated: {error} ({again})") from None
    places = [] if isinstance(bundle, Bundle) else [Path(bundle).absolute(), *Path(bundle).absolute().parents]
    sections, base = _found(stated.sections, evidence.recordings, data, [Path.cwd(), *places], where)
    began = time.perf_counter()
    fitted = trained_alone(sections, base, evidence.seed, evidence.design, evidence.repeat, evidence.refit)
    if evidence.precision is not None and isinstance(fitted, Network):
        fitted = rounded(fitted, evidence.precision.weight_bits, evidence.precision.pruned)
    train_s = time.perf_counter() - began
    before, after = weights(stated.fitted), weights(fitted)
    first, largest = _compared(before, after)
    kind: Literal["identical", "close", "different"] = "different"
    if largest <= TOLERANCE:
        kind = "close" if first else "identical"
    return Reproduced(kind, first, largest, digest(before), train_s, _changed(stated.evidence))


def _stated(folder: Path, trial: int | None) -> Bundle:
    """Return the bundle in a folder, or that of a design of the study in it."""
    if not (folder / store.SPACE).is_file():
        if trial is not None:
            raise BundleError(f"{folder}: is no study, and a bundle has one trial")
        return read(folder)
    study = open_study(folder)
    points = study.points()
    if trial is not None and not (points["trial"] == trial).any():
        raise BundleError(f"{folder}: has no trial {trial} that has finished")
    some = points if trial is None else points[points["trial"] == trial]
    best = some.sort_values("accuracy").iloc[-1]
    return bundle_of(study, {str(name): value for name, value in best.items()})


def _found(
    sections: Sections, content: str, data: str | Path | None, places: list[Path], where: str
) -> tuple[Sections, Path]:
    """Return the sections and what their recordings are relative to, once these are those of the training."""
    source: Any = sections.data
    named = [str(x) for name in PLACES if (x := getattr(source, name, None))]
    bases = places
    if data is not None:
        path = Path(data)
        if not path.exists():
            raise RecordingError(f"{path}: no such file or folder")
        bases = [path]
        if path.is_file() or any(Path(x).is_absolute() for x in named):
            key = next((name for name in PLACES if getattr(source, name, None)), "")
            moved = path if path.is_file() else path / Path(named[0]).name
            sections = dataclasses.replace(
                sections, data=dataclasses.replace(source, **{key: str(moved.absolute())})
            )
    others = ""
    for base in bases:
        try:
            if sections.data.content(base) == content:
                return sections, base
            others = f"the recordings at {base} are others: their SHA-256 is not {content[:12]}..."
        except (RecordingError, OSError):
            continue
    raise RecordingError(
        f"{where}{others or 'the recordings ' + ', '.join(named) + ' are not found'}; name them with --data"
    )


def _compared(before: Mapping[str, Array], after: Mapping[str, Array]) -> tuple[str, float]:
    """Return the first number that differs, in words, and the largest difference of all."""
    first, largest = "", 0.0
    for name in sorted(before.keys() | after.keys()):
        if name not in before or name not in after:
            return f"array {name} is {'stated' if name in before else 'trained'} alone", np.inf
        a, b = np.asarray(before[name]), np.asarray(after[name])
        if a.shape != b.shape or a.dtype != b.dtype:
            return f"array {name} is {a.dtype} {a.shape} in the bundle and {b.dtype} {b.shape} now", np.inf
        same = (a == b) | ((a != a) & (b != b))
        if same.all():
            continue
        place = np.unravel_index(int(np.argmin(same)), a.shape)
        first = (
            first or f"{name}[{', '.join(map(str, place))}] is {a[place]} in the bundle and {b[place]} now"
        )
        if a.dtype.kind not in "iufb":
            return first, np.inf
        apart = np.abs(a.astype(np.float64) - b.astype(np.float64))
        largest = max(largest, float(apart[~same].max() / max(np.abs(a).max(), np.finfo(np.float64).tiny)))
    return first, largest


def _changed(evidence: Mapping[str, Any]) -> tuple[str, ...]:
    """Return what of interpreter, machine and packages is not as stated."""
    sessions, now = evidence.get("environment"), describe()
    stated = sessions[-1] if isinstance(sessions, list) and sessions else {}
    pairs = [(key, stated.get(key), now[key]) for key in ("python", "machine")]
    versions: Any = now["versions"]
    pairs += [(name, version, versions.get(name)) for name, version in stated.get("versions", {}).items()]
    return tuple(f"{name} was {a} and is {b}" for name, a, b in pairs if a is not None and a != b)
