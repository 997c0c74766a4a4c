"""What a page plays: recordings that were held back, and the design's own module that answers them."""

from __future__ import annotations

import base64
import hashlib
import math
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np

from dse import store
from dse.base.records import Array, Ints, Network, Signals
from dse.base.text import one_line
from dse.data import dataset
from dse.data.dataset.assemble import New
from dse.deploy.bundle import Bundle
from dse.deploy.c.code import Code
from dse.deploy.c.replay import pushed
from dse.deploy.export import bundle_of
from dse.deploy.form import Unsupported, rule_of
from dse.deploy.reference import Reference, of_new
from dse.deploy.targets.wasm import Wasm
from dse.engine.neurons.fixed_point import BITS
from dse.measure.on_chips import columns_on
from dse.measure.run import load_of
from dse.models.snn.respond import respond
from dse.show.dashboard.write import packed_array
from dse.study import pricing
from dse.study.precision import AS_TRAINED
from dse.study.record import load_records
from dse.study.results import Study, sections_found

MOST = 20
"""Recordings that a page plays, at most: a few of each class."""
ENERGIES = {"flat": "energy_uj", "period": "energy_throttled_uj"}
_OF_SPIKES = ("data", "task", "window", "preprocessing", "encoder")
_HELD = {"response_test.npz": "test", "response.npz": "validation"}


class NotPlayed(ValueError):
    """A design cannot be played; one sentence says why."""


def shown_first(page: Mapping[str, Any], at: int = 0) -> list[int]:
    """Return the rows that the cards of a page show when it opens: pick, most accurate, half the cost.

    The rules are those of `dashboards/budgets.js`, for its limits and the task and chip of row `at`.
    """
    columns, budgets = page["columns"], page["budgets"]
    gain, known = budgets["maximise"], set(page["columns"])
    if gain is None or page["state"] is not None or not {"trial", "point"} <= known:
        return []

    def values(column: str) -> list[Any]:
        return cast("list[Any]", columns[column]["values"])

    def worth(column: str, way: str, row: int) -> float:
        value = values(column)[row]
        return math.inf if value is None else -value if way == "max" else value

    def is_within(row: int) -> bool:
        budgeted = page["definition"]["budgets"].items()
        limits = [(name, budgets["columns"][name], limit) for name, limit in budgeted]
        chosen = all(values(name)[row] == values(name)[at] for name in ("task", "hardware") if name in known)
        fits = row not in page["unable"] and ("fits" not in known or values("fits")[row] is not False)
        honest = "transductive" not in known or values("transductive")[row] is not True
        meets = (worth(name, way, row) <= (-x if way == "max" else x) for name, way, x in limits)
        return chosen and fits and honest and worth(gain, "max", row) < math.inf and all(meets)

    def first(rows: Iterable[int]) -> list[int]:
        goals = [(gain, "max"), *((name, way) for name, way in budgets["ties"] if name in known)]
        return sorted(rows, key=lambda row: ([worth(*goal, row) for goal in goals], row))[:1]

    rows = [row for row in budgets["contenders"] if is_within(row)]
    cost = next(
        (name for name in ("energy_uj", *page["objectives"]) if page["objectives"].get(name) == "min"), ""
    )
    best = first(rows)
    if not best or not cost:
        return best
    error = page["intervals"].get(gain, {}).get("low", [0] * (best[0] + 1))[best[0]] or 0
    enough = values(gain)[best[0]] - error
    at_most = min(worth(cost, "min", row) for row in rows if values(gain)[row] >= enough)
    pick = first(row for row in rows if worth(cost, "min", row) <= at_most)
    half = first(row for row in rows if worth(cost, "min", row) <= at_most / 2)
    return list(dict.fromkeys([*pick, *best, *half]))


