"""Flash of the C on Cortex-M: the bytes of the parts of its code, fitted and tested on random classifiers.

    python -m benchmarks.code_size [--core cortex_m4] [--compiler gcc] [--fit 0] [--test 20]

Classifiers are those of `benchmarks.instructions`, networks of `xylo_lif` neurons, and classifiers behind
encoders and pooling; the first of each kind are not part of the fit. Each is compiled by clang or gcc, and
what it takes in flash beyond its constants is divided among the parts of its code (`dse.deploy.c.code_size`)
by least squares. Without a fit (--fit 0) the parts that `dse` has predict the flash.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

import dse
from benchmarks.gcc import by_gcc
from benchmarks.instructions import FAMILIES, STEP_MS, made_network, made_of_counts
from dse.base.records import Layer, Network
from dse.base.registry import known
from dse.config import Sections
from dse.data.encoders.receptors import Receptors
from dse.deploy.bundle import Bundle, Input
from dse.deploy.c import code_size, files
from dse.deploy.c.counting import code_of
from dse.deploy.targets.emulated import Emulated
from dse.deploy.targets.thumb import CORES
from dse.engine.neurons import parameters_of, xylo_lif

KINDS: dict[str, Callable[[int], Bundle]] = {
    "networks": lambda seed: made_network(seed)[0],
    **{of: lambda seed, of=of: made_of_counts(seed, of)[0] for of in FAMILIES},  # type: ignore[misc]
    "xylo": lambda seed: of_xylo(made_network(seed)[0], seed),
    "front ends": lambda seed: in_front(
        KINDS[("networks", "counts")[seed // (1 + len(ENCODERS)) % 2]](seed), seed
    ),
}
"""What makes classifier `seed` of each kind."""


def main() -> None:
    """Print the bytes of each part, and how far predictions are off."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--core", choices=CORES, default="cortex_m4")
    parser.add_argument("--compiler", choices=("clang", "gcc"), default="clang")
    parser.add_argument("--of", choices=KINDS, nargs="+", default=list(KINDS), help="classifiers")
    parser.add_argument(
        "--fit", type=int, default=0, help="classifiers to fit, of each kind, after those to predict"
    )
    parser.add_argument("--test", type=int, default=20, help="classifiers to predict, of each kind")
    parser.add_argument("--csv", help="file for a row per classifier")
    options = parser.parse_args()
    target: Emulated = known("targets")[options.core]()
    table = built(
        by_gcc(target) if options.compiler == "gcc" else target, options.of, options.test + options.fit
    )
    if options.csv:
        table.to_csv(options.csv, index=False)
    parts = dict(target.core.parts.get(options.compiler, target.core.parts["clang"]))
    if options.fit:
        parts = fitted(table[table.seed >= options.test], parts)
        for part, n_bytes in parts.items():
            print(f"{part}: {n_bytes:.1f}")
    counts = table.reindex(columns=list(parts), fill_value=0).to_numpy()
    table["predicted"] = counts @ np.array(list(parts.values())) + table.constants
    for seen, of_fit in table.groupby(table.seed >= options.test):
        for of, rows in [*of_fit.groupby("of"), ("all", of_fit)]:
            off, n_bytes = (rows.predicted / rows.flash - 1).abs(), (rows.predicted - rows.flash).abs()
            print(
                f"{'fit' if seen else 'not used'}, {of}: {len(rows)} classifiers, {off.mean():.2%} or "
                f"{n_bytes.mean():.0f} bytes in the mean, {off.max():.1%}, {n_bytes.max():.0f} bytes at most"
            )


def built(target: Emulated, kinds: list[str], n: int) -> pd.DataFrame:
    """Return a row per classifier: its kind, constants, flash as compiled, how often each part occurs."""
    rows = []
    for of in kinds:
        for seed in range(n):
            made = KINDS[of](seed)
            code = code_of(made)
            with tempfile.TemporaryDirectory() as folder:
                files.write(code, Path(folder), "", dse.__version__)
                flash = target.program(Path(folder)).flash_bytes
            constants = code_size.constant_bytes(code)
            parts = {part: int(n) for part, n in code.parts().items()}
            rows.append({"of": of, "seed": seed, "constants": constants, "flash": flash, **parts})
    return pd.DataFrame(rows).fillna(0)


