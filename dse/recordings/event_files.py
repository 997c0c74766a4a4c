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
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

from dse.recordings import RecordingError
from dse.recordings.file_labels import (
    FOLDER,
    Labelled,
    folder_columns,
    labels_of_folders,
    labels_of_table,
    table_files,
)
from dse.recordings.files import content, locate
from dse.recordings.folder_events import LEFT_OUT, FolderEvents, unusable
from dse.recordings.folders import by_path, content_of, files_below
from dse.recordings.formats import Format, detect, named
from dse.recordings.formats.arrays import UNITS_US, USUAL
from dse.recordings.labels import columns_key
from dse.recordings.tables import column_names
from dse.registry import Rule, param, register

AUTO = "auto"

_MOST_NAMED = 5


def _arrays_key() -> Any:
    rule = Rule(
        "names of the arrays t, x, y and p in .npz, .h5 and .csv files (default: the usual names)", axis=False
    )
    return dataclasses.field(default_factory=dict, metadata={"rule": rule})


@register("recordings", "event_files")
@dataclasses.dataclass(frozen=True)
class EventFiles:
    """A folder of event files, one recording each; labels come from a table or from folder names.

    Recordings come in the order of the label table, without one in the order of their paths. What begins
    with a dot is no recording, nor is the label table.
    """

    folder: str = param(
        doc="folder of the recordings: an absolute path, or relative to the YAML file or to $DSE_DATA",
        axis=False,
    )
    pattern: str = param(
        "**/*",
        doc="glob pattern of the files, relative to the folder, in quotes; ** matches any folders",
        axis=False,
    )
    labels: str | None = param(
        None,
        doc="label table (.csv or .parquet) whose column `file` holds the path of every file",
        axis=False,
    )
    label_from: str | None = param(
        None,
        doc="labels are folder names: `folder` is the folder of the file, `folder2` the one above, ...",
        choices=(FOLDER,),
        axis=False,
    )
    format: str = param(
        AUTO,
        doc="format of the files, e.g. aedat4; auto: recognised from the first bytes and the name",
        axis=False,
    )
    width: int | None = param(
        None,
        doc="number of columns, addresses 0 to width - 1 (default: as stated in the files)",
        low=1,
        axis=False,
    )
    height: int | None = param(
        None,
        doc="number of rows, addresses 0 to height - 1 (default: as stated in the files)",
        low=1,
        axis=False,
    )
    arrays: Mapping[str, str] = _arrays_key()
    time_unit: str | None = param(
        None,
        doc="unit of the times in .npz, .h5 and .csv files (default: integers are us)",
        choices=tuple(UNITS_US),
        axis=False,
    )
    repair: bool = param(
        False,
        doc="repair damaged files or leave them out, with a warning for each, instead of stopping",
        axis=False,
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
            elif table is not None and set(names).intersection(table_files(table)):
                known = column_names(table)
        except RecordingError:
            pass
        columns = {column: name for column, name in self.columns.items() if name in known}
        return dataclasses.replace(self, columns=columns, labels=self.labels if columns else None)

    def content(self, base: Path) -> str:
        """Return a hash of the files' paths below the folder, of what is in them, and of the label table.

        Raises:
            RecordingError: folder or table are not found, or a file cannot be read.
        """
        folder, table, names = self._files(base)
        of_files = content_of(folder, names)
        return of_files if table is None else f"{of_files} {content(table)}"

    def channel_positions(self, base: Path) -> None:
        """Return None: an event's position is its address."""

    def read(self, base: Path) -> FolderEvents:
        """Return the recordings; with `repair`, files that hold no valid event are left out.

        Raises:
            RecordingError: anything wrong with names, label table and headers.
        """
        examined = self._examined(base)
        for fault in examined.faults:
            raise RecordingError(fault)
        left_out = dict(examined.left_out)
        if self.repair:
            for name, file_format in examined.formats.items():
                if (reason := unusable(examined.folder, name, file_format, examined.frame)) is not None:
                    left_out[name] = reason
        usable = [i for i, name in enumerate(examined.labelled.names) if name not in left_out]
        if not usable:
            raise RecordingError(
                f"{self.folder}: no file is usable; the first fault: {min(left_out.values())}"
            )
        names = [examined.labelled.names[i] for i in usable]
        return FolderEvents(
            *examined.frame,
            columns={column: values[usable] for column, values in examined.labelled.columns.items()},
            folder=examined.folder,
            names=tuple(names),
            formats=tuple(examined.formats[name] for name in names),
            repair=self.repair,
            left_out=tuple(left_out.values()),
        )

    def _files(self, base: Path) -> tuple[Path, Path | None, list[str]]:
        """Return the folder, the label table and the recordings' paths below the folder.

        Raises:
            RecordingError: folder or table are not found.
        """
        folder = locate(self.folder, base, "folder")
        names = files_below(folder, self.pattern)
        if self.labels is None:
            return folder, None, names
        inside = folder / self.labels
        table = inside if inside.is_file() else locate(self.labels, base)
        same = {name for name in names if name.endswith(table.name) and (folder / name).samefile(table)}
        return folder, table, [name for name in names if name not in same]

    def _examined(self, base: Path) -> _Examined:
        """Return everything that is known without reading events."""
        try:
            folder, table, names = self._files(base)
            if not names:
                raise RecordingError(f"{self.folder}: no file in it matches the pattern '{self.pattern}'")
        except RecordingError as error:
            return _Examined(Path(), Labelled([]), {}, {}, (0, 0), [str(error)])
        labelled = Labelled(names)
        if table is not None:
            labelled = labels_of_table(names, table, self.columns)
        elif self.label_from is not None:
            labelled = labels_of_folders(names, self.columns)
        formats, frames, left_out = self._headers(folder, names)
        faults = list(labelled.faults)
        if not (self.repair and formats):
            faults += list(left_out.values())[:_MOST_NAMED]
            if len(left_out) > _MOST_NAMED:
                faults.append(f"{self.folder}: {len(left_out) - _MOST_NAMED} more files of the same kind")
        frame = self._frame(frames, faults) if frames else (0, 0)
        return _Examined(folder, labelled, formats, left_out, frame, faults)

    def _headers(
        self, folder: Path, names: list[str]
    ) -> tuple[dict[str, Format], dict[str, tuple[int, int] | None], dict[str, str]]:
        """Return what reads each file, the frame that each states, and why others cannot be read."""
        formats: dict[str, Format] = {}
        frames: dict[str, tuple[int, int] | None] = {}
        left_out: dict[str, str] = {}
        of_key = None if self.format == AUTO else self._set_up(named(self.format))
        one_of_each: dict[type, Format] = {}  # one object for each kind, not for each file
        for name in names:
            try:
                file_format = of_key or self._set_up(detect(folder / name))
                file_format = one_of_each.setdefault(type(file_format), file_format)
                frames[name] = file_format.frame(folder / name)
                formats[name] = file_format
            except RecordingError as error:
                left_out[name] = f"{by_path(error, name)}; {LEFT_OUT}"
        return formats, frames, left_out

    def _set_up(self, file_format: Any) -> Format:
        """Return a format with those keys of this component that it has."""
        settings = {key.name for key in dataclasses.fields(file_format)}
        keys = {key: getattr(self, key) for key in ("arrays", "time_unit") if key in settings}
        set_up: Format = dataclasses.replace(file_format, **keys)
        return set_up

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


@dataclasses.dataclass(frozen=True)
class _Examined:
    """What names, labels and headers say.

    formats: what reads each file. left_out: why other files cannot be read.
    """

    folder: Path
    labelled: Labelled
    formats: Mapping[str, Format]
    left_out: Mapping[str, str]
    frame: tuple[int, int]
    faults: list[str]


def _by(frame: tuple[int, int]) -> str:
    return f"{frame[0]} x {frame[1]}"
