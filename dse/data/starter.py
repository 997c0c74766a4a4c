"""A first search space for recordings: split, encoder and window that follow from them, as commented YAML."""

from __future__ import annotations

import json
import math
import os
import re
import shlex
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dse.base import registry
from dse.base.records import Array, Bools, Rasters, Signals
from dse.config.locate import shipped_folder
from dse.config.yaml_lines import dump
from dse.data.look import LABELS, Look
from dse.data.recordings import RecordingError, Recordings, Source
from dse.data.recordings.doubts import MOST, drawn, nearest_neighbours

_GROUPS = re.compile(
    r"(?:session|subject|participant|person|user|day|date|hand|finger|device|group|block)(?:_?(?:id|no))?$",
    re.IGNORECASE,
)
_PARTS = re.compile(r"(?:split|set|subset|part|partition|fold)$", re.IGNORECASE)
_NAMES_OF_PARTS = {
    "train": ("train", "training"),
    "validation": ("validation", "val", "valid", "dev"),
    "test": ("test", "testing"),
}
_PLAIN = r"[A-Za-z][A-Za-z0-9_.-]*"  # a name that YAML reads as text, unless it is a constant
_MOST_CLASSES = 100
_MOST_STEPS = 1000  # of a window: longer ones train slowly
_STEPS_OF_EVENTS = 100  # bins in the shortest recording of events
_MOST_POOLS = 400  # pixels that events are pooled to
_TRAINING_STEPS = 2000
# Trainings of networks, folds counted: more of them race. Of few, the best in the end often lag at first.
_MOST_TRAININGS = 130
# Recordings of a part for which 3 folds are enough, and for which that part alone validates: standard errors
# of up to 0.03 and 0.025. First designs differ by little more, and the best of many is the luckiest.
_FEW_FOLDS, _NO_FOLDS = 100, 400
_LEVELS = 64  # of the usual range of a channel
_MOST_BINS = 256  # of a window, in which random kernels are looked at
_COUNT_SCALE = 0.15  # of windows of 127 steps and more: the default of the loss
_FEW_STEPS = 50  # of a window; below, two network steps for each leave neurons more spikes to tell classes by
_LEAST_ODDS = 19.0  # log-odds of an output that fires in every step: with far less, no loss can be small
_HIDDEN = {"hidden": {"choice": [20, 100]}}
_LOSSES = ["count_cross_entropy", "spike_rate"]  # neither learns all recordings better than the other
_MOST_COPIES, _MOST_INPUTS = 8, 2048  # of the inputs, each with a delay; of inputs with all copies
_NETWORK = {
    "loss": "count_cross_entropy",
    "threshold": 5.0,
    "current_decay": [0.3, 1.0],
    "voltage_decay": [0.12, 0.96],
    "output_current_decay": 0.12,
    "output_voltage_decay": 0.05,
    "output_tau_grad": 0.3,
    "initial_rate": 0.2,
    "whitened": "output",
}  # that which learns on the recordings of search_spaces/headline_*.yaml
# Of random kernels: neurons hold the level of what they add up, through resets.
_KERNELS = {
    "hidden": {"choice": [50, 200]},
    **{key: value for key, value in _NETWORK.items() if key != "initial_rate"},
    "current_decay": 0.03,
    "voltage_decay": 1.0,
}

_Commented = dict[str, dict[str, Any]]
"""Comment -> the sections that follow it in the file."""
_ENCODER = (
    "Signals become spikes where they change by a threshold, in their unit, or the binary digits of\n"
    "their changes, which add up to the signal: dse describe encoder."
)
_MODEL = (
    "Should it spike? Plain classifiers of 8-bit integers come first, then networks; what is a\n"
    "choice is explored: dse describe model NAME."
)
_HARDWARE = (
    "Chips to compute energy and latency for: dse describe hardware. All run on the processor, networks on\n"
    "the other. Goals are accuracy, few weights and little energy unless `objectives` names others."
)
_LIMITS = "What does not spike reads the quantised signal alone, random kernels that spike its changes."


