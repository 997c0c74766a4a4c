"""Chips of a search space, as far as their profiles say before they are loaded."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from dse import registry
from dse.config.locate import is_hardware_file, shipped_profiles
from dse.config.yaml_lines import Raw, parse


class Chip(NamedTuple):
    """A profile of section `hardware`: its place there, its name, what its file holds, its kind."""

    place: int
    name: str
    profile: Mapping[str, Raw]
    kind: Any

    @property
    def is_fixed(self) -> bool:
        """Whether its neurons cannot be programmed."""
        return self.profile.get("programmable") is not True and not self.kind.any_neuron


def chips(names: Sequence[str], base: Path) -> Iterator[Chip]:
    """Yield the chips whose profile is found and whose kind is known.

    Args:
        names: hardware profiles, or their files.
        base: folder of the search space, which files are relative to.
    """
    kinds = registry.known("hardware.kinds")
    for index, name in enumerate(names):
        path = base / name if is_hardware_file(name) else shipped_profiles().get(name)
        if path is None or not path.is_file():
            continue
        profile = parse(path.read_text(encoding="utf-8"), name).data
        kind = kinds.get(str(profile.get("kind"))) if isinstance(profile, dict) else None
        if isinstance(profile, dict) and kind is not None:
            yield Chip(index, name, profile, kind)
