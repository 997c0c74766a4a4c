"""What helps to decide, in a real browser: filters, colours, prices, chips, importance, undo, CSV."""

from __future__ import annotations

import csv
import io
import shlex
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from dse.figures.importance import gather_importance
from dse.skyline.front import skyline
from dse.skyline.pick import pick
from tests.page_data import OBJECTIVES, points, write_page

TIES = [(name, way) for name, way in OBJECTIVES.items() if name != "accuracy"]


def designs(n=400, seed=3):
    """Return points of two tasks on two chips: sizes and encoders, misfits on one chip, two energies."""
    rng = np.random.default_rng(seed)
    hidden = rng.choice([20, 40, 80, 160], n)
    encoder = rng.choice(["send_on_delta", "threshold"], n)
    task = rng.choice(["texture", "velocity"], n)
    frame = pd.DataFrame(
        {
            "trial": np.arange(n) // 4,
            "task": task,
            "encoder.kind": encoder,
            "model.hidden": hidden,
            "accuracy": np.round(0.5 + 0.1 * np.log2(hidden / 20) + 0.1 * rng.random(n), 3),
            "accuracy_se": 0.01,
            "energy_uj": hidden * rng.uniform(0.5, 1.5, n),
            "n_weights": hidden * 100,
            "latency_ms": rng.uniform(1, 90, n),
        }
    )
    frame["energy_throttled_uj"] = 5000 / frame["energy_uj"]
    chips = [
        frame.assign(hardware="large chip", fits=True),
        frame.assign(hardware="small chip", energy_uj=frame["energy_uj"] / 10, fits=hidden < 100),
    ]
    return pd.concat(chips, ignore_index=True)


@pytest.fixture(scope="module")
def written():
    """The pages of this module by their tables: importances take longer than a browser."""
    return {}


@pytest.fixture
def opened(shown, page_path, written):
    """Return a function that writes a page of a table and opens it."""

    def open_page(frame, fragment="", size=(1280, 720), scheme="light"):
        table = frame.to_csv()
        if table not in written:
            write_page(frame, page_path, name="made", objectives=OBJECTIVES)
            written[table] = page_path.read_bytes()
        page_path.write_bytes(written[table])
        return shown(fragment, size=size, scheme=scheme)

    return open_page


def budgets_of(page):
    words = shlex.split(page.tab.text_content("#command"))
    return [words[k + 1] for k, word in enumerate(words) if word == "--budget"]


EVALUATED = """async (states) => {
  const page = await Data.read();
  const engine = Budgets.over(page);
  return states.map((state) => {
    const { pick, front, command } = engine.evaluate(state);
    return { pick, front, command };
  });
}"""


def test_filters_give_the_front_and_the_pick_of_the_command_line(opened):
    frame = designs()
    page = opened(frame)
    rng = np.random.default_rng(5)
    states = []
    for _ in range(20):
        low, high = sorted(rng.choice([20, 40, 80, 160], 2))
        state = {"task": "texture", "hardware": str(rng.choice(["large chip", "small chip"]))}
        state["f.model.hidden"] = str(rng.choice([f"{low}~{high}", f"{low}~", f"~{high}"]))
        if rng.random() < 0.5:
            state["f.encoder.kind"] = f"in:{rng.choice(['threshold', 'send_on_delta'])}"
        if rng.random() < 0.5:
            state["b.latency_ms"] = f"{rng.uniform(2, 60):.3g}"
        states.append(state)
    for state, shown in zip(states, page.tab.evaluate(EVALUATED, states), strict=True):
        words = shlex.split(shown["command"])
        conditions = [words[k + 1] for k, word in enumerate(words) if word == "--budget"]
        picked = pick(frame, conditions, "accuracy", TIES).row
        assert (None if shown["pick"] < 0 else shown["pick"]) == (None if picked is None else picked.name)
        front = skyline(frame, list(OBJECTIVES.items()), " and ".join(conditions), "task").rows
        assert shown["front"] == sorted(front.index), state


