"""The panel of one design, in a real browser: its figures, and phi and theta that move it in every view."""

import json
import subprocess
import sys

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from dse import store
from dse.base.records import Response
from dse.config import load_space
from dse.deploy import bundle
from dse.measure.decision import decide
from dse.show.dashboard.details import TABS, of_tab
from dse.show.dashboard.gather import gather_page
from dse.show.dashboard.write import write_filled
from dse.show.figures.first_spike import FirstSpikeFigure
from dse.show.figures.power import PowerFigure
from dse.show.figures.recognition import RecognitionFigure
from dse.study import explore
from tests import tiny_study
from tests.show.dashboard.designs import ACCURACY, CLASSES, LATENCY_MS, details, hash_of, surface, table
from tests.show.dashboard.designs import drawn as drawn_from


def listed(page):
    """Return what the head of the panel lists, label -> text."""
    return page.tab.evaluate(
        "Object.fromEntries([...document.querySelectorAll('#design .body > div > dl dt')]"
        ".map((dt) => [dt.textContent, dt.nextElementSibling.textContent.replace(/\\u00a0/g, ' ')]))"
    )


def wait_for_ring(page, place, accuracy=ACCURACY):
    """Wait until the chosen design is ringed in the front where a setting of the surface lies."""
    page.tab.wait_for_function(
        "([x, y]) => document.getElementById('plot').drawn.marks"
        ".some((one) => one.name === 'your choice' && one.value[0] === x && one.value[1] === y)",
        arg=[LATENCY_MS[place], accuracy[place]],
    )


def press(page, name, *keys):
    page.tab.focus(f"[data-name={name}]")
    for key in keys:
        page.tab.keyboard.press(key)


def standing(page):
    return page.tab.inner_text("#design .standing strong")


def summary(page, last=False):
    found = page.tab.locator("#design-pane > .summary")
    return (found.last if last else found.first).inner_text().replace("\u00a0", " ")


def tab_names(page):
    return page.tab.eval_on_selector_all("#design [role=tab]", "tabs => tabs.map((tab) => tab.textContent)")


def figure_says(page):
    return page.tab.get_attribute("#design-pane [role=img]", "aria-label").replace("\u00a0", " ")


def pane_says(page, text):
    found = "(text) => document.querySelector('#design-pane').textContent.includes(text)"
    page.tab.wait_for_function(found, arg=text)


def drawn(page, name):
    ready = """(name) => {
      const node = document.querySelector(`#design-pane [data-figure=${name}]`);
      return node?.data || node?.matches(".map");
    }"""
    page.tab.wait_for_function(ready, arg=name)


# The setting that is ringed on the map, by its place; -1 where none is.
RINGED = """(() => {
  const place = document.querySelector(".map .ring")?.getAttribute("transform") ?? "";
  const at = (place.match(/[\\d.]+/g) ?? []).map(Number);
  const middle = (cell, [from, size]) => Number(cell.getAttribute(from)) + cell.getAttribute(size) / 2;
  return [...document.querySelectorAll(".map rect")].findIndex((cell) =>
    [["x", "width"], ["y", "height"]].every((side, k) => Math.abs(middle(cell, side) - at[k]) < 2));
})()"""
NEWS = """async () => {
  const panel = document.querySelector("#design");
  panel.scrollTop = 40;
  window.before = [document.querySelector("[data-figure=surface]"), document.activeElement, panel.scrollTop];
  const page = structuredClone(await Data.read());
  for (const column of Object.values(page.columns)) column.values.push(column.values[0]);
  page.columns.trial.values[page.columns.trial.values.length - 1] = 9;
  dispatchEvent(new CustomEvent("live", { detail: page }));
}"""
SAME = """() => {
  const [[plot, focused, top], panel] = [before, document.querySelector("#design")];
  const open = panel.querySelector("details").open;
  return [plot.isConnected, focused === document.activeElement, panel.scrollTop === top, open];
}"""