def fitted(rows: pd.DataFrame, before: dict[str, float]) -> dict[str, float]:
    """Return the bytes of each part, by least squares of the bytes of code, relative to their roots.

    What no classifier tells apart stays as close as it can to what it was before.
    """
    counts = rows.reindex(columns=list(before), fill_value=0).to_numpy(np.float64)
    code = (rows.flash - rows.constants).to_numpy(np.float64)
    off = (code - counts @ np.array(list(before.values()))) / np.sqrt(code)
    more = np.linalg.lstsq(counts / np.sqrt(code)[:, None], off, rcond=1e-9)[0]
    return {name: n_bytes + x for (name, n_bytes), x in zip(before.items(), more.tolist(), strict=True)}


def of_xylo(made: Bundle, seed: int) -> Bundle:
    """Return a network with `xylo_lif` neurons in place of its own, without delays of synapses."""
    rng, net = np.random.default_rng([82, seed]), made.fitted
    assert isinstance(net, Network)
    layers = []
    for layer in net.layers:
        n, is_output = len(layer.weight), layer is net.layers[-1]
        decays = [rng.integers(1, 9, n).astype(np.int32) for _ in range(2)]
        neurons = xylo_lif.Population(
            *decays, threshold=1024, weight_shift=2, most_spikes=1 if is_output else 31
        )
        layers.append(Layer(np.rint(64 * layer.weight), layer.recurrent, parameters_of(neurons), "xylo_lif"))
    return replace(made, fitted=replace(net, layers=tuple(layers)))


_DELTA = {"kind": "send_on_delta"}
ENCODERS = (
    _DELTA | {"thresholds": [1, 4]},
    _DELTA | {"thresholds": [0.5, 2.25], "reference": "level"},
    _DELTA | {"thresholds": [0.7, 1.9]},
    _DELTA | {"thresholds": [0.3, 1.1], "reference": "level"},
    {"kind": "quantised", "step": 0.5, "digits": 2},
    {"kind": "receptors", "sa": False},
)
"""Of samples: two or four channels per sensor; thresholds of two need floating point."""


def in_front(made: Bundle, seed: int) -> Bundle:
    """Return a classifier behind an encoder of samples or a pooling of events, which take turns."""
    n, n_steps = made.fitted.n_channels, made.input.n_steps
    encoder = None if n % 4 else (*ENCODERS, None)[seed % (1 + len(ENCODERS))]
    data = {"file": "none.npz", "columns": {"class": "class"}}
    if encoder:
        data |= {"kind": "time_series", "step_ms": STEP_MS}
        front = {"encoder": encoder}
    else:
        data |= {"kind": "events", "width": n, "height": 2, "x": "x", "y": "y", "polarity": "polarity"}
        front = {"preprocessing": {"bin_ms": STEP_MS, "pool": 2}}
    plain = {
        "data": data,
        "task": {"target": "class"},
        "window": {"n_steps": n_steps, "at": "middle"},
        **front,
        "split": {"stratified": {"validation": 0.2}},
        "model": {"kind": "snn"},
        "training": {},
    }
    sections = Sections.from_plain(plain, "a random classifier")
    taken = Input("events", 0, n, 2, n_steps, STEP_MS)
    if encoder:
        taken = Input.of_channels(sections.encoder, n, n_steps, STEP_MS)
    if isinstance(sections.encoder, Receptors):  # as fitted to recordings
        low, high = np.sort(np.random.default_rng([83, seed]).random((2, taken.n_channels)), axis=0).tolist()
        sections = replace(sections, encoder=replace(sections.encoder, low=tuple(low), high=tuple(high)))
    names = "data", "window", "encoder", "preprocessing"
    given = replace(made.sections, **{name: getattr(sections, name) for name in names})
    return replace(made, sections=given, input=taken)


if __name__ == "__main__":
    main()