def gather_touches(
    study: Study, points: Sequence[Mapping[str, Any]], hardware: Sequence[str] = ()
) -> dict[str, Any]:
    """Gather what plays recordings to designs, as plain values that JSON can hold.

    points: rows of its table of points. hardware: names or files of profiles for the energy; empty: those of
    the study.

    Returns:
        designs: {"trial.point": what it needs}: what `machine_of` returns; `of`, the part of the split;
            `input`, a key of inputs; and per recording `label`, `time_ms` (the answer of `dse evaluate`)
            and `energy`, {chip: {pace: uJ until the end of each step}}, None where unknown.
            One that cannot be played: `why`.
        inputs: {key: recordings}: `name`, `true` class, `counts` of input spikes per step and their
            `channels`, base64 of little-endian uint16 as all arrays here.
    """
    designs: dict[str, Any] = {}
    inputs: dict[str, Any] = {}
    read: dict[str, New] = {}  # designs of a study often share their recordings
    for point in points:
        try:
            played, own = _of_point(study, point, hardware, read)
        except Exception as error:  # a family of a user's module may fail in any way, and the page goes on
            why = one_line(str(error)) or type(error).__name__
            played, own = {"why": why.replace(str(study.folder), study.folder.name)}, []
        if own:
            key = hashlib.sha256(repr(own).encode()).hexdigest()[:12]
            inputs[key] = own
            played["input"] = key
        designs[f"{int(point['trial'])}.{int(point['point'])}"] = played
    return {"designs": designs, "inputs": inputs}


