"""What every classifier is as C: variables, constants, source, parts of its code; the C that makes spikes."""

from __future__ import annotations

import re
from abc import abstractmethod
from collections import Counter
from collections.abc import Collection
from functools import cached_property
from typing import Any, ClassVar

from dse.data.encoders.receptors import KINDS
from dse.data.preprocessing import END_OF_TIME_US, Pooling
from dse.deploy.c.arrays import Member, Table, index, members_of, struct_bytes
from dse.deploy.c.text import NAMES, TITLE, filled, real, wrapped
from dse.deploy.form import Frame, ReceptorsForm, SendOnDeltaForm
from dse.engine.neurons.izhikevich import FLOOR_MV, PEAK_MV, A, B, C

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
        kind = "receptors" if self.is_receptors else "real_samples" if self.takes_real else self.front_end
        is_divided = isinstance(self.encoder, SendOnDeltaForm) and self.encoder.rule == "level"
        return Counter() if kind == "spikes" else Counter([kind, *[f"divided_{kind}"] * is_divided])

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
        return self.is_receptors or self.takes_real or "double" in self.kinds

    @property
    def is_receptors(self) -> bool:
        return isinstance(self.encoder, ReceptorsForm)

    @property
    def takes_real(self) -> bool:
        """Whether its encoder needs floating point, whatever samples are."""
        return self.encoder is not None and not self.encoder.takes_whole

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
        return self.pooling is not None and self.pooling.end_us >= END_OF_TIME_US

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
    def footprint(self) -> dict[str, float]:
        """Its memory, but for code; the stack holds a few words more."""
        return {"ram_bytes": float(self.ram_bytes), "table_bytes": float(self.table_bytes)}

    @property
    def n_classes(self) -> int:
        return len(self.classes)

    @property
    def bound(self) -> str:
        """Condition of a channel that is none."""
        return "" if self.n_channels == _ALL_CHANNELS else f"(channel >= {self.n_channels}u) || "

    def source(self, apart: bool = False) -> str:
        """Return the text of dse.c, but for its title and the names of classes.

        Tables that it loads (`apart`) stand in it none the less (`weights.beside`).
        """
        cleared = [x for x in self.members() if x.is_cleared]
        arrays = [x for x in cleared if x.lengths]
        text = filled(
            self.template,
            self,
            title=TITLE,
            apart=apart,
            tables="\n".join(table.text for table in self.tables),
            front_end=_front_end(self),
            clearing={x.kind: x for x in arrays}.values(),
            arrays=arrays,
            numbers=[x for x in cleared if not x.lengths],
            names=NAMES,
            **self.values(),
        )
        # Not static, so that compilers make no variants of them; MISRA C wants them declared then.
        return re.sub(r"^(APART void [^{]*\))\n", r"\1;\n\1\n", text, flags=re.MULTILINE)


def _front_end(plan: Frame) -> str:
    """Return the functions that make spikes of what is pushed; '' where that is spikes."""
    if isinstance(plan.encoder, ReceptorsForm):
        return _receptors(plan.encoder)
    if plan.encoder is not None:
        return _send_on_delta(plan.encoder)
    return "" if plan.pooling is None else _pooling(plan.pooling)


def _send_on_delta(encoder: SendOnDeltaForm) -> str:
    return filled(
        "send_on_delta.c",
        encoder,
        **{f"is_{rule}": encoder.rule == rule for rule in ("value", "level")},
        adds=encoder.rule in ("step", "digits"),
        at="0" if encoder.rule == "digits" else "k",
        is_first="(net->begun == 0u) && (k == 0u)" if encoder.rule == "digits" else "net->begun == 0u",
        exact=", ".join(map(real, encoder.thresholds)),
        whole=", ".join(map(str, encoder.whole or ())),
        exact_first=wrapped(map(real, encoder.first)),
        whole_first=wrapped(str(int(x * 2**encoder.shift)) for x in encoder.first) if encoder.whole else "",
        by_unit=f" * {1 << encoder.shift}" if encoder.shift else "",
        first_level="begin[c]" if encoder.first else "x",
        channel="(k * DSE_SENSORS) + c"
        if encoder.merged
        else "(((2u * k) + ((d > ZERO) ? 1u : 0u)) * DSE_SENSORS) + c",
    )


def _receptors(plan: ReceptorsForm) -> str:
    """Return the C of the encoder `receptors`: all operations in the order of dse.data.encoders.receptors."""
    encoder, kinds = plan.encoder, plan.kinds
    solver_steps = encoder.solver_steps(plan.step_ms)
    h = plan.step_ms / solver_steps
    numbers = {
        "step_s": plan.step_ms / 1000,
        "gain": encoder.gain,
        "gain_fa": encoder.gain_fa,
        **{"A": A, "B": B, "C": C, "h": h, "half": 0.5 * h, "peak": PEAK_MV, "floor": FLOOR_MV},
    }
    return filled(
        "receptors.c",
        plan,
        **{name: real(x) for name, x in numbers.items()},
        gain_sa=real(encoder.gain_sa) if encoder.sa else "",
        low=wrapped(real(x) for x in encoder.low),
        span=wrapped(real(max(b - a, 0.0)) for a, b in zip(encoder.low, encoder.high, strict=True)),
        names=", ".join(KINDS if encoder.sa else KINDS[1:]),
        kinds=", ".join(f"{{{', '.join(map(real, kind))}}}" for kind in kinds.tolist()),
        half_steps=encoder.method == "half_steps",
        falling=0 if encoder.sa else 1,
        solver_steps=solver_steps,
        copies=encoder.spikes_per_step,
    )


def _pooling(pools: Pooling) -> str:
    x, y, columns, rows = pools.crop
    tables, several, sizes = [], [], []
    for axis, place, cut, begins, lengths, n in (
        ("x", "column", slice(x, x + columns), pools.first_x, pools.n_x, pools.width),
        ("y", "row", slice(y, y + rows), pools.first_y, pools.n_y, pools.height),
    ):
        tables.append(Table(index(n), f"first_{axis}", begins[cut]))
        first, *others = dict.fromkeys(lengths[cut].tolist())
        sizes.append(f"n_{axis}[{place}]" if others else f"{first}u")
        several += [Table("uint8_t", f"n_{axis}", lengths[cut])] if others else []
    return filled(
        "pooling.c",
        pools,
        tables="".join(table.text for table in [*tables, *several]),
        columns=columns,
        rows=rows,
        stop_us="" if pools.end_us >= END_OF_TIME_US else pools.end_us,
        too_late="" if pools.end_us >= END_OF_TIME_US else " || (t_us >= net->stop_us)",
        crop_x=x,
        crop_y=y,
        other_polarity=f" || (polarity != {pools.only}u)" if pools.only >= 0 else "",
        plane="(polarity != 0u) ? 1u : 0u" if pools.poles == 2 else "0",
        n_x=sizes[0],
        n_y=sizes[1],
        channel=f"(uint16_t)((((plane * {pools.height}u) + j) * {pools.width}u) + i)",
        needed=pools.needed if pools.needed > 1 else 0,
    )
