"""Targets of a bundle: written, run on recordings, and run again elsewhere."""

from __future__ import annotations

import dataclasses
import filecmp
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import dse
from dse.base import registry
from dse.config.faults import known_names
from dse.deploy.boards import Board, write_projects
from dse.deploy.bundle import Bundle, BundleError, read, target_files, write
from dse.deploy.prefix import checked
from dse.deploy.reference import Reference, of_recordings
from dse.deploy.targets import Target, TargetError
from dse.deploy.verdict import KINDS, Verdict

_WRITES = (
    f"dse {dse.__version__} writes for these weights: it was changed, or another version of dse or of a "
    "library wrote it; `dse export` writes it anew"
)
_UNRUN = "no recordings were given to run it on"


@dataclasses.dataclass(frozen=True)
class Verified:
    """A target's verdict, and the one that its bundle states or stated; None where it had none."""

    verdict: Verdict
    before: Verdict | None

    @property
    def drifts(self) -> bool:
        """Whether the target was faithful or equivalent and has been shown to be less, or is refused now."""
        if self.before is None or self.before.kind not in ("faithful", "equivalent"):
            return False
        kind = self.verdict.kind
        return kind != "not verified" and KINDS.index(kind) > KINDS.index(self.before.kind)


def target_named(name: str) -> Target:
    """Return a target."""
    known: dict[str, Any] = registry.known("targets")
    if name not in known:
        raise BundleError(f"unknown target '{name}'; {known_names(name, known)}")
    built: Target = known[name]()
    return built


def export_targets(
    folder: str | Path,
    names: Sequence[str],
    recordings: str | Path | None = None,
    prefix: str | None = None,
    force: bool = False,
    board: Board | None = None,
) -> dict[str, Verified]:
    """Write targets into a bundle, run them, and stamp the bundle with the verdicts.

    Args:
        folder: of the bundle.
        names: of targets; what the bundle holds of them is replaced, other targets stay.
        recordings: to run them on; None: they are written, but not verified.
        prefix: of the names in C (`dse.deploy.prefix`), which the bundle keeps; None: its own.
        force: whether files of these targets are replaced though they were edited.
        board: that the targets must be of, and the classifier must fit; None: any.

    Raises:
        BundleError: the bundle is damaged, a target is unknown or cannot be written or run on this machine,
            or the prefix is none, or not that of other targets of the bundle, or the classifier does not fit
            the board; then nothing is changed.
        RecordingError: the recordings do not fit.
        StoreError: the bundle cannot be written.
    """
    path = Path(folder)
    bundle = read(path, names if force else ())
    if board is not None:
        if wrong := [name for name in names if name != board.target]:
            raise BundleError(f"board {board.name} takes target {board.target}, not {', '.join(wrong)}")
        if why := board.misfit(bundle, target_named(board.target)):
            raise BundleError(f"the classifier does not fit board {board.name}: {why}")
    others = [name for name, x in bundle.targets.items() if name not in names and _is_written(x)]
    if prefix is not None:
        bundle = _with_prefix(bundle, prefix, names, others)
    return publish(bundle, path, names, recordings, {name: target_files(path, name) for name in others})


def _with_prefix(bundle: Bundle, prefix: str, names: Sequence[str], others: Sequence[str]) -> Bundle:
    """Return a bundle with another prefix of names in C; targets `others` stay as they are."""
    try:
        changed = dataclasses.replace(bundle, prefix=checked(prefix))
    except ValueError as error:
        raise BundleError(str(error)) from None
    if not any(_has_prefix(name) for name in names):
        raise BundleError(f"a prefix is of names in C, which {', '.join(names)} has not")
    if prefix != bundle.prefix and (stale := [name for name in others if _has_prefix(name)]):
        raise BundleError(
            f"the prefix {prefix} must be that of all targets: name {', '.join(stale)} too, "
            f"which the bundle has with {bundle.prefix}"
        )
    return changed


def _has_prefix(name: str) -> bool:
    return getattr(target_named(name), "has_prefix", False)


def publish(
    bundle: Bundle,
    folder: Path,
    names: Sequence[str] = (),
    recordings: str | Path | None = None,
    kept: Mapping[str, Mapping[str, Path]] | None = None,
) -> dict[str, Verified]:
    """Write a bundle with targets, and run them first; `kept`: files of targets that it states already."""
    reference = of_recordings(bundle, recordings) if names and recordings is not None else None

    def run(name: str, target: Target, place: Path) -> Verdict:
        return _written(name, target, bundle, place, reference)

    with tempfile.TemporaryDirectory(prefix="dse-targets-") as temporary:
        verified = _each(bundle, names, Path(temporary), recordings, run)
        verdicts = {name: each.verdict for name, each in verified.items()}
        files = {name: _files(Path(temporary) / name) for name, x in verdicts.items() if _is_written(x)}
        targets = {**bundle.targets, **verdicts}
        write(dataclasses.replace(bundle, targets=targets), folder, {**(kept or {}), **files})
    return verified


