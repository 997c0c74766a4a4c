"""Whatever of somebody else is opened: nothing of it runs, unless the user has consented."""

import io
import itertools
import json
import os
import shutil
import stat
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from dse.base import registry, trust
from dse.cli import main
from dse.cli.commands import MODULE_OF
from dse.config import ConfigError, load_space
from dse.deploy import bundle
from dse.deploy.verify import export_targets, target_named
from dse.show.dashboard.site import page_server
from dse.testing.targets import small_bundle, small_recordings
from tests.base.trust.others import forgotten, made, poisoned
from tests.serving import ask, served


@pytest.fixture(scope="module")
def original(tmp_path_factory, own_config):
    folder = tmp_path_factory.mktemp("others")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DSE_CONFIG", str(folder / "their_config"))
        return made(folder / "made", folder / "PWNED")


@pytest.fixture
def others(original, tmp_path, monkeypatch):
    """A copy of the files of others, on a machine that trusts nothing, in a process that knows nothing."""
    monkeypatch.setenv("DSE_CONFIG", str(tmp_path / "config"))
    monkeypatch.chdir(tmp_path)
    with forgotten():
        yield original.copied(tmp_path / "others")
    original.trace.unlink(missing_ok=True)


# Command -> its arguments, with properties of `Others` in braces, and its exit code without consent.
READ = {
    "skyline": ("{study}", 0),
    "pick": ("{study} --budget n_weights<=100000", 0),
    "dashboard": ("{study} --html page.html", 0),
    "figure": ("{study} front --out front.json", 0),
    "report": ("{study}", 2),
    "doctor": ("{study}", 0),
    "enqueue": ("{space} {root}/designs.yaml --results results", 2),
    "check": ("{space}", 2),
    "audit": ("{space}", 2),
    "run": ("{space} --results results", 2),
    "evaluate": ("{bundle} --data {data}", 2),
    "stream": ("{bundle} --data {data}", 2),
    "measure": ("{bundle} --data {data}", 2),
    "verify": ("{bundle} --data {data}", 2),
    "reproduce": ("{bundle}", 2),
    "export": ("{bundle} --target c99", 2),
    "init": ("{data} --label label --step-ms 10 --out first.yaml", 0),
    "example": ("", 0),
    "prepare": ("braille {root} --out prepared", 2),
    "describe": ("hardware {root}/mine.py", 2),
    "simulate": ("{root}/mine.py", 2),
    "cost": ("{study}/hardware/loihi1_silicon.yaml --hardware {root}/mine.py", 2),
}
MORE = {
    "skyline priced anew": ("skyline", "{study} --hardware mcu_m4", 0),
    "skyline on a profile of theirs": ("skyline", "{study} --hardware {root}/mine.py", 2),
    "pick exported": ("pick", "{study} --export picked", 2),
    "pick on a target": ("pick", "{study} --target c99", 2),
    "export for a board": ("export", "{bundle} --board pico", 2),
    "a page of theirs": ("dashboard", "{study} --html page.html --page {root}/page.yaml", 2),
    "a figure of theirs": ("figure", "{study} figure_of_others --out front.json", 2),
    "doctor repairs": ("doctor", "{study} --repair", 0),
    "their study is run on": ("run", "{study}/search_space.yaml --results results", 2),
    "tables are made anew": ("doctor", "{root}/bare --repair", None),
}
CASES = [
    *((name, name, *case) for name, case in READ.items()),
    *((name, *case) for name, case in MORE.items()),
]


def called(others, command, arguments):
    """Run a command with arguments about files of others."""
    places = {name: getattr(others, name) for name in ("root", "study", "space", "bundle", "data")}
    try:
        return main([command, *(argument.format(**places) for argument in arguments.split())])
    except SystemExit as left:
        return int(left.code or 0)


def prepared(others):
    (others.root / "designs.yaml").write_text("model.hidden: 4\n")
    (others.root / "page.yaml").write_text("plugins: [mine.py]\nviews: [table]\n")
    for name in ("again", "bare"):
        shutil.copytree(others.study, others.root / name)
    (others.root / "bare" / "points.parquet").unlink()


def test_every_command_is_tried():
    assert set(READ) == set(MODULE_OF)


