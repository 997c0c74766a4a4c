"""A view is found by its file: those of the package, and one of a user's own in a real browser."""

import re

import pytest

from dse.base import registry
from dse.config.faults import ConfigError
from dse.config.locate import shipped_folder
from dse.show.dashboard.definition import load
from dse.show.dashboard.views import ViewError, view_names, view_sources
from tests.page_data import OBJECTIVES, points, write_page
from tests.show.dashboard.page import Page

PLUGIN = '''
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar
from dse.base.registry import register

@register("views", "spread")
@dataclass(frozen=True)
class Spread:
    """Which designs are within the budgets, as a list."""

    script: ClassVar[str | Path] = {script}
'''
SCRIPT = """
Views.spread = { view(root, app) {
  return {
    render({ rows, within, state }) {
      root.replaceChildren(...rows.filter(within).map((row) => {
        const item = app.element("button", { type: "button", textContent: `design ${app.keyOf(row)}` });
        item.addEventListener("click", () => app.change({ chosen: app.keyOf(row) }));
        item.classList.toggle("chosen", state.chosen === app.keyOf(row));
        return item;
      }));
    },
    hover(key) { root.dataset.pointed = key ?? ""; },
  };
} };
"""


@pytest.fixture(autouse=True)
def no_view_stays(trusting):
    before = dict(registry._components.get("views", {}))
    yield
    registry._components["views"] = before


def definition(folder, script=repr(SCRIPT), views="[spread, table]"):  # noqa: B008
    """Write a plugin that brings a view, and a page definition that names it."""
    (folder / "spread.py").write_text(PLUGIN.format(script=script), encoding="utf-8")
    path = folder / "mine.yaml"
    path.write_text(f"plugins: [spread.py]\nviews: {views}\n", encoding="utf-8")
    return path


def test_every_file_is_a_view():
    assert view_names() == sorted(path.stem for path in (shipped_folder("dashboards") / "views").glob("*.js"))
    assert set(load("study").views or ()) == set(view_names())
    for view in view_sources([]):
        assert f"Views.{view.name} = " in view.script
        assert f'data-view="{view.name}"' in view.section
        assert re.search(r"<style|<script", view.section) is None
    names = [view.name for view in view_sources(["table", "front"])]
    assert names[:2] == ["table", "front"]
    assert sorted(names) == view_names()


@pytest.mark.parametrize("as_file", [False, True])
def test_a_view_of_ones_own(new_tab, page_path, tmp_path, as_file):
    script = repr(SCRIPT)
    if as_file:
        (tmp_path / "drawn.js").write_text(SCRIPT, encoding="utf-8")
        (tmp_path / "drawn.css").write_text(".chosen { outline-width: 7px }", encoding="utf-8")
        script = 'Path(__file__).with_name("drawn.js")'
    mine = load(definition(tmp_path, script))
    path = write_page(points(), page_path, name="x", objectives=OBJECTIVES, definition=mine)
    page = Page(new_tab(), path)
    tab = page.tab
    tab.goto(path.as_uri())
    items = tab.locator("#view-spread button")
    assert items.all_inner_texts() == [f"design {trial}" for trial in range(5)]
    assert tab.is_hidden("#figure")
    before, after = (tab.locator(name).bounding_box()["y"] for name in ("#view-spread", "#front"))
    assert before < after
    # It chooses for every view, and is told what they choose and mark.
    items.nth(2).click()
    assert tab.get_attribute("#front tr[aria-selected=true]", "data-key") == "2"
    tab.click("#front tbody tr >> nth=0")
    chosen = tab.locator("#view-spread .chosen")
    assert chosen.all_inner_texts() == ["design 0"]
    tab.hover("#front tbody tr >> nth=1")
    assert tab.get_attribute("#view-spread", "data-pointed") == "1"
    if as_file:
        assert chosen.evaluate("(node) => getComputedStyle(node).outlineWidth") == "7px"
    assert page.faults == []


def test_a_plugin_that_cannot_be_loaded_and_an_unknown_view(tmp_path):
    path = definition(tmp_path, "1 / 0", "[spred]")
    with pytest.raises(ConfigError) as caught:
        load(path)
    plugin, view = str(caught.value).splitlines()
    assert plugin.startswith(f"{path}:1: ")
    assert view.startswith(f"{path}:2: unknown views[0] 'spred'; known: audit, card, chips, design, expert, ")


@pytest.mark.parametrize(
    ("script", "message"),
    [
        ("3", "view 'spread': its `script` must be a script or the path of its file"),
        ("'x = \"</SCRIPT>\"'", "view 'spread': its script must not contain '</script'"),
    ],
)
def test_a_view_that_no_page_can_hold(tmp_path, script, message):
    mine = load(definition(tmp_path, script))
    with pytest.raises(ViewError) as caught:
        write_page(points(), tmp_path / "page.html", name="x", objectives=OBJECTIVES, definition=mine)
    assert str(caught.value) == message
    assert not (tmp_path / "page.html").exists()