def verify(
    folder: str | Path, recordings: str | Path, names: Sequence[str] | None = None
) -> dict[str, Verified]:
    """Run the targets of a bundle on recordings; the bundle is not changed.

    A target is written anew from the weights, and what was written here is run. Files in the bundle that
    differ from it in any byte are the finding; they are neither compiled nor run.

    Args:
        folder: of the bundle.
        recordings: to run them on.
        names: of targets; None: all that were written.

    Raises:
        BundleError: the bundle is damaged or has no such target, or a target cannot be run on this machine.
        RecordingError: the recordings do not fit.

    >>> {name: each.verdict.kind for name, each in dse.verify("bundle", "touch.npz").items()}
    {'c99': 'faithful'}
    """
    path = Path(folder)
    bundle = read(path)
    written = [name for name, verdict in bundle.targets.items() if _is_written(verdict)]
    for name in names or ():
        if name not in written:
            raise BundleError(f"{folder}: has no target '{name}'; {_has(written)}")
    if not written:
        raise BundleError(f"{folder}: {_has(written)}; `dse export` writes them")
    reference = of_recordings(bundle, recordings)

    def run(name: str, target: Target, place: Path) -> Verdict:
        if (verdict := _written(name, target, bundle, place, None)).kind == "unsupported":
            return verdict
        return _differs(path, name, place) or target.verify(bundle, place, reference)

    with tempfile.TemporaryDirectory(prefix="dse-targets-") as temporary:
        return _each(bundle, names or written, Path(temporary), recordings, run)


def _each(
    bundle: Bundle,
    names: Iterable[str],
    place: Path,
    recordings: str | Path | None,
    run: Callable[[str, Target, Path], Verdict],
) -> dict[str, Verified]:
    """Return what a run finds of every target, each with an empty folder in a place."""
    verified, faults = {}, []
    for name, target in {name: target_named(name) for name in names}.items():
        (folder := place / name).mkdir()
        try:
            verdict = run(name, target, folder)
        except BundleError as error:
            faults.append(f"target {name}: {error}")
            continue
        if recordings is not None and verdict.n_recordings:
            verdict = dataclasses.replace(verdict, recordings=Path(recordings).name)
        verified[name] = Verified(verdict, bundle.targets.get(name))
    if faults:
        raise TargetError("\n".join(faults))
    return verified


def _written(name: str, target: Target, bundle: Bundle, folder: Path, reference: Reference | None) -> Verdict:
    """Write a target into an empty folder and run it; return the verdict."""
    if refusal := target.refusal(bundle):
        return Verdict("unsupported", refusal)
    target.write(bundle, folder)
    write_projects(name, folder)
    if reference is None:
        return Verdict("not verified", _UNRUN)
    return target.verify(bundle, folder, reference)


def _differs(bundle: Path, name: str, written: Path) -> Verdict | None:
    """Return a verdict if files of a target in a bundle are not what was written here; None if they are."""
    theirs, ours = target_files(bundle, name), _files(written)
    for file in sorted({*theirs, *ours}, key=Path):
        if file not in theirs:
            return Verdict("not verified", f"it lacks {file}, which {_WRITES}")
        if file not in ours or not filecmp.cmp(theirs[file], ours[file], shallow=False):
            return Verdict("not verified", f"{file} is not what {_WRITES}")
    # What lies beside the sources is compiled with them, by Arduino for one.
    sources = bundle / "targets" / name / "src"
    for file in sorted(_files(sources), key=Path):
        if f"src/{file}" not in ours:
            return Verdict("not verified", f"src/{file} is not of dse and would be compiled too; remove it")
    return None


def _files(folder: Path) -> dict[str, Path]:
    """Return the files of a folder by their names in it."""
    return {x.relative_to(folder).as_posix(): x for x in folder.rglob("*") if x.is_file()}


def _is_written(verdict: Verdict) -> bool:
    return verdict.kind != "unsupported"


def _has(written: Iterable[str]) -> str:
    names = ", ".join(written)
    return f"it has the targets {names}" if names else "it has no targets"
