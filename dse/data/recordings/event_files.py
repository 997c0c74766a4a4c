"""Event recordings in files of their own: a folder, which of its files, and where their labels are.

    data:
      kind: event_files
      folder: N-MNIST
      pattern: "**/*.bin"
      label_from: folder
      columns: {digit: folder, part: folder2}    # N-MNIST/Train/7/00042.bin

Memory holds names, formats and labels alone: the events of a recording are read on request.
"""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any, ClassVar, Self

import numpy as np

from dse.base.records import Array, Block, FrontEnd
from dse.base.registry import fixed, register
from dse.config.faults import known_names
from dse.data.recordings import RecordingError, arrays
from dse.data.recordings.files import by_path, content, content_of, files_below, locate
from dse.data.recordings.formats import Format, Repairs, checked, detect, named
from dse.data.recordings.formats.arrays import UNITS_US, USUAL
from dse.data.recordings.source import columns_key, label_columns

AUTO = "auto"

LEFT_OUT = "--repair skips the file"
FILE = "file"
"""Column of a label table with the path of a row's file."""
FOLDER = "folder"

_MOST_NAMED = 5
_MOST_NOTES = 50


@register("recordings", "event_files")
@dataclasses.dataclass(frozen=True)
class EventFiles:
    """A folder of event files, one recording each; labels come from a table or from folder names.

    Recordings come in the order of the label table, without one in the order of their paths. What begins
    with a dot is no recording, nor is the label table.
    """

    folder: str = fixed(
        doc="folder of the recordings: an absolute path, or relative to the YAML file or to $DSE_DATA"
    )
    pattern: str = fixed(
        "**/*", doc="glob pattern of the files, relative to the folder, in quotes; ** matches any folders"
    )
    labels: str | None = fixed(
        None, doc="label table (.csv or .parquet) whose column `file` holds the path of every file"
    )
    label_from: str | None = fixed(
        None,
        doc="labels are folder names: `folder` is the folder of the file, `folder2` the one above, ...",
        choices=(FOLDER,),
    )
    format: str = fixed(
        AUTO, doc="format of the files, e.g. aedat4; auto: recognised from the first bytes and the name"
    )
    width: int | None = fixed(
        None, doc="number of columns, addresses 0 to width - 1 (default: as stated in the files)", low=1
    )
    height: int | None = fixed(
        None, doc="number of rows, addresses 0 to height - 1 (default: as stated in the files)", low=1
    )
    arrays: Mapping[str, str] = fixed(
        factory=dict,
        doc="names of the arrays t, x, y and p in .npz, .h5 and .csv files (default: the usual names)",
    )
    time_unit: str | None = fixed(
        None,
        doc="unit of the times in .npz, .h5 and .csv files (default: integers are us)",
        choices=tuple(UNITS_US),
    )
    repair: bool = fixed(
        False, doc="repair damaged files or leave them out, with a warning for each, instead of stopping"
    )
    columns: Mapping[str, str] = columns_key()

    def __post_init__(self) -> None:
        if self.labels is not None and self.label_from is not None:
            raise RecordingError("data.labels and data.label_from exclude each other, got both")
        if self.columns and self.labels is None and self.label_from is None:
            raise RecordingError("data.columns must come from data.labels or data.label_from, got neither")
        if (self.width is None) != (self.height is None):
            raise RecordingError("data.width and data.height must be given together, got one of them")
        if self.format != AUTO:
            named(self.format)
        for key in self.arrays:
            if key not in USUAL:
                raise RecordingError(f"data.arrays must have keys of t, x, y and p, got '{key}'")

    def check(self, base: Path) -> list[str]:
        """Return what names, label table and headers show to be wrong; no events are read.

        With `repair`, files with a wrong header are left out; that is a fault only where no file remains.
        """
        return self._examined(base).faults

    def with_columns_found(self, base: Path) -> Self:
        """Return the component with only the label columns that there are; a table of other files is none."""
        known: list[str] = []
        try:
            _, table, names = self._files(base)
            if self.label_from is not None:
                known = folder_columns(names)
            elif table is not None and set(names).intersection(_table_files(table)):
                known = arrays.column_names(table)
        except RecordingError:
            pass
        columns = {column: name for column, name in self.columns.items() if name in known}
        return dataclasses.replace(self, columns=columns, labels=self.labels if columns else None)

    def content(self, base: Path) -> str:
        """Return a hash of the files' paths below the folder, of what is in them, and of the label table."""
        folder, table, names = self._files(base)
        of_files = content_of(folder, names)
        return of_files if table is None else f"{of_files} {content(table)}"

    def channel_positions(self, base: Path) -> None:
        """Return None: an event's position is its address."""

    def read(self, base: Path) -> FolderEvents:
        """Return the recordings; with `repair`, files that hold no valid event are left out."""
        whole = self._examined(base)
        for fault in whole.faults:
            raise RecordingError(fault)
        left_out = dict(whole.left_out)
        if self.repair:
            found = {name: whole.unusable(name) for name in whole.formats}
            left_out |= {name: why for name, why in found.items() if why is not None}
        usable = [i for i, name in enumerate(whole.names) if name not in left_out]
        if not usable:
            raise RecordingError(
                f"{self.folder}: no file is usable; the first fault: {min(left_out.values())}"
            )
        return dataclasses.replace(
            whole,
            names=tuple(whole.names[i] for i in usable),
            columns={column: values[usable] for column, values in whole.columns.items()},
            left_out=left_out,
        )

    def _files(self, base: Path) -> tuple[Path, Path | None, list[str]]:
        """Return the folder, the label table and the recordings' paths below the folder."""
        folder = locate(self.folder, base, "folder")
        names = files_below(folder, self.pattern)
        if self.labels is None:
            return folder, None, names
        inside = folder / self.labels
        table = inside if inside.is_file() else locate(self.labels, base)
        same = {name for name in names if name.endswith(table.name) and (folder / name).samefile(table)}
        return folder, table, [name for name in names if name not in same]

    def _examined(self, base: Path) -> FolderEvents:
        """Return everything that is known without reading events, with what is wrong with it."""
        try:
            folder, table, names = self._files(base)
            if not names:
                raise RecordingError(f"{self.folder}: no file in it matches the pattern '{self.pattern}'")
        except RecordingError as error:
            return FolderEvents(0, 0, {}, Path(), (), {}, self.repair, faults=[str(error)])
        faults: list[str] = []
        columns: dict[str, Array] = {}
        if table is not None:
            names, columns, faults = labels_of_table(names, table, self.columns)
        elif self.label_from is not None:
            columns, faults = labels_of_folders(names, self.columns)
        formats: dict[str, Format] = {}
        frames: dict[str, tuple[int, int] | None] = {}
        left_out: dict[str, str] = {}
        for name in names:
            try:
                form: Any = detect(folder / name) if self.format == AUTO else named(self.format)
                keys = {key: getattr(self, key) for key in ("arrays", "time_unit") if hasattr(form, key)}
                formats[name] = dataclasses.replace(form, **keys)
                frames[name] = formats[name].frame(folder / name)
            except RecordingError as error:
                formats.pop(name, None)
                left_out[name] = f"{by_path(error, name)}; {LEFT_OUT}"
        if not (self.repair and formats):
            faults += list(left_out.values())[:_MOST_NAMED]
            if len(left_out) > _MOST_NAMED:
                faults.append(f"{self.folder}: {len(left_out) - _MOST_NAMED} more files of the same kind")
        frame = self._frame(frames, faults) if frames else (0, 0)
        return FolderEvents(
            *frame, columns, folder, tuple(names), formats, self.repair, left_out, faults=faults
        )

    def _frame(self, frames: Mapping[str, tuple[int, int] | None], faults: list[str]) -> tuple[int, int]:
        """Return the frame of all files; where they contradict each other or the keys, that is a fault."""
        stated: dict[tuple[int, int], str] = {}
        for name, frame in frames.items():
            if frame is not None:
                stated.setdefault(frame, name)
        if self.width is not None and self.height is not None:
            of_keys = (self.width, self.height)
            others = [(name, frame) for frame, name in stated.items() if frame != of_keys]
            faults += [
                f"{name}: data.width and data.height must be {_by(frame)} as in the file, got {_by(of_keys)}"
                for name, frame in others[:_MOST_NAMED]
            ]
            return of_keys
        silent = next((name for name, frame in frames.items() if frame is None), None)
        if silent is not None:
            faults.append(f"data.width and data.height must be given: {silent} does not state its frame")
        elif len(stated) > 1:
            got = " and ".join(f"{_by(frame)} in {name}" for frame, name in list(stated.items())[:2])
            faults.append(f"{self.folder}: all files must have the same frame, got {got}")
        return next(iter(stated), (0, 0))


