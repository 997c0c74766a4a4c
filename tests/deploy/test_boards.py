"""`dse export --board`: the target of a board, its project, its commands; and what is refused."""

import configparser
import re
from dataclasses import replace

import numpy as np
import pytest

from dse.base.registry import known
from dse.cli import main
from dse.deploy import boards, bundle
from dse.deploy.boards import BOARDS
from dse.deploy.bundle import Input, read
from dse.deploy.verify import target_named
from dse.testing.targets import small_bundle, small_recordings
from tests.deploy import bundles
from tests.deploy.c import nets
from tests.deploy.targets import test_loihi


@pytest.fixture
def folder(tmp_path):
    bundle.write(small_bundle(), tmp_path / "bundle")
    return tmp_path / "bundle"


def told(capsys, *arguments):
    """Return the only line that is said where a command fails."""
    capsys.readouterr()
    assert main(["export", *map(str, arguments)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    return error


@pytest.mark.parametrize("board", [x for x in BOARDS.values() if x.environment], ids=lambda x: x.name)
def test_a_board_gets_its_target_a_project_and_commands(board, folder, capsys):
    assert main(["export", str(folder), "--board", board.name, "--prefix", "texture_"]) == 0
    printed, place = capsys.readouterr(), folder / "targets" / board.target
    commands = [f"cd {place}", *board.steps.splitlines()]
    assert printed.err.splitlines()[-len(commands) :] == commands
    assert "\n".join(commands[1:]) in (place / "README.md").read_text()
    project = configparser.ConfigParser()
    project.read(place / "platformio.ini")
    environment = project[f"env:{board.name}"]
    assert environment["board"] and environment["platform"]
    sketch, source = place / project["platformio"]["src_dir"], place / project["env"]["build_flags"][2:]
    assert (sketch / "touch.ino").is_file() and (source / "texture.h").is_file()
    filters = re.findall(r"\+<([^>]*)>", project["env"]["build_src_filter"])
    assert filters == ["*", "../../src/"] and (sketch / filters[1] / "texture.c").is_file()
    others = [x.name for x in BOARDS.values() if x.target != board.target]
    assert not any(project.has_section(f"env:{name}") for name in others)


def test_the_project_of_a_board_is_of_its_target_whether_a_board_is_named_or_not(folder, tmp_path):
    small_recordings(tmp_path / "touch.npz")
    assert main(["export", str(folder), "--board", "nucleo-l476"]) == 0
    files = {x: x.read_bytes() for x in (folder / "targets").rglob("*") if x.is_file()}
    assert main(["export", str(folder), "--target", "cortex_m4"]) == 0
    assert files == {x: x.read_bytes() for x in (folder / "targets").rglob("*") if x.is_file()}
    assert main(["export", str(folder), "--target", "c99"]) == 0
    assert not (folder / "targets" / "c99" / "platformio.ini").exists()


@nets.needs_compiler
def test_a_board_can_be_verified_and_its_files_are_the_targets(folder, tmp_path):
    pytest.importorskip("unicorn")
    small_recordings(tmp_path / "touch.npz")
    command = ["export", str(folder), "--board", "esp32-c3", "--verify", str(tmp_path / "touch.npz")]
    assert main(command) == 0 and read(folder).targets["riscv32"].kind == "faithful"
    assert main(["verify", str(folder), "--data", str(tmp_path / "touch.npz")]) == 0
    (folder / "targets" / "riscv32" / "platformio.ini").unlink()
    assert main(["verify", str(folder), "--data", str(tmp_path / "touch.npz")]) == 2


def test_every_board_has_a_target_and_knows_its_memory():
    for board in BOARDS.values():
        target = target_named(board.target)
        assert board.target in known("targets") and board.commands
        assert set(board.memory) <= set(target.footprint(small_bundle()))
        assert bool(board.memory) == bool(board.environment)  # a gate array refuses by itself


def test_what_a_board_cannot_take_is_refused_in_a_line(folder, capsys, monkeypatch):
    before = (folder / "bundle.json").read_bytes()
    assert "nucleo-l476, pico, esp32-c3, icebreaker, ulx3s" in told(capsys, folder, "--board", "teensy")
    assert "takes target cortex_m0plus, not c99, ice40" in told(
        capsys, folder, "--board", "pico", *("--target", "c99", "--target", "ice40")
    )
    assert "--target NAME or --board NAME" in told(capsys, folder)
    taken = target_named("cortex_m0plus").footprint(read(folder))
    for column in ("ram_bytes", "flash_bytes"):
        small = replace(BOARDS["pico"], memory={column: int(taken[column]) - 1})
        monkeypatch.setitem(boards.BOARDS, "pico", small)
        assert f"its {column} are {taken[column]:.0f}, 1 more than" in told(capsys, folder, "--board", "pico")
    assert before == (folder / "bundle.json").read_bytes() and not (folder / "targets").exists()


@pytest.mark.parametrize("name", ["icebreaker", "ulx3s"])
def test_a_network_beyond_a_gate_array_says_by_what(name, tmp_path, capsys):
    network = bundles.network(np.random.default_rng(0), decays=test_loihi.DECAYS, sizes=(300, 900, 3))
    taken = Input("spikes", network.n_channels, 0, 0, 10, 5.0)
    bundle.write(bundles.bundle(network, input=taken), tmp_path / "large")
    error = told(capsys, tmp_path / "large", "--board", name)
    assert f"does not fit board {name}: it takes " in error and "blocks of memory" in error


def test_an_edited_project_is_not_replaced(folder, capsys):
    command = ["export", str(folder), "--board", "pico"]
    assert main(command) == 0
    project = folder / "targets" / "cortex_m0plus" / "platformio.ini"
    project.write_text(project.read_text() + "upload_port = /dev/ttyACM1\n")
    assert "platformio.ini: is damaged or edited" in told(capsys, *command[1:])
    assert main([*command, "--force"]) == 0 and "upload_port" not in project.read_text()


def test_boards_are_described(capsys):
    assert main(["describe", "boards"]) == 0
    text = capsys.readouterr().out
    assert all(x.name in text and x.target in text for x in BOARDS.values())
