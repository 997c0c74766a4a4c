"""What a user's file seems to hold: section `data` for it, label columns, and what was assumed.

A guess is made from names, types and shapes; each one is stated, so that it can be corrected.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dse.recordings import EventSource, RecordingError, arrays, beside, npz
from dse.recordings.formats.arrays import USUAL
from dse.recordings.grid import UNITS_MS, is_even
from dse.recordings.tables import TABLES, first_text, numbered, place, read_table
from dse.recordings.wide_table import sample_columns
from dse.records import Array, Floats

if TYPE_CHECKING:
    import pandas as pd

_TIMES = re.compile(
    r"(?:t|time|times|timestamp|timestamps|zeit)(?:[_ (]*(s|sec|ms|us|µs)\)?)?$", re.IGNORECASE
)
_UNIT_NAMES = {"seconds": "s", "secs": "s", "millis": "ms", "milliseconds": "ms", "micros": "us"}
_UNITS = {"s": "s", "sec": "s", "ms": "ms", "us": "us", "µs": "us"}
_RECORDINGS = re.compile(
    r"(?:recording|rec|trial|sample|touch|series|sequence|episode|run|grasp|slide|press)"
    r"(?:_?(?:id|no|nr|number|index))?$|(?:id|uid|file|filename)$",
    re.IGNORECASE,
)
_CHANNELS = re.compile(r"(?:channel|taxel|sensor|electrode|ch|variable|axis)(?:_?(?:id|no))?$", re.IGNORECASE)
_VALUES = re.compile(r"(?:value|val|reading|measurement|pressure|force|counts?|signal)$", re.IGNORECASE)
_STEPS = {"step_ms": 1.0, "dt_ms": 1.0, "period_ms": 1.0, "dt": 1e3, "dt_s": 1e3}
_RATES = re.compile(r"(?:fs|rate|sampl\w*|s?freq\w*)(?:_?hz)?$|hz$", re.IGNORECASE)
_FEWEST_SAMPLES = 4
"""Sample columns that make a table a wide one."""


@dataclass(frozen=True)
class Options:
    """What a user states instead of leaving it to be guessed; None: guess.

    labels: a file of labels. signal: the array of samples. recording: the column that tells
    recordings apart. base: folder of the search space.
    """

    step_ms: float | None = None
    time_unit: str | None = None
    labels: str | None = None
    signal: str | None = None
    recording: str | None = None
    base: Path = Path()

    def place(self, path: Path) -> str:
        """Return a path as a YAML file in `base` names it."""
        try:
            return str(path.absolute().relative_to(self.base.absolute()))
        except ValueError:
            return str(path.absolute())


@dataclass(frozen=True)
class Look:
    """What a file seems to hold.

    data: section `data`, with every column that may be a label.
    n_values: such a column -> the number of its values.
    assumed: what was guessed, one sentence each.
    lacks_step: whether the sampling period is in none of the file's names and numbers.
    refused: a column that is no label -> why.
    """

    data: dict[str, Any]
    n_values: Mapping[str, int]
    assumed: tuple[str, ...] = ()
    lacks_step: bool = False
    refused: Mapping[str, str] = field(default_factory=dict)


@dataclass
class _Notes:
    """Sentences on what is assumed, and why columns are no labels, gathered on the way."""

    sentences: list[str] = field(default_factory=list)
    refused: dict[str, str] = field(default_factory=dict)

    def add(self, sentence: str) -> None:
        self.sentences.append(sentence)


def look(path: Path, options: Options) -> Look:
    """Return what a file or a folder seems to hold.

    Raises:
        RecordingError: it does not exist, or holds nothing that can be read as recordings.
    """
    notes = _Notes()
    if path.is_dir():
        guess = _folder(path, options, notes)
    elif not path.is_file():
        what = (
            "must be a file or a folder, got a pipe or device" if path.exists() else "no such file or folder"
        )
        raise RecordingError(f"{path}: {what}")
    elif path.suffix.lower() in TABLES:
        guess = _table(path, options, notes)
    elif path.suffix.lower() == ".npz" or arrays.is_one(path):
        guess = _arrays(path, options, notes)
    elif path.suffix.lower() in (".xlsx", ".xls", ".ods"):
        raise RecordingError(f"{path.name}: spreadsheets are not read; save the sheet as CSV")
    else:
        raise RecordingError(
            f"{path.name}: must be a table (.csv, .tsv, .parquet), arrays (.npz, .npy, .mat, .h5), or a "
            "folder of event files"
        )
    if options.step_ms is not None and "step_ms" not in guess.data:
        raise RecordingError(f"{path.name}: --step-ms is for sampled signals and spikes, not for events")
    if options.step_ms is not None:
        guess = replace(guess, data=guess.data | {"step_ms": options.step_ms}, lacks_step=False)
    return replace(guess, assumed=tuple(notes.sentences), refused=notes.refused)


# ---- tables


def _table(path: Path, options: Options, notes: _Notes) -> Look:
    table = read_table(path, None)
    table.columns = table.columns.map(str)
    if table.empty:
        raise RecordingError(f"{path.name}: the table has no rows")
    names = list(table.columns)
    recording = options.recording or next((name for name in names if _RECORDINGS.match(name)), None)
    if recording is not None and recording not in names:
        raise RecordingError(f"{path.name}: no column '{recording}'; there are {', '.join(names)}")
    _check_cells(path, table, recording)
    time = next((name for name in names if _time_unit(name) is not None and _is_numeric(table[name])), None)
    starts = _sample_starts(table) if time is None else []
    if starts:
        return _wide(path, table, starts, options, notes)
    unit, scale = "ms", 1.0
    if time is not None:
        unit = (
            options.time_unit or _time_unit(time) or _unit_of(table[time].to_numpy(np.float64), time, notes)
        )
        scale = UNITS_MS[unit]
    channel = next((name for name in names if _CHANNELS.match(name)), None)
    value = next((name for name in names if _VALUES.match(name) and _is_numeric(table[name])), None)
    if channel is not None and value is not None and time is not None:
        return _long(path, table, (time, unit, scale), channel, value, recording, options, notes)
    return _tidy(path, table, time, (unit, scale), recording, options, notes)


def _wide(path: Path, table: pd.DataFrame, starts: list[str], options: Options, notes: _Notes) -> Look:
    samples = [name for start in starts for name in sample_columns(list(table.columns), start)]
    rest = [name for name in table.columns if name not in samples]
    notes.add(
        f"a row is a recording: {len(table)} rows; the columns {samples[0]} to {samples[-1]} are its "
        f"samples, {len(starts)} channel{'s' * (len(starts) > 1)} of {len(samples) // len(starts)}"
    )
    data = {"kind": "wide_table", "file": options.place(path), "step_ms": None, "samples": starts}
    columns, n_values = _label_candidates({name: table[name] for name in rest}, len(table), notes, path)
    if (file := options.labels or (None if columns else _labels_beside(path))) is not None:
        beside_it = beside.load(Path(file), beside.names_in(Path(file)))
        for name in set(rest) & set(beside_it):
            if not np.array_equal(table[name].astype(str), beside_it[name].astype(str)):
                raise RecordingError(f"{file}: '{name}' must be as in {path.name}, in the same order")
        columns, n_values = _label_candidates(beside_it, len(table), notes)
        data["labels"] = options.place(Path(file))
        notes.add(f"labels are in {file}, in the order of the recordings")
    return Look(data | {"columns": columns}, n_values, lacks_step=True)


def _long(
    path: Path,
    table: pd.DataFrame,
    times: tuple[str, str, float],
    channel: str,
    value: str,
    recording: str | None,
    options: Options,
    notes: _Notes,
) -> Look:
    time, unit, scale = times
    channels = [str(x) for x in _sorted(table[channel].dropna().unique())]
    code = np.searchsorted(_sorted(table[channel].unique()), table[channel].to_numpy())
    t_ms = table[time].to_numpy(np.float64) * scale
    number = numbered(t_ms, code) if recording is None else _codes(table[recording])
    notes.add(
        f"a row is a value of '{channel}' ({len(channels)} channels: {_some(channels)}) at '{time}' in "
        f"{unit}; {_separation(recording, number)}"
    )
    step_ms, even = _step(t_ms, number * len(channels) + code, notes, options.step_ms)
    data: dict[str, Any] = {"kind": "long_table", "file": options.place(path), "step_ms": step_ms}
    data |= {"time": time, "time_unit": unit, "channel": channel, "value": value}
    data |= {"channels": channels, "recording": recording}
    data |= {} if even else {"resample": "linear"}
    rest = [name for name in table.columns if name not in (time, channel, value, recording)]
    return _labelled(path, data, table, rest, number, recording, options, notes)


def _tidy(
    path: Path,
    table: pd.DataFrame,
    time: str | None,
    unit: tuple[str, float],
    recording: str | None,
    options: Options,
    notes: _Notes,
) -> Look:
    if time is None and recording is None:
        raise RecordingError(
            f"{path.name}: must have a column of times or one that tells recordings apart (--recording "
            f"NAME), got {_some(list(table.columns))}"
        )
    t_ms = None if time is None else table[time].to_numpy(np.float64) * unit[1]
    if recording is not None:
        number = _codes(table[recording])
    else:
        assert t_ms is not None  # one of both is there
        number = numbered(t_ms)
    if number.max() == 0:
        raise RecordingError(
            f"{path.name}: must hold several recordings, got one; a column that tells them apart is named by "
            "--recording NAME"
        )
    rest = [name for name in table.columns if name not in (time, recording)]
    changing = [name for name in rest if _changes(table[name], number)]
    channels = [name for name in changing if _is_numeric(table[name])]
    if not channels:
        raise RecordingError(
            f"{path.name}: must have a column of numbers that change within a recording, got "
            + (
                ", ".join(f"'{name}' with {first_text(table[name], path)}" for name in changing)
                or _some(rest)
            )
        )
    notes.add(
        f"a row is a sample of {len(channels)} channel{'s' * (len(channels) > 1)} ({_some(channels)}); "
        f"{_separation(recording, number)}"
    )
    data: dict[str, Any] = {"kind": "table", "file": options.place(path), "step_ms": None}
    data |= {"channels": channels, "recording": recording}
    lacks_step = t_ms is None
    if t_ms is not None:
        order = np.argsort(number, kind="stable")
        step_ms, even = _step(t_ms[order], number[order], notes, options.step_ms)
        data |= {"step_ms": step_ms, "time": time, "time_unit": unit[0]}
        data |= {} if even else {"resample": "linear"}
    fixed = [name for name in rest if name not in channels]
    guess = _labelled(path, data, table, fixed, number, recording, options, notes)
    return replace(guess, lacks_step=lacks_step)


def _labelled(
    path: Path,
    data: dict[str, Any],
    table: pd.DataFrame,
    names: Sequence[str],
    number: Array,
    recording: str | None,
    options: Options,
    notes: _Notes,
) -> Look:
    """Return a look at a table of samples with its label columns, or with those of a table beside it."""
    first = np.unique(number, return_index=True)[1]
    for name in (name for name in names if _changes(table[name], number)):
        column = table[name].to_numpy()
        row = int((table[name].isna().to_numpy() | (column != column[first][number])).argmax())
        where = place(path, row)
        notes.refused[name] = (
            f"is empty in {where}"
            if table[name].isna().iloc[row]
            else f"changes within a recording in {where}"
        )
    fixed = {name: table[name].iloc[first] for name in names if name not in notes.refused}
    columns, n_values = _label_candidates(fixed, len(first), notes, path)
    file = options.labels or (None if columns or recording is None else _labels_beside(path))
    if file is not None:
        if recording is None:
            raise RecordingError(f"{path.name}: labels in {file} need a column that tells recordings apart")
        labels = read_table(Path(file), None)
        labels.columns = labels.columns.map(str)
        if recording not in labels:
            raise RecordingError(
                f"{file}: no column '{recording}', which names the recordings of {path.name}"
            )
        notes.add(f"labels are in {file}, one row per '{recording}'")
        data = data | {"labels": options.place(Path(file))}
        rest = {name: labels[name] for name in labels.columns if name != recording}
        columns, n_values = _label_candidates(rest, len(labels), notes, Path(file))
    return Look(data | {"columns": columns}, n_values)


def _labels_beside(path: Path) -> str | None:
    names = [f"{path.stem}_labels", f"labels_{path.stem}", "labels", "metadata", "meta"]
    files = (path.with_name(f"{name}{suffix}") for name in names for suffix in TABLES)
    return next((str(file) for file in files if file.is_file() and file != path), None)


def _time_unit(name: str) -> str | None:
    """Return the unit that the name of a column of times states, '' if it states none; None: no times."""
    if name.lower() in _UNIT_NAMES:
        return _UNIT_NAMES[name.lower()]
    match = _TIMES.match(name)
    return None if match is None else _UNITS.get((match[1] or "").lower(), "")


def _unit_of(times: Floats, name: str, notes: _Notes) -> str:
    """Return the unit in which the smallest steps are those of a sensor, some 0.5 to 500 ms."""
    steps = np.diff(times)
    steps = steps[steps > 0]
    typical = float(np.median(steps)) if len(steps) else 1.0
    unit = "s" if typical < 0.5 else "ms" if typical < 500 else "us"
    notes.add(f"'{name}' rises by {typical:g}, so it is taken to be in {unit}; --time-unit states another")
    return unit


_JITTER = 0.1
"""Share of a step by which times may differ without a word."""


def _step(t_ms: Floats, number: Array, notes: _Notes, stated_ms: float | None) -> tuple[float, bool]:
    """Return the usual step of times in ms, and whether all times are even."""
    order = np.argsort(number, kind="stable")
    t_ms, number = t_ms[order], number[order]
    steps = np.diff(t_ms)[np.diff(number) == 0]
    if not len(steps):
        raise RecordingError("every recording must have several samples, got one")
    step_ms = stated_ms or float(f"{np.median(steps):.4g}")
    parts = np.split(t_ms, np.flatnonzero(np.diff(number)) + 1)
    n_uneven = sum(not is_even(part, step_ms) for part in parts)
    notes.add(f"a step is {step_ms:g} ms, the median of the times")
    if n_uneven:
        notes.add(f"{n_uneven} of {len(parts)} series have uneven times: resampled every {step_ms:g} ms")
    elif (off_ms := float(np.abs(steps - step_ms).max())) > _JITTER * step_ms:
        notes.add(f"steps differ from that by up to {off_ms:.2g} ms; samples are taken as they are")
    return step_ms, n_uneven == 0


def _sample_starts(table: pd.DataFrame) -> list[str]:
    """Return the beginnings of names that several numbered columns of numbers share, equally many each."""
    matches = (re.fullmatch(r"(.*?)(\d+)", name) for name in table.columns if _is_numeric(table[name]))
    starts = [match[1] for match in matches if match]
    counts = {start: starts.count(start) for start in dict.fromkeys(starts)}
    most = max(counts.values(), default=0)
    return [start for start, n in counts.items() if n == most] if most >= _FEWEST_SAMPLES else []


_STRAY = 0.1  # share of cells without a number that a column of numbers may have by mistake


def _check_cells(path: Path, table: pd.DataFrame, recording: str | None) -> None:
    """Refuse a table in which few cells of a column are no numbers, while the others are.

    A column that does not change within a recording is a label, whatever it holds.
    """
    import pandas

    number = None if recording is None else _codes(table[recording])
    for name in (name for name in table.columns if name != recording and not _is_numeric(table[name])):
        column = table[name].dropna()
        share = float(pandas.to_numeric(column, errors="coerce").isna().mean()) if len(column) else 0.0
        if 0 < share < _STRAY and (number is None or _changes(table[name], number)):
            raise RecordingError(
                f"{path.name}: column '{name}' must hold numbers, got {first_text(table[name], path)}"
            )


def _is_numeric(column: pd.Series[Any]) -> bool:
    return column.dtype.kind in "biuf"


def _codes(column: pd.Series[Any]) -> Array:
    import pandas

    return np.asarray(pandas.factorize(column)[0])


def _changes(column: pd.Series[Any], number: Array) -> bool:
    """Return whether a column has several values within a recording."""
    return bool(column.groupby(number).nunique(dropna=False).max() > 1)


def _separation(recording: str | None, number: Array) -> str:
    how = (
        "a recording begins where time falls"
        if recording is None
        else f"'{recording}' tells recordings apart"
    )
    return f"{how}: {int(number.max()) + 1} recordings"


def _sorted(values: Iterable[Any]) -> list[Any]:
    try:
        return sorted(values)
    except TypeError:
        return sorted(values, key=str)


def _some(names: Sequence[str]) -> str:
    return ", ".join(names) if len(names) <= 4 else f"{', '.join(names[:3])}, ... {names[-1]}"


# ---- label columns


def _label_candidates(
    columns: Mapping[str, Any], n: int, notes: _Notes, table: Path | None = None
) -> tuple[dict[str, str], dict[str, int]]:
    """Return the columns that may be labels or groups, and how many values each has: 1 < values < n.

    Why others are none is noted. `table` is the file whose rows the columns are.
    """
    kept = {}
    for name, values in columns.items():
        array = np.asarray(values)
        if len(array) != n or array.dtype.kind not in "biufUO":
            continue
        present = np.array([x is not None and x == x for x in array.tolist()])
        if not present.all():
            i = int((~present).argmax())
            where = (
                f"recording {i}"
                if table is None
                else place(table, int(getattr(values, "index", range(n))[i]))
            )
            notes.refused[name] = f"is empty in {where}"
            continue
        if array.dtype.kind in "UO":
            texts = array.astype(str)
            array = np.char.strip(texts)
            if (array != texts).any():
                notes.add(f"labels of '{name}' are read without blanks at their ends")
        if 1 < (k := len(np.unique(array))) < n:
            kept[name] = k
        else:
            notes.refused[name] = f"has {k} value{'s' * (k > 1)} in {n} recordings"
    short = {name: name.rpartition("/")[2] for name in kept}  # of arrays in a group of HDF5
    if len(set(short.values())) < len(short):
        short = {name: name for name in kept}
    return {short[name]: name for name in kept}, {short[name]: k for name, k in kept.items()}


# ---- arrays


def _arrays(path: Path, options: Options, notes: _Notes) -> Look:
    shapes = npz.headers(path)
    events = {
        key: next((name for name in shapes if name.rpartition("/")[2].lower() in (*usual, f"{key}_us")), None)
        for key, usual in USUAL.items()
    }
    if options.signal is None and events["t"] and events["x"] and "offsets" in shapes:
        return _events(path, shapes, events, options, notes)
    signal = options.signal or _largest(shapes)
    if signal is None or signal not in shapes:
        raise RecordingError(
            f"{path.name}: no array of recordings ({_some(list(shapes))}); --signal NAME names it"
        )
    shape = shapes[signal]
    vectors = {name: shape[0] for name, shape in shapes.items() if len(shape) == 1 and name != signal}
    data: dict[str, Any] = {
        "kind": "time_series",
        "file": options.place(path),
        "step_ms": None,
        "signal": signal,
    }
    label_file = options.labels or (None if vectors else _labels_beside(path))
    names, n = vectors, 0
    if label_file is not None:
        data["labels"] = options.place(Path(label_file))
        names = {name: s[0] for name, s in beside.shapes_in(Path(label_file)).items() if len(s) == 1}
        notes.add(f"labels are in {label_file}, in the order of the recordings")
    offsets = (
        next((name for name in vectors if _are_borders(path, name, shape[0])), None)
        if len(shape) == 2
        else None
    )
    if offsets is not None:
        data["offsets"], n = offsets, vectors[offsets] - 1
        notes.add(
            f"'{signal}' holds {n} recordings of {shape[1]} channels end to end, with borders '{offsets}'"
        )
    elif "packed" in signal.lower() and len(shape) > 1:
        data, n = _packed(path, shapes, data, set(vectors.values()), notes)
        if label_file is not None:
            raise RecordingError(f"{path.name}: the labels of spikes must be arrays of the same file")
    elif -1 in shape:
        n = shape[0]
        notes.add(f"'{signal}' holds {n} recordings of {shape[2]} channels, of different lengths")
    elif len(shape) in (2, 3):
        axes = _axes(shape, set(names.values()))
        n = shape[axes.index("recording")]
        if axes != ["recording", "step", "channel"]:
            data["axes"] = " ".join(axes)
        sizes = ", ".join(f"{size} {name}s" for name, size in zip(axes, shape, strict=True))
        samples = npz.load(path, [signal])[signal]
        if samples.dtype.kind in "bu" and samples.max(initial=0) <= 1:
            if label_file is not None:
                raise RecordingError(f"{path.name}: the labels of spikes must be arrays of the same file")
            named = ["sample" if name == "recording" else name for name in axes]
            data = {"kind": "raster", "file": data["file"], "step_ms": None, "array": signal}
            data["axes"] = " ".join(named)
            sizes += ", of spikes, as all values are 0 or 1"
        notes.add(f"'{signal}' is ({sizes})")
    else:
        raise RecordingError(
            f"{path.name}: '{signal}' must have 2 or 3 axes, got shape {shape}; --signal NAME"
        )
    candidates = [name for name, length in names.items() if length == n]
    values = beside.load(Path(label_file), candidates) if label_file else npz.load(path, candidates)
    columns, n_values = _label_candidates(values, n, notes)
    class_names = _class_names(
        path, {} if label_file else vectors, {x: values[name] for x, name in columns.items()}
    )
    data |= {"columns": columns} | ({"class_names": class_names} if class_names else {})
    step_ms = _stated_step(path, shapes)
    if step_ms is not None:
        data["step_ms"] = step_ms
        notes.add(f"a step is {step_ms:g} ms, as the file states")
    return Look(data, n_values, lacks_step=step_ms is None)


def _packed(
    path: Path, shapes: npz.Shapes, data: Mapping[str, Any], n_labels: set[int], notes: _Notes
) -> tuple[dict[str, Any], int]:
    """Return section `data` of an array of packed bits, and the number of its recordings.

    The axis of steps is the one that is longer in the unpacked shape, if an array such as `shape` holds it,
    else the longest.
    """
    signal = data["signal"]
    sizes = shapes[signal]
    recording = next((k for k, size in enumerate(sizes) if size in n_labels), 0)
    others = [k for k in range(len(sizes)) if k != recording]
    step = max(others, key=lambda k: sizes[k])
    full = [size * (8 if k == step else 1) for k, size in enumerate(sizes)]
    name = next((x for x, shape in shapes.items() if shape == (len(sizes),) and "shape" in x.lower()), None)
    if name is not None:
        full = npz.load(path, [name])[name].tolist()
        step = next((k for k in others if full[k] != sizes[k]), step)
    rest = [k for k in others if k != step]
    named = {k: "polarity" if sizes[k] == 2 else "taxel" if k == rest[0] else f"axis_{k}" for k in rest}
    named |= {recording: "sample", step: "step"} | ({rest[0]: "channel"} if len(rest) == 1 else {})
    axes = " ".join(named[k] for k in range(len(sizes)))
    notes.add(f"'{signal}' is ({axes}) = {tuple(full)} of spikes, packed as bits along its steps")
    raster = {"kind": "raster", "file": data["file"], "step_ms": None, "array": signal, "axes": axes}
    return raster | {"packed": True} | ({"shape": name} if name else {}), full[recording]


def _events(
    path: Path, shapes: npz.Shapes, fields: Mapping[str, str | None], options: Options, notes: _Notes
) -> Look:
    given = {key: name for key, name in fields.items() if name is not None}
    loaded = npz.load(path, [name for key, name in given.items() if key in "xy"])
    ends = {key: int(loaded[name].max(initial=0)) + 1 for key, name in given.items() if key in "xy"}
    n = shapes["offsets"][0] - 1
    data: dict[str, Any] = {
        "kind": "events", "file": options.place(path), "width": ends["x"], "t_us": given["t"],
        ("taxel" if "taxel" in given["x"] else "x"): given["x"],
    }  # fmt: skip
    if "y" in given:
        data |= {"height": ends["y"], "y": given["y"]}
    if "p" in given:
        data["polarity"] = given["p"]
    notes.add(f"{n} recordings of events at {ends['x']} x {ends.get('y', 1)} addresses, times in us")
    among = [name for name, shape in shapes.items() if shape == (n,)]
    values = npz.load(path, among)
    columns, n_values = _label_candidates(values, n, notes)
    vectors = {name: shape[0] for name, shape in shapes.items() if len(shape) == 1}
    class_names = _class_names(path, vectors, {x: values[name] for x, name in columns.items()})
    data |= {"columns": columns} | ({"class_names": class_names} if class_names else {})
    return Look(data, n_values)


def _largest(shapes: npz.Shapes) -> str | None:
    """Return the array of packed bits, or that with most values among those of two or three axes."""
    if packed := next((name for name, x in shapes.items() if "packed" in name.lower() and len(x) > 1), None):
        return packed
    sizes = {name: abs(int(np.prod(shape))) for name, shape in shapes.items() if len(shape) in (2, 3)}
    ragged = [name for name, shape in shapes.items() if -1 in shape]
    return ragged[0] if ragged else max(sizes, key=lambda name: sizes[name], default=None)


def _are_borders(path: Path, name: str, n_rows: int) -> bool:
    borders = npz.load(path, [name])[name]
    ends = borders.dtype.kind in "iu" and len(borders) > 1 and borders[0] == 0 and borders[-1] == n_rows
    return bool(ends and (np.diff(borders.astype(np.int64)) > 0).all())


def _axes(shape: tuple[int, ...], n_labels: set[int]) -> list[str]:
    """Return names of axes: recordings are as many as labels, and steps are more than channels."""
    recording = next((k for k, size in enumerate(shape) if size in n_labels), 0)
    if len(shape) == 2:
        return ["recording" if k == recording else "step" for k in range(2)]
    others = [k for k in range(3) if k != recording]
    step = max(others, key=lambda k: shape[k])
    return ["recording" if k == recording else "step" if k == step else "channel" for k in range(3)]


def _class_names(path: Path, vectors: Mapping[str, int], labels: Mapping[str, Array]) -> dict[str, str]:
    """Return which arrays of texts name the codes of label columns."""
    texts = {}
    for name in (name for name in vectors if re.search(r"names?$|classes$", name, re.IGNORECASE)):
        array = npz.load(path, [name])[name]
        if array.dtype.kind in "US":
            texts[name] = array
    chosen: dict[str, str] = {}
    for column, codes in labels.items():
        for name, array in texts.items():
            is_code = codes.dtype.kind in "iu" and codes.min() >= 0 and codes.max() == len(array) - 1
            alone = name.lower().removesuffix("names").strip("_") in ("", "class", column.lower())
            if is_code and (alone or column.lower() in name.lower()):
                chosen.setdefault(column, name)
    return chosen


def _stated_step(path: Path, shapes: npz.Shapes) -> float | None:
    """Return the sampling period that a number in the file states by its name, in ms."""
    for name, shape in shapes.items():
        if int(np.prod(shape)) != 1:
            continue
        factor = _STEPS.get(name.lower())
        if factor is None and not _RATES.match(name):
            continue
        number = float(np.ravel(npz.load(path, [name])[name])[0])
        if number > 0:
            return number * factor if factor is not None else 1000 / number
    return None


# ---- folders

_WIDEST = 1 << 15  # addresses of a frame that is not known yet


def _frame(events: EventSource) -> dict[str, int]:
    """Return the least frame that holds all events."""
    blocks = [block for i in range(events.n_recordings) for block in events.blocks(i)]
    ends = {key: max(int(getattr(block, key).max(initial=0)) for block in blocks) + 1 for key in "xy"}
    return {"width": ends["x"], "height": ends["y"]}


def _read_folder(path: Path, keys: dict[str, Any], data: dict[str, Any], notes: _Notes) -> EventSource:
    """Return the event files of a folder; a frame that they do not state is added to keys and data."""
    from dse.recordings.event_files import EventFiles

    try:
        return EventFiles(**keys).read(path.parent)
    except RecordingError as error:
        if "data.width and data.height" not in str(error):
            raise
    frame = _frame(EventFiles(**keys, width=_WIDEST, height=_WIDEST).read(path.parent))
    data |= frame
    keys |= frame
    notes.add("the files do not state their frame: it is as large as the addresses need")
    return EventFiles(**keys).read(path.parent)


def _folder(path: Path, options: Options, notes: _Notes) -> Look:
    from dse.recordings.file_labels import folder_columns
    from dse.recordings.folders import files_below

    table = next(
        (path / f"labels{suffix}" for suffix in TABLES if (path / f"labels{suffix}").is_file()), None
    )
    names = [name for name in files_below(path, "**/*") if table is None or name != table.name]
    if not names:
        raise RecordingError(f"{path}: the folder holds no files")
    data: dict[str, Any] = {"kind": "event_files", "folder": options.place(path)}
    keys: dict[str, Any] = {"folder": str(path.absolute())}
    if options.time_unit is not None:
        keys["time_unit"] = data["time_unit"] = options.time_unit
    if table is not None:
        beside_files = [str(x) for x in read_table(table, None, head=True).columns if str(x) != "file"]
        keys |= {"labels": table.name, "columns": {name: name for name in beside_files}}
        notes.add(f"labels are in {table.name}, one row per file")
    else:
        folders = folder_columns(names)
        if not folders:
            raise RecordingError(
                f"{path}: needs a table labels.csv with column 'file', or a folder per class"
            )
        keys |= {"label_from": "folder", "columns": {name: name for name in folders}}
        notes.add("the folder of a file is its label")
    try:
        source = _read_folder(path, keys, data, notes)
    except RecordingError as error:
        if "has no known format" in str(error) or "no arrays t, x, y and p" in str(error):
            text = "a folder must hold event files; sampled signals go into one table, a row per sample"
            raise RecordingError(f"{path}: {text}; {error}") from None
        if "floating-point times need their unit" in str(error):
            text = "the unit of the times is not known; state it with --time-unit"
            raise RecordingError(f"{path}: {text}") from None
        raise
    notes.add(f"{source.n_recordings} event files of {source.width} x {source.height} addresses")
    columns, n_values = _label_candidates(source.columns, source.n_recordings, notes)
    data |= {key: value for key, value in keys.items() if key in ("labels", "label_from")}
    return Look(data | {"columns": columns}, n_values)
