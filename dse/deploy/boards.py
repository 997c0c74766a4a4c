"""Boards: what each has, and how a target of a bundle gets there; a row of boards.yaml each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from dse.config.faults import known_names
from dse.deploy.bundle import Bundle, BundleError
from dse.deploy.c.text import filled
from dse.deploy.targets import Target

_PROJECT = "platformio.ini"
_RUN = "pip install platformio\npio run -e {name} -t upload\npio device monitor -e {name}"


@dataclass(frozen=True)
class Board:
    """A board; its fields are keys of boards.yaml, which says what they mean."""

    name: str
    title: str
    target: str
    memory: Mapping[str, int] = field(default_factory=dict)
    environment: str = ""
    commands: str = _RUN

    @property
    def steps(self) -> str:
        """The commands with its name."""
        return self.commands.format(name=self.name)

    def misfit(self, bundle: Bundle, target: Target) -> str:
        """Return why a classifier does not fit the board, one sentence; '' if nothing is known against it."""
        if why := target.refusal(bundle):
            return why
        taken: dict[str, float] = getattr(target, "footprint", lambda _: {})(bundle)
        for column, has in self.memory.items():
            if (takes := taken.get(column, 0)) > has:
                return f"its {column} are {takes:.0f}, {takes - has:.0f} more than the {has} that it has"
        return ""


BOARDS = {
    name: Board(name, **row)
    for name, row in yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text("utf-8")).items()
}


def board_named(name: str) -> Board:
    """Return a board.

    Raises:
        BundleError: it is unknown.
    """
    if name not in BOARDS:
        raise BundleError(f"unknown board '{name}'; {known_names(name, BOARDS)}")
    return BOARDS[name]


def write_projects(target: str, folder: Path) -> None:
    """Write what the boards of a target need beside its files: a project, and the commands into README.md."""
    boards = [board for board in BOARDS.values() if board.target == target]
    if any(board.environment for board in boards):
        (folder / _PROJECT).write_text(filled(_PROJECT, boards=boards), encoding="utf-8")
    if boards:
        with (folder / "README.md").open("a", encoding="utf-8") as readme:
            readme.write(filled("boards.md", boards=boards))
