"""What delays of synapses need of other sections, as far as a file shows it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path as File
from typing import Any

from dse import registry
from dse.config.locate import is_hardware_file, shipped_profiles
from dse.config.parts import Part
from dse.config.yaml_lines import Path, parse


def delay_faults(
    sections: Mapping[str, Part], hardware: Sequence[str], device: str, base: File
) -> Iterator[tuple[Path, str]]:
    """Yield (path, sentence) for delays beyond the window, a device and chips that have none.

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
    longest: list[int] = []
    for kind, part in families.items():
        delays = _values(part, "max_delay") or (0,)
        longest.append(min(delays))
        if not max(delays):
            continue
        where: Path = ("model", *([kind] if kind else []), "max_delay")
        if "window" in sections and sections["window"].good:
            windows = _values(sections["window"], "n_steps")
            steps = [n * min(_values(part, "steps_per_sample")) for n in windows if n is not None]
            if steps and max(delays) >= min(steps):
                text = f"must be below the network steps of the window, {min(steps)}: later spikes are lost"
                yield where, f"model.max_delay {text}, got {max(delays)}"
        if device != "cpu":
            yield where, f"model.max_delay must be 0 on execution.device {device}, got {max(delays)}"
    if not all(longest):
        return
    kinds: dict[str, Any] = registry.known("hardware.kinds")
    for index, name in enumerate(hardware):
        path = base / name if is_hardware_file(name) else shipped_profiles().get(name)
        if path is None or not path.is_file():
            continue
        profile = parse(path.read_text(encoding="utf-8"), name).data
        cls = kinds.get(str(profile.get("kind"))) if isinstance(profile, dict) else None
        if cls is not None and not cls.delays_synapses:
            text = f"cannot delay synapses (model.max_delay {min(longest)})"
            yield ("hardware", index), f"hardware '{name}' {text}"


def _values(part: Part, key: str) -> tuple[Any, ...]:
    """Return the values that a key has in some design, of a range its ends; empty: there is no such key."""
    axis = next((axis for axis in part.axes.values() if axis.place[1] == key), None)
    if axis is not None:
        return axis.extremes()
    return (part.values[key],) if key in part.values else ()