def _by(frame: tuple[int, int]) -> str:
    return f"{frame[0]} x {frame[1]}"


@dataclasses.dataclass(frozen=True)
class FolderEvents:
    """Event recordings of files, which are read on request; recording i is the file `names[i]` of `folder`.

    width, height: the frame of all of them.
    columns: label columns, each (n,).
    formats: name -> what reads the file.
    repair: whether damaged files are repaired; else they raise an error.
    left_out: name -> why the file was left out, one sentence.
    faults: what names, labels and headers show to be wrong.
    """

    width: int
    height: int
    columns: Mapping[str, Array]
    folder: Path
    names: tuple[str, ...]
    formats: Mapping[str, Format]
    repair: bool
    left_out: Mapping[str, str] = dataclasses.field(default_factory=dict)
    faults: list[str] = dataclasses.field(default_factory=list)
    front_end: ClassVar[FrontEnd | None] = "preprocessing"
    simulated: ClassVar[bool] = False
    _repaired: dict[int, list[str]] = dataclasses.field(default_factory=dict, init=False, compare=False)

    @property
    def n_recordings(self) -> int:
        return len(self.names)

    def blocks(self, i: int) -> Iterator[Block]:
        """Yield the events of recording i; every call reads its file."""
        repairs, whole = Repairs(self.names[i], self.repair), False
        try:
            yield from self._sound(self.names[i], repairs)
            whole = True
        finally:
            # A reader that stops early has met only some of the faults.
            if whole or i not in self._repaired:
                self._repaired[i] = repairs.notes

    def notes(self) -> list[str]:
        """Return what was repaired in the files read so far: a sentence for each file and kind of fault."""
        repaired = (note for i in sorted(self._repaired) for note in self._repaired[i])
        notes = [*self.left_out.values(), *repaired]
        more = len(notes) - _MOST_NOTES
        return notes if more <= 0 else [*notes[:_MOST_NOTES], f"{self.folder.name}: {more} more repairs"]

    def unusable(self, name: str) -> str | None:
        """Return why a file holds no valid event, None if it holds one; reading stops at the first."""
        repairs = Repairs(name, repair=True)
        try:
            if next(self._sound(name, repairs), None) is not None:
                return None
            why = repairs.notes[0].partition("; --repair")[0]
        except RecordingError as error:
            why = str(error)
        return f"{why}; {LEFT_OUT}"

    def _sound(self, name: str, repairs: Repairs) -> Iterator[Block]:
        try:
            blocks = self.formats[name].blocks(self.folder / name, repairs)
            yield from checked(blocks, self.width, self.height, repairs)
        except RecordingError as error:
            raise RecordingError(by_path(error, name)) from None
        except OSError as error:
            raise RecordingError(f"{name}: cannot be read: {error.strerror or error}") from None