def test_phi_and_theta_move_the_design_in_every_view(opened):
    page = opened(fragment="chosen=0.0&tab=surface&show=inside&expert=1")
    drawn(page, "surface")
    assert list(listed(page))[:4] == ["accuracy", "energy", "weights", "decision latency"], "with a budget"
    assert "answers at the end" in summary(page) and listed(page)["accuracy"] == "0.850"
    assert page.tab.input_value("[data-name=phi]") == "1"  # the best setting, nothing moved yet
    assert hash_of(page)["chosen"] == "0.0"
    for key, place in (("ArrowRight", 4), ("ArrowLeft", 2), ("Home", 0)):
        press(page, "phi", key)
        wait_for_ring(page, place)
        assert hash_of(page)["chosen"] == f"0.{place + 1}"
    press(page, "theta", "ArrowRight")
    wait_for_ring(page, 1)
    press(page, "phi", "End")  # a point that is no row of the page
    wait_for_ring(page, 5)
    assert page.tab.evaluate("document.activeElement.dataset.name") == "phi"
    found = listed(page)
    assert (found["accuracy"], found["energy"]) == ("0.800 ± 0.02", "60 (30–120) µJ")
    assert (found["φ"], found["θ"], found["model.hidden"]) == ("4", "0.8", "10")
    assert summary(page) == "accuracy 0.800 · decision latency 60 ms · energy 60 µJ · 50 % undecided"
    assert standing(page) == "another is better in everything"
    assert "80 % of the validation recordings" in page.sentence(), "the sentence follows"
    assert "Chosen, at the ring: φ 4, θ 0.8: accuracy 0.8" in figure_says(page)
    assert page.tab.evaluate(RINGED) == 5
    page.tab.click(".map rect >> nth=4")
    wait_for_ring(page, 4)
    assert page.tab.input_value("[data-name=theta]") == "0"
    page.tab.select_option("[data-name=quantity]", "energy_uj")
    assert "energy 50 µJ" in figure_says(page)
    page.tab.click("#design summary")
    press(page, "theta")
    page.tab.evaluate(NEWS)
    page.tab.evaluate("new Promise((later) => setTimeout(later, 100))")
    assert page.tab.evaluate(SAME) == [True] * 4, "news of a running study leave the panel as it is"
    assert page.marked("your choice") == [(LATENCY_MS[4], ACCURACY[4])]


def test_a_link_restores_a_point_that_is_not_on_the_page(opened):
    page = opened(fragment="chosen=0.6&tab=surface&show=inside&expert=1", scheme="dark")
    wait_for_ring(page, 5)
    drawn(page, "surface")
    page.tab.select_option("#hardware", "small chip")
    page.tab.wait_for_function("document.querySelector('#design .summary').textContent.includes('180')")
    assert listed(page)["energy"] == "180 (90–360) µJ" and page.tab.input_value("[data-name=phi]") == "2"
    for limit, where in (("179", "outside the limits"), ("180", "another is better in everything")):
        page.tab.fill("#sentence [aria-label^=energy][type=number]", limit)
        assert standing(page) == where


def test_another_precision_has_its_own_surface_and_figures_or_names_its_parent(opened):
    fewer = surface(weight_bits=4, pruned_after=0, first_point=7)
    for column in fewer["hardware"].values():
        column["accuracy"] = [value / 2 for value in column["accuracy"]]
    half = [value / 2 for value in ACCURACY]
    both = details(surfaces=[surface(weight_bits=8, pruned_after=0), fewer])
    page = opened(documents={0: both}, fragment="chosen=0.9&tab=surface&show=inside&expert=1")
    wait_for_ring(page, 2, half)
    assert "4 bits per weight" in page.tab.inner_text("#design-pane")
    press(page, "phi", "ArrowRight")
    wait_for_ring(page, 4, half)
    assert hash_of(page)["chosen"] == "0.11"
    own = {"confusion": details(2)["tasks"]["texture"]["figures"]["confusion"]}
    parts = {
        "surfaces": [surface(weight_bits=8, pruned_after=0, first_point=90)],
        "precisions": [{"weight_bits": 4, "pruned_after": 0.5, "figures": own}],
    }
    frame = table().assign(weight_bits=4, pruned_after=0.5)
    page = opened(frame, "chosen=0.1&tab=surface&show=inside&expert=1", documents={0: details(0, **parts)})
    drawn(page, "surface")
    assert "of the weights as trained, at 8 bits" in summary(page) and page.tab.evaluate(RINGED) == -1
    page.tab.click("#tab-confusion")
    drawn(page, "confusion")
    owner = page.tab.locator("#design .owner")
    assert owner.inner_text() == "This design: 4 bits per weight, 50\u00a0% of them removed"
    assert "16 of 22 right" in figure_says(page), "3 + 2 of the parent's 8 + 1 and 3 + 8 are wrong here"
    page.tab.click("#tab-learning")
    drawn(page, "learning")
    assert owner.inner_text() == "The parent network, as trained: 8 bits per weight"


