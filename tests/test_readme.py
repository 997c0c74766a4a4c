"""The README's promises: its size, its words, its two commands, its links, and its example, which is run."""

import re
import shlex
import subprocess
from pathlib import Path

import numpy as np
import pytest
import yaml

from dse.cli import main
from dse.cli.commands import MODULE_OF
from tests.command import document

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def shown_commands():
    """Every `dse <command>` that a shell block shows, without its arguments."""
    return sorted(set(re.findall(r"^dse (\w+)", "\n".join(blocks("sh")), flags=re.MULTILINE)))


def test_five_minutes():
    assert len(README.splitlines()) <= 110
    assert len(re.findall(r"!\[", README)) == 1


def test_a_word_is_defined_where_it_first_appears():
    text = re.sub(r"\s+", " ", README)
    words = re.findall(r"\*\*(.+?)\*\*", text)
    assert {
        "study",
        "trial",
        "design",
        "objective",
        "skyline",
        "cohort",
        "hardware profile",
        "φ",
        "θ",
    } <= set(words)
    for word in words:
        assert text.lower().index(word) == text.index(f"**{word}**") + 2, word


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
    fetched = re.findall(r"^\S+/python -m pip install (?!.* -e )(.*)", plan, flags=re.MULTILINE)
    assert fetched and all(" --require-hashes --no-deps -r .ci/" in each for each in fetched)
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
    commands = shown_commands()
    assert {"run", "skyline", "pick", "evaluate"} <= set(commands)
    assert set(commands) <= set(MODULE_OF)


def test_described_sections_exist(capsys):
    sections = re.findall(r"`dse describe ([\w.]+)`", README)
    assert sections
    assert [main(["describe", section]) for section in sections] == [0] * len(sections)


def test_search_spaces_named_exist():
    named = re.findall(r"search_spaces/[\w/]+\.yaml", README)
    assert named
    assert [name for name in named if not (ROOT / name).is_file()] == []


def test_networks_of_the_table_are_shipped_search_spaces(shared_data, monkeypatch, capsys):
    monkeypatch.setenv("DSE_DATA", str(shared_data))
    weights = []
    for path in sorted(ROOT.glob("search_spaces/headline_*.yaml")):
        pruned = yaml.safe_load(path.read_text(encoding="utf-8"))["model"].get("pruned", 0.0)
        [row] = document(capsys, "check", path.stem)["rows"]
        assert row["designs"] == 1
        weights.append(row["n_weights_high"] * (1 - pruned))
    shown = re.findall(r"^\| [^|]+\| spiking \|(?:[^|]+\|){3} ([\d ]+) \|", README, flags=re.MULTILINE)
    assert len(shown) == 5
    for text in shown:
        # Rounding to 8 bits makes a few more weights of a pruned network 0.
        assert any(int(text.replace(" ", "")) == pytest.approx(n, rel=0.04) for n in weights), text


def touches():
    """60 touches of three fabrics, which differ in the frequency that they make the sensor vibrate at."""
    rng = np.random.default_rng(0)
    fabric = np.tile(["denim", "silk", "wool"], 20)
    hz = np.tile([4.0, 9.0, 18.0], 20)[:, None, None]
    t_s = 0.004 * np.arange(250)[None, :, None]
    phase = rng.uniform(0, 6, (60, 1, 1)) + np.array([0.0, 1.0])
    pressure = 0.5 * np.sin(2 * np.pi * hz * t_s + phase) + rng.normal(0, 0.03, (60, 250, 2))
    return {"pressure": pressure, "fabric": fabric, "session": np.arange(60) // 3 % 5}


def run_shown(commands):
    for line in commands.splitlines():
        program, *arguments = shlex.split(line, comments=True)
        assert program == "dse"
        assert main(arguments) == 0, line


def test_the_example_goes_from_arrays_to_a_bundle(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DSE_CACHE", str(tmp_path / "cache"))
    (code,), (space,), (_, commands) = (
        re.findall(r"`(np\.savez\(.+\))`", README),
        blocks("yaml"),
        blocks("sh"),
    )
    exec(compile(code, "README.md", "exec"), {"np": np, **touches()})
    (tmp_path / "my_touch.yaml").write_text(space, encoding="utf-8")
    run_shown(commands)
    assert "bundle: bundle" in capsys.readouterr().err
    assert (tmp_path / "bundle" / "bundle.json").is_file()
    assert (tmp_path / "page.html").is_file()


def test_from_python_uses_what_exists():
    import dse

    names = set(re.findall(r"\bdse\.(\w+)\(", README))
    assert names
    assert names <= set(dse.__all__)
