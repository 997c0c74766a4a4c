"""What a user's file seems to hold: section `data` for it, label columns, and what was assumed.

A guess is made from names, types and shapes; each one is stated, so that it can be corrected.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dse.base.records import Array, Floats
from dse.data.recordings import EventSource, RecordingError, arrays
from dse.data.recordings.arrays import first_text, place, read_table
from dse.data.recordings.csv_head import LABEL, head_of
from dse.data.recordings.doubts import CLEARLY, SOME, smoothness
from dse.data.recordings.event_files import EventFiles, folder_columns
from dse.data.recordings.files import TABLES, TEXTS, files_below, tables_below
from dse.data.recordings.formats.arrays import USUAL
from dse.data.recordings.source import as_labels
from dse.data.recordings.table import UNITS_MS, is_even, numbered
from dse.data.recordings.time_series import sample_columns

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
LABELS = re.compile(
    r"(?:label|labels|class|target|y|texture|material|fabric|cloth|object|letter|digit|gesture|shape|folder|"
    r"activity)$",
    re.IGNORECASE,
)
"""Names of label columns."""
_SHORTEST_RUN = 20  # rows with one label of a log, in the mean
_FEWEST_SAMPLES = 4
"""Sample columns that make a table a wide one."""
_JITTER = 0.1  # share of a step by which times may differ without a word
_STRAY = 0.1  # share of cells without a number that a column of numbers may have by mistake
_POLARITIES = 2
_WIDEST = 1 << 15  # addresses of a frame that is not known yet


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
    refused: a column that is no label -> why.
    """

    data: dict[str, Any]
    n_values: Mapping[str, int]
    assumed: tuple[str, ...] = ()
    refused: Mapping[str, str] = field(default_factory=dict)

    @property
    def lacks_step(self) -> bool:
        """Whether the sampling period is in none of the file's names and numbers."""
        return "step_ms" in self.data and self.data["step_ms"] is None


def look(path: Path, options: Options) -> Look:
    """Return what a file or a folder seems to hold.

    Raises:
        RecordingError: it does not exist, or holds nothing that can be read as recordings.
    """
    of = _Looking(path, options)
    if path.is_dir() and not of.is_of_tables:
        guess = of.of_folder()
    elif not (path.is_file() or path.is_dir()):
        what = (
            "must be a file or a folder, got a pipe or device" if path.exists() else "no such file or folder"
        )
        raise RecordingError(f"{path}: {what}")
    elif arrays.is_table(path):
        guess = of.of_table()
    elif path.suffix.lower() in arrays.ARRAYS:
        guess = of.of_arrays()
    elif path.suffix.lower() in (".xlsx", ".xls", ".ods"):
        raise RecordingError(f"{path.name}: spreadsheets are not read; save the sheet as CSV")
    else:
        raise RecordingError(
            f"{path.name}: must be a table (.csv, .tsv, .txt, .parquet), arrays (.npz, .npy, .mat, .h5, "
            ".ts), or a folder of tables or event files"
        )
    if options.step_ms is not None and "step_ms" not in guess.data:
        raise RecordingError(f"{path.name}: --step-ms is for sampled signals and spikes, not for events")
    if options.step_ms is not None:
        guess.data["step_ms"] = options.step_ms
    return replace(guess, assumed=tuple(of.assumed), refused=of.refused)


