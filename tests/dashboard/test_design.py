"""The panel of one design, in a real browser: its figures, and phi and theta that move it in every view."""

from __future__ import annotations

import json
import subprocess
import sys
from xml.etree import ElementTree

import numpy as np
import pandas as pd

from dse import store
from dse.config import load_space
from dse.dashboard.gather import gather_page
from dse.dashboard.write import write_filled
from dse.deploy import bundle
from dse.figures.first_spike import FirstSpikeFigure
from dse.figures.power import PowerFigure
from dse.figures.recognition import RecognitionFigure
from dse.measure.decision import decide
from dse.records import Response
from dse.study import explore
from tests import tiny_study
from tests.dashboard.designs import (
    ACCURACY,
    CLASSES,
    LATENCY_MS,
    confusion_of,
    details,
    example,
    hash_of,
    surface,
    table,
)
from tests.dashboard.designs import drawn as drawn_from
from tests.dashboard.page import HOSTILE


def listed(page):
    """Return what the head of the panel lists, label -> text."""
    return page.tab.evaluate(
        "Object.fromEntries([...document.querySelectorAll('#design > div > dl dt')]"
        ".map((dt) => [dt.textContent, dt.nextElementSibling.textContent.replace(/\\u00a0/g, ' ')]))"
    )


def ring(page):
    """Return where the ring of the chosen design is in the front, x first."""
    [place] = page.marked("circle-open")
    return place


def wait_for_ring(page, x, y):
    page.tab.wait_for_function(
        "([x, y]) => document.getElementById('plot').data"
        ".some((t) => t.marker?.symbol === 'circle-open' && t.x[0] === x && t.y[0] === y)",
        arg=[x, y],
    )


def tab_names(page):
    return page.tab.eval_on_selector_all("#design [role=tab]", "tabs => tabs.map((tab) => tab.textContent)")


def figure_says(page):
    return page.tab.get_attribute("#design-pane [role=img]", "aria-label")


def drawn(page, name):
    page.tab.wait_for_function(
        "(name) => document.querySelector(`#design-pane [data-figure=${name}]`)?.data", arg=name
    )


RINGS = """() => {
  const { left, top } = document.querySelector("[data-figure=surface]").getBoundingClientRect();
  return [...document.querySelectorAll("#design .ring")].map((ring, k) => {
    const box = ring.getBoundingClientRect();
    const layout = document.querySelector("[data-figure=surface]")._fullLayout;
    const [x, y] = ["x", "y"].map((letter) => layout[`${letter}axis${k ? 2 : ""}`]);
    const [across, down] = [box.left + box.width / 2 - left, box.top + box.height / 2 - top];
    return [x.p2d(across - x._offset), y.p2d(down - y._offset)].map((value) => Math.round(10 * value) / 10);
  });
}"""


RINGS_SHOWN = "document.querySelectorAll('#design .ring:not([hidden])').length"


def test_phi_and_theta_move_the_design_in_every_view(opened):
    page = opened(fragment="chosen=0.0&tab=surface")
    drawn(page, "surface")
    assert "answers at the end" in page.tab.inner_text("#design .summary")
    assert listed(page)["accuracy"] == "0.850"
    assert page.tab.input_value("[data-name=phi]") == "1"  # the best setting, nothing moved yet
    assert hash_of(page)["chosen"] == "0.0"
    page.tab.focus("[data-name=phi]")
    for key, place in (("ArrowRight", 4), ("ArrowLeft", 2), ("Home", 0)):
        page.tab.keyboard.press(key)
        wait_for_ring(page, LATENCY_MS[place], ACCURACY[place])
        assert hash_of(page)["chosen"] == f"0.{place + 1}"
    page.tab.focus("[data-name=theta]")
    page.tab.keyboard.press("ArrowRight")
    wait_for_ring(page, LATENCY_MS[1], ACCURACY[1])
    page.tab.focus("[data-name=phi]")
    page.tab.keyboard.press("End")  # a point that is no row of the page
    wait_for_ring(page, LATENCY_MS[5], ACCURACY[5])
    shown = listed(page)
    assert (shown["accuracy"], shown["energy"]) == ("0.800 ± 0.02", "60 (30–120) µJ")
    assert (shown["φ"], shown["θ"], shown["model.hidden"]) == ("4", "0.8", "10")
    summary = page.tab.inner_text("#design .summary").replace("\u00a0", " ")
    assert summary == "accuracy 0.800 · decision latency 60 ms · energy 60 µJ · 50 % undecided"
    assert page.tab.inner_text("#design .standing strong") == "dominated"
    assert "Chosen, at the ring: φ 4, θ 0.8: accuracy 0.8, decision latency 60 ms" in figure_says(page)
    assert page.tab.evaluate(RINGS) == [[1, 2], [1, 2]]
    assert page.tab.evaluate("document.activeElement.dataset.name") == "phi"


