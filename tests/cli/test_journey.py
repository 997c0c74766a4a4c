"""From the page to a deployed bundle, as a reader goes: from disk and from a server, with a real study."""

import contextlib
import json
import shlex
import zipfile

import pytest

from dse.cli import main
from dse.dashboard.site import page_server
from dse.study.results import open as open_study
from tests.serving import served
from tests.spaces import write_space


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
        tab.wait_for_function("document.querySelector('#plot')?.data?.length > 0")
        yield tab
        tab.goto("about:blank")
    assert faults == []


def answered(capsys, *arguments):
    capsys.readouterr()
    assert main([*arguments, "--json"]) == 0
    return list(json.loads(capsys.readouterr().out)["rows"])


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
    # Every slider costs designs when it is moved to its end, and none when it is cleared.
    every = tab.inner_text("#feasible")
    sliders = tab.locator(".budget input[type=range]:enabled")
    assert sliders.count() >= 4
    for k in range(sliders.count()):
        loose = sliders.nth(k).input_value()
        sliders.nth(k).press("End" if loose == "0" else "Home")
        assert tab.inner_text("#feasible") != every
        tab.click("#clear")
        assert tab.inner_text("#feasible") == every
    # A brush of the parallel coordinates is the same budget.
    brush = tab.locator("#parallel [role=slider][aria-label^=energy]")
    for _ in range(60):
        brush.press("ArrowDown")
    limit = tab.input_value("#budget-2")
    assert float(limit) > 0
    rows = answered(
        capsys, "skyline", str(results), "--where", f"hardware == 'loihi1_silicon' and energy_uj <= {limit}"
    )
    assert sorted(keys(tab)) == sorted(map(key, rows))
    # Another chip has another front, and what it costs there.
    tab.select_option("#hardware", "mcu_m4")
    tab.click("#clear")
    where = "hardware == 'mcu_m4'"
    rows = answered(capsys, "skyline", str(results), "--where", where)
    assert sorted(keys(tab)) == sorted(map(key, rows))
    # A design is chosen in the table, marked in the figure, told in its panel, and set beside another.
    line = tab.locator("#front tbody tr").nth(1)
    line.click()
    trial, point = line.get_attribute("data-key").split(".")
    assert tab.inner_text("#design h2") == f"Trial {trial}"
    points = open_study(results).points()
    chosen = points[
        (points["trial"] == int(trial)) & (points["point"] == int(point)) & (points["hardware"] == "mcu_m4")
    ].iloc[0]
    tab.wait_for_function(
        "(x) => document.getElementById('plot').data"
        ".some((t) => t.marker?.symbol === 'circle-open' && Math.abs(t.x[0] - x) < 1e-12)",
        arg=float(chosen["energy_uj"]),
    )
    tab.wait_for_selector("#design [role=tab]")
    tab.keyboard.press("c")
    tab.locator("#front tbody tr").first.click()
    tab.keyboard.press("c")
    assert tab.locator("#compare thead .square").count() == 2
    # The pick is that of the command on the page, which exports it; a server hands it over too.
    tab.fill("#budget-1", "100")
    words = shlex.split(tab.text_content("#command"))
    assert words[:2] == ["dse", "pick"]
    arguments = [str(tmp_path / "bundle") if word == "bundle" else word for word in words[1:]]
    [picked, *_] = answered(capsys, *arguments)
    tab.click("#pick button >> nth=0")
    assert f"chosen={key(picked)}" in tab.evaluate("location.hash")
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
