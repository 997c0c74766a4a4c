"""What a bundle takes in every form: time, instructions, modelled energy, decisions that differ.

    python -m benchmarks.targets BUNDLE RECORDINGS [BUNDLE RECORDINGS ...] [--core cortex_m4] [--csv FILE]

A row per net and form: the engine in float32 and in integers, C on this machine, C on an emulated core. Times
are of this machine per recording, without preparation, of C with its compilation; the emulated core's
time is cycles / clock of the profile below. Decisions are compared with those in integers. `dse measure` and
`python -m benchmarks.stream` measure the stream, step by step.
"""

from __future__ import annotations

import argparse
import dataclasses
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table

from dse.deploy import bundle
from dse.deploy.bundle import Bundle
from dse.deploy.reference import Reference, answered, decided, of_recordings
from dse.deploy.targets.c99 import C99
from dse.hardware.profile import load
from dse.records import Network
from dse.registry import known

CHIPS = {"cortex_m4": "mcu_m4", "cortex_m7": "mcu_m7", "cortex_m33": "mcu_m33"}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("paths", nargs="+", help="bundle and recordings, in turns")
    parser.add_argument("--core", choices=CHIPS, default="cortex_m4")
    parser.add_argument("--csv", help="file for the rows")
    options = parser.parse_args()
    table = pd.DataFrame(
        [
            row
            for folder, data in zip(options.paths[::2], options.paths[1::2], strict=True)
            for row in rows(folder, data, options.core)
        ]
    )
    if options.csv:
        table.to_csv(options.csv, index=False)
    shown = Table(*table.columns)
    for values in table.itertuples(index=False):
        shown.add_row(*(f"{x:.4g}" if isinstance(x, float) else str(x) for x in values))
    Console().print(shown)


def rows(folder: str, data_file: str, core: str) -> Iterator[dict[str, object]]:
    """Yield the rows of one bundle."""
    made = bundle.read(folder)
    reference = of_recordings(made, data_file)
    name, n = Path(folder).name, max(1, reference.n_recordings)
    for arithmetic in ("float32", "integer"):
        ms, differ = _engine(made, reference, data_file, arithmetic)
        yield {"net": name, "form": f"engine, {arithmetic}", "ms": ms / n, "differ": differ}
    chip = load(CHIPS[core])
    for target in (C99(), known("targets")[core]()):
        with tempfile.TemporaryDirectory() as place:
            code = Path(place) / "code"
            code.mkdir()
            target.write(made, code)
            began = time.perf_counter()
            verdict = target.verify(made, code, reference)
            elapsed_ms = (time.perf_counter() - began) * 1e3
        row = {"net": name, "form": target.label, "differ": verdict.decisions_differ}
        figures = verdict.figures
        if "cycles_per_inference" in figures:
            cycles = figures["cycles_per_inference"]
            row |= {"ms": cycles / chip.clock_mhz.value / 1e3, "uJ": cycles * chip.cycle_nj.value / 1e3}
            row |= {"instructions": figures["instructions_per_inference"]}
        else:
            row |= {"ms": elapsed_ms / n}
        yield row


def _engine(made: Bundle, reference: Reference, data_file: str, arithmetic: str) -> tuple[float, float]:
    """Return the time of all recordings in ms, and the share of decisions that differ from the reference."""
    assert isinstance(made.fitted, Network)
    other = dataclasses.replace(made, fitted=dataclasses.replace(made.fitted, arithmetic=arithmetic))
    answered(other, reference.dataset, data_file)  # compiles
    began = time.perf_counter()
    response = answered(other, reference.dataset, data_file)
    elapsed_ms = (time.perf_counter() - began) * 1e3
    label, time_ms, _ = decided(other, reference.dataset, response)
    differ = (label != reference.label) | ~np.isclose(time_ms, reference.time_ms)
    return elapsed_ms, float(differ.mean())


if __name__ == "__main__":
    main()