# ---- labels


def _table_files(path: Path) -> list[str]:
    """Return the files that a label table names, in its order."""
    names = arrays.complete(arrays.load(path, [FILE])[FILE], FILE, path)
    return [PurePosixPath(str(name)).as_posix() for name in names.tolist()]


def labels_of_table(
    names: Sequence[str], path: Path, columns: Mapping[str, str]
) -> tuple[list[str], dict[str, Array], list[str]]:
    """Return the files in the order of a table's rows, their label columns, and what is wrong with these.

    `columns`: label column -> its name in the table.
    """
    faults: list[str] = []
    found: dict[str, Array] = {}
    try:
        known = arrays.column_names(path)
        needed = dict.fromkeys((FILE, *columns.values()))
        faults += [arrays.missing(path, name, known) for name in needed if name not in known]
        if FILE not in known:
            return list(names), {}, faults
        order = _table_files(path)
        values = arrays.load(path, [name for name in needed if name in known])
    except RecordingError as error:
        return list(names), {}, [*faults, str(error)]
    for rule, files in (
        ("one row per file, got several for", [name for name, rows in Counter(order).items() if rows > 1]),
        ("a file for every row, but there is none for", [x for x in dict.fromkeys(order) if x not in names]),
        ("a row for every file, but there is none for", [x for x in names if x not in set(order)]),
    ):
        if files:
            faults.append(f"{path.name}: must have {rule} {_some(files)}")
    for name in values:
        try:
            found[name] = arrays.complete(values[name], name, path)
        except RecordingError as error:
            faults.append(str(error))
    if faults:
        return list(names), {}, faults
    return order, label_columns(found, columns, {}, len(order), path.name), []


def labels_of_folders(names: Sequence[str], columns: Mapping[str, str]) -> tuple[dict[str, Array], list[str]]:
    """Return the names of the folders that files lie in as label columns, and what is wrong with these.

    `columns`: label column -> `folder` that the file lies in, `folder2` that this one lies in, ...
    """
    known = folder_columns(names)
    shallow = _some([name for name in names if name.count("/") == len(known)])
    faults = [
        f"data.columns: every file must lie in a folder '{name}', but {shallow} does not; "
        f"{known_names(name, known)}"
        for name in dict.fromkeys(columns.values())
        if name not in known
    ]
    above = [name.split("/")[-2::-1] for name in names]
    levels = {column: known.index(name) for column, name in columns.items() if name in known}
    return {column: np.array([x[level] for x in above]) for column, level in levels.items()}, faults


def folder_columns(names: Sequence[str]) -> list[str]:
    """Return `folder`, `folder2`, ...: as many as every file lies in."""
    depth = min((name.count("/") for name in names), default=0)
    return [FOLDER if level == 1 else f"{FOLDER}{level}" for level in range(1, depth + 1)]


def _some(names: Sequence[str]) -> str:
    """Return the first names in quotes, and how many more there are."""
    listed = ", ".join(f"'{name}'" for name in names[:_MOST_NAMED])
    return listed if len(names) <= _MOST_NAMED else f"{listed} and {len(names) - _MOST_NAMED} more"
