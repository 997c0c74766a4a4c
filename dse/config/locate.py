"""Where search spaces, scenes, hardware profiles and pages lie: a user's path, the package, or the clone."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from dse.config.faults import ConfigError, Fault, known_names

_PACKAGE = Path(__file__).resolve().parent.parent
_NOT_IN_FILE_NAMES = set('/\\:*?"<>|')


def shipped_folder(name: str) -> Path:
    """Return a folder that comes with the package: inside a wheel, or beside the package in a clone."""
    in_wheel = _PACKAGE / f"_{name}"
    return in_wheel if in_wheel.is_dir() else _PACKAGE.parent / name


def yaml_files(folder: Path) -> dict[str, Path]:
    """Return the YAML files of a folder by name, in the order of the names."""
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def find_file(path_or_name: str, shipped: Mapping[str, Path], what: str, base: Path | None = None) -> Path:
    """Return a file given by its path or by the name of a shipped one.

    Args:
        path_or_name: as the user wrote it.
        shipped: shipped files by name.
        what: what the file holds, such as 'search space'.
        base: folder in which the path is looked up first.

    Raises:
        ConfigError: there is neither.
    """
    for path in (*([base / path_or_name] if base else []), Path(path_or_name)):
        if path.is_file():
            return path
        if path.exists() and path_or_name not in shipped:
            raise ConfigError([Fault(path_or_name, 0, "must be a file, got a folder, pipe or device")])
    if path_or_name in shipped:
        return shipped[path_or_name]
    known = known_names(Path(path_or_name).stem, shipped)
    raise ConfigError([Fault(path_or_name, 0, f"no such file and no shipped {what} of this name; {known}")])


def shipped_spaces() -> dict[str, Path]:
    """Return the search spaces that come with the package, by name."""
    return yaml_files(shipped_folder("search_spaces"))


def shipped_profiles() -> dict[str, Path]:
    """Return the hardware profiles of the package, by name."""
    return yaml_files(_PACKAGE / "measure" / "hardware" / "profiles")


def names_a_file(name: str) -> bool:
    """Return whether a file or a folder can have a name, on every system."""
    return bool(name.strip(". ")) and name.isprintable() and not set(name) & _NOT_IN_FILE_NAMES


def is_hardware_file(name: str) -> bool:
    """Return whether a hardware profile is given by its file, not by its name."""
    return name.endswith((".yaml", ".yml"))
