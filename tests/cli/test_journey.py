"""From the page to a deployed bundle, as a reader goes: from disk and from a server, with a real study."""

import contextlib
import json
import shlex
import zipfile

import pytest

from dse.cli import main
from dse.show.dashboard.site import page_server
from dse.study.results import open as open_study
from tests.command import document
from tests.serving import served
from tests.spaces import write_space
from tests.waiting import until


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """The folder of a study of four designs on two chips."""
    folder = tmp_path_factory.mktemp("study")
    changes = (
        ("[4, 8, 12]", "[4, 40]"),
        ("[loihi1_silicon]", "[loihi1_silicon, mcu_m4]"),
        ("[accuracy:max, n_weights:min]", "[accuracy:max, n_weights:min, energy_uj:min]"),
    )
    space = write_space(folder, *changes)
    assert main(["run", str(space), "--results", str(folder / "results"), "--quiet", "--json"]) == 0
    return folder / "results" / "tiny"


@pytest.fixture(params=["disk", "server"])
def opened(request, results, new_tab, page_path):
    """A tab with the study's page; it may complain of nothing."""
    faults = []
    tab = new_tab()
    tab.is_served = request.param == "server"
    tab.on("pageerror", lambda error: faults.append(str(error)))
    tab.on("console", lambda line: faults.append(line.text) if line.type == "error" else None)
    with contextlib.ExitStack() as held:
        if tab.is_served:
            tab.goto(held.enter_context(served(page_server(results, "127.0.0.1", 0))).url)
        else:
            assert main(["dashboard", str(results), "--html", str(page_path)]) == 0
            tab.goto(page_path.as_uri())
        tab.wait_for_function("document.querySelector('#plot')?.drawn?.points.length > 0")
        yield tab
        tab.goto("about:blank")
    assert faults == []


def answered(capsys, *arguments):
    return list(document(capsys, *arguments)["rows"])


def keys(tab):
    return list(tab.eval_on_selector_all("#front tbody tr", "lines => lines.map((line) => line.dataset.key)"))


def key(row):
    return f"{row['trial']}.{row['point']}"


def test_a_reader_leaves_with_the_design_that_the_commands_name(opened, results, tmp_path, capsys):
    tab = opened
    whole = keys(tab)
    assert sorted(whole) == sorted(
        key(row) for row in answered(capsys, "skyline", str(results)) if row["hardware"] == "loihi1_silicon"
    )
    # A limit that is moved on the chart leaves the front of the command, and Back undoes it.
    handle = tab.locator(".limit[data-column=energy_uj]")
    for _ in range(60):
        handle.press("ArrowDown")
    limit = tab.input_value("#sentence [aria-label^=energy][type=number]")
    assert float(limit) > 0
    where = f"hardware == 'loihi1_silicon' and energy_uj <= {limit}"
    rows = answered(capsys, "skyline", str(results), "--where", where)
    until(lambda: sorted(keys(tab)) == sorted(map(key, rows)), "the table follows")
    tab.evaluate("location.hash = ''")
    # Another chip has another front, and what it costs there.
    tab.select_option("#hardware", "mcu_m4")
    rows = answered(capsys, "skyline", str(results), "--where", "hardware == 'mcu_m4'")
    until(lambda: sorted(keys(tab)) == sorted(map(key, rows)), "the table follows")
    # A design is chosen in the table, marked in the figure, told in its panel, and set beside another.
    line = tab.locator("#front tbody tr").nth(1)
    line.click()
    trial, point = line.get_attribute("data-key").split(".")
    points = open_study(results).points()
    chosen = points[
        (points["trial"] == int(trial)) & (points["point"] == int(point)) & (points["hardware"] == "mcu_m4")
    ].iloc[0]
    tab.wait_for_function(
        "(x) => document.getElementById('plot').drawn.marks"
        ".some((one) => one.name === 'your choice' && Math.abs(one.value[0] - x) < 1e-12)",
        arg=float(chosen["energy_uj"]),
    )
    tab.click("#show-inside")
    tab.wait_for_selector("#design [role=tab]")
    assert tab.inner_text("#design h2") == f"Trial {trial}"
    # The pick is that of the command on the page, which exports it; a server hands it over too.
    tab.keyboard.press("Escape")
    tab.fill("#sentence [aria-label^=energy][type=number]", "100")
    tab.click("#asks [data-ask=take]")
    words = shlex.split(tab.text_content("#command"))
    assert words[:2] == ["dse", "pick"]
    arguments = [str(tmp_path / "bundle") if word == "bundle" else word for word in words[1:]]
    [picked, *_] = answered(capsys, *arguments)
    assert tab.get_attribute("#cards article", "data-key") == key(picked)
    bundle = tmp_path / "bundle"
    assert tab.is_visible("#bundle") == tab.is_served
    if tab.is_served:
        with tab.expect_download() as saved:
            tab.click("#bundle")
        with zipfile.ZipFile(saved.value.path()) as archive:
            archive.extractall(tmp_path / "sent")
        [sent] = (tmp_path / "sent").iterdir()
        exported = json.loads((bundle / "bundle.json").read_text())
        of_point = exported["record"]
        assert json.loads((sent / "bundle.json").read_text())["record"] == of_point
        bundle = sent
    [row] = answered(capsys, "evaluate", str(bundle), "--data", str(results.parent.parent / "touch.npz"))
    assert 0 <= row["accuracy"] <= 1
