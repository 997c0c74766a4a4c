"""The C of `c99` for processors: cross-compiled for a core, and executed in an emulator (`emulator`).

To add processors, write a file with their instruction set and their cores, as `thumb` is, and register them.
"""

from __future__ import annotations

import functools
import tempfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from dse.base.records import Array, Ints
from dse.deploy.bundle import Bundle
from dse.deploy.c import code_size, host, replay
from dse.deploy.c.arrays import Matrix
from dse.deploy.c.code import Code
from dse.deploy.c.counting import code_of
from dse.deploy.c.plan import Plan
from dse.deploy.c.replay import Executed, Recorded
from dse.deploy.form import Unsupported
from dse.deploy.prefix import prefixed
from dse.deploy.reference import Reference
from dse.deploy.targets import emulator
from dse.deploy.targets.c99 import InC
from dse.deploy.targets.emulator import MOST_FLASH_BYTES, Core, Machine, Program, compiled
from dse.measure.hardware.profile import Profile, load

MEMORY = Path(__file__).parent / "memory"
_APART = 16
"""Recordings over which the instructions of single functions are counted."""


class Emulated(InC):
    """The target of a core.

    core: which; it is all that differs.
    profile: hardware profile that predicts its cycles; '' for none.
    """

    core: ClassVar[Core]
    profile: ClassVar[str]
    extra: ClassVar[str] = "targets"
    use: ClassVar[str] = "compile `src/dse.c` there with your firmware; README.md beside it has the flags"

    def form(self, bundle: Bundle) -> Code:
        """Return the classifier as C holds it, if it fits into the flash."""
        plan = code_of(bundle)
        chip, flash = "the emulator", MOST_FLASH_BYTES
        if self.profile:
            flash_kib = load(self.profile).at("value")["flash_kib"]
            chip, flash = f"the chip of profile {self.profile}", int(flash_kib) * 1024
        if (n := int(self._flash(plan).get("flash_bytes", 0))) > flash:
            raise Unsupported(f"it takes {n} bytes of flash, and {chip} has {flash}")
        return plan

    def _flash(self, plan: Code, compiler: str = "clang") -> dict[str, float]:
        parts = self.core.parts.get(compiler)
        return {"flash_bytes": code_size.flash_bytes(plan, parts)} if parts else {}

    def footprint(self, bundle: Bundle, chip: Profile | None = None) -> dict[str, float]:
        """Return its memory before it is written: in flash constants exactly, code from measured parts."""
        plan = code_of(bundle)
        return plan.footprint | self._flash(plan, chip.compiler if chip else "clang")

    def emit(self, form: Code, bundle: Bundle, folder: Path) -> None:
        """Write the files of `c99`, and how they are compiled for the core."""
        super().emit(form, bundle, folder)
        readme = folder / "README.md"
        text = readme.read_text(encoding="utf-8") + prefixed(_readme(self.core), bundle.prefix)
        readme.write_text(text, encoding="utf-8")

    def executed(self, form: Code, folder: Path, reference: Reference, recorded: Recorded) -> Executed:
        """Compile the files for the core, and run all recordings in an emulator (`InC`).

        Figures per inference are means over the recordings, from `dse_reset` to the answer, input spikes
        pushed: front_end_instructions is what an encoder or preprocessing in C adds to them. The longest
        step and the stack are over these recordings and `replay.hostile`, encoder or preprocessing included.
        """
        options, of_spikes = recorded.options, replay.of_spikes(reference)
        traced = Machine(self.program(folder, "-DDSE_TRACE", *options), self.core)
        played = _played(traced, recorded.commands or of_spikes)
        machine, answers = self.inferred(folder, reference, played.steps, *options)
        assert np.array_equal(answers.label, played.label)  # traced or not
        counts, n = machine.counts(), max(1, reference.n_recordings)
        each = form.steps_per_sample if isinstance(form, Plan) else 1
        n_steps = int((-(-played.steps // each)).sum())
        hostile = replay.hostile(form, "-DDSE_REAL_SAMPLES" in options)
        longest = [
            machine.longest_step(functools.partial(_played, machine, commands))
            for commands in (hostile, recorded.commands or of_spikes)
        ]
        figures = {
            "ram_bytes": float(machine.program.ram_bytes),
            "stack_bytes": float(machine.stack_bytes),
            "flash_bytes": float(machine.program.flash_bytes),
            "instructions_per_inference": counts.instructions / n,
            "cycles_per_inference": counts.cycles(self.core) / n,
            "cycles_per_step": counts.cycles(self.core) / max(1, n_steps),
            "cycles_of_longest_step": max(longest),
        }
        if isinstance(form, Plan):
            apart = Machine(self.program(folder, "-fno-inline", *options), self.core)
            figures |= _of_functions(apart, form, reference)
        if recorded.commands is not None:
            instructions = []
            for commands in (recorded.commands, of_spikes):
                machine.forget()
                _played(machine, commands[:_APART])
                instructions.append(machine.counts().instructions)
            figures["front_end_instructions"] = (instructions[0] - instructions[1]) / max(1, min(_APART, n))
        return Executed(played, figures, emulator.compiler_name(), emulator.versions())

    def program(self, folder: Path, *options: str) -> Program:
        """Return the C in a folder, with replay.c to drive it, compiled for the core."""
        with tempfile.TemporaryDirectory() as place:
            sources, all_options = host.driven(folder, Path(place), *options)
            return compiled(sources, self.core, f"-isystem{MEMORY}", *all_options)

    def inferred(
        self, folder: Path, reference: Reference, steps: Ints | None = None, *options: str
    ) -> tuple[Machine, replay.Played]:
        """Execute the C in a folder on the input spikes of every window, up to (n,) steps or its answer.

        Returns:
            The machine, which has counted, and the answers.
        """
        if steps is None:
            steps = np.rint(reference.time_ms / reference.step_ms).astype(np.int64)
        _, prefix = host.classifier_in(folder)
        ends = f"{prefix}step", f"{prefix}reset"
        machine = Machine(self.program(folder, *options), self.core, ends)
        return machine, _played(machine, replay.of_spikes(reference, steps))


def target_of(core: Core, module: str) -> type[Emulated]:
    """Return the target of a core, a class of a module."""
    members = {
        "__doc__": f"The C of c99, executed in an emulator{core.note}.",
        "__module__": module,
        "core": core,
        "label": core.label,
        "profile": core.profile,
    }
    name = core.label.replace("-", "").replace("+", "Plus")
    return dataclass(frozen=True)(type(name, (Emulated,), members))


def _readme(core: Core) -> str:
    return f"""
## {core.label}

`src/dse.c` needs neither a library nor an operating system: add it and `src/dse.h` to the firmware.
`dse verify` executes it in an emulator, compiled by

    python -m ziglang cc {" ".join(core.options)} -c src/dse.c
"""


def _played(machine: Machine, commands: Iterable[Array]) -> replay.Played:
    """Run recordings through replay.c in the emulator."""
    run = functools.partial(machine.call, "main")
    return replay.parsed(in_memory(commands, machine.write, machine.read, run))


def in_memory(
    commands: Iterable[Array],
    write: Callable[[str, bytes], object],
    read: Callable[[str, int], bytes],
    run: Callable[[], object],
) -> Ints:
    """Return what replay.c writes of recordings, int32, where memory/stdio.h stands for files.

    The first bytes of its variables are written and read; `run` calls the program.
    """
    written = []
    for numbers in commands:
        words = np.ascontiguousarray(numbers, "<i4")
        write("memory_in", words.tobytes())
        for name, value in (("memory_n_in", len(words)), ("memory_read", 0), ("memory_n_out", 0)):
            write(name, value.to_bytes(4, "little"))
        run()
        n_bytes = 4 * int.from_bytes(read("memory_n_out", 4), "little")
        written.append(np.frombuffer(read("memory_out", n_bytes), "<i4"))
    return np.concatenate(written)


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
        total += int(_row_lengths(layer.forward)[before].sum())
        if layer.back is not None:
            total += int(_row_lengths(layer.back)[own].sum())
    return total


def _row_lengths(matrix: Matrix) -> Ints:
    """Return how many weights each row of a matrix stores."""
    if matrix.form == "sparse":
        return np.asarray(np.count_nonzero(matrix.weights, axis=1))
    return np.full(len(matrix.weights), matrix.row_length)
