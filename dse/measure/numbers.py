"""The measured numbers of a run, as its record holds them."""

from __future__ import annotations

import types
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dse.measure.objectives.accuracy_unseen import Unseen


@dataclass(frozen=True)
class Numbers:
    """The measured numbers of a run: columns of the record, of each hardware profile, and of each head.

    unseen: label column -> fold of its values -> accuracy after a training without the fold.
    """

    columns: Mapping[str, Any]
    hardware: Mapping[str, Mapping[str, Any]]
    of_heads: Mapping[str, Numbers] = field(default_factory=dict)
    unseen: Unseen = field(default_factory=dict)

    def with_columns(self, **columns: Any) -> Numbers:
        """Return them with further columns, of the heads too."""
        heads = {name: head.with_columns(**columns) for name, head in self.of_heads.items()}
        return replace(self, columns={**self.columns, **columns}, of_heads=heads)

    @classmethod
    def from_plain(cls, plain: Mapping[str, Any]) -> Numbers:
        """Return the numbers in plain data; `to_plain` is the way back."""
        heads = {name: cls.from_plain(head) for name, head in plain.get("of_heads", {}).items()}
        numbers = cls(plain["columns"], plain["hardware"], heads, plain.get("unseen", {}))
        check_kinds(numbers, _KINDS)
        for columns in (numbers.columns, *numbers.hardware.values()):
            for name, value in columns.items():
                if not isinstance(value, _SCALARS):
                    raise TypeError(f"'{name}'")
        return numbers

    def to_plain(self) -> dict[str, Any]:
        """Return the numbers as plain data."""
        unseen = {"unseen": self.unseen} if self.unseen else {}
        heads = {name: head.to_plain() for name, head in self.of_heads.items()}
        for head in heads.values():
            del head["of_heads"]  # a head has none
        return {"columns": self.columns, "hardware": self.hardware, "of_heads": heads, **unseen}

    def of_head(self, head: str | None) -> Numbers:
        """Return the numbers of a head; None or '': of the whole classifier."""
        return self.of_heads[head] if head else self


_SCALARS = (bool, int, float, str, types.NoneType)
_KINDS = {"columns": Mapping, "hardware": Mapping, "unseen": Mapping}


def check_kinds(record: object, kinds: Mapping[str, Any]) -> None:
    """Check the types of fields that were read."""
    for name, kind in kinds.items():
        if not isinstance(getattr(record, name), kind):
            raise TypeError(f"'{name}'")
