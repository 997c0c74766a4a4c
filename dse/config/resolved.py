"""The sections of a search space: the class of each, and those of one design as typed objects.

`data`, `encoder` and `model` hold one component of a package, named by `kind`; the other sections
are one dataclass each (`dse.config.settings`), whose fields are the keys. Components are imported on request.
"""

from __future__ import annotations

import dataclasses
import typing
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from dse.base.records import FrontEnd
from dse.config import parts
from dse.config.contracts import PLACES, Encoder, Family, Source
from dse.config.faults import ConfigError, Fault
from dse.config.search import Search
from dse.config.settings import (
    Decision,
    Evaluation,
    ExecutionSettings,
    Precision,
    Preprocessing,
    Schedule,
    Split,
    Task,
    Training,
    Window,
)
from dse.config.values import Report, Values, dotted, plain, read_object, refuse
from dse.config.yaml_lines import Path as Keys
from dse.config.yaml_lines import Raw

SETTINGS: Mapping[str, type] = {
    "task": Task,
    "window": Window,
    "split": Split,
    "evaluation": Evaluation,
    "preprocessing": Preprocessing,
    "training": Training,
    "decision": Decision,
    "precision": Precision,
    "schedule": Schedule,
    "execution": ExecutionSettings,
    "search": Search,
}
# In the order of a file; `test` holds keys of `data`; `hardware`, `targets`, `objectives` are lists of
# names, `limits` is one of conditions.
SECTIONS = (
    *("data", "task", "window", "split", "evaluation", "test", "preprocessing", "encoder", "model"),
    *("training", "decision", "precision", "hardware", "schedule", "targets", "objectives", "limits"),
    *("search", "execution"),
)
_FITTED = ("preprocessing", "encoder")


def front_end(source: type[Source]) -> FrontEnd | None:
    """Return the section that the recordings of a source require; None for spikes.

    Signals require an encoder, and events preprocessing. Spikes, and events once they are counted, may have
    an encoder as well.

    Raises:
        TypeError: the annotation of `read` names recordings of several kinds.
    """
    hint = typing.get_type_hints(source.read)["return"]
    sections: set[FrontEnd | None] = {kind.front_end for kind in typing.get_args(hint) or (hint,)}
    if len(sections) > 1:
        raise TypeError(f"{source.__name__}.read must return recordings of one kind, got {hint}")
    return sections.pop()


@dataclass(frozen=True)
class LeftOut:
    """Values of a label column that are left out of training, and tested on."""

    column: str
    values: tuple[Raw, ...]

    @property
    def name(self) -> str:
        """The values as text, joined by |."""
        return "|".join(f"{x:g}" if isinstance(x, float) else str(x) for x in self.values)


@dataclass(frozen=True, kw_only=True)
class Sections:
    """The sections of one design.

    kinds: names of the components: of data and model, and of encoder where there is one.
    test: where recordings of a final test lie, if they are not part of the data.
    evaluation: what else is tested; None: nothing.
    preprocessing: of event recordings; encoder: of signals, and perhaps of what is spikes already.
    left_out: groups that training leaves out and that are the test set; None: none. It is no section.
    """

    kinds: Mapping[str, str]
    data: Source
    task: Task
    window: Window
    split: Split
    evaluation: Evaluation | None = None
    test: Source | None = None
    preprocessing: Preprocessing | None = None
    encoder: Encoder | None = None
    model: Family
    training: Training
    left_out: LeftOut | None = None

    @property
    def reads_labels(self) -> str:
        """Why the design says nothing about new recordings: its encoder must know labels; '' where it can."""
        if self.encoder is None or not self.encoder.transductive:
            return ""
        return f"encoder {self.kinds['encoder']} reads the labels of the recordings that it encodes"

    def to_plain(self) -> dict[str, dict[str, Raw]]:
        """Return the sections as plain data, as they are recorded; `from_plain` is the way back."""
        sections: dict[str, dict[str, Raw]] = {}
        for name in (name for name in SECTIONS if getattr(self, name, None) is not None):
            kind = {"kind": self.kinds[name]} if name in self.kinds else {}
            sections[name] = kind | plain(getattr(self, name))
        if "test" in sections:
            data = sections["data"]
            sections["test"] = {
                key: value
                for key, value in sections["test"].items()
                if value != data[key] or (key in PLACES and value is not None)
            }
        return sections

    @classmethod
    def from_plain(cls, sections: Mapping[str, Raw], where: str) -> Self:
        """Return the sections of plain data.

        Args:
            sections: of `to_plain`, with lists or tuples.
            where: what errors are about, such as a file.

        Raises:
            ConfigError: a section is missing, or is none of the components that are known.
        """
        faults: list[Fault] = []

        def report(path: Keys, message: str) -> None:
            faults.append(Fault(where, 0, message))

        values = {name: _read(name, raw, report) for name, raw in sections.items() if name != "test"}
        fields = {name: part.built({}) for name, part in values.items() if part is not None and part.good}
        data = values.get("data")
        if sections.get("test") and data is not None and data.good:
            fields["test"] = data.built(parts.test_file(data, sections["test"], report).values)
        fields.setdefault("window", Window())
        for name in ("data", "task", "split", "model", "training"):
            if name not in sections:
                report((), f"section '{name}' is required")
        if faults:
            raise ConfigError(faults)
        kinds = {name: part.kind for name, part in values.items() if part is not None and part.kind}
        return cls(kinds=kinds, **fields)

    def on_fold(self, fold: int) -> Self:
        """Return the design with another fold of its cross-validation to validate on."""
        if self.split.k_fold is None:
            raise ValueError("a design without split.k_fold has no folds")
        k_fold = dataclasses.replace(self.split.k_fold, fold=fold)
        return dataclasses.replace(self, split=dataclasses.replace(self.split, k_fold=k_fold))

    def with_fitted(self, fitted: Mapping[str, Mapping[str, Raw]]) -> Self:
        """Return the design with keys of `preprocessing` and `encoder` that were fitted to recordings.

        Args:
            fitted: section -> key -> plain value, as `fitted_since` returns it.

        Raises:
            ValueError: there is no such section, or its class refuses a value.
        """
        changed: Values = {}
        for name, keys in fitted.items():
            section = getattr(self, name) if name in _FITTED else None
            if section is None:
                raise ValueError(f"a design without section '{name}' has nothing fitted in it")
            changed[name] = read_object(type(section), plain(section) | dict(keys), (name,), refuse)
        return dataclasses.replace(self, **changed)

    def fitted_since(self, before: Sections) -> dict[str, dict[str, Raw]]:
        """Return section -> key -> plain value of what has been fitted to recordings since."""
        fitted = {}
        for name in _FITTED:
            old, new = plain(getattr(before, name)) or {}, plain(getattr(self, name)) or {}
            if keys := {key: value for key, value in new.items() if old.get(key) != value}:
                fitted[name] = keys
        return fitted


def _read(name: str, raw: Raw, report: Report) -> parts.Part | None:
    if name in parts.COMPONENTS:
        return parts.component((name,), raw, report)
    if name in SETTINGS:
        return parts.settings(name, SETTINGS[name], raw, report)
    report((name,), f"unknown section '{dotted((name,))}'")
    return None