def label_of(look: Look, recordings: Recordings) -> str:
    """Return the column that most probably is the label.

    Raises:
        RecordingError: there is none.
    """
    why = dict(look.refused)
    for name, n in look.n_values.items():
        values = np.asarray(recordings.columns[name])
        known, counts = np.unique(values, return_counts=True)
        if _PARTS.match(name) or _parts(values) or _GROUPS.match(name):
            why[name] = "is named as a part or a group"
        elif n > _MOST_CLASSES:
            why[name] = f"has {n} values"
        elif counts.min() == 1:
            why[name] = f"has the value '{known[counts.argmin()]}' in one recording alone"
    candidates = [name for name in look.n_values if name not in why]
    if not candidates:
        reasons = "; ".join(f"'{name}' {reason}" for name, reason in why.items())
        raise RecordingError(
            "no label column was found, with two values or more and each in several recordings"
            f"{f' ({reasons})' if reasons else ''}; --labels FILE names a file of labels"
        )

    def rank(name: str) -> tuple[bool, bool, int]:
        is_text = np.asarray(recordings.columns[name]).dtype.kind == "U"
        return not LABELS.match(name), not is_text, look.n_values[name]

    return min(candidates, key=rank)


def starter(
    look: Look,
    out: Path,
    recordings: Recordings,
    label: str,
    group: str | None = None,
) -> tuple[str, tuple[str, ...]]:
    """Return a YAML file that trains on the recordings of a look, and what was guessed and chosen for it.

    out: file of the search space, which names the study. label: column to predict. group: column whose values
    stay in one part of the split; None: one that is named as a session, subject or the like.

    Raises:
        RecordingError: no classes, a class with too few recordings for any split, or signals that never
            change.
    """
    assumed: list[str] = []
    columns = {name: np.asarray(values) for name, values in recordings.columns.items()}
    check_classes(columns[label], label)
    split, is_open = _split(columns, label, group, assumed)
    n_classes = len(np.unique(columns[label]))
    assumed.insert(0, f"'{label}' is predicted: {n_classes} classes")
    others = ", ".join(x for x in columns if x != label) or "none"
    kind = look.data["kind"]
    sections: _Commented = {
        f"Where the recordings are and how they are read: dse describe data {kind}": {
            "data": dict(look.data)
        },
        f"What is predicted; other label columns: {others}.": {"task": {"target": label}},
        "Which recordings train, validate and test: dse describe split.": {"split": split},
    }
    known = np.flatnonzero(is_open)
    (shares,) = split.values() if len(split) == 1 else ({},)
    tested = share if isinstance(share := shares.get("test"), float) else 0.0
    held_out = tested + ((1 - tested) / shares["k"] if "k" in shares else shares.get("validation", 0.0))
    before = _front_end(recordings, columns[label], known, assumed)
    sections |= before
    by_name = {name: keys for each in before.values() for name, keys in each.items()}
    n_steps, step_ms, n_inputs = _inputs(recordings, by_name)
    of_signals = "encoder" in by_name
    networks = _networks(n_steps, n_inputs)
    sections[_MODEL] = {
        "model": {"choice": [*_rivals(n_steps, step_ms, of_signals), *networks]},
        "training": _training(max(1, round(len(known) * (1 - held_out)))),
    }
    sections[_HARDWARE] = {
        "hardware": ["mcu_m4", "loihi1_silicon"],
        "objectives": ["accuracy:max", "n_weights:min", "energy_uj:min"],
    }
    if of_signals:
        sections[_LIMITS] = {
            "limits": [
                "family == 'snn' or family == 'kernel_snn' or encoder == 'quantised'",
                "family != 'kernel_snn' or encoder == 'send_on_delta'",
            ]
        }
    n_networks = _n_designs(by_name.get("encoder", {})) * _n_designs(networks[-1])
    if n_networks * shares.get("k", 1) > _MOST_TRAININGS:
        text = "Networks that fall behind after these shares of their epochs stop: dse describe search."
        sections[text] = {"search": {"racing": {"rungs": [0.2, 0.5], "eta": 3}}}
    notes = (*look.assumed, *assumed, *recordings.notes())
    return _yaml(out, notes, sections), notes


def check_classes(values: Array, label: str) -> None:
    """Check that a label column names classes.

    Raises:
        RecordingError: it has one value alone, or measured numbers.
    """
    values = np.asarray(values)
    if len(names := np.unique(values)) < 2:
        raise RecordingError(f"'{label}' must have 2 classes or more, got one: '{names[0]}'")
    if values.dtype.kind == "f" and len(measured := values[values != np.rint(values)]):
        raise RecordingError(
            f"'{label}' must name classes, got measured numbers such as {measured[0]:.6g}; sort them into "
            "classes first"
        )