def test_a_link_restores_a_point_that_is_not_on_the_page(opened):
    page = opened(fragment="chosen=0.6&tab=surface&x=n_weights")
    wait_for_ring(page, 100, ACCURACY[5])
    assert listed(page)["energy"] == "60 (30–120) µJ"
    page.tab.select_option("#hardware", "small chip")
    page.tab.wait_for_function("document.querySelector('#design .summary').textContent.includes('180')")
    assert listed(page)["energy"] == "180 (90–360) µJ"
    assert page.tab.input_value("[data-name=phi]") == "2"
    for limit, standing in (("179", "outside the budgets"), ("180", "dominated")):
        page.tab.fill("#budgets [aria-label^=energy][type=number]", limit)
        assert page.tab.inner_text("#design .standing strong") == standing


COUNT_DRAWINGS = """() => {
  window.again = 0;
  for (const name of ["react", "newPlot"]) {
    const draw = Plotly[name];
    Plotly[name] = (node, ...more) => {
      again += node.dataset?.figure === "surface";
      return draw(node, ...more);
    };
  }
}"""

CELL = """([i, j]) => {
  const plot = document.querySelector("[data-figure=surface]");
  plot.scrollIntoView();
  const [box, { xaxis2: x, yaxis2: y }] = [plot.getBoundingClientRect(), plot._fullLayout];
  return [box.left + x._offset + x.d2p(j), box.top + y._offset + y.d2p(i)];
}"""


def test_a_setting_moves_by_slider_or_cell_without_drawing_the_maps_again(opened):
    page = opened(fragment="chosen=0.1&tab=surface")
    drawn(page, "surface")
    page.tab.evaluate(COUNT_DRAWINGS)
    page.tab.focus("[data-name=phi]")
    page.tab.keyboard.press("End")
    wait_for_ring(page, LATENCY_MS[4], ACCURACY[4])
    page.tab.mouse.click(*page.tab.evaluate(CELL, [2, 1]))
    wait_for_ring(page, LATENCY_MS[5], ACCURACY[5])
    assert page.tab.input_value("[data-name=theta]") == "1"
    assert page.tab.evaluate("again") == 0
    page.tab.select_option("[data-name=quantity]", "energy_uj")
    page.tab.wait_for_function("again === 1")
    assert "energy 60 µJ" in figure_says(page)


def test_another_precision_has_its_own_surface(opened):
    fewer = surface(weight_bits=4, pruned_after=0, first_point=7)
    for column in fewer["hardware"].values():
        column["accuracy"] = [value / 2 for value in column["accuracy"]]
    both = [surface(weight_bits=8, pruned_after=0), fewer]
    page = opened({0: details(surfaces=both)}, fragment="chosen=0.9&tab=surface")
    wait_for_ring(page, LATENCY_MS[2], ACCURACY[2] / 2)
    assert "4 bits per weight" in page.tab.inner_text("#design-pane")
    page.tab.focus("[data-name=phi]")
    page.tab.keyboard.press("ArrowRight")
    wait_for_ring(page, LATENCY_MS[4], ACCURACY[4] / 2)
    assert hash_of(page)["chosen"] == "0.11"


def test_a_surface_of_another_precision_than_the_point_says_so(opened):
    frame = table().assign(weight_bits=4, pruned_after=0)
    trained = details(surfaces=[surface(weight_bits=8, pruned_after=0, first_point=90)])
    page = opened({0: trained}, "chosen=0.1&tab=surface", frame=frame)
    drawn(page, "surface")
    assert "of the weights as trained, at 8 bits" in page.tab.inner_text("#design .summary")
    assert page.tab.evaluate(RINGS_SHOWN) == 0


