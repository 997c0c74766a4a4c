"""C99 without dependencies, for any processor: a header, a source, and a program that reads recordings."""

from __future__ import annotations

import tempfile
from abc import abstractmethod
from collections.abc import Hashable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import dse
from dse.base.registry import register
from dse.deploy.bundle import Bundle
from dse.deploy.c import code_size, files, host, replay
from dse.deploy.c.code import Code
from dse.deploy.c.counting import code_of
from dse.deploy.c.replay import Executed, Recorded
from dse.deploy.c.selftest import windows
from dse.deploy.reference import Reference
from dse.deploy.targets import BackEnd, Engine, TargetError


class InC(BackEnd[Code]):
    """A target that is C, for one processor or any; a subclass says how it is compiled and executed."""

    has_prefix: ClassVar[bool] = True
    apart: ClassVar[bool] = False

    def form(self, bundle: Bundle) -> Code:
        """Return the classifier as C holds it."""
        return code_of(bundle, self.apart)

    def emit(self, form: Code, bundle: Bundle, folder: Path) -> None:
        """Write src/dse.h, src/dse.c, main.c, README.md, and what makes them a package (`files.write`)."""
        title = f"{bundle.evidence.get('study', 'dse')}: a classifier of {', '.join(form.classes)}"
        # What the self-test must give is of these weights: after an update it would fail.
        tests = () if self.apart else windows(bundle, form)
        named = dse.__version__, bundle.prefix, bundle.digest
        files.write(form, folder, title, *named, tests, self.apart)

    def engines(self, form: Code, bundle: Bundle, folder: Path, reference: Reference) -> Iterator[Engine]:
        """Compile the files, run them on recordings: all spikes and decisions, those of an encoder too."""
        done = self.executed(form, folder, reference, replay.of_recordings(reference, form))
        run = replay.run_of(done.played, form, reference)
        has_same_input = replay.same_input(done.played, reference)
        yield Engine(done.run_by, run, done.figures, done.compiler, has_same_input)

    @abstractmethod
    def executed(self, form: Code, folder: Path, reference: Reference, recorded: Recorded) -> Executed:
        """Compile the C in a folder with replay.c, and execute it; without commands, push the input spikes.

        Raises:
            TargetError: it does not compile or run here.
        """


@register("targets", "c99")
@dataclass(frozen=True)
class C99(InC):
    """One header and one source, static memory only; networks in integers only (dse.deploy.c)."""

    label: ClassVar[str] = "C99 for any processor"
    extra: ClassVar[str] = ""
    use: ClassVar[str] = "`cc -O2 -Isrc main.c src/dse.c -o touch` there, then `./touch < recording.csv`"

    def footprint(self, bundle: Bundle) -> dict[str, float]:
        """Return its memory before it is written.

        RAM and tables are exact. Flash is that of this machine's compiler (`dse.deploy.c.host.sizes`), whose
        code is compiled once per kind of classifier: instructions of others of the kind differ by some
        bytes. Without a compiler it is left out.
        """
        plan = code_of(bundle)
        kind = frozenset(plan.parts().items()), plan.front_end, plan.encoder, plan.pooling is not None
        if kind not in _INSTRUCTIONS:
            _INSTRUCTIONS[kind] = _instructions(plan)
        if (instructions := _INSTRUCTIONS[kind]) is None:
            return plan.footprint
        return plan.footprint | {"flash_bytes": instructions + code_size.constant_bytes(plan)}

    def executed(self, form: Code, folder: Path, reference: Reference, recorded: Recorded) -> Executed:
        """Compile the C in a folder with replay.c, and execute it; without commands, push the input spikes.

        Raises:
            TargetError: it does not compile or run here.
        """
        commands, options = recorded.commands or replay.of_spikes(reference), recorded.options
        played, sizes = host.played(folder, commands, *options), host.sizes(folder, *options)
        return Executed(played, sizes, host.compiler_name(), (host.compiler_version(),))


@register("targets", "c99_weights")
@dataclass(frozen=True)
class C99Weights(InC):
    """The C of c99 with all weights in weights.bin, which may be replaced (dse.deploy.c.weights)."""

    label: ClassVar[str] = "C99 that loads its weights"
    extra: ClassVar[str] = ""
    use: ClassVar[str] = (
        "flash `weights.bin` beside the firmware, and call `dse_load` with its address before `dse_init`"
    )
    apart: ClassVar[bool] = True

    executed = C99.executed


_INSTRUCTIONS: dict[Hashable, float | None] = {}
"""Kinds of classifiers, by what their instructions follow from -> the bytes of these."""


def _instructions(example: Code) -> float | None:
    """Return the bytes of the instructions of a kind as compiled here; None without compiler or `size`."""
    with tempfile.TemporaryDirectory() as folder:
        files.write(example, Path(folder) / "c", "", dse.__version__)
        try:
            flash = host.sizes(Path(folder) / "c").get("flash_bytes")
        except TargetError:
            return None
    return None if flash is None else flash - code_size.constant_bytes(example)
