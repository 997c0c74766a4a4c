"""The C of `c99` for Cortex-M processors: cross-compiled, and executed in an emulator (`emulator`)."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from dse.config.resolved import Sections
from dse.dataset.shape import Shape
from dse.deploy.bundle import Bundle
from dse.deploy.c import code_size, host, replay
from dse.deploy.c.counting import planned
from dse.deploy.c.footprint import footprint
from dse.deploy.c.host import Played
from dse.deploy.c.least import FLASH, RAM, least_memory
from dse.deploy.c.matrix import Matrix
from dse.deploy.c.plan import Plan, Unsupported
from dse.deploy.prefix import prefixed
from dse.deploy.reference import Reference
from dse.deploy.targets import Target, Verdict, emulator
from dse.deploy.targets.c99 import C99
from dse.deploy.targets.emulator import CORES, MOST_FLASH_BYTES, Core, Machine, Program, compiled
from dse.hardware.profile import load
from dse.records import Array, Ints
from dse.registry import Column, register

_MEMORY = Path(__file__).parent / "memory"
_APART = 16
"""Recordings over which the instructions of single functions are counted."""


class CortexM(Target):
    """The target of one core.

    core: which.
    profile: hardware profile that predicts its cycles; '' for none.
    code_bytes: of the parts of the code (dse.deploy.c.code_size).
    """

    core: ClassVar[Core]
    profile: ClassVar[str] = ""
    known_before: ClassVar[tuple[Column, ...]] = (RAM, FLASH)
    has_prefix: ClassVar[bool] = True
    code_bytes: ClassVar[Mapping[str, float]] = code_size.CORTEX_M
    extra: ClassVar[str] = "targets"
    use: ClassVar[str] = "compile `src/dse.c` there with your firmware; README.md beside it has the flags"

    def refusal(self, bundle: Bundle) -> str:
        """Return why the core cannot hold the classifier, one sentence; '' if it can."""
        try:
            plan = planned(bundle)
        except Unsupported as error:
            return str(error)
        chip, flash = "the emulator", MOST_FLASH_BYTES
        if self.profile:
            flash_kib = load(self.profile).at("value")["flash_kib"]
            chip, flash = f"the chip of profile {self.profile}", int(flash_kib) * 1024
        if (n := int(code_size.flash_bytes(plan, self.code_bytes))) > flash:
            return f"it takes {n} bytes of flash, and {chip} has {flash}"
        return ""

    def footprint(self, bundle: Bundle) -> dict[str, float]:
        """Return its memory before it is written: in flash constants exactly, code from measured parts."""
        plan = planned(bundle)
        sizes = {name: float(x) for name, x in vars(footprint(plan)).items()}
        return sizes | {"flash_bytes": code_size.flash_bytes(plan, self.code_bytes)}

    def least_footprint(self, sections: Sections, shape: Shape) -> dict[str, tuple[float, float]]:
        """Return its memory before a design is trained (`dse.deploy.c.least`)."""
        return least_memory(sections, shape, self.code_bytes)

    def write(self, bundle: Bundle, folder: Path) -> None:
        """Write the files of `c99`, and how they are compiled for the core."""
        C99().write(bundle, folder)
        readme = folder / "README.md"
        text = readme.read_text(encoding="utf-8") + prefixed(_readme(self.core), bundle.prefix)
        readme.write_text(text, encoding="utf-8")

    def verify(self, bundle: Bundle, folder: Path, reference: Reference) -> Verdict:
        """Compile the files for the core, run all recordings in an emulator, compare spikes and decisions.

        Figures per inference are means over the recordings, from `dse_reset` to the answer, input spikes
        pushed: front_end_instructions is what an encoder or preprocessing in C adds to them.

        Raises:
            TargetError: compiler or emulator are missing, or the files do not compile or run.
        """
        plan = planned(bundle)
        recorded = replay.of_recordings(reference, plan)
        real = ["-DDSE_REAL_SAMPLES"] if replay.reals(reference, plan) else []
        traced = Machine(self.program(folder, "-DDSE_TRACE", *real), self.core)
        played = _played(traced, recorded or replay.of_spikes(reference))
        machine, answers = executed(self, folder, reference, played.steps, *real)
        assert np.array_equal(answers.label, played.label)  # traced or not
        counts, n = machine.counts(), max(1, reference.n_recordings)
        figures = {
            "ram_bytes": float(machine.program.ram_bytes),
            "stack_bytes": float(machine.stack_bytes),
            "flash_bytes": float(machine.program.flash_bytes),
            "instructions_per_inference": counts.instructions / n,
            "cycles_per_inference": counts.cycles(self.core) / n,
        }
        if isinstance(plan, Plan):
            apart = Machine(self.program(folder, "-fno-inline", *real), self.core)
            figures |= _of_functions(apart, plan, reference)
        if recorded is not None:
            machine.forget()
            _played(machine, recorded[:_APART])
            with_front_end = machine.counts().instructions
            machine.forget()
            _played(machine, replay.of_spikes(reference)[:_APART])
            beyond = with_front_end - machine.counts().instructions
            figures["front_end_instructions"] = beyond / max(1, min(_APART, n))
        return replay.verdict_of(
            played, plan, reference, figures, emulator.compiler_name(), emulator.versions()
        )

    def program(self, folder: Path, *options: str) -> Program:
        """Return the C in a folder, with replay.c to drive it, compiled for the core."""
        with tempfile.TemporaryDirectory() as place:
            sources, all_options = host.driven(folder, Path(place), *options)
            return compiled(sources, self.core, f"-isystem{_MEMORY}", *all_options)


@register("targets", "cortex_m0plus")
@dataclass(frozen=True)
class CortexM0Plus(CortexM):
    """The C of c99, executed in an emulator; the core has no instruction for divisions or long products."""

    label: ClassVar[str] = "Cortex-M0+"
    core: ClassVar[Core] = CORES["cortex_m0plus"]
    code_bytes: ClassVar[Mapping[str, float]] = code_size.CORTEX_M0_PLUS


@register("targets", "cortex_m4")
@dataclass(frozen=True)
class CortexM4(CortexM):
    """The C of c99, executed in an emulator."""

    label: ClassVar[str] = "Cortex-M4"
    core: ClassVar[Core] = CORES["cortex_m4"]
    profile: ClassVar[str] = "mcu_m4"


@register("targets", "cortex_m7")
@dataclass(frozen=True)
class CortexM7(CortexM):
    """The C of c99, executed in an emulator."""

    label: ClassVar[str] = "Cortex-M7"
    core: ClassVar[Core] = CORES["cortex_m7"]
    profile: ClassVar[str] = "mcu_m7"


@register("targets", "cortex_m33")
@dataclass(frozen=True)
class CortexM33(CortexM):
    """The C of c99, executed in an emulator."""

    label: ClassVar[str] = "Cortex-M33"
    core: ClassVar[Core] = CORES["cortex_m33"]
    profile: ClassVar[str] = "mcu_m33"


def executed(
    target: CortexM, folder: Path, reference: Reference, steps: Ints | None = None, *options: str
) -> tuple[Machine, Played]:
    """Execute the C in a folder on the input spikes of every window, up to its answer.

    Args:
        target: says for which core.
        folder: of the C.
        reference: what is run.
        steps: (n,) network steps until each answer; None: those of the reference.
        options: of the compiler.

    Returns:
        The machine, which has counted, and the answers.
    """
    if steps is None:
        steps = np.rint(reference.time_ms / reference.step_ms).astype(np.int64)
    machine = Machine(target.program(folder, *options), target.core)
    return machine, _played(machine, inferences(reference, steps))


def inferences(reference: Reference, steps: Sequence[int] | Ints) -> list[Ints]:
    """Return the commands that push the input spikes of every window up to its answer.

    Args:
        reference: what is run.
        steps: (n,) network steps until each answer.
    """
    n, n_steps = reference.n_recordings, reference.dataset.n_steps
    per_sample = max(1, reference.n_steps // n_steps)
    needed = np.minimum(-(-np.asarray(steps) // per_sample), n_steps)
    spikes = reference.spikes_in
    borders = np.searchsorted(spikes[:, 0], np.arange(n + 1))
    commands = []
    for i, last in enumerate(needed.tolist()):
        of_window = spikes[borders[i] : borders[i + 1]]
        counts = np.bincount(of_window[:, 1], minlength=n_steps)[:last]
        commands.append(host.of_spikes(counts, of_window[: counts.sum(), 2]))
    return commands


def _played(machine: Machine, commands: Iterable[Array]) -> Played:
    """Run recordings through replay.c in the emulator."""
    answers = []
    for numbers in commands:
        words = np.ascontiguousarray(numbers, np.int32)
        machine.write("memory_in", words.tobytes())
        for name, value in (("memory_n_in", len(words)), ("memory_read", 0), ("memory_n_out", 0)):
            machine.write(name, value.to_bytes(4, "little"))
        machine.call("main")
        length = int.from_bytes(machine.read("memory_n_out"), "little")
        answers.append(np.frombuffer(machine.read("memory_out", 4 * length), np.int32))
    return host.parsed(np.concatenate(answers))


def _of_functions(machine: Machine, plan: Plan, reference: Reference) -> Mapping[str, float]:
    """Return the instructions per weight that a spike meets, per neuron and step, and per step of a decision.

    The program is compiled without inlining, so that its functions can be told apart.
    """
    n = min(_APART, reference.n_recordings)
    _played(machine, replay.of_spikes(reference)[:n])

    def instructions(*prefixes: str) -> int:
        names = [name for name in machine.program.symbols if name.startswith(prefixes)]
        return sum(machine.counts_of(name).instructions for name in names)

    steps = max(1, n * reference.n_steps)
    neurons = sum(layer.n_neurons for layer in plan.layers)
    met = max(1, weights_met(plan, reference, n))
    return {
        "instructions_per_synapse": instructions("reach_", "return_", "dse_add_") / met,
        "instructions_per_neuron_step": instructions("step_", "leak") / (steps * neurons),
        "instructions_per_decision_step": instructions("decide") / steps,
    }


def weights_met(plan: Plan, reference: Reference, n: int) -> int:
    """Return how many stored weights the spikes of the first n windows meet; dense rows store zeros."""
    inputs = reference.spikes_in[reference.spikes_in[:, 0] < n].astype(np.int64)
    step, channel = inputs[:, 1] * plan.steps_per_sample, inputs[:, 2]
    arriving = [
        channel[step + delay < reference.n_steps] + copy * plan.n_channels
        for copy, delay in enumerate(plan.delays)
    ]
    fired = [np.concatenate(arriving), *(x[x[:, 0] < n, 2] for x in reference.fired)]
    total = 0
    for layer, before, own in zip(plan.layers, fired, fired[1:], strict=False):
        total += int(_row_lengths(layer.feed_forward)[before].sum())
        if layer.recurrent is not None:
            total += int(_row_lengths(layer.recurrent)[own].sum())
    return total


def _row_lengths(matrix: Matrix) -> Ints:
    """Return how many weights each row of a matrix stores."""
    if matrix.form == "sparse":
        return np.asarray(np.count_nonzero(matrix.weights, axis=1))
    return np.full(len(matrix.weights), matrix.row_length)


def _readme(core: Core) -> str:
    return f"""
## {core.label}

`src/dse.c` needs neither a library nor an operating system: add it and `src/dse.h` to the firmware.
`dse verify` executes it in an emulator, compiled by

    python -m ziglang cc {" ".join(core.options)} -c src/dse.c
"""
