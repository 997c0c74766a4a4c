"""What a page plays: each recording is answered in the browser as `dse evaluate` answers it."""

import json
import re

import numpy as np
import pytest

from dse.deploy.evaluate import evaluate
from dse.deploy.export import bundle_of
from dse.deploy.targets import emulator
from dse.show.dashboard import touches
from dse.show.dashboard.site import page_server
from dse.show.dashboard.study import write_page
from dse.show.dashboard.write import write_filled
from dse.study import results
from tests import tiny_study
from tests.deploy.bundles import FAMILIES, explored
from tests.page_data import held
from tests.serving import ask, served

WHY = emulator.missing({"ziglang": "cross-compiler", "wasmtime": "run time"})
needs_compiler = pytest.mark.skipif(bool(WHY), reason=WHY)


@pytest.fixture(scope="module")
def networks(tmp_path_factory):
    text = tiny_study.REAL.replace("repeats: 2", "repeats: 1").replace(
        "{validation: 0.5}", "{validation: 0.3, test: 0.3}"
    )
    return explored(tmp_path_factory.mktemp("networks"), text).folder


def played(page, k):
    """Return the label and the time of recording k, played at once."""
    page.tab.select_option("#touch-recording", str(k))
    page.tab.click("#touch-end")
    data = page.tab.evaluate("({ ...document.querySelector('.touch').dataset })")
    assert int(data["recording"]) == k
    return int(data["label"]), float(data["time"])


def refused_of(study, places, page_path, shown):
    """Compare each recording in the browser with what a bundle answers; return why designs are not played.

    places: of points of each trial: at 0 it answers at the end, at -1 as soon as it is sure.
    """
    points = study.points()
    rows = [points[points["trial"] == x].iloc[k].to_dict() for x in points["trial"].unique() for k in places]
    document = touches.gather_touches(study, rows)
    refused = {key: design["why"] for key, design in document["designs"].items() if "why" in design}
    assert len(refused) < len(document["designs"])
    write_page(study, page_path, plays=False)
    write_filled("page", held(page_path) | {"touches": document}, page_path)
    page = shown()
    file = study.folder.parent.parent / "tiny.npz"
    for row in rows:
        if (key := f"{row['trial']}.{row['point']}") in refused:
            continue
        design = document["designs"][key]
        found = evaluate(bundle_of(study, row), file)
        page.tab.evaluate(f"location.hash = 'chosen={key}'")
        page.tab.wait_for_selector(f"#cards article:first-child[data-key='{key}']")
        page.tab.click("#touch")
        page.tab.wait_for_selector("#touch-next")
        recordings = document["inputs"][design["input"]]
        assert 0 < len(recordings) <= touches.MOST
        for k, recording in enumerate(recordings):
            number = int(re.match(r"recording (\d+)", recording["name"])[1])
            assert recording["true"] == found.target[number]
            label, time_ms = played(page, k)
            assert (label, time_ms) == (found.label[number], pytest.approx(found.time_ms[number]))
            assert (label, time_ms) == (design["label"][k], pytest.approx(design["time_ms"][k]))
    return refused


@needs_compiler
def test_networks_answer_in_the_page_as_they_do_outside(networks, page_path, shown):
    assert refused_of(results.open(networks), (0, -1), page_path, shown) == {}


@needs_compiler
def test_other_families_answer_in_the_page_too(tmp_path, page_path, shown):
    assert all(refused_of(explored(tmp_path, FAMILIES), (-1,), page_path, shown).values())


@needs_compiler
def test_the_energy_of_the_meter_is_that_of_the_table(networks):
    study = results.open(networks)
    points = study.points()
    row = points[(points["trial"] == 0) & points["phi"].isna()].iloc[0].to_dict()
    document = touches.gather_touches(study, [row])
    [design] = document["designs"].values()
    curves = [one["loihi1_silicon"] for one in design["energy"]]
    assert all((np.diff(curve["flat"]) > 0).all() for curve in curves)
    assert all(one["period"][-1] >= one["flat"][-1] for one in curves)
    # Those of the test part are as dear, in the mean, as the validation recordings of the table.
    mean = np.mean([curve["flat"][-1] for curve in curves])
    assert mean == pytest.approx(row["energy_uj"], rel=0.1)


@needs_compiler
def test_a_reader_plays_one_and_the_next_and_another_design_says_so(networks, page_path, shown):
    study = results.open(networks)
    write_page(study, page_path)
    document = held(page_path)
    page = shown()
    [pick, *_] = touches.shown_first(document)
    name = ".".join(str(document["columns"][column]["values"][pick]) for column in ("trial", "point"))
    assert page.tab.get_attribute("#cards article:first-child", "data-key") == name
    page.tab.click("#touch")
    page.tab.wait_for_function("document.querySelector('.touch').dataset.label !== undefined")
    assert page.tab.inner_text(".touch [role=status]") in page.tab.inner_text("#cards")
    page.tab.focus("#touch-next")
    page.tab.keyboard.press("Enter")
    page.tab.wait_for_function("document.querySelector('.touch').dataset.recording === '1'")
    assert page.tab.evaluate("document.activeElement.id") == "touch-next"
    drawn = "document.querySelector('.touch canvas').getContext('2d').getImageData(0, 0, 240, 96)"
    assert page.tab.evaluate(f"{drawn}.data.some(Boolean)")
    assert page.violations() == []
    points = study.points()
    others = {f"{t}.{p}" for t, p in zip(points["trial"], points["point"], strict=True)}
    other = min(others - set(document["touches"]["designs"]))
    page.tab.evaluate(f"location.hash = 'chosen={other}'")
    page.tab.wait_for_selector(f"#cards article:first-child[data-key='{other}']")
    assert page.tab.is_hidden("#touch") and "first" in page.tab.inner_text(".touch")


@needs_compiler
def test_a_served_page_plays_any_design(networks):
    with served(page_server(networks, "127.0.0.1", 0)) as server:
        status, _, body = ask(server, "/touch.json?trial=0&point=1")
        assert status == 200 and "module" in json.loads(body)["designs"]["0.1"]
        assert ask(server, "/touch.json?trial=0&point=1")[2] == body
        assert ask(server, "/touch.json?trial=0&point=9999")[0] == 404
        assert ask(server, "/touch.json?trial=0")[0] == 400
        assert "wasm-unsafe-eval" in ask(server)[1]["Content-Security-Policy"]


def test_what_cannot_be_played_says_why(networks, monkeypatch):
    study = results.open(networks)
    row = study.points().iloc[0].to_dict()

    def why():
        [design] = touches.gather_touches(study, [row])["designs"].values()
        return design["why"]

    with monkeypatch.context() as patch:
        patch.setattr("dse.deploy.targets.emulator.missing", lambda _: "ziglang is not installed")
        assert why() == "ziglang is not installed"
    if not WHY:
        moved = networks.parent.parent / "tiny.npz"
        moved.rename(moved.with_suffix(".away"))
        try:
            assert "not found" in why()
        finally:
            moved.with_suffix(".away").rename(moved)


def test_a_page_without_designs_or_with_no_play_has_no_control(networks, page_path, shown):
    write_page(results.open(networks), page_path, plays=False)
    assert "touches" not in held(page_path)
    assert shown().tab.locator(".touch").count() == 0
    assert "wasm" not in page_path.read_text()[:4000]