@pytest.mark.parametrize(("name", "command", "arguments", "code"), CASES)
def test_nothing_of_a_folder_runs(others, capsys, name, command, arguments, code):
    prepared(others)
    found = called(others, command, arguments)
    error = capsys.readouterr().err
    assert not others.trace.exists(), name
    assert code is None or found == code, error
    assert "Traceback" not in error


PATHS, MODULES = ("others/mine.py", "./others/../others/mine.py"), ("mine_of_others", "pack_of_others.part")
FINDERS = [case for case in CASES if case[1] in ("skyline", "figure", "dashboard", "run")]
FOUND = [*zip(FINDERS * 2, itertools.cycle((*PATHS, *MODULES, "antigravity")), strict=False)]
"""Each command with two of the plugins, each plugin with some of the commands."""


@pytest.mark.parametrize(("case", "plugin"), FOUND)
def test_no_name_of_a_plugin_finds_code(others, monkeypatch, capsys, plugin, case):
    """Paths are relative to the working folder, and modules may lie in it: `python -m dse` looks there."""
    prepared(others)
    here = Path.cwd()
    trace = f"open({str(others.trace)!r}, 'w').close()\n"
    (here / "mine_of_others.py").write_text(trace)
    (here / "pack_of_others").mkdir()
    (here / "pack_of_others" / "__init__.py").write_text(trace)
    (here / "pack_of_others" / "part.py").write_text(trace)
    monkeypatch.syspath_prepend(here)
    monkeypatch.setattr("webbrowser.open", lambda *_: others.trace.touch())  # what antigravity does
    others.rename_plugins(plugin)
    called(others, *case[1:3])
    assert not others.trace.exists()
    assert "antigravity" not in sys.modules


@pytest.mark.parametrize("kind", ["pipe", "folder", "device", "huge"])
def test_what_is_no_source_is_refused_at_once(others, capsys, kind):
    plugin = others.root / "mine.py"
    plugin.unlink()
    if kind == "pipe":
        os.mkfifo(plugin)
    elif kind == "folder":
        plugin.mkdir()
    elif kind == "device":
        plugin.symlink_to("/dev/zero")
    else:
        with plugin.open("wb") as file:
            file.truncate(2**40)
    for words in (
        ["check", str(others.space)],
        ["figure", str(others.study), "front", "--plugin", str(plugin)],
    ):
        extra = ["--trust"] if words[0] == "check" else ["--out", "front.json"]
        assert main([*words, *extra]) == 2
        [line] = capsys.readouterr().err.splitlines()
        assert " must " in line and "mine.py" in line
    others.rename_plugins(str(plugin))
    assert main(["skyline", str(others.study), "--json"]) == 0


def test_a_server_runs_nothing(others):
    shutil.copytree(others.bundle, others.study / "bundles" / "theirs")
    with served(page_server(others.study, "127.0.0.1", 0)) as server:
        for path in ("/", "/data.json", "/progress.json", "/design.json?trial=0"):
            assert ask(server, path)[0] == 200
        row = next(iter(others.rows()))
        fields = "&".join(f"{name}={row[name]}" for name in ("trial", "point", "hardware"))
        assert ask(server, f"/bundle.zip?{fields}")[0] == 422
    assert not others.trace.exists()


def test_the_token_of_a_page_is_the_users_own(others, monkeypatch):
    """Open pages find their server again; nobody else knows where, and no other study has the same."""
    tokens = [trust.token(name) for name in ("a", "a", "b")]
    assert tokens[0] == tokens[1] != tokens[2]
    key = Path(os.environ["DSE_CONFIG"], "key")
    assert stat.S_IMODE(key.stat().st_mode) == 0o600
    key.unlink()
    assert trust.token("a") != tokens[0]
    monkeypatch.setenv("DSE_CONFIG", "/dev/null")
    assert trust.token("a") != trust.token("a")


def test_consent_is_for_a_content_and_is_asked_once(others, capsys):
    check = ["check", str(others.space), "--json"]
    assert main(check) == 2
    assert main([*check, "--trust"]) == 0 and others.trace.exists()
    capsys.readouterr()
    for arguments in (
        check,
        ["evaluate", str(others.bundle), "--data", str(others.data)],
        ["pick", str(others.study), "--export", "picked"],
        ["report", str(others.study)],
        ["run", str(others.space), "--results", "results", "--quiet"],
    ):
        others.trace.unlink()
        with forgotten():
            assert main(arguments) == 0, capsys.readouterr().err
            assert others.trace.exists()
    others.trace.unlink()
    plugin = others.root / "mine.py"
    plugin.write_text(plugin.read_text() + "# changed\n")
    with forgotten():
        assert main(check) == 2
    assert not others.trace.exists()