RULE = """(cases) => cases.map(([spikes, steps, classes, phi, theta]) => {
  const { label, step, decided } = Design.decide(spikes, steps, classes, phi, theta);
  return [label, step, decided];
})"""


def test_an_example_is_decided_by_the_setting_chosen_as_in_python(opened):
    page = opened(fragment="chosen=0.0&tab=raster&show=inside&expert=1")
    drawn(page, "raster")
    assert summary(page, last=True) == "answers denim after 100 ms (right)"
    press(page, "phi", "Home")
    wait_for_ring(page, 0)
    assert summary(page, last=True) == "decides silk & wool after 10 ms (wrong: it is denim)"
    press(page, "phi", "End")
    press(page, "theta", "End")
    wait_for_ring(page, 5)
    undecided = "undecided: the largest count says denim after 100 ms (right)"
    assert summary(page, last=True) == undecided and undecided in figure_says(page)
    page.tab.keyboard.press("Home")
    shapes = "document.querySelector('[data-figure=raster]').layout.shapes"
    marks = f"Object.fromEntries({shapes}.map((shape) => [shape.name, [shape.x0, shape.y0]]))"
    page.tab.wait_for_function(f"{marks}.decision[0] === 65")
    assert page.tab.evaluate(marks) == {"decision": [65, 0], "theta": [0, 0.5]}
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


def test_tabs_are_those_that_were_recorded_and_open_by_keyboard(opened):
    bare = details(1, figures={}, surfaces=[], examples=[])
    page = opened(documents={0: details(), 1: bare}, fragment="chosen=0.0&show=inside&expert=1")
    drawn(page, "confusion")
    assert page.tab.inner_text("#design .owner") == ""
    assert tab_names(page) == ["confusion", "φ/θ", "raster", "learning"]
    assert figure_says(page) == (
        "The confusion matrix of 2 classes: 16 of 20 right; most often wrong: "
        "silk & wool taken for denim 3 times, denim taken for silk & wool 1 times."
    )
    page.tab.evaluate("window.gone = [...document.querySelectorAll('#design-pane .plot')]")
    page.tab.focus("#tab-confusion")
    page.tab.keyboard.press("ArrowLeft")
    drawn(page, "learning")
    assert page.tab.evaluate("gone.map((node) => node._fullLayout === undefined)") == [True], "purged"
    assert figure_says(page) == "The learning curve: loss 2 to 0.500."
    assert page.tab.evaluate("document.activeElement.id") == "tab-learning"
    assert page.tab.get_attribute("#tab-learning", "aria-selected") == "true"
    assert hash_of(page)["tab"] == "learning"
    page.tab.click("#tab-surface")
    press(page, "phi", "Home")
    wait_for_ring(page, 0)
    page.tab.evaluate("location.hash = 'chosen=1.0&show=inside'")
    pane_says(page, "nothing to draw")
    assert tab_names(page) == []
    page.tab.evaluate("location.hash = 'chosen=2.0&show=inside'")
    pane_says(page, "carries")
    said = "This file carries the details of 2 designs; dse dashboard results/fabric shows all."
    assert page.tab.inner_text("#design-pane") == said


