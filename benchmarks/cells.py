"""Cells of gate arrays: synthesised, placed and routed for random networks, beside what was predicted before.

    python -m benchmarks.cells [--test 20] [--fit 0] [--csv FILE] [--encoders]

Networks are those of `benchmarks.instructions`; those that a chip cannot hold are passed over. With `--fit`,
the costs that the profiles quote are fitted anew to so many further networks (least squares
of relative errors), and the others are predicted by these too. With `--encoders`, it prints instead the cells
that encoders of samples add to one network, beside what is predicted. The tools are of the extra `fpga`.
"""

from __future__ import annotations

import argparse
import itertools
import json
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from benchmarks.instructions import network
from dse.data.encoders.quantised import Quantised
from dse.data.encoders.send_on_delta import SendOnDelta
from dse.deploy.form import Unsupported, send_on_delta_form, spiking_of
from dse.deploy.targets.fpga import Ecp5, Fpga, Ice40
from dse.deploy.verilog import circuit
from dse.deploy.verilog.circuit import Circuit


def main() -> None:
    """Print the costs and the errors of each chip."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--test", type=int, default=20, help="networks to predict")
    parser.add_argument("--fit", type=int, default=0, help="networks of the fit, after those to predict")
    parser.add_argument("--csv", type=Path, help="file for a row per network and chip")
    parser.add_argument("--encoders", action="store_true", help="what encoders of samples take")
    options = parser.parse_args()
    if options.encoders:
        for target in (Ice40(), Ecp5()):
            print(with_encoders(target).to_string(index=False), flush=True)
        return
    tables = []
    for target in (Ice40(), Ecp5()):
        table = placed(target, options.test + options.fit)
        work = table[list(WORK)].to_numpy()
        test, fit = slice(options.test), slice(options.test, None)
        figures = target.board.chip.at("value")
        quoted = np.array([figures[of] for of in WORK])
        report(target.profile, "quoted", quoted, work[test], table.cells[test])
        if options.fit:
            costs = np.linalg.lstsq(
                work[fit] / table.cells.to_numpy()[fit, None], np.ones(options.fit), rcond=None
            )[0]
            report(target.profile, "fitted", costs, work[test], table.cells[test])
        tables.append(table)
    if options.csv:
        pd.concat(tables).to_csv(options.csv, index=False)


ENCODERS = (
    SendOnDelta((1.0, 4.0, 16.0)),
    SendOnDelta((0.5, 2.25), polarity="merged"),
    SendOnDelta((2.7, 6.0), reference="value"),
    SendOnDelta((1.5, 4.0), start="mean", means=(0.0,) * 4),
    SendOnDelta(tuple(2.0**k for k in range(8))),
    Quantised(step=0.5, digits=4, start="mean", means=(0.0,) * 4),
    Quantised(step=0.125, digits=7),
)
"""Of four sensors."""


def with_encoders(target: Fpga) -> pd.DataFrame:
    """Return a row per encoder that a network gets: the cells and blocks that it adds, and as predicted."""
    made = next(made for k in itertools.count() if not target.refusal(made := network(k)[0]))
    bare = circuit.of_form(spiking_of(made))

    def report(form: Circuit) -> dict[str, float]:
        with tempfile.TemporaryDirectory() as folder:
            target.emit(form, made, Path(folder))
            return dict(json.loads((Path(folder) / "report.json").read_bytes()))

    before, chip, rows = report(bare), target.board.chip, []
    for encoder in ENCODERS:
        form = replace(bare, encoder=send_on_delta_form(encoder, 4))
        after = report(form)
        blocks = chip.n_blocks(form.memories)["levels"]
        rows.append(
            {
                "chip": target.profile,
                "bits": form.level_bits,
                "cells": after["cells"] - before["cells"],
                "predicted": form.level_bits * chip.level_cells.value,
                "blocks": after["memory_blocks"] - before["memory_blocks"],
                "predicted_blocks": blocks,
                "clock_mhz": after["clock_mhz"],
                "encoder": encoder,
            }
        )
    return pd.DataFrame(rows)


WORK = tuple(f"{of}_cells" for of in ("circuit", "address", "share", "slot", "choice", "list"))
"""What cells are for, by figure of the chip."""


def placed(target: Fpga, n_networks: int) -> pd.DataFrame:
    """Return a row per network that fits the chip: what its cells are for, and what placing reports."""
    rows: list[dict[str, float]] = []
    for seed in itertools.count():
        if len(rows) == n_networks:
            break
        made = network(seed)[0]
        try:
            form = target.form(made)
        except Unsupported:
            continue
        before = target.footprint(made)
        with tempfile.TemporaryDirectory() as folder:
            target.emit(form, made, Path(folder))
            report = json.loads((Path(folder) / "report.json").read_bytes())
        rows.append(
            {"seed": seed, **target.cell_work(form), **report, "predicted": before["cells"]}
            | {"predicted_blocks": before["memory_blocks"]}
        )
        print({"chip": target.profile, **rows[-1]}, flush=True)
    return pd.DataFrame(rows).assign(chip=target.profile)


def report(
    chip: str, what: str, costs: NDArray[np.float64], work: NDArray[np.float64], cells: pd.Series
) -> None:
    """Print the costs of a chip and how far they are off."""
    off = np.abs(work @ costs / cells - 1)
    print(
        f"{chip}, {what}: {', '.join(f'{cost:.1f}' for cost in costs)} per {', '.join(WORK)}; "
        f"{len(cells)} networks, {np.count_nonzero(off <= 0.1)} within 10 %, {off.mean():.1%} in the mean, "
        f"{off.max():.1%} at most"
    )


if __name__ == "__main__":
    main()