def test_tabs_are_of_the_design_s_own_precision_or_name_its_parent(opened):
    frame = table().assign(weight_bits=4, pruned_after=0.5)
    own = {"confusion": details(2)["tasks"]["texture"]["figures"]["confusion"]}
    both = {
        "surfaces": [surface(weight_bits=8, pruned_after=0, first_point=90)],
        "precisions": [{"weight_bits": 4, "pruned_after": 0.5, "figures": own}],
    }
    page = opened({0: details(0, **both)}, "chosen=0.1&tab=confusion", frame=frame)
    drawn(page, "confusion")
    assert (
        page.tab.inner_text("#design .owner") == "This design: 4 bits per weight, 50\u00a0% of them removed"
    )
    assert "16 of 22 right" in figure_says(page), "3 + 2 of the parent's 8 + 1 and 3 + 8 are wrong here"
    page.tab.click("#tab-learning")
    drawn(page, "learning")
    assert page.tab.inner_text("#design .owner") == "The parent network, as trained: 8 bits per weight"
    page = opened({0: details(0)}, "chosen=0.1&tab=confusion")
    drawn(page, "confusion")
    assert page.tab.inner_text("#design .owner") == ""


RULE = """(cases) => cases.map(([spikes, steps, classes, phi, theta]) => {
  const { label, step, decided } = Design.decide(spikes, steps, classes, phi, theta);
  return [label, step, decided];
})"""


def test_spikes_decide_as_in_python(opened):
    page = opened()
    rng = np.random.default_rng(5)
    cases, expected = [], []
    for _ in range(400):
        n_classes, n_steps = rng.integers(2, 6), rng.integers(1, 30)
        output = (rng.random((n_steps, n_classes)) < rng.choice([0.02, 0.1, 0.4])).astype(np.uint8)
        phi, theta = float(rng.integers(0, 8)), float(rng.choice([0, 0.25, 0.35, 0.5, 0.6, 2 / 3, 1]))
        cases.append([np.argwhere(output).tolist(), int(n_steps), int(n_classes), phi, theta])
        label, step, decided = decide(output[None], phi, theta)
        expected.append([int(label[0]), int(step[0]), bool(decided[0])])
    assert page.tab.evaluate(RULE, cases) == expected
    assert 50 < sum(decided for _, _, decided in expected) < 350


def test_an_example_is_decided_by_the_setting_chosen(opened):
    page = opened(fragment="chosen=0.0&tab=raster")
    drawn(page, "raster")
    answer = page.tab.locator("#design-pane > .summary").last
    assert answer.inner_text().replace("\u00a0", " ") == "answers denim after 100 ms (right)"
    page.tab.focus("[data-name=phi]")
    page.tab.keyboard.press("Home")
    wait_for_ring(page, LATENCY_MS[0], ACCURACY[0])
    wrong = "decides silk & wool after 10 ms (wrong: it is denim)"
    assert answer.inner_text().replace("\u00a0", " ") == wrong
    page.tab.keyboard.press("End")
    page.tab.focus("[data-name=theta]")
    page.tab.keyboard.press("End")
    wait_for_ring(page, LATENCY_MS[5], ACCURACY[5])
    undecided = "undecided: the largest count says denim after 100 ms (right)"
    assert answer.inner_text().replace("\u00a0", " ") == undecided
    assert undecided in figure_says(page).replace("\u00a0", " ")
    page.tab.keyboard.press("Home")
    shapes = "document.querySelector('[data-figure=raster]').layout.shapes"
    marks = f"Object.fromEntries({shapes}.map((shape) => [shape.name, [shape.x0, shape.y0]]))"
    page.tab.wait_for_function(f"{marks}.decision[0] === 65")
    assert page.tab.evaluate(marks) == {"decision": [65, 0], "theta": [0, 0.5]}