def described(data: Mapping[str, Any], base: Path) -> Look:
    """Return the look at recordings whose section `data` is given, such as `from_arrays` returns.

    Raises:
        RecordingError: anything wrong with the file.
    """
    recordings = read(Look(dict(data), {}), base)
    n_values = {name: len(np.unique(values)) for name, values in recordings.columns.items()}
    assumed: tuple[str, ...] = ()
    if isinstance(recordings, Signals):
        ends = sorted({int(recordings.lengths.min()), int(recordings.lengths.max())})
        steps, n = " to ".join(map(str, ends)), recordings.n_recordings
        assumed = (f"{n} recordings of {steps} steps and {recordings.n_channels} channels",)
    return Look(dict(data), {name: n for name, n in n_values.items() if n > 1}, assumed)


def read(look: Look, base: Path) -> Recordings:
    """Return the recordings of a look, whose files are relative to `base`; signals and spikes need its step.

    Raises:
        RecordingError: anything wrong with the file.
    """
    keys = {key: tuple(x) if isinstance(x, list) else x for key, x in look.data.items() if key != "kind"}
    source: Source = registry.known("recordings")[look.data["kind"]](**keys)
    return source.read(base)


def _yaml(out: Path, assumed: Sequence[str], sections: _Commented) -> str:
    study, file = out.stem, shlex.quote(out.name)
    lines = [
        *_schema_line(out.absolute().parent),
        f"# A first search space. dse check {file} lists every fault; dse run {file} trains.",
        "# Assumed:",
        *(
            line
            for sentence in assumed
            for line in textwrap.wrap(sentence, 100, initial_indent="# - ", subsequent_indent="#   ")
        ),
        f"study: {study if re.fullmatch(_PLAIN, study) else json.dumps(study, ensure_ascii=False)}",
        "seed: 1",
    ]
    for comment, section in sections.items():
        lines += ["", *(f"# {line}" for line in comment.splitlines()), dump(section).rstrip()]
    lines += [
        "",
        "# Budgets are given when you pick, e.g.",
        f"# dse pick {shlex.quote(f'results/{study}')} \\",
        '#     --budget "energy_uj <= 100" --budget "n_weights <= 10000" --export bundle --refit',
        "# --refit trains the pick once more, on training and validation together.",
        "",
    ]
    return "\n".join(lines)


def _schema_line(folder: Path) -> list[str]:
    """Return the line by which editors complete keys, where the file and the schema move together."""
    schema = shipped_folder("search_spaces") / "schema.json"
    together = os.path.commonpath([folder, schema]) in map(str, (folder, schema.parents[1]))
    place = Path(os.path.relpath(schema, folder)).as_posix()
    return [f"# yaml-language-server: $schema={place}"] if together else []


def _n_designs(keys: Any) -> int:
    """Return the number of combinations of what keys of a section, or below them, leave to choose."""
    if not isinstance(keys, Mapping):
        return 1
    if set(keys) == {"choice"}:
        return sum(map(_n_designs, keys["choice"]))
    return math.prod(map(_n_designs, keys.values()))