def test_less_certain_points_leave_the_front_its_table_and_its_picture(opened):
    page = opened(points(front_probability=[0.9, 0.2, 0.6, 0.4, 0.0]))
    assert page.tab.inner_text("#n-front") == "4 on the front"
    for _ in range(10):
        page.tab.locator("#sure").press("ArrowRight")
    assert page.tab.inner_text("#n-front").startswith("2 on the front, in at least 50")
    assert sorted(page.cells(1)) == ["0", "2"]
    page.tab.wait_for_function(
        "document.getElementById('plot').data.some((one) => one.mode === 'lines' && one.x.length === 2)"
    )
    for _ in range(10):  # quick presses are one step back; slow ones, on a busy machine, are several
        page.tab.click("#undo")
        if page.tab.inner_text("#n-front") == "4 on the front":
            break
    assert page.tab.inner_text("#n-front") == "4 on the front"
    assert opened(points()).tab.is_hidden("#sure-label")


def test_a_filter_is_set_by_keyboard_holds_in_every_view_and_is_undone(opened):
    page = opened(designs(), "task=texture&hardware=large+chip")
    total = page.tab.inner_text("#feasible")
    page.tab.select_option("#add-filter", "model.hidden")
    assert page.tab.evaluate("document.activeElement.ariaLabel") == "model.hidden from"
    page.tab.keyboard.type("40")
    page.tab.keyboard.press("Tab")
    page.tab.keyboard.type("80")
    page.tab.select_option("#add-filter", "encoder.kind")
    page.tab.uncheck("#filters input[value=threshold]")
    chosen = designs().query(
        "task == 'texture' and hardware == 'large chip' and 40 <= `model.hidden` <= 80 "
        "and `encoder.kind` == 'send_on_delta'"
    )
    assert page.tab.inner_text("#feasible") == f"{len(chosen)} of {len(chosen)} points feasible"
    assert set(page.cells(7)) <= {"40", "80"}
    assert f"of {len(chosen)} lines" in page.tab.inner_text("#parallel h2")
    assert "model.hidden >= 40" in budgets_of(page) and 'encoder.kind in ["send_on_delta"]' in budgets_of(
        page
    )
    page.open(page.link())
    assert page.tab.inner_text("#feasible").startswith(f"{len(chosen)} of")
    for name in ("encoder.kind", "model.hidden"):
        page.tab.click(f"button[aria-label='remove the filter of {name}']")
    assert page.tab.inner_text("#feasible") == total
    page.tab.click("#undo")
    page.tab.locator("h1").click()
    page.tab.keyboard.press("u")
    assert page.tab.inner_text("#feasible").startswith(f"{len(chosen)} of")


def test_colours_and_axes_of_words(opened):
    page = opened(designs(), "task=texture&x=encoder.kind&colour=model.hidden&hardware=large+chip")
    layout = page.tab.evaluate("document.getElementById('plot').layout.xaxis")
    assert layout["ticktext"] == ["send_on_delta", "threshold"] and layout["type"] == "linear"
    bar = page.tab.evaluate(
        "document.getElementById('plot').data.map((t) => t.marker?.colorbar?.title?.text).find(Boolean)"
    )
    assert bar == "model.hidden"
    page.tab.select_option("#colour", "encoder.kind")
    page.tab.select_option("#x", "energy_uj")
    page.tab.wait_for_function("document.querySelectorAll('#plot .legendtext').length >= 2")
    assert page.tab.locator("#plot .legendtext").all_text_contents()[:2] == ["send_on_delta", "threshold"]
    colours = page.tab.evaluate(
        "document.getElementById('plot').data.filter((t) => t.customdata).map((t) => t.marker.color)[0]"
    )
    front = page.tab.evaluate(
        "document.getElementById('plot').data.filter((t) => t.customdata).map((t) => t.customdata)[0]"
    )
    kinds = designs()["encoder.kind"]
    of_kind = {kinds[row]: colour for row, colour in zip(front, colours, strict=True)}
    assert len(set(of_kind.values())) == len(of_kind)
    assert [of_kind[kinds[row]] for row in front] == colours