def test_tabs_are_those_that_were_recorded_and_open_by_keyboard(opened):
    bare = details(1, figures={}, surfaces=[], examples=[])
    page = opened({0: details(), 1: bare}, fragment="chosen=0.0")
    drawn(page, "confusion")
    assert tab_names(page) == ["confusion", "φ/θ", "raster", "learning"]
    assert figure_says(page) == (
        "Confusion matrix of 2 classes: 16 of 20 right; most often wrong: "
        "silk & wool taken for denim 3 times, denim taken for silk & wool 1 times."
    )
    page.tab.focus("#tab-confusion")
    page.tab.keyboard.press("ArrowLeft")
    drawn(page, "learning")
    assert figure_says(page) == "Learning curves over 3 epochs: loss 2 to 0.5."
    assert page.tab.evaluate("document.activeElement.id") == "tab-learning"
    assert page.tab.get_attribute("#tab-learning", "aria-selected") == "true"
    assert hash_of(page)["tab"] == "learning"
    page.tab.keyboard.press("Home")
    drawn(page, "confusion")
    page.tab.evaluate("location.hash = 'chosen=1.0'")
    page.tab.wait_for_function(
        "document.querySelector('#design-pane').textContent.includes('nothing to draw')"
    )
    assert tab_names(page) == []


def test_figures_of_the_papers_say_their_numbers(opened):
    power = pd.DataFrame({"hardware": ["a", "b"], "power_idle_w": [56.0, 0.5], "power_w": [56.005, 2.25]})
    titles = [{"text": name} for name in ("denim", "silk &amp; wool")]
    output = np.zeros((3, 8, 2), np.uint8)
    output[0, 0, 0] = output[1, 6, 0] = 1
    answered = Response(output, np.zeros((3, 2)), np.zeros(2), 20.0, 0)
    response = store.response_arrays(answered, np.arange(3)) | {"target": np.array([0, 0, 1])}
    lengths = {"decision_latency_ms": np.array([50.0, 100.0]), "accuracy": np.array([0.5, 0.9])}
    own = {
        "recognition": drawn_from(RecognitionFigure(0), read_out=[lengths]),
        "first_spike": drawn_from(FirstSpikeFigure(0), classes=CLASSES, response=[response]),
        "histograms": {"data": [{"type": "bar", "y": [1, 1, 1]}] * 2, "layout": {"annotations": titles}},
        "power": drawn_from(PowerFigure(0), power.assign(trial=0)),
    }
    page = opened({0: details(figures=own, surfaces=[], examples=[])}, fragment="chosen=0.0")
    assert tab_names(page) == ["over time", "first spike", "prototypes", "power"]
    told = {}
    for name in own:
        page.tab.click(f"#tab-{name}")
        drawn(page, name)
        told[name] = figure_says(page)
    assert told == {
        "recognition": "Accuracy over input length: 0.500 after 50 ms, 0.900 after 100 ms.",
        "first_spike": "First output spike: denim: median of 2 of 2 samples, 80 ms.",
        "histograms": "Class histograms over 3 prototypes: denim, silk & wool.",
        "power": "Power at rest and beyond: a 56 W + 5 mW, b 500 mW + 1.75 W.",
    }


def test_what_the_file_does_not_carry_is_said(opened):
    page = opened(fragment="chosen=2.0")
    page.tab.wait_for_function("document.querySelector('#design-pane').textContent.includes('carries')")
    said = page.tab.inner_text("#design-pane")
    assert said == "This file carries the details of 2 designs; dse dashboard RESULTS shows all."
    assert not page.tab.is_visible("#design .save")


def test_a_server_gives_the_bundle_of_any_point(opened):
    page = opened(fragment="chosen=0.3")
    assert not page.tab.is_visible("#design .head a")
    page.tab.evaluate("""async () => {
      Details.of = async () => null; // there is no server to ask
      dispatchEvent(new CustomEvent("live", { detail: { ...await Data.read(), tags: {} } }));
    }""")
    page.tab.wait_for_selector("#design .head a", state="visible")
    link = page.tab.get_attribute("#design .head a", "href")
    assert link == "bundle.zip?trial=0&point=3&hardware=large+chip"
    assert not page.tab.is_visible("#design .export")
    page.tab.evaluate("location.hash = 'chosen=1.0'")
    page.tab.wait_for_function(
        "document.querySelector('#design-pane').textContent === 'Nothing was recorded.'"
    )