def test_figures_of_the_papers_say_their_numbers(opened):
    power = pd.DataFrame({"hardware": ["a", "b"], "power_idle_w": [56.0, 0.5], "power_w": [56.005, 2.25]})
    titles = [{"text": name} for name in ("denim", "silk &amp; wool")]
    output = np.zeros((3, 8, 2), np.uint8)
    output[0, 0, 0] = output[1, 6, 0] = 1
    answered = Response(output, np.zeros((3, 2)), np.zeros(2), 20.0, 0)
    response = store.response_arrays(answered, np.arange(3)) | {"target": np.array([0, 0, 1])}
    lengths = {"decision_latency_ms": np.array([50.0, 100.0]), "accuracy": np.array([0.5, 0.9])}
    own = {
        "recognition": drawn_from("recognition", RecognitionFigure(0), read_out=[lengths]),
        "first_spike": drawn_from("first_spike", FirstSpikeFigure(0), classes=CLASSES, response=[response]),
        "histograms": of_tab(
            TABS["histograms"], go.Figure([go.Bar(y=[1, 1, 1])] * 2, {"annotations": titles})
        ),
        "power": drawn_from("power", PowerFigure(0), power.assign(trial=0)),
    }
    page = opened(
        documents={0: details(figures=own, surfaces=[], examples=[])},
        fragment="chosen=0.0&show=inside&expert=1",
    )
    assert tab_names(page) == ["over time", "first spike", "prototypes", "power"]
    told = {}
    for name in own:
        page.tab.click(f"#tab-{name}")
        drawn(page, name)
        told[name] = figure_says(page)
    assert "accuracy" in told["recognition"] and "0.500 to 0.900" in told["recognition"]
    assert "denim: median of 2 of 2 samples" in told["first_spike"]
    assert told["histograms"].endswith("; denim; silk & wool.")
    assert "56 W + 5 mW" in told["power"] and "500 mW + 1.75 W" in told["power"]


SERVED = "dispatchEvent(new CustomEvent('live', {detail: {...await Data.read(), tags: {}}}));"


def test_a_server_gives_documents_and_bundles(opened):
    """An older answer never replaces a newer choice; what a lost connection kept comes when it is back."""
    page = opened(fragment="chosen=0.3&show=inside")
    page.ask("take")
    assert not page.tab.is_visible("#bundle")
    page.tab.evaluate(
        """async () => {
      window.lost = true;
      window.fetch = async (address) => {
        if (lost) throw new TypeError("lost");
        const trial = new URLSearchParams(address.split("?")[1]).get("trial");
        if (trial === "1") await new Promise((later) => { window.answer = later; });
        return trial === "2" ? new Response("It has none.", {status: 404}) : new Response(window.document_0);
      };"""
        + SERVED
        + "}"
    )
    page.tab.wait_for_selector("#bundle", state="visible")
    link = page.tab.get_attribute("#bundle", "href")
    assert link == "bundle.zip?trial=0&point=3&hardware=large+chip"
    pane_says(page, "The connection was lost")
    news = "async (text) => { window.lost = false; window.document_0 = text;" + SERVED + "}"
    page.tab.evaluate(news, json.dumps(details(0)))
    drawn(page, "confusion")
    page.tab.evaluate("location.hash = 'chosen=2.0&show=inside'")
    pane_says(page, "It has none.")
    page.tab.evaluate("location.hash = 'chosen=1.0&show=inside'")
    page.tab.wait_for_function(
        "document.querySelector('#design-pane').textContent === '…' && 'answer' in window"
    )
    page.tab.evaluate("location.hash = 'chosen=0.0&show=inside'")
    drawn(page, "confusion")
    page.tab.evaluate("answer()")
    page.tab.evaluate("new Promise((later) => setTimeout(later, 50))")
    assert "taken for denim 3 times" in figure_says(page)
    assert page.tab.inner_text("#design h2") == "Trial 0"


def test_beside_its_study_the_line_that_exports_a_design_runs(shown, page_path, tmp_path):
    tiny_study.write_recordings(tmp_path / "tiny.npz")
    (tmp_path / "real.yaml").write_text(tiny_study.REAL)
    found = explore.run(load_space(tmp_path / "real.yaml"), tmp_path / "its results", progress=False)
    results = str(found.folder.relative_to(tmp_path))
    page = gather_page(found.points(), name="real", objectives=found.objectives, results=results)
    write_filled("page", page, page_path)
    line = shown("chosen=0.3&ask=take").tab.text_content("#command")
    assert line.startswith("dse pick ")
    line = line.replace("dse", f"{sys.executable} -m dse", 1)
    subprocess.run(line, shell=True, check=True, cwd=tmp_path, capture_output=True)
    record = bundle.read(tmp_path / "bundle").record
    assert (record["trial"], record["point"]) == (0, 3)
