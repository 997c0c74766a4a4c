"""The search space that a command names, with values replaced."""

from __future__ import annotations

from collections.abc import Iterable

from dse.config import ConfigError, Fault, SearchSpace, load_space


def load(space: str, replaced: Iterable[str], repair: bool) -> SearchSpace:
    """Return a search space with values KEY=VALUE; its data files and hardware profiles are checked too."""
    from dse.measure.hardware.profile import of_space

    overrides = overrides_of(replaced) | ({"data.repair": "true"} if repair else {})
    loaded = load_space(space, overrides, check_data=True)
    of_space(loaded)
    return loaded


def overrides_of(texts: Iterable[str]) -> dict[str, str]:
    """Return key -> value of each `--set`."""
    overrides, faults = {}, []
    for text in texts:
        key, equals, value = text.partition("=")
        if not equals:
            faults.append(Fault(f"--set {text}", 0, "must be KEY=VALUE"))
        overrides[key.strip()] = value
    if faults:
        raise ConfigError(faults)
    return overrides