@dataclass
class _Looking:
    """A look at a file or a folder, and what it assumes on the way.

    refused: why columns are no labels.
    """

    path: Path
    options: Options
    assumed: list[str] = field(default_factory=list)
    refused: dict[str, str] = field(default_factory=dict)

    def _refuse(self, sentence: str) -> RecordingError:
        return RecordingError(f"{self.path.name}: {sentence}")

    @property
    def is_of_tables(self) -> bool:
        """Whether a folder holds nothing but tables, those of labels aside, and none of them is of events."""
        names, tables = files_below(self.path, "**/*"), tables_below(self.path)
        others = {x for x in names if not x.startswith("labels.")} - {*tables}
        if not tables or others:
            return False
        known = {str(x).lower() for x in arrays.column_names(self.path)}
        return not all(known & {*USUAL[key]} for key in "txp")  # taxels have no y

    # ---- tables

    def of_table(self) -> Look:
        """Return a look at a table: a row per recording, per value, or per sample."""
        import pandas

        table = read_table(self.path, None)
        table.columns = table.columns.map(str)
        if table.empty:
            raise self._refuse("the table has no rows")
        one = self.path / tables_below(self.path)[0] if self.path.is_dir() else self.path
        if one.suffix.lower() in TEXTS and (unnamed := head_of(one).names) is not None:
            label = f", '{LABEL}' is the {'first' if unnamed[0] == LABEL else 'last'}" * (LABEL in unnamed)
            self.assumed.append(f"the first line names no columns: they are numbered from 0{label}")
        names, dates = list(table.columns), []
        for name in (name for name in names if _time_unit(name) is not None):
            if (ms := arrays.dates_ms(table[name].to_numpy())) is not None:
                table[name] = ms
                dates.append(name)
        usual: str | None = (
            "file" if self.path.is_dir() else next((x for x in names if _RECORDINGS.match(x)), None)
        )
        recording = self.options.recording or usual
        if recording is not None and recording not in names:
            raise self._refuse(f"no column '{recording}'; there are {', '.join(names)}")
        number: Array | None = None if recording is None else pandas.factorize(table[recording])[0]
        self._check_cells(table, recording, number)
        numeric = [name for name in names if _is_numeric(table[name])]
        time = next((name for name in numeric if _time_unit(name) is not None), None)
        if time is None and not self.path.is_dir() and (starts := _sample_starts(numeric)):
            return self._wide(table, starts)
        t_ms, unit = np.zeros(0), "ms"
        if time is not None:
            stated = "ms" if time in dates else self.options.time_unit or _time_unit(time)
            unit = stated or self._unit_of(table[time])
            t_ms = table[time].to_numpy(np.float64) * UNITS_MS[unit]
        channel = next((name for name in names if _CHANNELS.match(name)), None)
        value = next((name for name in numeric if _VALUES.match(name)), None)
        data: dict[str, Any] = {"kind": "table", "file": self.options.place(self.path), "step_ms": None}
        if channel is not None and value is not None and time is not None:
            code, known = pandas.factorize(table[channel], sort=True)
            channels = [str(x) for x in known]
            number = numbered(t_ms, code) if number is None else number
            self.assumed.append(
                f"a row is a value of '{channel}' ({len(channels)} channels: {_some(channels)}) at '{time}' "
                f"in {unit}; {_separation(recording, number)}"
            )
            data |= {"kind": "long_table", **self._step(t_ms, number * len(channels) + code)}
            data |= {"time": time, "time_unit": unit, "channel": channel, "value": value}
            data |= {"channels": channels, "recording": recording}
            rest = [name for name in names if name not in (time, channel, value, recording)]
            return self._labelled(data, table, rest, number, recording)
        if number is None and time is None:
            raise self._refuse(
                "must have a column of times or one that tells recordings apart (--recording NAME), got "
                + _some(names)
            )
        number = numbered(t_ms) if number is None else number
        if number.max() == 0 and recording is None:
            number = self._runs(table, t_ms)
        if number.max() == 0:
            raise self._refuse(
                "must hold several recordings, got one; a column that tells them apart is named by "
                "--recording NAME"
            )
        rest = [name for name in names if name not in (time, recording)]
        changing = [name for name in rest if _changes(table[name], number)]
        channels = [name for name in changing if name in numeric]
        if not channels:
            texts = (f"'{name}' with {first_text(table[name].to_numpy(), self.path)}" for name in changing)
            raise self._refuse(
                "must have a column of numbers that change within a recording, got "
                + (", ".join(texts) or _some(rest))
            )
        self.assumed.append(
            f"a row is a sample of {len(channels)} channel{'s' * (len(channels) > 1)} ({_some(channels)}); "
            f"{_separation(recording, number)}"
        )
        data |= {"channels": channels, "recording": recording}
        data |= {} if time is None else self._step(t_ms, number) | {"time": time, "time_unit": unit}
        fixed = [name for name in rest if name not in channels]
        return self._labelled(data, table, fixed, number, recording)

    def _runs(self, table: pd.DataFrame, t_ms: Floats) -> Array:
        """Return the number of the recording of each row of a log, where one begins when a label changes."""
        labels = []
        for name in table.columns:
            column = table[name]
            runs = int((column != column.shift()).sum())
            if (not _is_numeric(column) or LABELS.match(name)) and 1 < runs <= len(column) / _SHORTEST_RUN:
                labels.append(column.to_numpy())
                self.assumed.append(f"'{name}' changes {runs - 1} times: a recording begins at each change")
        return numbered(t_ms, None, labels)

    def _wide(self, table: pd.DataFrame, starts: list[str]) -> Look:
        samples = [name for start in starts for name in sample_columns(list(table.columns), start)]
        rest = [name for name in table.columns if name not in samples]
        self.assumed.append(
            f"a row is a recording: {len(table)} rows; the columns {samples[0]} to {samples[-1]} are its "
            f"samples, {len(starts)} channel{'s' * (len(starts) > 1)} of {len(samples) // len(starts)}"
        )
        place = self.options.place(self.path)
        data = {"kind": "wide_table", "file": place, "step_ms": None, "samples": starts}
        columns, n_values = self._candidates({name: table[name] for name in rest}, len(table), self.path)
        if (file := self._labels_file(bool(columns))) is not None:
            beside = _labels_in(file)
            for name in set(rest) & set(beside):
                if not np.array_equal(table[name].astype(str), beside[name].astype(str)):
                    raise RecordingError(
                        f"{file}: '{name}' must be as in {self.path.name}, in the same order"
                    )
            columns, n_values = self._candidates(beside, len(table))
            data["labels"] = self._labels_at(file, "in the order of the recordings")
        return Look(data | {"columns": columns}, n_values)

    def _labelled(
        self,
        data: dict[str, Any],
        table: pd.DataFrame,
        names: Sequence[str],
        number: Array,
        recording: str | None,
    ) -> Look:
        """Return a look at a table of samples with its label columns, or with those of a table beside it."""
        first = np.unique(number, return_index=True)[1]
        for name in (name for name in names if _changes(table[name], number)):
            column, empty = table[name].to_numpy(), table[name].isna().to_numpy()
            row = int((empty | (column != column[first][number])).argmax())
            what = "is empty" if empty[row] else "changes within a recording"
            self.refused[name] = f"{what} in {place(self.path, row)}"
        fixed = {name: table[name].iloc[first] for name in names if name not in self.refused}
        columns, n_values = self._candidates(fixed, len(first), self.path)
        if (file := self._labels_file(bool(columns) or recording is None)) is not None:
            if recording is None:
                raise self._refuse(f"labels in {file} need a column that tells recordings apart")
            labels = read_table(file, None)
            labels.columns = labels.columns.map(str)
            if recording not in labels:
                raise RecordingError(
                    f"{file}: no column '{recording}', which names the recordings of {self.path.name}"
                )
            data = data | {"labels": self._labels_at(file, f"one row per '{recording}'")}
            rest = {name: labels[name] for name in labels.columns if name != recording}
            columns, n_values = self._candidates(rest, len(labels), file)
        return Look(data | {"columns": columns}, n_values)

    def _labels_file(self, has_labels: bool) -> Path | None:
        """Return the file of labels that is stated, or that lies beside recordings without labels."""
        if self.options.labels is not None or has_labels:
            return None if self.options.labels is None else Path(self.options.labels)
        stem = self.path.stem
        names = [f"{stem}_labels", f"labels_{stem}", "labels", "metadata", "meta", "y"]
        files = (self.path.with_name(f"{name}{suffix}") for name in names for suffix in (*TABLES, ".npy"))
        return next((file for file in files if file.is_file() and file != self.path), None)

    def _labels_at(self, file: Path, how: str) -> str:
        """Return the key `labels` for a file, and note how its rows are those of the recordings."""
        self.assumed.append(f"labels are in {file}, {how}")
        return self.options.place(file)

    def _unit_of(self, times: pd.Series[Any]) -> str:
        """Return the unit in which the smallest steps are those of a sensor, some 0.5 to 500 ms."""
        steps = np.diff(times.to_numpy(np.float64))
        steps = steps[steps > 0]
        typical = float(np.median(steps)) if len(steps) else 1.0
        unit = "s" if typical < 0.5 else "ms" if typical < 500 else "us"
        self.assumed.append(
            f"'{times.name}' rises by {typical:g}, so it is taken to be in {unit}; --time-unit states another"
        )
        return unit

    def _step(self, t_ms: Floats, number: Array) -> dict[str, Any]:
        """Return the keys step_ms, the usual step of times, and `resample` where not all times are even.

        t_ms, number: (row,) time, and number of the series, of each.
        """
        order = np.argsort(number, kind="stable")
        t_ms, number = t_ms[order], number[order]
        steps = np.diff(t_ms)[np.diff(number) == 0]
        if not len(steps):
            raise RecordingError("every recording must have several samples, got one")
        step_ms = self.options.step_ms or float(f"{np.median(steps):.4g}")
        parts = np.split(t_ms, np.flatnonzero(np.diff(number)) + 1)
        n_uneven = sum(not is_even(part, step_ms) for part in parts)
        self.assumed.append(f"a step is {step_ms:g} ms, the median of the times")
        if n_uneven:
            self.assumed.append(
                f"{n_uneven} of {len(parts)} series have uneven times: resampled every {step_ms:g} ms"
            )
        elif (off_ms := float(np.abs(steps - step_ms).max())) > _JITTER * step_ms:
            self.assumed.append(
                f"steps differ from that by up to {off_ms:.2g} ms; samples are taken as they are"
            )
        return {"step_ms": step_ms} | ({"resample": "linear"} if n_uneven else {})

    def _check_cells(self, table: pd.DataFrame, recording: str | None, number: Array | None) -> None:
        """Refuse a table in which few cells of a column are no numbers, while the others are.

        A column that does not change within a recording is a label, whatever it holds.
        """
        import pandas

        for name in (name for name in table.columns if name != recording and not _is_numeric(table[name])):
            column = table[name].dropna()
            share = float(pandas.to_numeric(column, errors="coerce").isna().mean()) if len(column) else 0.0
            if 0 < share < _STRAY and (number is None or _changes(table[name], number)):
                got = first_text(table[name].to_numpy(), self.path)
                raise self._refuse(f"column '{name}' must hold numbers, got {got}")

    # ---- label columns

    def _candidates(
        self, columns: Mapping[str, Any], n: int, table: Path | None = None
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
                row = int(getattr(values, "index", range(n))[i])
                where = f"recording {i}" if table is None else place(table, row)
                self.refused[name] = f"is empty in {where}"
                continue
            if array.dtype.kind in "UO":
                texts = array.astype(str)
                array = np.char.strip(texts)
                if (array != texts).any():
                    self.assumed.append(f"labels of '{name}' are read without blanks at their ends")
            if 1 < (k := len(np.unique(array))) < n:
                kept[name] = k
            else:
                self.refused[name] = f"has {k} value{'s' * (k > 1)} in {n} recordings"
        short = {name: name.rpartition("/")[2] for name in kept}  # of arrays in a group of HDF5
        short |= {arrays.ONE: "label"} if arrays.ONE in kept else {}  # that of an .npy file has no name
        if len(set(short.values())) < len(short):
            short = {name: name for name in kept}
        return {short[name]: name for name in kept}, {short[name]: k for name, k in kept.items()}

    # ---- arrays

    def of_arrays(self) -> Look:
        """Return a look at arrays: events, a cube, recordings end to end, or spikes."""
        path, shapes = self.path, arrays.headers(self.path)
        vectors = {name: shape[0] for name, shape in shapes.items() if len(shape) == 1}
        events = {
            key: next((x for x in shapes if x.rpartition("/")[2].lower() in (*usual, f"{key}_us")), None)
            for key, usual in USUAL.items()
        }
        if self.options.signal is None and events["t"] and events["x"] and "offsets" in shapes:
            return self._events({key: name for key, name in events.items() if name is not None}, vectors)
        signal = self.options.signal or _largest(shapes)
        if not shapes:
            raise self._refuse("the file holds no arrays")
        if signal is None or signal not in shapes:
            raise self._refuse(f"no array of recordings ({_some(list(shapes))}); --signal NAME names it")
        shape, vectors = shapes[signal], {name: n for name, n in vectors.items() if name != signal}
        data: dict[str, Any] = {"file": self.options.place(path), "step_ms": None}
        series = {"kind": "time_series", **data, "signal": signal}
        names, beside, labels = vectors, {}, {}
        if (label_file := self._labels_file(bool(vectors))) is not None:
            labels = _labels_in(label_file)
            beside = {"labels": self._labels_at(label_file, "in the order of the recordings")}
            names = {name: len(x) for name, x in labels.items()}
        ends = (name for name in vectors if len(shape) == 2 and _are_borders(path, name, shape[0]))
        if (offsets := next(ends, None)) is not None:
            n = vectors[offsets] - 1
            data = series | {"offsets": offsets}
            self.assumed.append(
                f"'{signal}' holds {n} recordings of {shape[1]} channels end to end, with borders '{offsets}'"
            )
        elif "packed" in signal.lower() and len(shape) > 1:
            raster, n = self._packed(shapes, signal, set(vectors.values()))
            data = {"kind": "raster", **data, **raster}
        elif -1 in shape:
            data, n = series, shape[0]
            self.assumed.append(
                f"'{signal}' holds {n} recordings of {shape[2]} channels, of different lengths"
            )
        elif len(shape) in (2, 3, 4):
            samples = arrays.load(path, [signal])[signal]
            axes = _axes(samples, set(names.values()))
            n = shape[axes.index("recording")]
            sizes = ", ".join(f"{size} {name}s" for name, size in zip(axes, shape, strict=True))
            if samples.dtype.kind in "bu" and samples.max(initial=0) <= 1:
                named = " ".join("sample" if name == "recording" else name for name in axes)
                data = {"kind": "raster", **data, "array": signal, "axes": named}
                sizes += ", of spikes, as all values are 0 or 1"
            else:
                usual = axes == ["recording", "step", "channel"]
                data = series | ({} if usual else {"axes": " ".join(axes)})
            self.assumed.append(f"'{signal}' is ({sizes})")
        else:
            raise self._refuse(f"'{signal}' must have 2 to 4 axes, got shape {shape}; --signal NAME")
        known = {name: of for name, of in arrays.described(path).items() if name != signal}
        used = (signal, *arrays.halves(known).get(signal, ()))
        alike = [x for x, of in shapes.items() if len(of) == len(shape) > 2 and x not in used]
        if alike:
            self.assumed.append(f"not read: {_some(alike)}, with as many axes; --signal NAME names another")
        matrices = () if labels else (x for x, of in shapes.items() if len(of) == 2 and of[0] == n != 0)
        names |= {x: n for x in matrices if x != signal and as_labels(arrays.load(path, [x])[x]).ndim == 1}
        candidates = [name for name, length in names.items() if length == n]
        loaded = {name: labels[name] for name in candidates} if labels else arrays.load(path, candidates)
        values = {name: as_labels(x) for name, x in loaded.items()}
        guess = self._with_labels(data | beside, values, n, {} if label_file else vectors)
        step_ms = _stated_step(path, shapes)
        if step_ms is not None:
            guess.data["step_ms"] = step_ms
            self.assumed.append(f"a step is {step_ms:g} ms, as the file states")
        return guess

    def _with_labels(
        self, data: dict[str, Any], values: Mapping[str, Array], n: int, vectors: Mapping[str, int]
    ) -> Look:
        """Return a look with those arrays of values that may be labels, and with the names of their codes."""
        columns, n_values = self._candidates(values, n)
        codes = {column: values[name] for column, name in columns.items()}
        class_names = _class_names(self.path, vectors, codes)
        named = {"class_names": class_names} if class_names else {}
        return Look(data | {"columns": columns} | named, n_values)

    def _packed(self, shapes: arrays.Shapes, signal: str, n_labels: set[int]) -> tuple[dict[str, Any], int]:
        """Return the keys of an array of packed bits, and the number of its recordings.

        The axis of steps is the one that is longer in the unpacked shape, if an array such as `shape` holds
        it, else the longest.
        """
        sizes = shapes[signal]
        recording, others = _recording_axis(sizes, n_labels)
        step = max(others, key=lambda k: sizes[k])
        full = [size * (8 if k == step else 1) for k, size in enumerate(sizes)]
        of_shape = (x for x, shape in shapes.items() if shape == (len(sizes),) and "shape" in x.lower())
        if (name := next(of_shape, None)) is not None:
            full = arrays.load(self.path, [name])[name].tolist()
            step = next((k for k in others if full[k] != sizes[k]), step)
        axes = " ".join(_names_of(sizes, {recording: "sample", step: "step"}))
        self.assumed.append(
            f"'{signal}' is ({axes}) = {tuple(full)} of spikes, packed as bits along its steps"
        )
        raster = {"array": signal, "axes": axes, "packed": True} | ({"shape": name} if name else {})
        return raster, full[recording]

    def _events(self, given: Mapping[str, str], vectors: Mapping[str, int]) -> Look:
        loaded = arrays.load(self.path, [name for key, name in given.items() if key in "xy"])
        ends = {key: int(loaded[name].max(initial=0)) + 1 for key, name in given.items() if key in "xy"}
        n = vectors["offsets"] - 1
        data: dict[str, Any] = {
            "kind": "events", "file": self.options.place(self.path), "width": ends["x"], "t_us": given["t"],
            ("taxel" if "taxel" in given["x"] else "x"): given["x"],
        }  # fmt: skip
        if "y" in given:
            data |= {"height": ends["y"], "y": given["y"]}
        if "p" in given:
            data["polarity"] = given["p"]
        self.assumed.append(
            f"{n} recordings of events at {ends['x']} x {ends.get('y', 1)} addresses, times in us"
        )
        values = arrays.load(self.path, [name for name, length in vectors.items() if length == n])
        return self._with_labels(data, values, n, vectors)

    # ---- folders

    def of_folder(self) -> Look:
        """Return a look at a folder of event files, with a table of labels or a folder per class."""
        path = self.path
        table = next((x for suffix in TABLES if (x := path / f"labels{suffix}").is_file()), None)
        names = [name for name in files_below(path, "**/*") if table is None or name != table.name]
        if not names:
            raise RecordingError(f"{path}: the folder holds no files")
        keys: dict[str, Any] = {}
        if self.options.time_unit is not None:
            keys["time_unit"] = self.options.time_unit
        if table is not None:
            columns = [x for x in arrays.column_names(table) if x != "file"]
            keys["labels"] = table.name
            self.assumed.append(f"labels are in {table.name}, one row per file")
        else:
            columns = folder_columns(names)
            if not columns:
                raise RecordingError(
                    f"{path}: needs a table labels.csv with column 'file', or a folder per class"
                )
            keys["label_from"] = "folder"
            self.assumed.append("the folder of a file is its label")
        try:
            source = self._read_folder(keys, {name: name for name in columns})
        except RecordingError as error:
            if "has no known format" in str(error) or "no arrays t, x, y and p" in str(error):
                text = "a folder must hold event files, or tables alone, with a row per sample"
                raise RecordingError(f"{path}: {text}; {error}") from None
            if "floating-point times need their unit" in str(error):
                text = "the unit of the times is not known; state it with --time-unit"
                raise RecordingError(f"{path}: {text}") from None
            raise
        self.assumed.append(
            f"{source.n_recordings} event files of {source.width} x {source.height} addresses"
        )
        found, n_values = self._candidates(source.columns, source.n_recordings)
        data = {"kind": "event_files", "folder": self.options.place(path), **keys, "columns": found}
        return Look(data, n_values)

    def _read_folder(self, keys: dict[str, Any], columns: dict[str, str]) -> EventSource:
        """Return the event files of a folder; a frame that they do not state is added to the keys."""
        folder = str(self.path.absolute())
        try:
            return EventFiles(folder, columns=columns, **keys).read(self.path.parent)
        except RecordingError as error:
            if "data.width and data.height" not in str(error):
                raise
        wide = EventFiles(folder, columns=columns, width=_WIDEST, height=_WIDEST, **keys)
        events = wide.read(self.path.parent)
        blocks = [block for i in range(events.n_recordings) for block in events.blocks(i)]
        keys["width"], keys["height"] = (
            max(int(getattr(block, key).max(initial=0)) for block in blocks) + 1 for key in "xy"
        )
        self.assumed.append("the files do not state their frame: it is as large as the addresses need")
        return EventFiles(folder, columns=columns, **keys).read(self.path.parent)


def _labels_in(path: Path) -> dict[str, Array]:
    """Return the vectors of a file of labels."""
    values = {name: x for name, x in arrays.load(path).items() if x.ndim == 1}
    is_table = arrays.is_table(path)
    return {name: arrays.complete(x, name, path) for name, x in values.items()} if is_table else values


def _time_unit(name: str) -> str | None:
    """Return the unit that the name of a column of times states, '' if it states none; None: no times."""
    if name.lower() in _UNIT_NAMES:
        return _UNIT_NAMES[name.lower()]
    match = _TIMES.match(name)
    return None if match is None else _UNITS.get((match[1] or "").lower(), "")


def _sample_starts(numeric: Sequence[str]) -> list[str]:
    """Return the beginnings of names that several numbered columns of numbers share, equally many each."""
    starts = [match[1] for name in numeric if (match := re.fullmatch(r"(.*?)(\d+)", name))]
    counts = {start: starts.count(start) for start in dict.fromkeys(starts)}
    most = max(counts.values(), default=0)
    return [start for start, n in counts.items() if n == most] if most >= _FEWEST_SAMPLES else []


def _is_numeric(column: pd.Series[Any]) -> bool:
    return column.dtype.kind in "biuf"


def _changes(column: pd.Series[Any], number: Array) -> bool:
    """Return whether a column has several values within a recording."""
    return bool(column.groupby(number).nunique(dropna=False).max() > 1)


def _separation(recording: str | None, number: Array) -> str:
    how = (
        "a recording begins where time falls or a label changes"
        if recording is None
        else f"'{recording}' tells recordings apart"
    )
    return f"{how}: {int(number.max()) + 1} recordings"


def _some(names: Sequence[str]) -> str:
    return ", ".join(names) if len(names) <= 4 else f"{', '.join(names[:3])}, ... {names[-1]}"


def _largest(shapes: arrays.Shapes) -> str | None:
    """Return the array of packed bits, or that with most values among those of two to four axes."""
    if packed := next((name for name, x in shapes.items() if "packed" in name.lower() and len(x) > 1), None):
        return packed
    sizes = {name: abs(int(np.prod(shape))) for name, shape in shapes.items() if len(shape) in (2, 3, 4)}
    ragged = [name for name, shape in shapes.items() if -1 in shape]
    return ragged[0] if ragged else max(sizes, key=lambda name: sizes[name], default=None)


def _are_borders(path: Path, name: str, n_rows: int) -> bool:
    borders = arrays.load(path, [name])[name]
    ends = borders.dtype.kind in "iu" and len(borders) > 1 and borders[0] == 0 and borders[-1] == n_rows
    return bool(ends and (np.diff(borders.astype(np.int64)) > 0).all())


def _axes(samples: Array, n_labels: set[int]) -> list[str]:
    """Return names of axes: recordings are as many as labels; steps are those of frames, smooth or many."""
    recording, others = _recording_axis(samples.shape, n_labels)
    n = samples.shape[recording]
    some = np.take(samples, np.arange(0, n, max(1, n // SOME)), recording)
    places = [k for k in others if samples.shape[k] != _POLARITIES] or others
    if len(places) == 3:  # rows and columns are neighbours, and more alike than either is like steps
        before, between, after = (math.log(max(1, samples.shape[k])) for k in places)
        step = places[0] if abs(between - after) <= abs(before - between) else places[2]
    else:
        step = max(places, key=lambda k: samples.shape[k])
        step = max(places, key=lambda k: smoothness(some, k) + (CLEARLY if k == step else 0.0))
    return _names_of(samples.shape, {recording: "recording", step: "step"})


def _recording_axis(sizes: tuple[int, ...], n_labels: set[int]) -> tuple[int, list[int]]:
    """Return the axis of recordings, as many as labels, and the others."""
    recording = next((k for k, size in enumerate(sizes) if size in n_labels), 0)
    return recording, [k for k in range(len(sizes)) if k != recording]


def _names_of(sizes: tuple[int, ...], known: Mapping[int, str]) -> list[str]:
    """Return the names of all axes; of several others, one of two is polarity."""
    rest = [k for k in range(len(sizes)) if k not in known]
    planes = [k for k in rest if sizes[k] == _POLARITIES][: len(rest) > 1]
    places = [k for k in rest if k not in planes]
    usual = {1: ["taxel" if planes else "channel"], 2: ["row", "column"]}
    names = {**known, **dict.fromkeys(planes, "polarity")}
    names |= zip(places, usual.get(len(places), [f"axis_{k}" for k in places]), strict=True)
    return [names[k] for k in range(len(sizes))]


def _class_names(path: Path, vectors: Mapping[str, int], labels: Mapping[str, Array]) -> dict[str, str]:
    """Return which arrays of texts name the codes of label columns."""
    texts = {}
    for name in (name for name in vectors if re.search(r"names?$|classes$", name, re.IGNORECASE)):
        array = arrays.load(path, [name])[name]
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


def _stated_step(path: Path, shapes: arrays.Shapes) -> float | None:
    """Return the sampling period that a number in the file states by its name, in ms."""
    for name, shape in shapes.items():
        if int(np.prod(shape)) != 1:
            continue
        factor = _STEPS.get(name.lower())
        if factor is None and not _RATES.match(name):
            continue
        number = float(np.ravel(arrays.load(path, [name])[name])[0])
        if number > 0:
            return number * factor if factor is not None else 1000 / number
    return None
