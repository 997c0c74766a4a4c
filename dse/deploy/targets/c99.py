"""C99 without dependencies, for any processor: a header, a source, and a program that reads recordings."""

from __future__ import annotations

import functools
import tempfile
from collections.abc import Hashable
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import dse
from dse.config.resolved import Sections
from dse.dataset.shape import Shape
from dse.deploy.bundle import Bundle
from dse.deploy.c import code_size, counting_source, files, host, replay, source
from dse.deploy.c.counting import CountingPlan, planned
from dse.deploy.c.footprint import footprint
from dse.deploy.c.least import RAM, least_memory
from dse.deploy.c.plan import Plan, Unsupported
from dse.deploy.reference import Reference
from dse.deploy.targets import TargetError, Verdict
from dse.registry import Column, register


@register("targets", "c99")
@dataclass(frozen=True)
class C99:
    """One header and one source, static memory only; networks in integers only (dse.deploy.c)."""

    label: ClassVar[str] = "C99 for any processor"
    extra: ClassVar[str] = ""
    has_prefix: ClassVar[bool] = True
    known_before: ClassVar[tuple[Column, ...]] = (RAM,)
    use: ClassVar[str] = "`cc -O2 -Isrc main.c src/dse.c -o touch` there, then `./touch < recording.csv`"

    def refusal(self, bundle: Bundle) -> str:
        """Return why C cannot hold the classifier, one sentence; '' if it can."""
        try:
            planned(bundle)
        except Unsupported as error:
            return str(error)
        return ""

    def footprint(self, bundle: Bundle) -> dict[str, float]:
        """Return its memory before it is written.

        RAM and tables are exact. Flash is that of this machine's compiler (`dse.deploy.c.host.sizes`), whose
        code is compiled once per kind of classifier: instructions of others of the kind differ by some
        bytes. Without a compiler it is left out.
        """
        plan = planned(bundle)
        sizes = {name: float(x) for name, x in vars(footprint(plan)).items()}
        instructions = _instructions(_Kind(_kind(plan), plan))
        return sizes if instructions is None else sizes | {"flash_bytes": instructions + _constants(plan)}

    def least_footprint(self, sections: Sections, shape: Shape) -> dict[str, tuple[float, float]]:
        """Return its memory before a design is trained (`dse.deploy.c.least`)."""
        return least_memory(sections, shape)

    def write(self, bundle: Bundle, folder: Path) -> None:
        """Write src/dse.h, src/dse.c, main.c, CMakeLists.txt, what makes it an Arduino library, README.md."""
        try:
            plan = planned(bundle)
        except Unsupported as error:
            raise TargetError(str(error)) from None
        files.write(_code(plan), folder, _title(bundle), dse.__version__, bundle.prefix)

    def verify(self, bundle: Bundle, folder: Path, reference: Reference) -> Verdict:
        """Compile the files here, run them on recordings, compare all spikes and decisions.

        Raises:
            TargetError: there is no compiler, or the files do not compile or run.
        """
        plan = planned(bundle)
        recorded = replay.of_recordings(reference, plan)
        real = ["-DDSE_REAL_SAMPLES"] if replay.reals(reference, plan) else []
        try:
            played = host.played(folder, recorded or replay.of_spikes(reference), *real)
            sizes, compiler = host.sizes(folder, *real), host.compiler_name()
            run_by = [host.compiler_version()]
        except (host.NoCompiler, host.RunFailed) as error:
            raise TargetError(str(error)) from None
        figures = {} if sizes is None else {name: float(x) for name, x in vars(sizes).items()}
        return replay.verdict_of(played, plan, reference, figures, compiler, run_by)


@dataclass(frozen=True)
class _Kind:
    """What the instructions of a classifier follow from; `example` is one of the kind."""

    parts: Hashable
    example: Plan | CountingPlan = field(compare=False)


def _kind(plan: Plan | CountingPlan) -> Hashable:
    front_end = plan.front_end, plan.encoder, plan.pooling is not None
    return frozenset(code_size.parts(plan).items()), front_end


@functools.cache
def _instructions(kind: _Kind) -> float | None:
    """Return the bytes of the instructions of a kind as compiled here; None without compiler or `size`."""
    with tempfile.TemporaryDirectory() as folder:
        files.write(_code(kind.example), Path(folder) / "c", "", dse.__version__)
        try:
            sizes = host.sizes(Path(folder) / "c")
        except (host.NoCompiler, host.RunFailed):
            return None
    return None if sizes is None else sizes.flash_bytes - _constants(kind.example)


def _constants(plan: Plan | CountingPlan) -> float:
    """Return the bytes of all constants of a plan."""
    return float(footprint(plan).table_bytes + code_size.other_constants(plan))


def _title(bundle: Bundle) -> str:
    study = bundle.evidence.get("study", "dse")
    return f"{study}: a classifier of {', '.join(planned(bundle).classes)}"


def _code(plan: Plan | CountingPlan) -> files.Code:
    return source.code(plan) if isinstance(plan, Plan) else counting_source.code(plan)