@pytest.mark.parametrize(("said", "code"), [("y\n", 0), ("yes\n", 0), ("\n", 2), ("n\n", 2), ("", 2)])
def test_a_person_is_asked(others, monkeypatch, capsys, said, code):
    monkeypatch.setattr("sys.stdin", io.StringIO(said))
    monkeypatch.setattr("dse.cli.asking.is_person", lambda: True)
    assert main(["check", str(others.space)]) == code
    assert others.trace.exists() == (code == 0)
    assert f"{others.root / 'mine.py'}, which {others.space} names" in capsys.readouterr().err
    with forgotten():  # readers ask nobody
        monkeypatch.setattr("sys.stdin", io.StringIO("y\n"))
        others.trace.unlink(missing_ok=True)
        assert main(["skyline", str(others.study)]) == 0
        assert sys.stdin.read() == "y\n" and others.trace.exists() == (code == 0)


def test_a_list_that_cannot_be_kept_is_no_reason(others, capsys):
    Path(os.environ["DSE_CONFIG"]).write_text("a file where the folder should be")
    for _ in range(2):
        with forgotten():
            assert main(["check", str(others.space)]) == 2
            assert main(["check", str(others.space), "--trust"]) == 0


def test_python_is_told_how_to_go_on(others):
    with pytest.raises(ConfigError, match=r"dse\.base\.registry\.load_plugin"):
        load_space(others.space)
    assert not others.trace.exists()
    registry.load_plugin(str(others.root / "mine.py"))
    assert others.trace.exists() and load_space(others.space).plugins
    with forgotten(), trust.answering(True), ThreadPoolExecutor(1) as pool:
        space = load_space(others.space)
        assert space.plugins
        with forgotten():
            Path(os.environ["DSE_CONFIG"], trust.LIST).unlink()
            assert isinstance(pool.submit(load_space, others.space).exception(), ConfigError)


def test_changed_c_is_named_and_neither_compiled_nor_run(tmp_path, capsys):
    bundle.write(small_bundle(), tmp_path / "b")
    data = small_recordings(tmp_path / "touch.npz")
    verify = ["verify", str(tmp_path / "b"), "--data", str(data), "--json"]
    export_targets(tmp_path / "b", ["c99"])
    assert main(verify) == 0
    capsys.readouterr()
    trace = tmp_path / "PWNED"
    run = f'\n__attribute__((constructor)) static void run(void) {{ system("touch {trace}"); }}\n'
    poisoned(tmp_path / "b", "targets/c99/src/dse.c", f"#include <stdlib.h>\n{run}")
    capsys.readouterr()
    assert main(verify) == 2
    [row] = json.loads(capsys.readouterr().out)["rows"]
    assert row["verdict"] == "not verified" and row["reason"].startswith("src/dse.c is not what dse ")
    for command in ("measure", "evaluate", "stream"):
        assert main([command, str(tmp_path / "b"), "--data", str(data)]) == 0
    assert not trace.exists()
    assert main(["export", str(tmp_path / "b"), "--target", "c99"]) == 0
    assert main(verify) == 0
    (tmp_path / "b" / "targets" / "c99" / "src" / "more.c").write_text(run)  # no file that the bundle lists
    capsys.readouterr()
    assert main(verify) == 2
    [row] = json.loads(capsys.readouterr().out)["rows"]
    assert row["verdict"] == "not verified" and row["reason"].startswith("src/more.c ")


@pytest.mark.parametrize("name", sorted({*registry.known("targets")} - {"xylo", "ice40", "ecp5"}))
def test_a_target_is_written_the_same_again(tmp_path, name):
    target, net = target_named(name), small_bundle()
    if name == "torch":
        pytest.importorskip("torch")
    contents = []
    for folder in (tmp_path / "one", tmp_path / "two"):  # of circuits: check_target
        folder.mkdir()
        assert target.refusal(net) == ""
        target.write(net, folder)
        contents.append({x.relative_to(folder): x.read_bytes() for x in folder.rglob("*") if x.is_file()})
        time.sleep(1.1)  # a second of a clock in a file would differ
    assert contents[0] and contents[0] == contents[1]
