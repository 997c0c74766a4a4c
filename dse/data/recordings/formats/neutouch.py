"""NeuTouch text recordings (.tact): a line per event with its sign, its taxel and its time on the clock.

    0 44 1606029303.0246768

The sign is 0 for a positive event (ON) and 1 for a negative one (OFF); the recorder's own tools call that
column isNeg. Taxels 1-39 are the left finger, 40-79 the right. The addresses 0 and 60 carry no taxel, and
their events are left out. Time 0 is the first event of a taxel; as float64 a Unix time resolves 0.24 us.

Source: recordings and tools of github.com/tasbolat1/neutouch.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from dse.base.records import Block
from dse.base.registry import register
from dse.data.recordings.formats import BLOCK_EVENTS, Format, Repairs, block_of, open_file

N_TAXELS = 80
NO_TAXEL = (0, 60)

_LINE = re.compile(rb"\s*([01])\s+(\d{1,9})\s+(\d{1,12}(?:\.\d*)?)\s*")
_LINE_BYTES = 24
_SHOWN = 40


@register("recordings.formats", "neutouch")
@dataclass(frozen=True)
class Neutouch(Format):
    """NeuTouch text: `polarity taxel time` per line, polarity 0 for ON."""

    suffixes: ClassVar[tuple[str, ...]] = (".tact",)

    def matches(self, path: Path, head: bytes) -> bool:
        """Return whether the name says so and the first line reads like an event."""
        return path.suffix.lower() in self.suffixes and _LINE.fullmatch(head.split(b"\n", 1)[0]) is not None

    def frame(self, path: Path) -> tuple[int, int]:
        """Return the taxel addresses, in a row."""
        return N_TAXELS, 1

    def blocks(self, path: Path, broken: Repairs) -> Iterator[Block]:
        """Yield the events of the taxels; `broken` hears of lines that are none."""
        first_s, n_before = None, 0
        with open_file(path) as file:
            while lines := file.readlines(BLOCK_EVENTS * _LINE_BYTES):
                rows = []
                for number, line in enumerate(lines, n_before + 1):
                    if fields := _LINE.fullmatch(line):
                        rows.append(fields.groups())
                    elif line.strip():
                        broken(
                            f"line {number} must be a sign (0 or 1), a taxel and a time, got "
                            f"{line.decode(errors='replace')[:_SHOWN].rstrip()!r}",
                            "skips lines that are not events",
                        )
                n_before += len(lines)
                sign, taxel, time_s = np.array(rows).astype(np.float64).reshape(-1, 3).T
                is_taxel = ~np.isin(taxel, NO_TAXEL)
                if first_s is None and is_taxel.any():
                    first_s = time_s[is_taxel][0]
                t_us = np.rint((time_s - (first_s or 0)) * 1e6)
                yield from block_of(t_us, taxel, np.zeros_like(taxel), sign == 0, is_taxel)
