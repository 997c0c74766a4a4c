"""The page of a trial: what it carries, and what a browser makes of it."""

import base64
import json
from types import SimpleNamespace

import numpy as np
import pytest

from dse.base.records import Block
from dse.show.dashboard.trial import trial_page, write_trial_page
from dse.show.figures.trial import draw_pins, gather_trial
from tests.page_data import held
from tests.show.dashboard.page import Page

HOSTILE = '<img src=x onerror="window.hacked=1"></script><script>window.hacked=1</script>{{script}}'
SIZES = ((1280, 720), (390, 844), (320, 568))


def made_up(n_pins=12, n_events=2000, name="a trial", most_events=60_000):
    """A trial of 0.2 s: pins in a row, which sway together by 5 px; events at random near them."""
    rng = np.random.default_rng(5)
    t_s = np.arange(401) * 5e-4
    sway = 5 * np.sin(2 * np.pi * t_s / 0.2)
    px = np.stack([np.linspace(20, 140, n_pins) + sway[:, None], np.full((401, n_pins), 50.0)], axis=2)
    paths = SimpleNamespace(t_s=t_s, px=px, s_mm=sway / 10, v_mm_s=20 + sway, radius_px=4.0)
    t_us = np.sort(rng.integers(0, 199_000, n_events))
    x = rng.integers(15, 145, n_events).astype(np.int32)
    y = rng.integers(44, 56, n_events).astype(np.int32)
    block = Block(t_us, x, y, rng.integers(0, 2, n_events).astype(np.uint8))
    return gather_trial(block, paths, (160, 100), name, most_events)


def unpacked(text, kind):
    return np.frombuffer(base64.b64decode(text), kind)


def test_what_a_page_carries_is_the_view():
    view = made_up()
    page = trial_page(view)
    json.dumps(page, allow_nan=False)
    places = unpacked(page["px"], "<i2").reshape(page["n_moments"], 12, 2) * page["px_unit"]
    assert np.abs(places - view.px).max() <= page["px_unit"] / 2 < 0.01
    for name, kind in (("t_us", "<i4"), ("x", "<i2"), ("y", "<i2"), ("polarity", "u1")):
        assert unpacked(page[name], kind).tolist() == getattr(view.events, name).tolist()
    assert page["facts"] == "12 pins · 160 × 100 px · 0.2 s · 2,000 events, 0.01 million per s"
    assert page["notes"] == []
    (note,) = trial_page(made_up(most_events=500))["notes"]
    assert note.startswith("The image shows one event in 4")
    assert trial_page(made_up(n_events=0))["notes"] == ["No pixel sent an event in this trial."]


def test_the_largest_page_is_of_sane_size_and_hostile_text_stays_data(tmp_path):
    path = write_trial_page(made_up(n_pins=331, n_events=400_000), tmp_path / "page.html")
    assert path.stat().st_size < 8e6
    path = write_trial_page(made_up(name=HOSTILE), tmp_path / "page.html")
    text = path.read_text(encoding="utf-8")
    assert held(path)["name"] == HOSTILE
    assert "window.hacked=1</script>" not in text
    assert text.count("// The page's two figures were drawn in Python") == 1


@pytest.fixture
def opened(new_tab, page_path):
    """Return a function that writes a page of a trial and opens it; no page may complain or fetch."""
    faults = []

    def open_page(view):
        page = Page(new_tab(), write_trial_page(view, page_path))
        faults.append(page.faults)
        page.tab.goto(page.path.as_uri())
        page.tab.wait_for_selector("#course .plot-container")
        return page.tab

    yield open_page
    assert [fault for of_page in faults for fault in of_page] == []


MOVE = """(moment) => {
  const slider = document.getElementById("moment");
  slider.value = moment;
  slider.dispatchEvent(new Event("input"));
}"""
FITS = """(at) => {
  const place = document.querySelector(at);
  return place.querySelector(".main-svg").clientWidth <= place.clientWidth;
}"""
SHOWN = """() => document.getElementById("pins").data.map((t) => ({ x: [...t.x], y: [...t.y] }))"""


def test_the_page_moves_as_the_figure_in_python_would_and_plays(opened):
    view = made_up()
    tab = opened(view)
    for moment, exaggeration in ((view.busiest, 1), (100, 1), (100, 10)):
        if moment != view.busiest:
            tab.evaluate(MOVE, moment)
        tab.select_option("#exaggeration", str(exaggeration))
        for shown, drawn in zip(tab.evaluate(SHOWN), draw_pins(view, moment, exaggeration).data, strict=True):
            for axis in "xy":
                np.testing.assert_allclose(
                    np.array(shown[axis], float), np.array(drawn[axis], float), atol=0.05, equal_nan=True
                )
    assert tab.inner_text("#now") == "0.050 s"
    assert "drawn 10 × larger;" in tab.inner_text("#caption")
    cursor = tab.evaluate("document.getElementById('course').layout.shapes[0].x0")
    assert cursor == pytest.approx(0.05)
    # It plays to the end and goes where it is told.
    tab.select_option("#slower", "1")
    tab.evaluate(MOVE, 390)
    tab.click("#play")
    tab.wait_for_function("document.getElementById('moment').value === '400'")
    assert tab.inner_text("#play") == "Play"
    tab.select_option("#slower", "100")
    tab.click("#play")
    assert tab.inner_text("#play") == "Pause"
    tab.wait_for_function("Number(document.getElementById('moment').value) > 0")
    assert int(tab.input_value("#moment")) < 400
    tab.click("#play")
    assert tab.inner_text("#play") == "Play"
    tab.evaluate("document.getElementById('course').emit('plotly_click', {points: [{x: 0.12}]})")
    assert tab.inner_text("#now") == "0.120 s"
    tab.focus("#moment")
    tab.keyboard.press("ArrowRight")
    assert tab.input_value("#moment") == "241"


def test_a_hostile_name_never_runs_and_is_readable_at_any_size_in_light_and_dark(opened):
    name = f"{HOSTILE} is much longer than any phone is wide, " * 3
    tab = opened(made_up(name=name, n_events=0))
    assert "No pixel sent an event" in tab.inner_text("#notes") and tab.is_visible("#pins .plot-container")
    assert tab.evaluate("window.hacked") is None and tab.locator("img").count() == 0
    assert tab.locator("h1").text_content() == name
    for width, height in SIZES:
        tab.set_viewport_size({"width": width, "height": height})
        assert tab.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
        for plot in ("#pins", "#course"):
            tab.wait_for_function(FITS, arg=plot)
            assert tab.locator(plot).bounding_box()["height"] >= 320
    ink = "(ink) => getComputedStyle(document.querySelector('#course .ytitle')).fill === ink"
    for theme, text, colour in (
        ("light", "rgb(27, 30, 34)", "#0072B2"),
        ("dark", "rgb(232, 234, 237)", "#56B4E9"),
    ):
        tab.emulate_media(color_scheme=theme)
        tab.wait_for_function(ink, arg=text)
        assert tab.evaluate("document.getElementById('pins').data[3].marker.color") == colour