def test_an_older_answer_never_replaces_a_newer_choice(opened):
    page = opened()
    page.tab.evaluate("""() => {
      const { of } = Details;
      Details.of = async (page, trial) => {
        if (trial === 1) await new Promise((later) => { window.answer = later; });
        return of(page, trial);
      };
      location.hash = "chosen=1.0";
    }""")
    page.tab.wait_for_function(
        "document.querySelector('#design-pane').textContent === '…' && 'answer' in window"
    )
    page.tab.evaluate("location.hash = 'chosen=0.0'")
    drawn(page, "confusion")
    page.tab.evaluate("answer()")
    page.tab.evaluate("new Promise((later) => setTimeout(later, 50))")
    assert "taken for denim 3 times" in figure_says(page)
    assert page.tab.inner_text("#design h2") == "Trial 0"


def test_news_of_a_running_study_leave_the_panel_as_it_is(opened):
    page = opened(fragment="chosen=0.6&tab=surface")
    wait_for_ring(page, LATENCY_MS[5], ACCURACY[5])
    drawn(page, "surface")
    page.tab.click("#design summary")
    page.tab.focus("[data-name=theta]")
    page.tab.evaluate("""async () => {
      const panel = document.querySelector("#design");
      panel.scrollTop = 40;
      const plot = document.querySelector("[data-figure=surface]");
      window.before = [plot, document.activeElement, panel.scrollTop];
      const page = structuredClone(await Data.read());
      for (const column of Object.values(page.columns)) column.values.push(column.values[0]);
      page.columns.trial.values[page.columns.trial.values.length - 1] = 9;
      dispatchEvent(new CustomEvent("live", { detail: page }));
    }""")
    page.tab.evaluate("new Promise((later) => setTimeout(later, 100))")
    same = """() => {
      const [plot, focused, top] = before;
      const panel = document.querySelector("#design");
      const open = panel.querySelector("details").open;
      return [plot.isConnected, focused === document.activeElement, panel.scrollTop === top, open];
    }"""
    assert page.tab.evaluate(same) == [True] * 4
    assert ring(page) == (LATENCY_MS[5], ACCURACY[5])


def test_a_figure_that_gave_way_holds_nothing(opened):
    page = opened(fragment="chosen=0.0&tab=confusion&compare=0.0")
    drawn(page, "confusion")
    page.tab.wait_for_function("document.querySelector('#compare .plot')?.data")
    page.tab.evaluate("window.gone = [...document.querySelectorAll('#design-pane .plot, #compare .plot')]")
    page.tab.click("#tab-learning")
    page.tab.select_option("#compare select", "learning")
    drawn(page, "learning")
    assert page.tab.evaluate("gone.map((node) => node._fullLayout === undefined)") == [True, True]


def test_the_panel_lists_what_has_a_budget(opened):
    page = opened(fragment="chosen=0.0")
    assert list(listed(page))[:4] == ["accuracy", "energy", "weights", "decision latency"]


def test_details_that_a_lost_connection_kept_come_when_it_is_back(opened):
    page = opened({})
    page.tab.evaluate(
        """async () => {
          const page = {...await Data.read(), tags: {}};
          window.fetch = () => Promise.reject(new TypeError("lost"));
          window.arrive = () => dispatchEvent(new CustomEvent("live", {detail: page}));
          window.arrive();
        }"""
    )
    page.tab.click("#front tbody tr:first-child")
    page.tab.wait_for_function(
        "document.querySelector('#design-pane').textContent.startsWith('The connection was lost')"
    )
    page.tab.evaluate(
        "(text) => { window.fetch = async () => new Response(text); window.arrive(); }",
        json.dumps(details(2)),
    )
    drawn(page, "confusion")


