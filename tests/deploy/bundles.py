"""Studies of small rasters, bundles of made-up networks, and what their engine does on made-up spikes."""

import json
from itertools import pairwise

import numpy as np

from dse.base.records import Layer, Network
from dse.config import load_space
from dse.deploy.bundle import Bundle, sealed
from dse.deploy.reference import of_recordings
from dse.engine.neurons import cuba_lif, parameters_of, resonator
from dse.study import explore
from tests import tiny_study
from tests.spaces import RASTER, sections

FAMILIES = """
study: families
seed: 3
data: {kind: raster, file: tiny.npz, step_ms: 5.0, columns: {fabric: label, speed: speed}}
task: {target: fabric}
window: {n_steps: 16, at: middle}
split: {stratified: {validation: 0.5}}
model:
  choice:
    - {kind: knn, channels: each, window_ms: 20}
    - {kind: naive_bayes, channels: each, window_ms: 20}
    - {kind: elm, hidden: 8, window_ms: 20, windows: 4}
    - {kind: hots, layers: 1, prototypes: 4, tau_ms: 20}
    - {kind: snn, hidden: [8]}
training: {epochs: 2, batch_size: 9}
decision: {phi: [1], theta: [0.6]}
objectives: [accuracy:max, n_weights:min]
search: {sampler: grid}
execution: {jobs: 1}
"""
JOINT = (
    FAMILIES.replace("target: fabric", "target: [fabric, speed], joint: true")
    .replace("study: families", "study: joint")
    .replace("snn, hidden: [8]}", "snn, hidden: [8]}\n    - {kind: cascade, hidden: [6], first_hidden: [5]}")
)


def explored(folder, text):
    """Train what a search space says on labelled rasters of two columns."""
    tiny_study.write_recordings(folder / "tiny.npz")
    with np.load(folder / "tiny.npz") as file:
        arrays = dict(file)
    np.savez(folder / "tiny.npz", **arrays, speed=np.arange(len(arrays["label"])) % 2)
    (folder / "space.yaml").write_text(text)
    return explore.run(load_space(folder / "space.yaml"), folder / "results", progress=False)


def population(rng, n, decays, resonates):
    """Return neurons whose decays are drawn from some, or from all."""

    def decay():
        drawn = rng.integers(0, 4097, n) if decays is None else rng.choice(np.array(decays), n)
        return drawn.astype(np.int32)

    threshold = int(rng.integers(20, 120))
    if not resonates:
        return cuba_lif.Population(decay(), decay(), threshold)
    which = rng.random(n) < 0.7
    cosine, sine = resonator.factors(rng.uniform(2.2, 30, n), rng.uniform(1, 5, n))
    turning = [np.where(which, x, 0).astype(np.int32) for x in (cosine, sine)]
    others = [np.where(which, 0, x).astype(np.int32) for x in (decay(), decay())]
    return resonator.Population(which, *turning, *others, threshold, bool(rng.integers(2)))


def network(
    rng,
    sizes=(4, 7, 3),
    *,
    delays=(0,),
    steps_per_sample=1,
    recurrent=False,
    pruned=0.0,
    scale=1.0,
    decays=None,
    resonates=False,
    arithmetic="integer",
):
    """Return a network with random weights; hidden layers may resonate and be recurrent."""
    layers = []
    for k, (n_in, n) in enumerate(pairwise((sizes[0] * len(delays), *sizes[1:]))):
        hidden = k < len(sizes) - 2

        def matrix(rows, columns):
            drawn = rng.normal(0, scale, (rows, columns)) * (rng.random((rows, columns)) >= pruned)
            return drawn.astype(np.float32)

        neurons = population(rng, n, decays, resonates and hidden)
        name = "resonator" if resonates and hidden else "cuba_lif"
        ring = matrix(n, n) if recurrent and hidden else None
        layers.append(Layer(matrix(n, n_in), ring, parameters_of(neurons), name))
    return Network(tuple(layers), sizes[0], delays, steps_per_sample, arithmetic)


def bundle(fitted, **changes):
    """Return a bundle that reads rasters of `recordings`; it decides early unless `changes` say otherwise."""
    n_classes = fitted.sizes[-1]
    plain = {**RASTER, "model": {"kind": "snn", "hidden": [3]}}
    named = {
        "classes": tuple(f"class {k}" for k in range(n_classes)),
        "phi": 2.0,
        "theta": 0.5,
        "record": {"trial": 0},
        "evidence": {"study": "made up"},
    }
    return Bundle(fitted=fitted, sections=sections(plain), **{**named, **changes})


def spikes(rng, n_channels, n=12, n_steps=40):
    """Return rasters (n, step, channel): the first is silent, the last full, others more and more busy."""
    rate = np.linspace(0, 0.6, n)
    rate[-1] = 1
    return rng.random((n, n_steps, n_channels)) < rate[:, None, None]


def verified(target, made, folder, rng, n_steps=40):
    """Return the verdict on what a target writes into folder/target, and the reference of random spikes."""
    assert target.refusal(made) == ""
    engine = reference(made, spikes(rng, made.fitted.n_channels, n_steps=n_steps), folder)
    assert len(engine.fired[-1])
    (folder / "target").mkdir()
    target.write(made, folder / "target")
    return target.verify(made, folder / "target", engine), engine


def reference(made, rasters, folder):
    """Return what the engine of a bundle does on rasters."""
    np.savez(folder / "rasters.npz", spikes=rasters)
    return of_recordings(made, folder / "rasters.npz")


def document(**changes):
    """Change keys of bundle.json, `a__b` for a key within a; its checksum agrees."""

    def damage(folder):
        content = json.loads((folder / "bundle.json").read_text())
        for path, value in changes.items():
            *parents, key = path.split("__")
            part = content
            for parent in parents:
                part = part[parent]
            if value is None:
                del part[key]
            else:
                part[key] = value
        (folder / "bundle.json").write_text(json.dumps(sealed(content)))

    return damage
