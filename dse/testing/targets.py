"""The contract of a target."""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dse.base.records import Floats, Layer, Network
from dse.config import Sections
from dse.deploy.bundle import Bundle, Input
from dse.deploy.reference import Reference, of_recordings
from dse.deploy.targets import Target, TargetError, Verdict
from dse.engine.neurons import cuba_lif, parameters_of
from dse.store import checksum
from dse.testing.expect import expect, expect_component

_N_CHANNELS, _N_STEPS, _N_RECORDINGS, _CLASSES = 6, 24, 5, ("felt", "linen", "silk")


def check_target(
    target: Target, bundle: Bundle | None = None, reference: Reference | None = None
) -> Verdict | None:
    """Check a target on a network: what it writes, and whether its run sees another net's weights.

    Args:
        target: the component.
        bundle: the network; None: a small one with recurrent weights and delays, or one without where that
            is refused.
        reference: what the bundle answers to some recordings.

    Returns:
        The verdict; None where it refuses the network, or where it cannot be written or run on this machine.

    Raises:
        AssertionError: what it violates.
    """
    name = expect_component(target)
    expect(not dataclasses.fields(target), f"{name} must have no keys")  # type: ignore[arg-type]
    for key in ("label", "use"):
        expect(getattr(target, key, ""), f"{name}.{key} must be a text")
    expect(isinstance(target.extra, str), f"{name}.extra must be a text, '' for no extra")
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        recordings = small_recordings(folder / "touch.npz")
        small = small_bundle(recurrent=True, delays=(0, 2), steps_per_sample=2), small_bundle()
        for each in small if bundle is None else (bundle,):
            refusal = target.refusal(each)
            expect(isinstance(refusal, str), f"{name}.refusal must return a text, got {refusal!r}")
            expect("\n" not in refusal, f"{name}.refusal must return one sentence")
            if not refusal:
                return _check_run(target, each, reference or of_recordings(each, recordings), folder)
    return None


def _check_run(target: Target, bundle: Bundle, reference: Reference, folder: Path) -> Verdict | None:
    """Check what a target writes of a bundle, and its runs; return the verdict."""
    name = type(target).__name__
    of_bundle, again, of_other = (folder / part for part in ("bundle", "again", "other"))
    other = dataclasses.replace(bundle, fitted=_negated(bundle.fitted))
    try:
        for part, written in ((of_bundle, bundle), (again, bundle), (of_other, other)):
            part.mkdir(parents=True)
            target.write(written, part)
        files = _files(of_bundle)
        expect(files, f"{name}.write must write files")
        expect(files == _files(again), f"{name}.write must write the same bytes twice")
        expect(files != _files(of_other), f"{name}.write must write the weights")
        verdict = target.verify(bundle, of_bundle, reference)
        expect(files == _files(of_bundle), f"{name}.verify must not change the files")
        _expect_verdict(name, verdict, reference)
        if verdict.kind == "faithful":
            wrong = target.verify(bundle, of_other, reference)
            expect(wrong.kind != "faithful", f"{name}.verify must run the files: other weights are faithful")
    except TargetError as error:
        expect("\n" not in str(error), f"{name} must say in one line what is missing, got {error}")
        return None
    return verdict


def _expect_verdict(name: str, verdict: Verdict, reference: Reference) -> None:
    kind = verdict.kind
    allowed = ("faithful", "equivalent", "approximate", "not verified")
    expect(kind in allowed, f"{name}.verify must return one of {', '.join(allowed)}, got {kind!r}")
    expect(bool(verdict.reason) == (kind != "faithful"), f"{name}: every verdict but faithful has a reason")
    expect("\n" not in verdict.reason, f"{name}: a reason must be one sentence")
    differs = verdict.decisions_differ or verdict.spikes_differ or verdict.largest_difference
    expect(kind != "faithful" or not differs, f"{name} must not be faithful where something differs")
    n = 0 if kind == "not verified" else reference.n_recordings
    expect(verdict.n_recordings == n, f"{name} must answer {n} recordings, got {verdict.n_recordings}")
    expect(kind == "not verified" or verdict.run_by, f"{name}.verify must say in run_by what ran the files")
    for column, value in verdict.figures.items():
        expect(np.isfinite(value), f"{name}: {column} must be a finite number, got {value}")


def _files(folder: Path) -> Mapping[str, str]:
    """Return the checksum of every file of a folder, by its path in it."""
    return {str(x.relative_to(folder)): checksum(x) for x in sorted(folder.rglob("*")) if x.is_file()}


def _negated(fitted: Any) -> Network:
    """Return a network with the signs of the first layer's weights changed."""
    assert isinstance(fitted, Network)
    first = dataclasses.replace(fitted.layers[0], weight=-fitted.layers[0].weight)
    return dataclasses.replace(fitted, layers=(first, *fitted.layers[1:]))


def small_recordings(path: Path) -> Path:
    """Write a few rasters of random spikes, of which the second is silent."""
    spikes = np.random.default_rng(2).random((_N_RECORDINGS, _N_STEPS, _N_CHANNELS)) < 0.3
    spikes[1] = False
    np.savez(path, spikes=spikes.astype(np.uint8))
    return path


def small_bundle(
    recurrent: bool = False, delays: tuple[int, ...] = (0,), steps_per_sample: int = 1
) -> Bundle:
    """Return a bundle of a random network that spikes, of CUBA-LIF neurons, on rasters of 6 channels."""
    rng = np.random.default_rng(1)
    sizes = (_N_CHANNELS * len(delays), 8, len(_CLASSES))

    def matrix(n: int, n_inputs: int) -> Floats:
        return rng.normal(0.3, 1, (n, n_inputs)).astype(np.float32)

    layers = []
    for n_inputs, n in ((sizes[0], sizes[1]), (sizes[1], sizes[2])):
        current, voltage = rng.integers(200, 3000, (2, n)).astype(np.int32)
        population = cuba_lif.Population(current, voltage, 80)
        back = matrix(n, n) / 4 if recurrent and n == sizes[1] else None
        layers.append(Layer(matrix(n, n_inputs), back, parameters_of(population)))
    keys = {"input_delays": list(delays), "steps_per_sample": steps_per_sample, "recurrent": recurrent}
    sections = {
        "data": {"kind": "raster", "file": "touch.npz", "step_ms": 5.0, "columns": {"fabric": "label"}},
        "task": {"target": "fabric"},
        "split": {"stratified": {"validation": 0.5}},
        "model": {"kind": "snn", "hidden": [sizes[1]], **keys},
        "training": {},
    }
    return Bundle(
        fitted=Network(tuple(layers), _N_CHANNELS, delays, steps_per_sample, "integer"),
        sections=Sections.from_plain(sections, "a small bundle"),
        classes=_CLASSES,
        phi=2.0,
        theta=0.5,
        record={},
        evidence={},
        input=Input("spikes", _N_CHANNELS, 0, 0, _N_STEPS, 5.0),
    )
