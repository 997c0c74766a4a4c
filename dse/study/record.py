"""The record of a training run: the content of its record.json as typed objects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dse import store
from dse.base.records import Head
from dse.measure.numbers import Numbers, check_kinds
from dse.store import StoreError

STOPPED = "stopped"
"""The status of a run that racing stopped before its end."""


_KINDS = {
    **dict.fromkeys(("design", "sections", "samples"), Mapping),
    **dict.fromkeys(("reason", "details", "data", "leak"), str),
    **dict.fromkeys(("needs_bytes", "stopped_at_epoch"), int | None),
    "seed": int,
}
"""Types of fields as JSON holds them."""
_AS_WRITTEN = ("seed", "details", "needs_bytes", "stopped_at_epoch", "sections", "data", "samples")
_PARTS = {
    "failed": ("details",),
    STOPPED: ("stopped_at_epoch", "data", "samples"),
    "finished": ("sections", "data", "samples"),
}
"""Status of a run -> fields that its record holds beside those that every one has."""


@dataclass(frozen=True, kw_only=True)
class RunRecord:
    """A run that has ended.

    design: its axes. seed: of the study.
    reason, details: why it failed, in a line and as a traceback; '' if it did not fail.
    needs_bytes: necessary memory of a run that failed for lack of memory.
    numbers: the measured numbers; None if it failed or stopped early, and then most fields below are empty.
    stopped_at_epoch: epochs after which racing stopped it, for the reason; None: it was not stopped.
    sections: of its design, as plain data, with the values that were fitted to the recordings.
    classes, heads: of its answers.
    data: key of the data set. samples: number of samples in each part of it.
    leak: why evaluations on the data know the labels; '' if they do not.
    rungs: epochs -> what was measured after so many, at each rung where the training paused.
    files: names of its artefacts.
    """

    trial: int
    repeat: int
    design: Mapping[str, object]
    seed: int
    reason: str = ""
    details: str = ""
    needs_bytes: int | None = None
    numbers: Numbers | None = None
    stopped_at_epoch: int | None = None
    sections: Mapping[str, Any] = field(default_factory=dict)
    classes: tuple[str, ...] = ()
    heads: tuple[Head, ...] = ()
    data: str = ""
    samples: Mapping[str, int] = field(default_factory=dict)
    leak: str = ""
    rungs: Mapping[int, Numbers] = field(default_factory=dict)
    files: tuple[str, ...] = ()

    @property
    def failed(self) -> bool:
        """Whether the run failed; one that stopped early did not."""
        return self.numbers is None and self.stopped_at_epoch is None

    @property
    def finished(self) -> bool:
        """Whether the run trained to its end."""
        return self.numbers is not None

    @property
    def last(self) -> Numbers:
        """The numbers of a finished run, or those at the rung where it stopped.

        Raises:
            ValueError: it failed.
        """
        return self.measured if self.stopped_at_epoch is None else self.rungs[self.stopped_at_epoch]

    @property
    def measured(self) -> Numbers:
        """The numbers of a finished run.

        Raises:
            ValueError: it failed, or stopped early.
        """
        if self.numbers is None:
            how = "failed" if self.failed else f"stopped after {self.stopped_at_epoch} epochs"
            raise ValueError(f"trial {self.trial} {how}: {self.reason}")
        return self.numbers

    def to_plain(self) -> dict[str, Any]:
        """Return the content of record.json without the schema and the checksums of files."""
        status = "failed" if self.failed else "finished" if self.finished else STOPPED
        names = ("trial", "repeat", "seed", "reason", *_PARTS[status])
        plain = {"design": dict(self.design), "status": status, **{x: getattr(self, x) for x in names}}
        if self.needs_bytes is not None:
            plain["needs_bytes"] = self.needs_bytes
        if self.rungs:
            plain["rungs"] = plain_rungs(self.rungs)
        if self.numbers is not None:
            heads = {head.pop("name"): head for head in store.heads_document(self.heads)}
            plain |= {"classes": list(self.classes), "heads": heads, "transductive": self.leak}
            plain |= self.numbers.to_plain()
        return plain

    @classmethod
    def from_plain(cls, plain: Mapping[str, Any], where: Path) -> RunRecord:
        """Return the record in plain data; `to_plain` is the way back.

        Raises:
            StoreError: a key is missing or invalid; `where` names the file.
        """
        if plain.get("status") == "told":
            raise store.damaged(where, "holds values of `dse tell`, which are no longer read")
        try:
            record = cls(
                trial=int(plain["trial"]),
                repeat=int(plain["repeat"]),
                design=plain["design"],
                reason=plain["reason"],
                numbers=None if plain["status"] in ("failed", STOPPED) else Numbers.from_plain(plain),
                classes=tuple(plain.get("classes", ())),
                heads=store.heads_of({"name": name, **x} for name, x in plain.get("heads", {}).items()),
                leak=plain.get("transductive", ""),
                rungs={int(n): Numbers.from_plain(x) for n, x in plain.get("rungs", {}).items()},
                files=tuple(plain.get("files", ())),
                **{"seed": 0, **{name: plain[name] for name in _AS_WRITTEN if name in plain}},
            )
            check_kinds(record, _KINDS)
            if not all(isinstance(name, str) for name in record.classes):
                raise TypeError("'classes'")
        except (LookupError, TypeError, AttributeError, ValueError, ArithmeticError) as error:
            raise store.damaged(where, f"key {error} is missing or invalid") from error
        return record


def plain_rungs(rungs: Mapping[int, Numbers]) -> dict[str, Any]:
    """Return what was measured at rungs, epochs -> numbers, as plain data."""
    return {str(epochs): numbers.to_plain() for epochs, numbers in rungs.items()}


def load_record(folder: Path) -> RunRecord | None:
    """Return the record of the run in a folder, None if there is none."""
    plain = store.load_run(folder)
    return None if plain is None else RunRecord.from_plain(plain, folder)


def load_records(folder: Path, trial: int) -> list[RunRecord]:
    """Return the records of a trial's runs in a study's folder, repeat 0 first.

    Raises:
        StoreError: as in `plain_records`.
    """
    return [RunRecord.from_plain(plain, folder) for plain in plain_records(folder, trial)]


def plain_records(folder: Path, trial: int) -> list[dict[str, Any]]:
    """Return the content of record.json of each run of a trial, repeat 0 first."""
    records = [record for run in store.runs_of(folder, trial) if (record := store.load_run(run)) is not None]
    if not records:
        only = "" if (folder / store.RUNS).is_dir() else ": the folder holds tables alone, not the runs"
        raise StoreError(f"{folder}: there is no trial {trial}{only}")
    return records
