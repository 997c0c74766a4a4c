"""Completion of a shell: bash runs the script; what zsh and fish get names the same commands."""

from __future__ import annotations

import shutil
import subprocess

import pytest

from dse.cli import main
from dse.cli.commands import commands_by_name

COMPLETED = {
    "dse pi": ["pick"],
    "dse run quick": ["quickstart"],
    "dse pick results/example --hardware xylo": ["xylo_imu"],
    "dse export bundle --target c9": ["c99"],
    "dse skyline --conf": ["--confidence"],
    "dse describe enc": ["encoder"],
    "dse pick --format j": ["json"],
    "dse nothing x": [],
}


def printed(capsys: pytest.CaptureFixture[str], shell: str) -> str:
    assert main(["completion", shell]) == 0
    return capsys.readouterr().out


def test_bash_completes_commands_options_and_names(capsys: pytest.CaptureFixture[str]) -> None:
    lines = [printed(capsys, "bash")]
    for line in COMPLETED:
        words = line.split(" ")
        lines += [
            f"COMP_WORDS=({' '.join(words)}); COMP_CWORD={len(words) - 1}; _dse",
            'echo "${COMPREPLY[*]}"',
        ]
    done = subprocess.run(["bash", "-c", "\n".join(lines)], capture_output=True, text=True, check=True)
    assert [line.split() for line in done.stdout.splitlines()] == list(COMPLETED.values())


def test_zsh_and_fish_know_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert printed(capsys, "zsh").startswith("#compdef dse\n")
    fish = printed(capsys, "fish")
    for command in commands_by_name():
        assert f"-f -a {command} -d '" in fish
    assert "-l hardware -x -a 'asic45_memory " in fish
    for shell, script in (("zsh", printed(capsys, "zsh")), ("fish", fish)):
        if shutil.which(shell):
            subprocess.run([shell, "--no-execute"], input=script, text=True, check=True)


def test_an_unknown_shell_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["completion", "tcsh"])
    assert "invalid choice: 'tcsh'" in capsys.readouterr().err
