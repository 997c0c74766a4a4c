"""Targets: forms in which a classifier leaves the framework, a file each, verified by running them.

Contract: `Target`. To add one, here or in a module of your own, write a file with a frozen dataclass that
`@register("targets", "my_target")` names: what it refuses, what it writes, and how that is run. A `BackEnd`
walks the form of a classifier (dse.deploy.form), and has refusal, writing and verdict from there. One that
runs the C extends `dse.deploy.targets.c99.InC`, and says how it is compiled and executed; in the emulator,
`dse.deploy.targets.emulated`, it registers cores and their instruction set.
`dse.testing.check_target` says what it lacks.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar, Generic, Protocol, TypeVar

from dse.deploy.bundle import Bundle
from dse.deploy.form import Unsupported
from dse.deploy.reference import Reference, Run
from dse.deploy.run import Engine, TargetError, compare, verdict_of
from dse.deploy.verdict import Verdict

__all__ = ["BackEnd", "Engine", "Run", "Target", "TargetError", "Verdict", "compare"]

F = TypeVar("F")


class Target(Protocol):
    """A form of a classifier outside `dse`: a frozen dataclass without keys.

    A target that knows what a classifier takes before anything is written has a method `footprint(bundle)`,
    which returns column -> number, such as ram_bytes; `dse pick` chooses by these columns. If it also has
    `profile`, the name of a hardware profile of kind processor or gate_array, this predicts column cycles.
    On another profile of this kind whose key `target` names it, that one does, and `footprint(bundle, chip)`
    is called with it.

    A target whose names begin with the bundle's `prefix` (`dse export --prefix`) has `has_prefix`, True.

    label: what it is, such as 'C99 for any processor'.
    extra: extra of `dse` (pip install 'dse-spiking[EXTRA]') that writing or verifying needs; '' for none.
    use: how its files are used, one sentence or command, relative to the bundle's folder.
    """

    label: ClassVar[str]
    extra: ClassVar[str]
    use: ClassVar[str]

    def refusal(self, bundle: Bundle) -> str:
        """Return why it cannot hold the classifier, one sentence; '' if it can."""
        ...

    def write(self, bundle: Bundle, folder: Path) -> None:
        """Write its files into an empty folder; the same bundle gives the same bytes.

        Raises:
            TargetError: something that writing needs is missing.
        """
        ...

    def verify(self, bundle: Bundle, folder: Path, reference: Reference) -> Verdict:
        """Run the files that `write` wrote on recordings, and compare; the folder is not changed.

        The verdict names what ran them: `run_by`.

        Raises:
            TargetError: something that running needs is missing, or it fails to run.
        """
        ...


class BackEnd(Target, Generic[F]):
    """A target that walks the form of a classifier (dse.deploy.form); refusal and verdict are alike for all.

    To add one, write `form`, `emit` and `engines`.
    """

    @abstractmethod
    def form(self, bundle: Bundle) -> F:
        """Return the classifier in the form that is written.

        Raises:
            Unsupported: the target cannot hold it; the reason in one sentence.
        """

    @abstractmethod
    def emit(self, form: F, bundle: Bundle, folder: Path) -> None:
        """Write the files of a form into an empty folder, as `write`."""

    @abstractmethod
    def engines(self, form: F, bundle: Bundle, folder: Path, reference: Reference) -> Iterator[Engine]:
        """Yield every engine that runs the files here, after its run, and those that are not installed."""

    def refusal(self, bundle: Bundle) -> str:
        """Return why it cannot hold the classifier, one sentence; '' if it can."""
        try:
            self.form(bundle)
        except Unsupported as error:
            return str(error)
        return ""

    def write(self, bundle: Bundle, folder: Path) -> None:
        """Write its files into an empty folder (`Target`)."""
        try:
            form = self.form(bundle)
        except Unsupported as error:
            raise TargetError(str(error)) from None
        self.emit(form, bundle, folder)

    def verify(self, bundle: Bundle, folder: Path, reference: Reference) -> Verdict:
        """Run its files on recordings and compare (`Target`); the engine that strays most counts."""
        return verdict_of(reference, list(self.engines(self.form(bundle), bundle, folder, reference)))
