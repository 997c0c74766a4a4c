"""What helps to decide, in a real browser: filters, colours, prices, chips, importance, undo, CSV."""

import csv
import io
import shlex

import numpy as np
import pandas as pd
import pytest

from dse.figures.price import price_of
from dse.skyline.front import skyline
from dse.skyline.pick import pick
from tests.page_data import OBJECTIVES, points

TIES = [(name, way) for name, way in OBJECTIVES.items() if name != "accuracy"]
LARGE, SMALL = (
    "task == 'texture' and hardware == 'large chip'",
    "task == 'texture' and hardware == 'small chip'",
)


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


def feasible(page):
    return page.tab.inner_text("#feasible")


def rows_of(page, section):
    """Return the lines of a table, a list of texts each."""
    return [line.split("\t") for line in page.tab.locator(f"{section} tbody tr").all_inner_texts()]


def csv_of(page):
    return list(csv.DictReader(io.StringIO(page.saved("#front", "csv")[1].decode())))


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


def test_a_filter_is_set_by_keyboard_holds_in_every_view_and_is_undone(opened):
    page = opened(designs(), "task=texture&hardware=large+chip")
    assert page.tab.is_hidden("#sure-label")
    total = feasible(page)
    front = skyline(designs().query(LARGE), list(OBJECTIVES.items()), None, "task").rows
    assert sorted(map(int, page.cells(1))) == sorted(front["trial"])
    page.tab.check("#once")
    ordered = front.sort_values("accuracy", ascending=False, kind="stable")["trial"].drop_duplicates()
    assert list(map(int, page.cells(1))) == ordered.tolist(), "one row per trial"
    assert page.tab.inner_text("#front-count").startswith(f"{len(front)} points")
    page.tab.select_option("#add-filter", "model.hidden")
    assert page.tab.evaluate("document.activeElement.ariaLabel") == "model.hidden from"
    page.tab.keyboard.type("40")
    page.tab.keyboard.press("Tab")
    page.tab.keyboard.type("80")
    page.tab.select_option("#add-filter", "encoder.kind")
    page.tab.uncheck("#filters input[value=threshold]")
    chosen = designs().query(f"{LARGE} and 40 <= `model.hidden` <= 80 and `encoder.kind` == 'send_on_delta'")
    assert feasible(page) == f"{len(chosen)} of {len(chosen)} points feasible"
    assert set(page.cells(7)) <= {"40", "80"}
    assert f"of {len(chosen)} lines" in page.tab.inner_text("#parallel h2")
    assert {"model.hidden >= 40", 'encoder.kind in ["send_on_delta"]'} <= set(page.budgets())
    page.open(page.link())
    assert feasible(page).startswith(f"{len(chosen)} of")
    for name in ("encoder.kind", "model.hidden"):
        page.tab.click(f"button[aria-label='remove the filter of {name}']")
    assert feasible(page) == total
    page.tab.click("#undo")
    page.tab.locator("h1").click()
    page.tab.keyboard.press("u")
    assert feasible(page).startswith(f"{len(chosen)} of")


def test_colours_and_axes_of_words_and_what_matters(opened):
    link = "task=texture&x=encoder.kind&colour=model.hidden&hardware=large+chip"
    page = opened(designs(), link, forest=True)
    layout = page.tab.evaluate("document.getElementById('plot').layout.xaxis")
    assert layout["ticktext"] == ["send_on_delta", "threshold"] and layout["type"] == "linear"
    bars = "document.getElementById('plot').data.map((t) => t.marker?.colorbar?.title?.text).find(Boolean)"
    assert page.tab.evaluate(bars) == "model.hidden"
    page.tab.select_option("#colour", "encoder.kind")
    page.tab.select_option("#x", "energy_uj")
    page.tab.wait_for_function("document.querySelectorAll('#plot .legendtext').length >= 2")
    assert page.tab.locator("#plot .legendtext").all_text_contents()[:2] == ["send_on_delta", "threshold"]
    front, colours = page.tab.evaluate(
        "document.getElementById('plot').data.filter((t) => t.customdata)"
        ".map((t) => [t.customdata, t.marker.color])[0]"
    )
    kinds = designs()["encoder.kind"][front]
    of_kind = dict(zip(kinds, colours, strict=True))
    assert len(set(of_kind.values())) == len(of_kind) and [of_kind[kind] for kind in kinds] == colours
    root = "#view-importance"
    assert page.tab.locator(f"{root} .bar button").all_inner_texts()[0] == "model.hidden"
    assert "explain" in page.tab.inner_text(f"{root} p")
    page.tab.click(f"{root} .bar button >> nth=1")
    assert page.tab.evaluate("document.activeElement.textContent") == "encoder.kind"
    assert page.tab.locator(f"{root} tbody th").all_inner_texts() == ["send_on_delta", "threshold"]


