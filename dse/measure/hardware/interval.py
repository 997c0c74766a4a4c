"""A figure with the range that it may lie in."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

T_co = TypeVar("T_co", covariant=True)
U = TypeVar("U")


_DECADES = 100.0


@dataclass(frozen=True)
class Interval(Generic[T_co]):
    """A value and the ends of its range; as table columns: name, name_low, name_high.

    value: NaN or None where only the range is known.
    """

    value: T_co
    low: T_co
    high: T_co

    def __iter__(self) -> Iterator[T_co]:
        return iter((self.value, self.low, self.high))

    def map(self, change: Callable[[T_co], U]) -> Interval[U]:
        """Return the interval with a change made to the value and to both ends."""
        return Interval(change(self.value), change(self.low), change(self.high))

    def columns(self, name: str) -> dict[str, T_co]:
        """Return the value and the ends under the names of their table columns."""
        return dict(zip(column_names(name), self, strict=True))


def is_open(low: float, high: float) -> bool:
    """Return whether a range spans more than two decades, so that its low end alone is worth stating."""
    return 0 < _DECADES * low < high


def column_names(name: str) -> tuple[str, str, str]:
    """Return the names of the table columns of an interval: of its value, its low and its high end."""
    return name, f"{name}_low", f"{name}_high"
