"""The README's promises: its size, its two commands, its links, and every `dse` command it shows."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def shown_commands() -> list[str]:
    """Every `dse <command>` that a shell block shows, without its arguments."""
    return sorted(set(re.findall(r"^dse (\w+)", "\n".join(blocks("sh")), flags=re.MULTILINE)))


def test_five_minutes():
    assert len(README.splitlines()) <= 110
    assert len(re.findall(r"!\[", README)) == 1


def test_two_commands_do_everything():
    set_up = blocks("sh")[0].split("#")[0]
    assert "make quickstart" in README
    assert "make test" in README
    assert re.findall(r"^make (\w+)", blocks("sh")[0], flags=re.MULTILINE) == ["quickstart", "test"]
    assert "pip" not in set_up


@pytest.mark.parametrize("target", ["quickstart", "test"])
def test_the_commands_exist(target):
    plan = subprocess.run(
        ["make", "--dry-run", "--always-make", target], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    assert "-c constraints.txt" in plan
    assert ("dse run search_spaces/quickstart.yaml" if target == "quickstart" else "-m pytest") in plan


def test_ci_runs_the_readme_command():
    script = ROOT / ".ci" / "run"
    assert script.stat().st_mode & 0o111
    assert "make test" in script.read_text()


def test_links_lead_somewhere():
    links = re.findall(r"\]\((?!https?://|#)([^)#]+)", README)
    assert links
    assert [link for link in links if not (ROOT / link).exists()] == []


def test_shown_commands_exist():
    from dse.cli.command_line import commands_by_name

    commands = shown_commands()
    assert {"run", "skyline", "pick", "evaluate"} <= set(commands)
    assert set(commands) <= set(commands_by_name())


def test_described_sections_exist(capsys):
    from dse.cli import main

    sections = re.findall(r"^dse describe (\w+)", "\n".join(blocks("sh")), flags=re.MULTILINE)
    assert sections
    assert [main(["describe", section]) for section in sections] == [0] * len(sections)


def test_search_spaces_named_exist():
    named = re.findall(r"search_spaces/[\w/]+\.yaml", README)
    assert named
    assert [name for name in named if not (ROOT / name).is_file()] == []


def test_python_blocks_compile_and_use_what_exists():
    import dse

    code = blocks("python")
    assert code
    for block in code:
        compile(block, "README.md", "exec")
    names = set(re.findall(r"\bdse\.(\w+)\(", "\n".join(code)))
    assert names
    assert names <= set(dse.__all__)