def test_designs_that_do_not_fit_are_hidden_and_shown_with_their_reason(opened):
    frame = designs()
    unfit, fits = frame.query(f"{SMALL} and not fits"), frame.query(f"{SMALL} and fits")
    page = opened(frame, "task=texture&hardware=small+chip")
    assert page.tab.inner_text("#left").strip() == f"{len(unfit)} points do not fit small chip"
    assert feasible(page) == f"{len(fits)} of {len(fits)} points feasible"
    assert f"of {len(fits)} lines" in page.tab.inner_text("#parallel h2")
    page.tab.check("#left-out")
    assert f"of {len(fits) + len(unfit)} lines" in page.tab.inner_text("#parallel h2")
    row = unfit.iloc[0]
    page.point_at(row["energy_uj"], row["accuracy"])
    page.tab.wait_for_function("!document.getElementById('tip').hidden")
    assert "does not fit small chip" in page.tab.inner_text("#tip")
    other = points(trial=range(900, 905), family="knn", hardware="small chip", energy_uj=np.nan)
    both = pd.concat([frame.assign(family="snn"), other.drop(columns=["status", "reason"])])
    page = opened(both, "family=knn&hardware=small+chip")
    assert page.tab.inner_text("#fit") == "small chip cannot run knn."
    assert feasible(page) == "0 of 5 points feasible", "which is not the fault of a budget"


def test_what_fits_no_chip_is_feasible_on_none_but_on_demand(opened):
    frame = designs()
    frame["fits"] = frame["fits"].astype(object)
    small = frame["hardware"] == "small chip"
    frame.loc[small, "fits"] = False
    unable = small & (frame["encoder.kind"] == "threshold")
    frame.loc[unable, ["fits", "energy_uj"]] = None, np.nan
    page = opened(frame, "task=texture&hardware=small+chip")
    n = int((small & (frame["task"] == "texture")).sum())
    assert feasible(page) == f"0 of {n} points feasible"
    assert page.tab.inner_text("#n-front") == "0 on the front"
    assert page.tab.inner_text("#pick h2") == "Nothing is feasible"
    assert "No design fits small chip: it cannot run some" in page.tab.inner_text("#pick")
    assert not page.tab.is_visible("#command") and page.cells(1) == []
    [large, row] = rows_of(page, "#view-decide .chips")
    assert row == ["small chip", "none fits", "–", "–", "–"] and large[2] != "–"
    page.tab.check("#oversize")
    held = frame[small & ~unable & (frame["task"] == "texture")]
    assert feasible(page) == f"{len(held)} of {len(held)} points feasible"
    assert "--oversize" in shlex.split(page.tab.text_content("#command"))
    picked = pick(frame, page.budgets(), "accuracy", TIES, oversize=True).row
    assert page.tab.inner_text("#pick button >> nth=0") == f"Trial {picked['trial']}"
    assert "on the front of a larger chip" in page.tab.inner_text("#design")
    page.open(page.link())
    assert page.tab.is_checked("#oversize")


def test_energy_at_the_period_is_one_switch_for_every_number(opened):
    page = opened(designs(), "task=texture&hardware=large+chip")
    goals = [("accuracy", "max"), ("energy_throttled_uj", "min"), ("n_weights", "min")]
    page.tab.select_option("#pace", "period")
    front = skyline(designs().query(LARGE), goals, None, "task").rows
    assert page.tab.inner_text("#n-front") == f"{len(front)} on the front"
    pair = skyline(designs().query(LARGE), goals[:2], None, "task").rows
    page.tab.wait_for_function(
        "(n) => document.getElementById('plot').data.some((t) => t.customdata?.length === n)", arg=len(pair)
    )
    assert page.tab.input_value("#x") == "energy_throttled_uj"
    assert page.tab.inner_text("#sliders").count("energy") == 1
    page.tab.fill("#budget-1", "70")
    assert "energy_throttled_uj <= 70" in page.budgets()
    page.tab.select_option("#pace", "flat")
    assert page.tab.input_value("#budget-1") == "", "a limit of one energy is none of the other"