def _of_point(
    study: Study, point: Mapping[str, Any], hardware: Sequence[str], read: dict[str, New]
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    bundle = bundle_of(study, point)
    if bundle.heads and not bundle.head:
        raise NotPlayed("A network that answers several tasks at once is not played.")
    try:
        form = Wasm().form(bundle)
    except Unsupported as error:
        raise NotPlayed(str(error)) from None
    part, reference = _held(study, bundle, read)
    data = reference.dataset
    options: list[str] = []
    if form.encoder is not None and isinstance(reference.inputs, Signals):
        options = pushed(reference.inputs.values, form.encoder)[1]
    names, target = bundle.answers, bundle.answered(np.asarray(data.target[data.test]))
    is_network = isinstance(bundle.fitted, Network)
    played = {
        **machine_of(bundle, form, options),
        "of": part,
        "label": reference.label.tolist(),
        "time_ms": reference.time_ms.tolist(),
        "energy": _energies(study, bundle, reference, hardware) if is_network else [None] * len(target),
    }
    recordings = []
    for i, sample in enumerate(data.test.tolist()):
        spikes = reference.spikes_in[reference.spikes_in[:, 0] == i]
        counts = np.bincount(spikes[:, 1], minlength=data.n_steps)
        recordings.append(
            {
                "name": f"recording {sample}: {names[target[i]]}"
                if target[i] >= 0
                else f"recording {sample}",
                "true": int(target[i]),
                "counts": packed_array(counts, "<u2"),
                "channels": packed_array(spikes[:, 2], "<u2"),
            }
        )
    return played, recordings


def machine_of(bundle: Bundle, form: Code, options: Sequence[str] = ()) -> dict[str, Any]:
    """Return a design as a page runs it.

    options: of the compiler, which samples that are not whole numbers need (`pushed`).

    Returns:
        `module`, its WebAssembly (target `wasm`), whose exports begin with `prefix`; `classes`; `n_channels`;
        `first`, number of the output neuron of the first class, None of a classifier that only counts;
        `n_steps` of a window, `step_ms` of its input, `network_ms` of a network step. `samples`, None where
        spikes are made elsewhere: `n` sensors; whether they are `whole` numbers; `at`, where the window of a
        recording begins, a contact being `onset` away from the first sample; `cut`, steps of the recordings
        that a stream is cut into, 0: into none, and `every`, steps from one to the next.
    """
    first, per_sample, samples = None, 1, None
    if isinstance(network := bundle.fitted, Network):
        per_sample = network.steps_per_sample
        timing = form.n_steps * per_sample, network.sizes[-1], form.step_ms / per_sample
        first = rule_of(bundle, *timing).first
    if form.encoder is not None:
        cut, apart = form.cut_steps or 0, form.every_steps or 1
        samples = {
            "n": form.encoder.n_sensors,
            "whole": not options,
            "at": form.window,
            "onset": float(np.float32(form.onset_threshold)),
            "cut": cut,
            "every": -(-cut // apart) * apart,
        }
    with tempfile.TemporaryDirectory(prefix="dse-touch-") as folder:
        Wasm().emit(form, bundle, Path(folder), *options)
        [path] = Path(folder).glob("*.wasm")
        module = path.read_bytes()
    return {
        "module": base64.b64encode(module).decode("ascii"),
        "prefix": bundle.prefix,
        "classes": list(bundle.answers),
        "first": first,
        "n_channels": form.n_channels,
        "n_steps": form.n_steps,
        "step_ms": form.step_ms,
        "network_ms": form.step_ms / per_sample,
        "samples": samples,
    }


def _held(study: Study, bundle: Bundle, read: dict[str, New]) -> tuple[str, Reference]:
    """Return the part of the split that recordings are of, and what the design does on them.

    Only those are read: a study whose recordings are simulated or large is played as soon as another.
    """
    records = load_records(study.folder, bundle.evidence["trial"])
    record = next(x for x in records if x.repeat == bundle.evidence["repeat"])
    folder = store.run_file(study.folder, record.trial, record.repeat)
    name = next((name for name in _HELD if name in record.files), None)
    if name is None or bundle.sections.test is not None or record.sections.get("test"):
        raise NotPlayed("No recordings were held back from the study's own data.")
    response = store.load_arrays(folder / name)
    places = _few(response["target"])
    found = (base for _, base, key in sections_found(study.folder, record) if key == record.data)
    if (base := next(found, None)) is None:
        raise NotPlayed("The recordings of the study are not found here, or have changed.")
    chosen = np.asarray(response["index"])[places]
    plain = bundle.sections.to_plain()
    same = repr([base, chosen.tolist(), *(plain.get(name) for name in _OF_SPIKES)])
    if same not in read:
        read[same] = dataset.build_for(bundle.sections, base, bundle.classes, chosen)
    reference = of_new(bundle, read[same], base)
    setting = bundle.evidence.get("precision", {})
    as_trained = (setting.get("weight_bits", BITS), setting.get("pruned", 0.0)) == AS_TRAINED
    if as_trained and "output" in response and isinstance(bundle.fitted, Network):
        answered = respond(bundle.fitted, reference.dataset, reference.dataset.test).output
        if not np.array_equal(answered, store.response_of(response).output[places]):
            raise NotPlayed("The recordings give other spikes here than in training.")
    return _HELD[name], reference


def _few(target: Array) -> Ints:
    """Return some places, rising: as many of each class as there is room for, the first ones."""
    order = np.lexsort((np.arange(len(target)), _turns(target)))
    return np.sort(order[:MOST])


def _turns(target: Array) -> Ints:
    """Return how many of the same class come before each."""
    turns = np.zeros(len(target), np.int64)
    for name in np.unique(target):
        same = np.flatnonzero(target == name)
        turns[same] = np.arange(len(same))
    return turns


def _energies(
    study: Study, bundle: Bundle, reference: Reference, hardware: Sequence[str]
) -> list[dict[str, Any]]:
    """Return what each recording costs until the end of each network step, by counted operations."""
    assert isinstance(bundle.fitted, Network)
    data = reference.dataset
    response = respond(bundle.fitted, data, data.test)
    counted = (response.spikes, response.updates, response.updates > 0)
    work = np.concatenate(counted, axis=2, dtype=np.int64).cumsum(axis=1)
    steps = np.broadcast_to(np.arange(1, work.shape[1] + 1), work.shape[:2])
    bits = int(bundle.evidence.get("precision", {}).get("weight_bits", BITS))
    load = load_of(bundle.fitted, response, work, steps, bits)
    names = hardware or study.space.get("hardware") or ()
    priced = {chip.name: columns_on(chip, load) for chip in pricing.profiles(study.folder, names)}
    return [
        {
            chip: {
                pace: [float(f"{x:.4g}") for x in columns[name][i].tolist()]
                for pace, name in ENERGIES.items()
                if name in columns and np.isfinite(columns[name][i]).all()
            }
            for chip, columns in priced.items()
        }
        for i in range(reference.n_recordings)
    ]
