"""Where search spaces and hardware profiles lie: a user's path, the installed package, or the clone."""

from __future__ import annotations

from pathlib import Path

from dse.config.faults import ConfigError, Fault, known_names

_PACKAGE = Path(__file__).parent.parent
_NOT_IN_FILE_NAMES = set('/\\:*?"<>|')


def shipped_spaces() -> dict[str, Path]:
    """Return the search spaces that come with the package (in a clone: `search_spaces/`), by name."""
    # The wheel carries the folder inside the package; a clone has it beside the package.
    folders = (_PACKAGE.parent / "search_spaces", _PACKAGE / "_search_spaces")
    return {path.stem: path for folder in folders for path in sorted(folder.glob("*.yaml"))}


def find_space(path_or_name: str) -> Path:
    """Return the file of a search space given by path or by the name of a shipped one.

    Raises:
        ConfigError: there is neither.
    """
    path = Path(path_or_name)
    if path.is_file():
        return path
    shipped = shipped_spaces()
    if path_or_name in shipped:
        return shipped[path_or_name]
    message = f"no such file and no shipped search space of this name; {known_names(path.stem, shipped)}"
    raise ConfigError([Fault(path_or_name, 0, message)])


def hardware_names() -> list[str]:
    """Return the names of the hardware profiles of the package."""
    return sorted(path.stem for path in (_PACKAGE / "hardware" / "profiles").glob("*.yaml"))


def names_a_file(name: str) -> bool:
    """Return whether a file or a folder can have a name, on every system."""
    return bool(name.strip(". ")) and name.isprintable() and not set(name) & _NOT_IN_FILE_NAMES


def is_hardware_file(name: str) -> bool:
    """Return whether a hardware profile is given by its file, not by its name."""
    return name.endswith((".yaml", ".yml"))