def test_tasks_and_chips_have_a_pick_each(opened):
    frame = designs()
    page = opened(frame, "hardware=large+chip&b.energy_uj=60")
    assert page.tab.inner_text("#pick h2") == "Picks"
    names = page.tab.locator("#pick h3").all_inner_texts()
    for task in ("texture", "velocity"):
        conditions = [f"task == '{task}'", "hardware == 'large chip'", "energy_uj <= 60"]
        trial = pick(frame, conditions, "accuracy", TIES).row["trial"]
        assert page.tab.inner_text(f"#pick button >> nth={names.index(task)}") == f"Trial {trial}"
    assert not page.tab.is_visible("#command") and page.tab.is_visible("#which")
    page.open("task=texture&b.n_weights=8000")
    lines = rows_of(page, "#view-decide .chips")
    assert [line[0] for line in lines] == ["large chip", "small chip"]
    for name, line in zip(("large chip", "small chip"), lines, strict=True):
        conditions = ["task == 'texture'", f"hardware == '{name}'", "n_weights <= 8000"]
        assert line[2].startswith(f"{pick(frame, conditions, 'accuracy', TIES).row['accuracy']:.3f}")
    page.tab.click("#view-decide .chips button >> nth=1")
    assert page.tab.input_value("#hardware") == "small chip"
    assert page.tab.evaluate("document.activeElement.textContent") == "small chip"


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
    first = csv_of(page)[0]
    saved = [float(first[f"accuracy_corrected{end}"]) for end in ("", "_low", "_high")]
    assert saved == [0.9, pytest.approx(0.84), pytest.approx(0.94)] and float(first["accuracy_se"]) == 0.02
    # A point of which it is not known is no reason to hide it: all are drawn as measured.
    page = opened(frame.assign(accuracy_corrected=[np.nan, *value[1:]]))
    assert page.tab.input_value("#y") == "accuracy" and "not corrected" in page.tab.inner_text("#pick")


def test_an_interval_without_an_upper_end_is_at_least_its_lower_one(opened):
    page = opened(points().assign(energy_uj_high=lambda f: f["energy_uj"] * 90))
    assert "energy at least 40\u00a0µJ" in page.tab.inner_text("#pick").replace(" µ", "\u00a0µ")
    assert page.cells(3)[0] == "at least 40"
    arrows = page.tab.evaluate("document.getElementById('plot').layout.annotations")
    assert sorted(arrow["x"] for arrow in arrows) == [5, 20, 50]


PRICED = """(fronts) => fronts
  .map((some) => Decide.priceOf(some, some.reduce((a, b) => (b.gain > a.gain ? b : a))))"""


def test_prices_are_those_of_the_figure(opened):
    page = opened(points(), "b.energy_uj=40")
    assert page.tab.evaluate("document.getElementById('plot').layout.annotations") == [], "no end is open"
    rng = np.random.default_rng(7)
    fronts, expected = [], []
    for _ in range(200):
        gain, se = rng.uniform(0.8, 0.95, 60), rng.choice([0.0, 1.0]) * rng.uniform(0.002, 0.04, 60)
        cost = np.sort(np.exp(8 * gain + rng.normal(0, 0.5, 60)))
        fronts.append([{"gain": g, "cost": c, "se": s} for g, c, s in zip(gain, cost, se, strict=True)])
        expected.append(price_of(gain, cost, se, int(gain.argmax())))
    for one, other in zip(page.tab.evaluate(PRICED, fronts), expected, strict=True):
        found = one and [one["price"], one["least"], one["most"], one["other"]["cost"]]
        assert found == (other and pytest.approx(list(other[:4])))
    assert sum(one is not None for one in expected) > 50
    # The pick is trial 1, 0.90 with 40 000 weights; trial 2 has 0.85 with 10 000.
    lines = {line[0]: line[1:] for line in rows_of(page, "#view-decide .price")}
    price = "6\u202f000 (3\u202f110–86\u202f400)"
    assert lines["weights"] == ["10\u202f000, not 40\u202f000", "Trial 2", "−0.050 ± 0.03", price]


def test_what_would_put_a_design_on_the_front_or_make_it_the_pick_and_csv(opened):
    page = opened(points(**{"model.kind": 'a "b", c'}), "chosen=4")
    # Trial 4 (0.88, 30 µJ, 45 000) is beaten by trial 1 (0.90, 20 µJ, 40 000) alone in all three objectives.
    needs = "On the front with accuracy above 0.9, or energy below 20\u202fµJ, or weights below 40\u202f000."
    assert needs in page.tab.inner_text("#design")
    page.tab.fill("#budget-1", "25")
    assert "Within the budgets with energy at most 25 (now 30)." in page.tab.inner_text("#design")
    page.tab.fill("#budget-1", "30")
    rows = csv_of(page)
    assert [row["trial"] for row in rows] == ["1", "2", "3"]
    assert rows[0]["model.kind"] == 'a "b", c' and rows[0]["energy_uj"] == "20"
    # Row 1 (0.90, 20 µJ, 40 000 weights) is second to row 0 (0.95, 50 µJ, 90 000 weights) alone.
    page.open("chosen=1")
    told = (
        "The pick with accuracy above 0.950, or under the budget energy at most 20 µJ, "
        "or under the budget weights at most 40\u202f000."
    )
    assert told in page.tab.inner_text("#design")
