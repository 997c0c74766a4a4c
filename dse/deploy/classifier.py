"""A classifier that can be deployed, and the recordings that it takes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Self

import numpy as np

from dse.base.records import Array, Head, Ints, Network, Parameters
from dse.base.registry import param
from dse.config import Sections
from dse.config.contracts import Encoder
from dse.deploy.prefix import DEFAULT
from dse.deploy.verdict import Verdict


class BundleError(ValueError):
    """A folder that is no bundle, a damaged one, or one of another schema, in one line."""


InputKind = Literal["samples", "spikes", "events"]
RULE = "phi", "theta", "read_out_ms", "head"
"""Fields of a classifier that decide when and with what it answers."""
_LARGEST = float(np.finfo(np.float32).max)
_MOST = 2**31


@dataclass(frozen=True)
class Input:
    """The recordings that a classifier takes, before encoder and preprocessing.

    kind: samples, which an encoder turns into spikes; spikes; or events, which are preprocessed.
    n_channels: numbers in a step of samples or spikes; 0 of events.
    width, height: frame of events; 0 of others.
    n_steps: length of the window in input steps.
    step_ms: duration of an input step.
    """

    kind: InputKind
    n_channels: int = param(low=0, high=_MOST)
    width: int = param(low=0, high=_MOST)
    height: int = param(low=0, high=_MOST)
    n_steps: int = param(low=0, high=_MOST)
    step_ms: float = param(low=0)

    @classmethod
    def of_channels(cls, encoder: Encoder | None, n_channels: int, n_steps: int, step_ms: float) -> Self:
        """Return the samples that an encoder makes spikes of so many channels of; without one, the spikes."""
        if encoder is None:
            return cls("spikes", n_channels, 0, 0, n_steps, step_ms)
        n_in = next(n for n in range(1, n_channels + 1) if encoder.n_channels(n) == n_channels)
        return cls("samples", n_in, 0, 0, n_steps, step_ms)

    def fault_of_sample(self, values: Array) -> str:
        """Return what a step of samples or spikes must be and is not: '' if it is one."""
        if values.shape != (self.n_channels,) or values.dtype.kind not in "biuf":
            got = f"{values.dtype} of shape {values.shape}"
            got = str(values.size) if values.ndim == 1 and values.dtype.kind in "biuf" else got
            return f"must have {self.n_channels} numbers, got {got}"
        if not (is_good := np.abs(values) <= _LARGEST).all():
            return f"must have finite numbers, got {values[~is_good][0]}"
        if self.kind == "spikes" and not (is_good := (values == 0) | (values == 1)).all():
            return f"must have 0 or 1 of every channel, got {values[~is_good][0]:g}"
        return ""

    def fault_of_time(self, t_us: int, last_us: int) -> str:
        """Return the same of a time, after another one."""
        if not 0 <= t_us < 2**62:
            return f"must have a time from 0 to 2^62 us, got {t_us}"
        if t_us < last_us:
            return f"must not be earlier than the one before, at {last_us} us, got {t_us}"
        return ""

    def fault_of_event(self, t_us: int, x: int, y: int, polarity: int, last_us: int) -> str:
        """Return the same of an event."""
        if fault := self.fault_of_time(t_us, last_us):
            return fault
        if not (0 <= x < self.width and 0 <= y < self.height):
            return f"must have x below {self.width} and y below {self.height}, got {x} and {y}"
        return "" if polarity in (0, 1) else f"must have the polarity 0 or 1, got {polarity}"


@dataclass(frozen=True)
class Classifier:
    """A classifier that can be deployed.

    fitted: the trained network or parameters; the family of section model runs it.
    sections: of its design, with the values that were fitted to the recordings.
    classes: names of the classes of the whole network.
    phi, theta: the decision rule; both None if the answer comes at a fixed time.
    read_out_ms: that time; None for the end of the window.
    heads: of a joint target; head: the one that answers, '' for all of them together.
    prefix: of its names in C (`dse.deploy.prefix`).
    plugins: the plugins with its components: names of modules, or paths of files.
    input: what recordings it takes; None where the export could not tell.
    targets: the verdict on each target that it was exported to, by name.
    record: the design point, column -> value.
    evidence: the origin of the numbers.
    """

    fitted: Network | Parameters
    sections: Sections
    classes: tuple[str, ...]
    phi: float | None = None
    theta: float | None = None
    record: Mapping[str, object] = field(default_factory=dict)
    evidence: Mapping[str, Any] = field(default_factory=dict)
    read_out_ms: float | None = None
    heads: tuple[Head, ...] = ()
    head: str = ""
    plugins: tuple[str, ...] = ()
    input: Input | None = None
    targets: Mapping[str, Verdict] = field(default_factory=dict)
    prefix: str = DEFAULT

    @property
    def rule(self) -> dict[str, Any]:
        """The decision rule, and the head that answers."""
        return {name: getattr(self, name) for name in RULE}

    @property
    def n_outputs(self) -> int:
        """Output neurons of a network: classes, of all heads."""
        return sum(len(head.classes) for head in self.heads) or len(self.classes)

    @property
    def answering(self) -> Head | None:
        """The head that answers alone; None: all of them together, or there are none."""
        return next((head for head in self.heads if head.name == self.head), None)

    @property
    def answers(self) -> tuple[str, ...]:
        """Names of the classes that it answers: those of the head that answers, else all."""
        return self.classes if self.answering is None else self.answering.classes

    def named(self, label: int) -> str | None:
        """Return the name of a class that it answers; None for -1, which is none."""
        return self.answers[label] if label >= 0 else None

    def answered(self, label: Ints) -> Ints:
        """Return classes of the whole network as those that it answers; -1 stays."""
        head = self.answering
        return label if head is None else np.where(label >= 0, head.of_class[label], -1)
