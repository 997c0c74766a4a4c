"""Completion scripts of shells: commands, options, and names of profiles, targets and search spaces."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass

from dse import registry
from dse.cli.reference import sections
from dse.config.locate import hardware_names, shipped_spaces

SHELLS = ("bash", "zsh", "fish")


@dataclass(frozen=True)
class Word:
    """An option, or a positional argument (name '').

    values: what may follow the option, or stand in the place.
    """

    name: str
    doc: str
    values: tuple[str, ...]


def script(shell: str, parsers: Mapping[str, argparse.ArgumentParser]) -> str:
    """Return the completion script of a shell.

    Args:
        shell: one of SHELLS.
        parsers: by the name of their command.
    """
    commands = {name: _words(parser) for name, parser in parsers.items()}
    if shell == "fish":
        docs = {name: parser.description or "" for name, parser in parsers.items()}
        return "\n".join(_fish(commands, docs)) + "\n"
    start = ["#compdef dse", "autoload -U +X bashcompinit && bashcompinit"] if shell == "zsh" else []
    return "\n".join([*start, *_bash(commands)]) + "\n"


def _words(parser: argparse.ArgumentParser) -> list[Word]:
    names: Mapping[str, Callable[[], Iterable[str]]] = {
        "hardware": hardware_names,
        "target": lambda: registry.known("targets"),
        "space": shipped_spaces,
        "section": lambda: [row["section"] for row in sections()],
        "figure": lambda: registry.known("figures"),
    }
    words = []
    for action in parser._actions:
        known = names[action.dest]() if action.dest in names else ()
        values = tuple(map(str, action.choices or known))
        doc = (action.help or "").replace("%%", "%").split(";")[0]
        words += [Word(name, doc, values) for name in action.option_strings or [""]]
    return words


def _bash(commands: Mapping[str, list[Word]]) -> Iterator[str]:
    yield from ("_dse() {", '    local current="${COMP_WORDS[COMP_CWORD]}" words')
    yield '    if [ "$COMP_CWORD" -eq 1 ]; then'
    yield f"        words={shlex.quote(' '.join(commands))}"
    yield from ("    else", '        case "${COMP_WORDS[1]} ${COMP_WORDS[COMP_CWORD-1]}" in')
    for command, words in commands.items():
        for word in words:
            if word.name and word.values:
                yield f"            '{command} {word.name}') words={shlex.quote(' '.join(word.values))} ;;"
    for command, words in commands.items():
        values = [value for word in words for value in ((word.name,) if word.name else word.values)]
        yield f"            '{command} '*) words={shlex.quote(' '.join(values))} ;;"
    yield from ("        esac", "    fi", '    COMPREPLY=($(compgen -W "$words" -- "$current"))', "}")
    yield "complete -o default -F _dse dse"


def _fish(commands: Mapping[str, list[Word]], docs: Mapping[str, str]) -> Iterator[str]:
    for command, doc in docs.items():
        yield f"complete -c dse -n __fish_use_subcommand -f -a {command} -d {_fish_text(doc)}"
    for command, words in commands.items():
        within = f"complete -c dse -n '__fish_seen_subcommand_from {command}'"
        for word in words:
            values = f" -x -a {_fish_text(' '.join(word.values))}" if word.values else ""
            if not word.name:
                if values:
                    yield f"{within} -a {_fish_text(' '.join(word.values))}"
                continue
            form = f"-l {word.name[2:]}" if word.name.startswith("--") else f"-s {word.name[1:]}"
            yield f"{within} {form}{values} -d {_fish_text(word.doc)}"


def _fish_text(text: str) -> str:
    return "'" + text.replace("\\", "\\\\").replace("'", "\\'") + "'"
