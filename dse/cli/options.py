"""Arguments that several commands share: SPACE, --set, --repair, --verify, what is asked of design points."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace

from dse.cli.fields import argument, flag, option
from dse.config import ConfigError, Fault, SearchSpace, load_space
from dse.door.question import Question

REPAIR = "repair damaged event files or leave them out, with a warning for each, instead of stopping"


@dataclass(frozen=True, kw_only=True)
class OfSpace:
    """A search space, with values replaced."""

    space: str = argument("SPACE", "a YAML file, or the name of a shipped search space")
    set: tuple[str, ...] = option(
        "KEY=VALUE",
        "replace the value of a key, e.g. data.file=touch.npz or 'model.hidden={choice: [50, 100]}'; "
        "repeatable",
        (),
    )
    repair: bool = flag(f"{REPAIR}; short for --set data.repair=true")


@dataclass(frozen=True, kw_only=True)
class InResults(OfSpace):
    """The study of a search space, in the folder of all studies."""

    results: str = option("DIR", "folder for studies (default: results)", "results")


@dataclass(frozen=True, kw_only=True)
class Verifying:
    """Targets that are run."""

    verify: str | None = option(
        "RECORDINGS",
        "run each target on these recordings, in the format of the training data, and compare all decisions "
        "and spikes; a target that shows less than its verdict of before gives exit code 4",
    )


def question_of(arguments: Question, targets: Iterable[str] = ()) -> Question:
    """Return what is asked beside objectives and budgets."""
    asked = {field.name: getattr(arguments, field.name) for field in fields(Question)}
    return replace(Question(**asked), targets=tuple(targets))


def load(arguments: OfSpace) -> SearchSpace:
    """Return the search space that the arguments name; its data files and hardware profiles are checked too.

    Raises:
        ConfigError: every fault.
    """
    from dse.hardware.profile import load_all

    overrides = overrides_of(arguments.set)
    if arguments.repair:
        overrides["data.repair"] = "true"
    space = load_space(arguments.space, overrides, check_data=True)
    load_all(space.hardware, space.source.parent)
    return space


def overrides_of(texts: Iterable[str]) -> dict[str, str]:
    """Return key -> value of each `--set`.

    Raises:
        ConfigError: every `--set` that is not KEY=VALUE.
    """
    overrides, faults = {}, []
    for text in texts:
        key, equals, value = text.partition("=")
        if not equals:
            faults.append(Fault(f"--set {text}", 0, "must be KEY=VALUE"))
        overrides[key.strip()] = value
    if faults:
        raise ConfigError(faults)
    return overrides
