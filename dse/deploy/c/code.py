"""What every classifier is as C: variables, constants, one source, and the parts of its code."""

from __future__ import annotations

from abc import abstractmethod
from collections import Counter
from collections.abc import Collection
from functools import cached_property
from typing import Any, ClassVar

from dse.deploy.c.arrays import Member, Table, declared, struct_bytes
from dse.deploy.c.front_end import (
    begin,
    binned,
    floats,
    front_end,
    front_end_members,
    level_type,
    needs_double,
)
from dse.deploy.c.text import NAMES, TITLE, filled
from dse.deploy.form import Frame, ReceptorsForm

_ALL_CHANNELS = 2**16


class Code(Frame):
    """A classifier as C; a subclass says what it holds and computes.

    template: of its source.
    """

    template: ClassVar[str]

    @property
    @abstractmethod
    def what(self) -> str:
        """What it is, and in which arithmetic, a sentence."""

    @property
    @abstractmethod
    def n_outputs(self) -> int:
        """Output neurons that are counted; 0: none."""

    @abstractmethod
    def own_members(self) -> list[Member]:
        """Return its variables, without those of the front end."""

    @cached_property
    @abstractmethod
    def tables(self) -> list[Table]:
        """Its constant data, without that of the front end."""

    @abstractmethod
    def values(self) -> dict[str, Any]:
        """Return what the template needs beside the attributes of the code."""

    @abstractmethod
    def own_parts(self) -> Counter[str]:
        """Return how often each part of the code occurs (dse.deploy.c.code_size), without the front end."""

    def members(self) -> list[Member]:
        """Return all variables."""
        return [*self.own_members(), *front_end_members(self)]

    def parts(self) -> Counter[str]:
        """Return how often each part of the code occurs."""
        n = self.own_parts()
        if self.front_end != "spikes":
            n["receptors" if isinstance(self.encoder, ReceptorsForm) else self.front_end] = 1
        return n

    @property
    def kinds(self) -> Collection[str]:
        """Types of its tables."""
        return {table.kind for table in self.tables}

    @property
    def needs_double(self) -> bool:
        """Whether it computes in double, whatever samples are."""
        return needs_double(self, self.kinds)

    @property
    def ram_bytes(self) -> int:
        """All static data, as a compiler lays it out."""
        return struct_bytes(self.members())

    @property
    def table_bytes(self) -> int:
        """Constants, without those of the front end and names of classes."""
        return sum(table.n_bytes for table in self.tables)

    @property
    def n_classes(self) -> int:
        return len(self.classes)

    @property
    def bound(self) -> str:
        """Condition of a channel that is none."""
        return "" if self.n_channels == _ALL_CHANNELS else f"channel >= {self.n_channels}u || "

    def source(self) -> str:
        """Return the text of dse.c, but for its title and the names of classes."""
        return filled(
            self.template,
            self,
            title=TITLE,
            floats=floats(self, self.kinds),
            tables="\n".join(table.text for table in self.tables) + level_type(self),
            members=declared(self.members()),
            front_end=front_end(self),
            init=begin(self),
            names=NAMES,
            **binned(self),
            **self.values(),
        )
