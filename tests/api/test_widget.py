"""The page of a study as a widget: drawn as a notebook draws it, and what is chosen in it known in Python."""

from pathlib import Path

import pytest

import dse
from dse.base.native.extras import MissingExtra
from dse.store import StoreError

EXAMPLE = Path(__file__).resolve().parents[2] / "results" / "example"

# What a notebook does with a widget: it imports its module, and keeps a model in step with Python.
_HOST = """async ([module, state]) => {
  const address = URL.createObjectURL(new Blob([module], { type: "text/javascript" }));
  const { default: widget } = await import(address);
  window.saved = [];
  const model = { get: (name) => state[name], set: (name, value) => { state[name] = value; },
    save_changes: () => window.saved.push(state.chosen) };
  window.clean = widget.render({ model, el: document.body });
}"""


def test_a_reader_chooses_in_the_page_and_the_notebook_exports_it(new_tab, tmp_path):
    study = dse.open(EXAMPLE)
    page = study.page(height_px=700)
    with pytest.raises(StoreError, match="no design point yet"):
        _ = page.row
    tab = new_tab((1280, 720), "light")
    tab.goto("about:blank")
    tab.evaluate(_HOST, [page._esm, {"html": page.html, "height_px": page.height_px}])
    tab.wait_for_function("window.saved.length > 0")  # the pick, as the page opens
    page.chosen = tab.evaluate("window.saved.at(-1)")
    assert {name: page.row[name] for name in ("trial", "point", "task", "hardware")} == page.chosen
    frame = tab.frame_locator("iframe")
    frame.locator("#front tbody tr[aria-selected=false]").first.click()
    is_other = "at => saved.at(-1).trial !== at.trial || saved.at(-1).point !== at.point"
    tab.wait_for_function(is_other, arg=page.chosen)
    before = page.row
    page.chosen = tab.evaluate("window.saved.at(-1)")
    chosen = page.row
    assert (chosen["trial"], chosen["point"]) != (before["trial"], before["point"])
    study.export(chosen, tmp_path / "bundle")
    assert (tmp_path / "bundle" / "bundle.json").is_file()
    heard = tab.evaluate("window.saved.length")
    tab.evaluate("() => postMessage({ chosen: { trial: 99 } })")  # of another window than the page's
    tab.wait_for_timeout(50)
    tab.evaluate("window.clean()")
    assert tab.evaluate("window.saved.length") == heard
    page.chosen = {"trial": 99, "point": 0}
    with pytest.raises(StoreError, match="has no more"):
        _ = page.row


@pytest.mark.parametrize("height_px", ["tall", 0, 1.5])
def test_a_height_is_a_number_of_pixels(height_px):
    with pytest.raises(TypeError, match="height_px"):
        dse.open(EXAMPLE).page(height_px=height_px)


def test_without_the_library_one_line_says_what_to_install(monkeypatch):
    monkeypatch.setattr("dse.api.study.find_spec", lambda name: None)
    with pytest.raises(MissingExtra, match=r"dse-spiking\[notebook\]"):
        dse.open(EXAMPLE).page()
