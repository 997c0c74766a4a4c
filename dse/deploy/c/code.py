"""What every classifier is as C: variables, constants, one source, and the parts of its code."""

from __future__ import annotations

import re
from abc import abstractmethod
from collections import Counter
from collections.abc import Collection
from functools import cached_property
from typing import Any, ClassVar

from dse.deploy.c.arrays import Member, Table, members_of, struct_bytes
from dse.deploy.c.front_end import front_end, is_endless
from dse.deploy.c.text import NAMES, TITLE, filled
from dse.deploy.form import Frame, ReceptorsForm, SendOnDeltaForm

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

    @cached_property
    @abstractmethod
    def tables(self) -> list[Table]:
        """Its constant data, without that of the front end."""

    @abstractmethod
    def values(self) -> dict[str, Any]:
        """Return what the template needs beside the attributes of the code."""

    def members(self) -> list[Member]:
        """Return all variables; those of the front end, which come last."""
        return members_of("front_end_members.txt", self, *([] if self.encoder is None else [self.encoder]))

    def parts(self) -> Counter[str]:
        """Return how often each part of the code occurs (dse.deploy.c.code_size): here, of the front end."""
        kind = "receptors" if self.is_receptors else self.front_end
        return Counter() if kind == "spikes" else Counter([kind])

    @property
    def kinds(self) -> Collection[str]:
        """Types of its tables."""
        return {table.kind for table in self.tables}

    @property
    def is_rounded(self) -> bool:
        """Whether it computes in floating point."""
        return self.encoder is not None or bool({"float", "double"} & set(self.kinds))

    @property
    def needs_double(self) -> bool:
        """Whether it computes in double, whatever samples are."""
        real = self.encoder is not None and not self.encoder.takes_whole
        return self.is_receptors or real or "double" in self.kinds

    @property
    def is_receptors(self) -> bool:
        return isinstance(self.encoder, ReceptorsForm)

    @property
    def is_delta(self) -> bool:
        """Whether it encodes samples by send-on-delta, which keeps levels."""
        return isinstance(self.encoder, SendOnDeltaForm)

    @property
    def level(self) -> str:
        """Type of a level; dse_level_t: of whole samples."""
        return "dse_level_t" if self.encoder is not None and self.encoder.takes_whole else "double"

    @property
    def is_endless(self) -> bool:
        """Whether no event is too late."""
        return self.pooling is not None and is_endless(self.pooling)

    @property
    def bin_us(self) -> int:
        """Width of a bin of events; 0: there is none."""
        return 0 if self.pooling is None else self.pooling.bin_us

    @property
    def n_events(self) -> int:
        """Pools whose events are counted in a bin."""
        return self.n_channels if self.pooling is not None and self.pooling.counts_needed else 0

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
        return "" if self.n_channels == _ALL_CHANNELS else f"(channel >= {self.n_channels}u) || "

    def source(self, apart: bool = False) -> str:
        """Return the text of dse.c, but for its title and the names of classes.

        Args:
            apart: whether it loads its tables, which stand in it none the less (`weights.beside`).
        """
        cleared = [x for x in self.members() if x.is_cleared]
        arrays = [x for x in cleared if x.lengths]
        text = filled(
            self.template,
            self,
            title=TITLE,
            apart=apart,
            tables="\n".join(table.text for table in self.tables),
            front_end=front_end(self),
            clearing={x.kind: x for x in arrays}.values(),
            arrays=arrays,
            numbers=[x for x in cleared if not x.lengths],
            names=NAMES,
            **self.values(),
        )
        # Not static, so that compilers make no variants of them; MISRA C wants them declared then.
        return re.sub(r"^(APART void [^{]*\))\n", r"\1;\n\1\n", text, flags=re.MULTILINE)
