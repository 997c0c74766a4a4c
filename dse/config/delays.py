"""What delays and learnt decays need of other sections, as far as a file shows it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path as File
from typing import Any

import numpy as np

from dse.config.chips import chips
from dse.config.parts import Part
from dse.config.yaml_lines import Path


def delay_faults(
    sections: Mapping[str, Part], hardware: Sequence[str], device: str, base: File
) -> Iterator[tuple[Path, str]]:
    """Yield (path, sentence) for delays beyond the window, and for a device and chips without what is named.

    Args:
        sections: as they are written; those at fault are not looked into.
        hardware: profiles, or their files; one that some designs can run on is not at fault.
        device: that trains.
        base: folder of the search space, which files are relative to.
    """
    model = sections.get("model")
    if model is None or not model.good:
        return
    families = model.entries or {"": model}
    window = sections.get("window")
    lengths = _values(window, "n_steps") if window is not None and window.good else ()
    known = [n for n in lengths if n is not None]
    longest: list[tuple[str, int]] = []
    for kind, part in families.items():
        keys = ("model", kind) if kind else ("model",)
        of_inputs = [x for value in _values(part, "input_delays") for x in np.atleast_1d(value).tolist()]
        if known and len(known) == len(lengths) and max(of_inputs, default=0) >= max(known):
            text = f"must be below the steps of the window, {max(known)}: later spikes are lost"
            yield (*keys, "input_delays"), f"model.input_delays {text}, got {max(of_inputs)}"
        least: list[tuple[str, int]] = []
        for key in ("max_delay", "max_axonal_delay"):
            delays = _values(part, key) or (0,)
            least += [(key, min(delays))] * (min(delays) > 0)
            if not max(delays):
                continue
            where: Path = (*keys, key)
            steps = [n * min(_values(part, "steps_per_sample")) for n in known]
            if steps and max(delays) >= min(steps):
                text = f"must be below the network steps of the window, {min(steps)}: later spikes are lost"
                yield where, f"model.{key} {text}, got {max(delays)}"
            if device != "cpu":
                yield where, f"model.{key} must be 0 on execution.device {device}, got {max(delays)}"
        learnt = [x for x in _values(part, "learnt_decays") if x != "no"]
        if learnt and device != "cpu":
            text = f"must be no on execution.device {device}, got {learnt[0]}"
            yield (*keys, "learnt_decays"), f"model.learnt_decays {text}"
        longest += least[:1] or [("", 0)]
    key, shortest = min(longest, key=lambda x: x[1])
    if not shortest:
        return
    for chip in chips(hardware, base):
        if not chip.kind.delays_synapses:
            text = f"cannot delay synapses (model.{key} {shortest})"
            yield ("hardware", chip.place), f"hardware '{chip.name}' {text}"


def _values(part: Part, key: str) -> tuple[Any, ...]:
    """Return the values that a key has in some design, of a range its ends; empty: there is no such key."""
    axis = next((axis for axis in part.axes.values() if axis.place[1] == key), None)
    if axis is not None:
        return axis.extremes()
    return (part.values[key],) if key in part.values else ()