def test_an_open_figure_is_saved_in_the_colours_of_print(opened):
    page = opened(fragment="chosen=0.6&tab=surface", scheme="dark")
    wait_for_ring(page, LATENCY_MS[5], ACCURACY[5])
    drawn(page, "surface")
    with page.tab.expect_download() as download:
        page.tab.click("#design .save button:text-is('SVG')")
    assert download.value.suggested_filename == "fabric-design.svg"
    text = download.value.path().read_text(encoding="utf-8")
    drawing = ElementTree.fromstring(text)
    assert drawing.tag.endswith("svg")
    assert "rgb(255, 255, 255)" in text and "decision latency (ms)" in text
    assert "rgb(232, 234, 237)" not in text
    with page.tab.expect_download() as download:
        page.tab.click("#design .save button:text-is('PNG')")
    assert download.value.path().read_bytes().startswith(b"\x89PNG")


def test_nothing_in_a_document_can_run(opened):
    n = len(HOSTILE)
    confusion = confusion_of(np.eye(n, dtype=int), HOSTILE)
    examples = [example(name, (name, "silk")) for name in HOSTILE]
    document = details(figures={"confusion": confusion}, examples=examples)
    document["notes"] = list(HOSTILE)
    task = HOSTILE[0]
    document["tasks"] = {task: document["tasks"]["texture"], "__proto__": {}}
    page = opened({0: document}, "chosen=0.0", frame=table().assign(task=task), name=HOSTILE[1])
    for tab in ("confusion", "surface", "raster"):
        page.tab.click(f"#tab-{tab}")
        drawn(page, tab)
        assert page.overflow() <= 0
    for k, name in enumerate(HOSTILE):
        page.tab.select_option("[data-name=example]", str(k))
        answer = page.tab.inner_text("#design-pane > .summary >> nth=-1")
        assert f"{name[:30]}" in answer or "\u2028" in name
        assert figure_says(page).startswith(name)
    assert page.tab.evaluate("window.hacked") is None


def test_verdicts_on_targets_are_those_of_the_point_chosen(opened):
    document = details() | {
        "targets": [
            {"point": 0, "text": f"c99: faithful {HOSTILE[0]}"},
            {"point": 1, "text": "c99: approximate"},
        ]
    }
    page = opened({0: document}, "chosen=0.0&tab=surface")
    drawn(page, "surface")
    assert page.tab.inner_text("#design .quiet >> text=c99").startswith("c99: faithful")
    page.tab.focus("[data-name=phi]")
    page.tab.keyboard.press("Home")
    wait_for_ring(page, LATENCY_MS[0], ACCURACY[0])
    assert page.tab.inner_text("#design .quiet >> text=c99") == "c99: approximate"
    assert page.tab.evaluate("window.hacked") is None


FITS = """(tab) => {
  const plot = document.querySelector(`[data-figure=${tab}]`);
  const drawing = plot.querySelector(".main-svg");
  return drawing && drawing.clientWidth <= plot.clientWidth && plot.clientWidth <= innerWidth;
}"""


def test_every_figure_fits_its_panel(opened):
    page = opened(fragment="chosen=0.0", scheme="dark")
    for width, height in ((1280, 720), (390, 844)):
        page.tab.set_viewport_size({"width": width, "height": height})
        for tab in ("confusion", "surface", "raster", "learning"):
            page.tab.click(f"#tab-{tab}")
            drawn(page, tab)
            page.tab.wait_for_function(FITS, arg=tab)
            assert page.overflow() <= 0


def test_beside_its_study_the_line_that_exports_a_design_runs(shown, page_path, tmp_path):
    tiny_study.write_recordings(tmp_path / "tiny.npz")
    (tmp_path / "real.yaml").write_text(tiny_study.REAL)
    found = explore.run(load_space(tmp_path / "real.yaml"), tmp_path / "its results", progress=False)
    results = str(found.folder.relative_to(tmp_path))
    page = gather_page(found.points(), name="real", objectives=found.objectives, results=results)
    write_filled("page", page, page_path)
    line = shown("chosen=0.3").tab.text_content("#design .export code")
    assert line.startswith("python -c ")
    subprocess.run(
        line.replace("python", sys.executable, 1), shell=True, check=True, cwd=tmp_path, capture_output=True
    )
    record = bundle.read(tmp_path / "bundle").record
    assert (record["trial"], record["point"]) == (0, 3)