def test_designs_that_do_not_fit_are_hidden_and_shown_with_their_reason(opened):
    frame = designs()
    unfit = frame.query("hardware == 'small chip' and not fits and task == 'texture'")
    page = opened(frame, "task=texture&hardware=small+chip")
    words = f"{len(unfit)} points do not fit small chip"
    assert page.tab.inner_text("#left").strip() == words
    fits = frame.query("hardware == 'small chip' and fits and task == 'texture'")
    assert page.tab.inner_text("#feasible") == f"{len(fits)} of {len(fits)} points feasible"
    assert f"of {len(fits)} lines" in page.tab.inner_text("#parallel h2")
    page.tab.check("#left-out")
    assert f"of {len(fits) + len(unfit)} lines" in page.tab.inner_text("#parallel h2")
    row = unfit.iloc[0]
    page.point_at(row["energy_uj"], row["accuracy"])
    page.tab.wait_for_function("!document.getElementById('tip').hidden")
    assert "does not fit small chip" in page.tab.inner_text("#tip")


def test_a_family_that_a_chip_cannot_run_does_not_blame_the_budgets(opened):
    frame = designs().assign(family="snn")
    other = points(trial=range(900, 905), family="knn", hardware="small chip", energy_uj=np.nan)
    page = opened(
        pd.concat([frame, other.drop(columns=["status", "reason"])]), "family=knn&hardware=small+chip"
    )
    assert page.tab.inner_text("#fit") == "small chip cannot run knn."
    assert page.tab.inner_text("#feasible") == "0 of 5 points feasible"


def test_energy_at_the_period_is_one_switch_for_every_number(opened):
    frame = designs()
    page = opened(frame, "task=texture&hardware=large+chip")
    page.tab.select_option("#pace", "period")
    on_chip = frame.query("task == 'texture' and hardware == 'large chip'")
    goals = [("accuracy", "max"), ("energy_throttled_uj", "min"), ("n_weights", "min")]
    front = skyline(on_chip, goals, None, "task").rows
    assert page.tab.inner_text("#n-front") == f"{len(front)} on the front"
    assert page.tab.evaluate("document.getElementById('x').value") == "energy_throttled_uj"
    assert page.tab.inner_text("#sliders").count("energy") == 1
    page.tab.fill("#budget-1", "70")
    assert "energy_throttled_uj <= 70" in budgets_of(page)
    page.tab.select_option("#pace", "flat")
    assert page.tab.input_value("#budget-1") == "", "a limit of one energy is none of the other"


def test_all_tasks_have_a_pick_each_and_no_command(opened):
    frame = designs()
    page = opened(frame, "hardware=large+chip&b.energy_uj=60")
    assert page.tab.inner_text("#pick h2") == "Picks"
    for k, task in enumerate(("texture", "velocity")):
        conditions = [f"task == '{task}'", "hardware == 'large chip'", "energy_uj <= 60"]
        trial = pick(frame, conditions, "accuracy", TIES).row["trial"]
        names = page.tab.locator("#pick h3").all_inner_texts()
        assert page.tab.inner_text(f"#pick button >> nth={names.index(task)}") == f"Trial {trial}", k
    assert not page.tab.is_visible("#command") and page.tab.is_visible("#which")


def test_what_fits_no_chip_is_feasible_on_none_but_on_demand(opened):
    frame = designs()
    frame["fits"] = frame["fits"].astype(object)
    small = frame["hardware"] == "small chip"
    frame.loc[small, "fits"] = False
    unable = small & (frame["encoder.kind"] == "threshold")
    frame.loc[unable, ["fits", "energy_uj"]] = None, np.nan
    page = opened(frame, "task=texture&hardware=small+chip")
    n = int((small & (frame["task"] == "texture")).sum())
    assert page.tab.inner_text("#feasible") == f"0 of {n} points feasible"
    assert page.tab.inner_text("#n-front") == "0 on the front"
    assert page.tab.inner_text("#pick h2") == "Nothing is feasible"
    assert "No design fits small chip: it cannot run some" in page.tab.inner_text("#pick")
    assert not page.tab.is_visible("#command")
    assert page.cells(1) == []
    [large, row] = [
        line.split("\t") for line in page.tab.locator("#view-decide .chips tbody tr").all_inner_texts()
    ]
    assert row == ["small chip", "none fits", "–", "–", "–"] and large[2] != "–"
    page.tab.check("#oversize")
    held = frame[small & ~unable & (frame["task"] == "texture")]
    assert page.tab.inner_text("#feasible") == f"{len(held)} of {len(held)} points feasible"
    words = shlex.split(page.tab.text_content("#command"))
    assert "--oversize" in words
    picked = pick(frame, budgets_of(page), "accuracy", TIES, oversize=True).row
    assert page.tab.inner_text("#pick button >> nth=0") == f"Trial {picked['trial']}"
    assert "on the front of a larger chip" in page.tab.inner_text("#design")
    page.open(page.link())
    assert page.tab.is_checked("#oversize")