def _training(n: int) -> dict[str, Any]:
    """Return section `training`, of some 2000 steps whatever the number of recordings."""
    batch_size = int(min(32, max(4, 2 ** int(np.log2(max(n / 16, 4))))))
    epochs = int(min(200, max(30, _TRAINING_STEPS * batch_size // n)))
    return {
        "epochs": epochs,
        "batch_size": batch_size,
        "learning_rate": 0.05,
        "warmup_epochs": 3,
        "lr_every": epochs // 5,
        "average_epochs": epochs // 20,
        "dropout": 0.0,
    }


def _inputs(recordings: Recordings, sections: Mapping[str, Any]) -> tuple[int, float, int]:
    """Return the steps of a window, their period in ms, and the most inputs of a network, by the sections."""
    if isinstance(recordings, Rasters):
        spikes = recordings.spikes
        return spikes.n_steps, spikes.step_ms, spikes.n_channels
    if isinstance(recordings, Signals):
        n_steps = sections.get("window", {}).get("n_steps", int(recordings.lengths.min()))
        changes, digits = sections["encoder"]["choice"]
        each = max(len(changes["thresholds"]), int(digits["digits"]))
        return n_steps, recordings.step_ms, 2 * recordings.n_channels * each
    of_events = sections["preprocessing"]
    pool = int(of_events.get("pool", 1))
    n_inputs = 2 * -(-recordings.width // pool) * -(-recordings.height // pool)
    return sections["window"]["n_steps"], of_events["bin_ms"], n_inputs


def _networks(n_steps: int, n_inputs: int) -> list[dict[str, Any]]:
    """Return the spiking families: random kernels, and networks that train whole.

    Copies of the inputs go back by halves of the window; whole networks also have none, or even parts of it.
    In short windows, which hold few spikes, cross entropy counts each for more.
    """
    n = next(n for n in (_MOST_COPIES, 4, 2, 1) if n * n_inputs <= _MOST_INPUTS or n == 1)
    halves = sorted({0, *(n_steps >> k for k in range(1, n))})
    parts = sorted({n_steps * k // n for k in range(n)})
    delays = [[0], *(x for x in ([halves] if halves == parts else [halves, parts]) if len(x) > 1)]
    count_scale = float(f"{max(_COUNT_SCALE, _LEAST_ODDS / n_steps):.2g}")
    short = {**({"steps_per_sample": 2} if n_steps < _FEW_STEPS else {}), "count_scale": count_scale}
    copies = {"input_delays": {"choice": delays}} if len(delays) > 1 else {}
    return [
        {"kind": "kernel_snn", **_KERNELS, "input_delays": halves, **short},
        {"kind": "snn", **_HIDDEN, **copies, **_NETWORK, "loss": {"choice": _LOSSES}, **short},
    ]


def _rivals(n_steps: int, step_ms: float, of_signals: bool) -> list[dict[str, Any]]:
    """Return families that do not spike.

    Where spikes add up to a signal, they are read in eighths of the window; else counted in quarters and
    eighths.
    """

    def window_ms(parts: int) -> float:
        return float(f"{-(-n_steps // parts) * step_ms:.10g}")  # whole steps

    mlp = {"kind": "mlp", "channels": "each", "window_ms": window_ms(8), "hidden": 32, "precision": "int8"}
    return [
        {"kind": "linear", "window_ms": window_ms(8), "reads": {"choice": ["counts", "levels"]}}
        if of_signals
        else {"kind": "linear", "window_ms": {"choice": [window_ms(4), window_ms(8)]}},
        mlp | ({"reads": "levels"} if of_signals else {}),
        {
            "kind": "kernels",
            "window_ms": window_ms(_MOST_BINS),
            "kernels": {"choice": [300, 1000]},
            "thresholds": 4,
            "readout": "ridge",
        },
    ]


# ---- the split


def _split(
    columns: Mapping[str, Array], label: str, group: str | None, assumed: list[str]
) -> tuple[dict[str, Any], Bools]:
    """Return section `split`: the file's own parts, or a draw of every class with whole groups.

    Also which recordings, (n,), it trains on or draws from: no published test set.
    """
    named = ((name, _parts(values)) for name, values in columns.items() if name != label)
    name, parts = next((x for x in named if {"train"} < x[1].keys()), ("", {}))
    if "validation" in parts:
        assumed.append(f"the split is that of column '{name}'")
        return {part: {name: value} for part, value in parts.items()}, columns[name] == parts["train"]
    drawn = np.ones(len(columns[label]), bool)
    more: dict[str, Any] = {}
    if parts:
        drawn, more = columns[name] == parts["train"], {"test": {name: parts["test"]}}
        assumed.append(
            f"the test set is that of column '{name}', {np.count_nonzero(~drawn)} recordings; validation is "
            "drawn from the others"
        )
    labels = columns[label][drawn]
    groups = group or next((x for x in columns if x not in (label, name) and _GROUPS.match(x)), None)
    if groups is not None:
        known = columns[groups]
        if np.isin(known[~drawn], known[drawn]).any():
            text = f"values of '{groups}' are in training and in the test set of column '{name}'"
        elif shares := _shares(labels, known[drawn], bool(parts)):
            assumed.append(
                f"recordings with one value of '{groups}' stay in one part of the split, so that a {groups} "
                "is not recognised in place of the class"
            )
            return _drawn({**shares, **more}, len(labels), assumed, groups), drawn
        else:
            few = min(np.unique(labels), key=lambda x: len(np.unique(known[drawn][labels == x])))
            text = f"'{groups}' has one value in class '{few}': a split by it would leave it out of a part"
        if group is not None:
            raise RecordingError(text)
        assumed.append(f"{text}; the recordings are drawn one by one")
    shares = _shares(labels, np.arange(len(labels)), bool(parts))
    if shares is None:
        names, counts = np.unique(labels, return_counts=True)
        raise RecordingError(
            f"every class must have at least 2 recordings{' in training' if parts else ''}, but "
            f"'{names[counts.argmin()]}' of '{label}' has {counts.min()}"
        )
    if groups is None:
        assumed.append(
            "recordings are drawn for training and validation one by one: if some were made in one session "
            "or by one person, name their column with --group"
        )
    return _drawn({**shares, **more}, len(labels), assumed), drawn


def _drawn(shares: Mapping[str, Any], n: int, assumed: list[str], group: str | None = None) -> dict[str, Any]:
    """Return section `split` of n recordings: folds where one part for validation would tell little."""
    of_group = {} if group is None else {"group": group}
    validated = shares["validation"] * n
    if validated >= _NO_FOLDS:
        return {"stratified": {**shares, **of_group, "seed": 1}}
    k = round(1 / shares["validation"]) - isinstance(shares.get("test"), float)  # of which one tests
    k = min(k, 3) if validated >= _FEW_FOLDS else k
    assumed.append(f"every recording outside the test set validates in one of {k} folds, as there are few")
    of_test = {"test": shares["test"]} if "test" in shares else {}
    return {"k_fold": {"k": k, **of_test, **of_group, "seed": 1}}


def _shares(labels: Array, groups: Array, has_test: bool) -> dict[str, float] | None:
    """Return fractions for validation, and test if there is none, with groups of each class in every part.

    None where a class has too few.
    """
    fewest = min(len(np.unique(groups[labels == label])) for label in np.unique(labels))
    if fewest < 2:
        return None
    if fewest < 3:
        return {"validation": 0.5}
    share = 0.2 if fewest >= 5 else round(1 / fewest, 2)
    return {"validation": share} if has_test else {"validation": share, "test": share}


def _parts(values: Array) -> dict[str, str]:
    """Return train, validation and test -> the value that names it; nothing where a value is none of them."""
    texts = {str(x).lower(): str(x) for x in np.unique(values)} if values.dtype.kind == "U" else {}
    found = {part: texts[name] for part, names in _NAMES_OF_PARTS.items() for name in names if name in texts}
    return found if len(found) == len(texts) else {}


# ---- windows, and what makes spikes


def _front_end(recordings: Recordings, labels: Array, known: Array, assumed: list[str]) -> _Commented:
    """Return the sections window, preprocessing and encoder."""
    if isinstance(recordings, Rasters):
        return {}
    if not isinstance(recordings, Signals):
        return _of_events(recordings, assumed)
    if (recordings.values == recordings.values[:1]).all():
        raise RecordingError("signals must change, but every channel has one value in all recordings")
    sections: _Commented = {}
    shortest, longest = int(recordings.lengths.min()), int(recordings.lengths.max())
    n_steps = min(longest, _MOST_STEPS)
    if shortest < longest or n_steps < longest:
        why = "the longest recording" if n_steps == longest else f"the most that train quickly; of {longest}"
        text = f"windows have {n_steps} steps, {n_steps * recordings.step_ms:g} ms ({why})"
        window: dict[str, Any] = {"n_steps": n_steps, "at": "middle"}
        if shortest < n_steps:
            window |= {"at": "start", "pad": True}
            assumed.append(
                f"{text}; shorter recordings, of {shortest} steps and more, hold their last sample: how long "
                "one lasts can tell its class"
            )
        else:
            assumed.append(f"{text}, from the middle of each recording")
        sections[f"{text}: dse describe window."] = {"window": window}
    ranges = channel_ranges(recordings)
    unit = float(np.median(ranges[ranges > 0])) if (ranges > 0).any() else 1.0
    theta, quantised = float(f"{0.05 * unit:.2g}"), _quantised(recordings, unit)
    assumed.append(
        f"a channel spikes when it has changed by {theta:g}, a twentieth of the usual range within a "
        f"recording ({unit:.3g}), or with the {quantised['digits']} binary digits of its changes by "
        f"{quantised['step']:g}"
    )
    live = ranges[ranges > 0]
    if len(live) and live.max() > 20 * live.min():
        assumed.append(
            f"the ranges of channels differ ({live.min():.2g} to {live.max():.2g}): scale them alike "
            "if small ones matter"
        )
    if (ranges == 0).any():
        assumed.append(f"{int((ranges == 0).sum())} of {len(ranges)} channels hardly ever change")
    common: dict[str, Any] = {}
    if (accuracy := _of_levels(recordings, labels, known)) is not None:
        common["start"] = {"choice": ["sample", "mean"]}
        assumed.append(
            f"the mean of each channel tells the class in {accuracy:.2f} of the recordings: with "
            "encoder.start mean it is sent too; keep sample if a session or how the sensor was placed sets it"
        )
    encoders = [
        {"kind": "send_on_delta", "thresholds": [theta, 4 * theta], **common},
        {"kind": "quantised", **quantised, **common},
    ]
    return sections | {_ENCODER: {"encoder": {"choice": encoders}}}


def _quantised(signals: Signals, unit: float) -> dict[str, Any]:
    """Return a step of a 64th of a range, whole for whole samples, and digits for twice that range."""
    step = float(f"{unit / _LEVELS:.2g}")
    if (signals.values == np.rint(signals.values)).all():
        step = float(max(round(step), 1))
    return {"step": step, "digits": max(int(np.ceil(np.log2(2 * unit / step + 1))), 1)}


def _of_levels(signals: Signals, labels: Array, known: Array) -> float | None:
    """Return the accuracy of neighbours by the means of the channels; None: not a quarter of the way to 1.

    labels: of all recordings. known: (n,) those that are looked at: not those of a test set.
    """
    means = np.add.reduceat(signals.values, signals.offsets[:-1], axis=0, dtype=np.float64)
    means /= signals.lengths[:, None]
    codes = np.unique(labels, return_inverse=True)[1]
    some = drawn(known, 2 * MOST)
    order = some[np.argsort(codes[some], kind="stable")]  # every class in both halves
    train, query = order[::2], order[1::2]
    largest = np.bincount(codes[some]).max() / len(some)
    right = nearest_neighbours(means[train], codes[train], means[query]) == codes[query]
    return float(right.mean()) if right.mean() >= largest + (1 - largest) / 4 else None


def channel_ranges(signals: Signals) -> Array:
    """Return the median over recordings of each channel's range, 5 to 95 % of its samples, (channel,)."""
    parts = np.split(signals.values, signals.offsets[1:-1])
    ends = np.array([np.percentile(part, (5, 95), axis=0) for part in parts])
    return np.asarray(np.median(ends[:, 1] - ends[:, 0], axis=0))


def _of_events(recordings: Any, assumed: list[str]) -> _Commented:
    """Return the sections for events: bins, pools and a window that the shortest recording has."""
    lengths_ms = []
    for i in range(recordings.n_recordings):
        ends = [(int(x.t_us[0]), int(x.t_us[-1])) for x in recordings.blocks(i) if len(x.t_us)]
        if not ends:
            raise RecordingError(f"recording {i} must have events, got none")
        lengths_ms.append((ends[-1][1] - ends[0][0]) / 1000)
    shortest = min(lengths_ms)
    bin_ms = max(float(f"{shortest / _STEPS_OF_EVENTS:.1g}"), 0.001)
    n_steps = max(int(shortest / bin_ms), 1)
    side = int(np.ceil(np.sqrt(recordings.width * recordings.height / _MOST_POOLS)))
    preprocessing: dict[str, Any] = {"bin_ms": bin_ms}
    if side > 1 and recordings.height > 1:
        preprocessing["pool"] = side
        assumed.append(f"pixels are pooled {side} x {side}")
    text = (
        f"windows have {n_steps} bins of {bin_ms:g} ms, as long as the shortest recording ({shortest:g} ms)"
    )
    assumed.append(text)
    return {
        f"{text}: dse describe window.": {"window": {"n_steps": n_steps, "at": "start"}},
        "Events become spikes: dse describe preprocessing.": {"preprocessing": preprocessing},
    }