def test_the_corrected_accuracy_leads_and_what_was_measured_stands_beside_it(opened):
    frame = points(accuracy_test=[0.9, 0.85, 0.8, 0.5, 0.86])
    alone = opened(frame)
    text = alone.tab.inner_text("#pick")
    assert "accuracy 0.950 ± 0.02" in text and "not corrected" in text and "0.900 on test" in text
    assert alone.tab.input_value("#y") == "accuracy"
    value = [0.9, 0.88, 0.84, 0.6, 0.87]
    ends = {f"accuracy_corrected_{end}": np.add(value, by) for end, by in (("low", -0.06), ("high", 0.04))}
    page = opened(frame.assign(accuracy_corrected=value, **ends))
    pick_text = page.tab.inner_text("#pick").replace("\u00a0", " ")
    assert page.tab.inner_text("#pick strong") == "accuracy 0.900 (0.840–0.940)"
    assert "0.950 ± 0.02 on validation" in pick_text and "0.900 on test" in pick_text
    assert page.tab.input_value("#y") == "accuracy_corrected"
    assert page.traces()[2]["y"] == [0.6, 0.88, 0.9], "the front of what was measured, where it is expected"
    assert page.cells(2)[0] == "0.900 (0.840–0.940)" and page.cells(3)[0] == "0.950 ± 0.02"
    page.point_at(20, 0.88)
    page.tab.wait_for_selector("#tip", state="visible")
    tip = page.tab.text_content("#tip")
    assert "accuracy corrected  0.880 (0.820–0.920)" in tip and "accuracy test  0.850" in tip
    with page.tab.expect_download() as waiting:
        page.tab.click("#front .save button")
    first = next(csv.DictReader(io.StringIO(waiting.value.path().read_text(encoding="utf-8"))))
    written = [float(first[f"accuracy_corrected{end}"]) for end in ("", "_low", "_high")]
    assert written == [0.9, pytest.approx(0.84), pytest.approx(0.94)] and float(first["accuracy_se"]) == 0.02
    # A point of which it is not known is no reason to hide it: all are drawn as measured.
    page = opened(frame.assign(accuracy_corrected=[np.nan, *value[1:]]))
    assert page.tab.input_value("#y") == "accuracy" and "not corrected" in page.tab.inner_text("#pick")


def test_an_interval_without_an_upper_end_is_at_least_its_lower_one(opened):
    open_ended = points().assign(energy_uj_high=lambda f: f["energy_uj"] * 90)
    page = opened(open_ended)
    assert "energy at least 40\u00a0µJ" in page.tab.inner_text("#pick").replace(" µ", "\u00a0µ")
    assert page.cells(3)[0] == "at least 40"
    arrows = page.tab.evaluate("document.getElementById('plot').layout.annotations")
    assert sorted(arrow["x"] for arrow in arrows) == [5, 20, 50]
    assert opened(points()).tab.evaluate("document.getElementById('plot').layout.annotations") == []


def test_a_price_lies_in_its_own_interval(opened):
    rng = np.random.default_rng(7)
    fronts = []
    for _ in range(200):
        gain = rng.uniform(0.8, 0.95, 60)
        cost = np.sort(np.exp(8 * gain + rng.normal(0, 0.5, 60)))
        se = rng.uniform(0.002, 0.04, 60)
        fronts.append([{"gain": g, "cost": c, "se": s} for g, c, s in zip(gain, cost, se, strict=True)])
    priced = """(fronts) => fronts
      .map((some) => Decide.priceOf(some, some.reduce((a, b) => (b.gain > a.gain ? b : a))))
      .filter(Boolean).map(({ price, least, most }) => [least, price, most ?? null])"""
    found = opened(points()).tab.evaluate(priced, fronts)
    assert len(found) > 50
    assert all(least <= price <= (np.inf if most is None else most) for least, price, most in found)


def test_prices_by_hand(opened):
    page = opened(points(), "b.energy_uj=40")
    found = page.tab.evaluate(
        """() => {
          const points = [[0.80, 10], [0.90, 30], [0.95, 60]]
            .map(([gain, cost], k) => ({ gain, cost, se: 0, trial: k }));
          const noisy = points.map((one) => ({ ...one, se: 0.06 }));
          const below = points.filter(({ gain }) => gain === 0.95);
          return [points, noisy, below].map((some) => Decide.priceOf(some, some.at(-1)));
        }"""
    )
    exact, noisy, alone = found
    # 0.95 at 60 against 0.90 at 30: 0.05 for 30, so 6 for 0.01.
    assert [exact[name] for name in ("price", "least", "most")] == pytest.approx([6, 6, 6])
    assert exact["other"]["cost"] == 30
    # 0.05 is not told from nothing where each is known to 0.06: at least 30 / (5 + 1.645 * 6 * sqrt(2)).
    assert noisy["least"] == pytest.approx(30 / (5 + 1.645 * 6 * 2**0.5)) and noisy["price"] == pytest.approx(
        6
    )
    assert noisy["most"] == np.inf
    assert alone is None, "nothing lies below"
    # The pick is trial 1, 0.90 with 40 000 weights; trial 2 has 0.85 with 10 000.
    lines = {
        line.split("\t")[0]: line.split("\t")[1:]
        for line in page.tab.locator("#view-decide .price tbody tr").all_inner_texts()
    }
    assert lines["weights"][:3] == ["10\u202f000, not 40\u202f000", "Trial 2", "−0.050 ± 0.03"]
    assert lines["weights"][3] == "6\u202f000 (3\u202f110–86\u202f400)"


def test_chips_side_by_side(opened):
    frame = designs()
    page = opened(frame, "task=texture&b.n_weights=8000")
    lines = [line.split("\t") for line in page.tab.locator("#view-decide .chips tbody tr").all_inner_texts()]
    assert [line[0] for line in lines] == ["large chip", "small chip"]
    for name, line in zip(("large chip", "small chip"), lines, strict=True):
        conditions = ["task == 'texture'", f"hardware == '{name}'", "n_weights <= 8000"]
        row = pick(frame, conditions, "accuracy", TIES).row
        assert line[2].startswith(f"{row['accuracy']:.3f}")
    page.tab.click("#view-decide .chips button >> nth=1")
    assert page.tab.evaluate("document.getElementById('hardware').value") == "small chip"
    assert page.tab.evaluate("document.activeElement.textContent") == "small chip"


def test_importance_finds_the_parameter_that_matters_and_says_how_far_to_trust_it():
    rng = np.random.default_rng(0)
    n = 120
    frame = pd.DataFrame(
        {"trial": np.arange(n), "task": "texture", "model.hidden": rng.choice([10, 20, 40], n)}
    )
    frame["model.kind"] = rng.choice(["a", "b"], n)
    frame["encoder.noise"] = rng.random(n)
    frame["accuracy"] = 0.5 + frame["model.hidden"] / 100 + 0.05 * (frame["model.kind"] == "b")
    frame["n_weights"] = rng.integers(1, 9, n)
    sized, noise = gather_importance(frame, {"accuracy": "max", "n_weights": "min"})
    assert [one["column"] for one in sized["parameters"]] == ["model.hidden", "model.kind", "encoder.noise"]
    assert sized["r2"] > 0.95 and sized["n"] == n and sized["parameters"][2]["importance"] < 0.01
    slices = {one["value"]: one for one in sized["parameters"][0]["slices"]}
    for hidden in (10, 20, 40):
        values = frame["accuracy"][frame["model.hidden"] == hidden]
        assert slices[f"{hidden}"]["n"] == len(values)
        assert slices[f"{hidden}"]["mean"] == pytest.approx(values.mean(), rel=1e-3)
    assert noise["r2"] < 0.1, "random numbers cannot be predicted, and the page says so"
    binned = sized["parameters"][2]["slices"]
    assert len(binned) == 6 and sum(one["n"] for one in binned) == n
    assert gather_importance(frame.head(9), {"accuracy": "max"}) == []


def test_importance_on_the_page(opened):
    page = opened(designs(), "task=texture&hardware=large+chip")
    root = "#view-importance"
    assert page.tab.locator(f"{root} .bar button").all_inner_texts()[0] == "model.hidden"
    assert "explain" in page.tab.inner_text(f"{root} p")
    page.tab.click(f"{root} .bar button >> nth=1")
    assert page.tab.evaluate("document.activeElement.textContent") == "encoder.kind"
    assert page.tab.locator(f"{root} tbody th").all_inner_texts() == ["send_on_delta", "threshold"]


def test_what_would_put_a_design_on_the_front(opened):
    page = opened(points(), "chosen=4")
    # Trial 4 (0.88, 30 µJ, 45 000) is beaten by trial 1 (0.90, 20 µJ, 40 000) alone in all three objectives.
    assert (
        "On the front with accuracy above 0.9, or energy below 20\u202fµJ, or weights below 40\u202f000."
        in (page.tab.inner_text("#design"))
    )
    page.tab.fill("#budget-1", "25")
    assert "Within the budgets with energy at most 25 (now 30)." in page.tab.inner_text("#design")
    # Row 1 (0.90, 20 µJ, 40 000 weights) is second to row 0 (0.95, 50 µJ, 90 000 weights) alone.
    page = opened(points(), "chosen=1")
    assert (
        "The pick with accuracy above 0.950, or under the budget energy at most 20 µJ, "
        "or under the budget weights at most 40\u202f000." in page.tab.inner_text("#design")
    )


def test_the_table_has_one_row_per_trial_on_demand(opened):
    frame = designs()
    page = opened(frame, "task=texture&hardware=large+chip")
    chosen = frame.query("task == 'texture' and hardware == 'large chip'")
    front = skyline(chosen, list(OBJECTIVES.items()), None, "task").rows
    assert sorted(map(int, page.cells(1))) == sorted(front["trial"])
    page.tab.check("#once")
    ordered = front.sort_values("accuracy", ascending=False, kind="stable")
    assert list(map(int, page.cells(1))) == ordered["trial"].drop_duplicates().tolist()
    assert page.tab.inner_text("#front-count").startswith(f"{len(front)} points")


def test_what_is_shown_as_csv(opened):
    page = opened(points(**{"model.kind": 'a "b", c'}), "b.energy_uj=30")
    with page.tab.expect_download() as waiting:
        page.tab.click("#front .save button")
    rows = list(csv.DictReader(io.StringIO(waiting.value.path().read_text(encoding="utf-8"))))
    assert [row["trial"] for row in rows] == ["1", "2", "3"]
    assert rows[0]["model.kind"] == 'a "b", c' and rows[0]["energy_uj"] == "20"


@pytest.mark.parametrize(("scheme", "size"), [("light", (1280, 720)), ("dark", (390, 844))])
def test_axe_finds_nothing(opened, scheme, size):
    axe = pytest.importorskip("axe_playwright_python", reason="no axe-core")
    script = (Path(axe.__file__).parent / "axe.min.js").read_text(encoding="utf-8")
    link = "task=texture&hardware=small+chip&chosen=4&compare=4,8&f.model.hidden=30~&b.energy_uj=20"
    page = opened(designs(), link, size, scheme)
    page.tab.evaluate(script)
    found = page.tab.evaluate("async () => (await axe.run()).violations")
    assert [(one["id"], [node["html"][:120] for node in one["nodes"]]) for one in found] == []
    assert page.overflow() <= 0
