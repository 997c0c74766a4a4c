"""What a limit buys, and the shape of a front, in a real browser; and the model card of the design."""

import re

import numpy as np
import pandas as pd

from dse.skyline.pick import pick
from tests.page_data import OBJECTIVES, points
from tests.show.dashboard.page import HOSTILE

TIES = [(name, way) for name, way in OBJECTIVES.items() if name != "accuracy"]
SHAPE = """([x, y, error, tried]) => {
  const rows = x.map((_, k) => k);
  const all = [...x, ...tried];
  return Budgets.shape(rows, (row) => all[row], (row) => y[row], () => error, () => all.map((_, k) => k));
}"""
CARD = [["h2", "A card"], ["p", HOSTILE[0]], ["ul", ["one"]], ["table", [["accuracy", HOSTILE[1]]]]]


def many(n=300, seed=1):
    """Return points whose accuracies repeat, of two chips, with what is expected of them."""
    rng = np.random.default_rng(seed)
    accuracy = np.round(rng.uniform(0.2, 1, n), 1)
    frame = pd.DataFrame(
        {
            "trial": range(n),
            "task": "texture",
            "hardware": rng.choice(["a", "b"], n),
            "accuracy": accuracy,
            "accuracy_se": 0.001,
            "accuracy_corrected": accuracy - np.round(0.05 * rng.random(n), 3),
            "energy_uj": np.round(100 * accuracy * rng.uniform(0.5, 1.5, n) + 1),
            "n_weights": rng.integers(100, 900, n),
            "latency_ms": np.round(60 * accuracy * rng.uniform(0.5, 1.5, n), 1),
        }
    )
    return frame.assign(accuracy_corrected_low=frame["accuracy_corrected"] - 0.01).assign(
        accuracy_corrected_high=frame["accuracy_corrected"] + 0.01
    )


def curves(page):
    """Return what each curve says: the unit's column, and (limit, gain) of its steps."""
    said = page.tab.locator("#price svg").evaluate_all(
        "all => all.map((one) => one.getAttribute('aria-label'))"
    )
    found = {}
    for text in said:
        name, steps = re.fullmatch(
            r"accuracy corrected over the limit of ([\w ]+?)(?: \(.*\))?: (.*)\.", text
        ).groups()
        pairs = [re.fullmatch(r"([\d.]+)\s*\S*? ([\d.]+)\s%", step) for step in steps.split(", ")]
        found[name] = [(float(pair[1]), float(pair[2])) for pair in pairs]
    return found


def test_each_step_of_a_limit_is_what_pick_takes_there(opened):
    frame = many()
    page = opened(frame, "show=matters&hardware=a&b.latency_ms=80")
    found = curves(page)
    assert set(found) == {"energy", "weights", "latency"}
    columns = {"energy": "energy_uj", "weights": "n_weights", "latency": "latency_ms"}
    for name, steps in found.items():
        others = [] if name == "latency" else ["latency_ms <= 80"]
        assert len(steps) >= 4 and [limit for limit, _ in steps] == sorted(limit for limit, _ in steps)
        limits = sorted(frame[columns[name]])
        told_at = [[gain for at, gain in steps if at <= limit] for limit in limits]
        for k, (limit, told) in enumerate(zip(limits, told_at, strict=True)):
            if k % 10 and all(x == told for x in told_at[k - 1 : k + 2]):
                continue  # within a step
            budgets = ["hardware == 'a'", *others, f"{columns[name]} <= {limit}"]
            row = pick(frame, budgets, "accuracy", TIES).row
            assert (row is None) == (not told)
            if row is not None:
                assert abs(told[-1] - 100 * row["accuracy_corrected"]) < 0.06, (name, limit)
    page.tab.click("#price button >> text=latency")
    assert "x=latency_ms" in page.link() and page.tab.is_visible("#price")


def test_few_designs_say_nothing_of_a_limit(opened):
    page = opened(points(), "show=matters")
    assert page.tab.locator("#price svg").count() == 0
    assert page.tab.inner_text("#price").count("Too few designs") == 2
    assert page.tab.locator("#plot text >> text=knee").count() == 0


def test_a_knee_lies_above_the_line_between_the_ends_and_a_gap_is_where_nobody_tried(opened):
    page = opened(points())
    bent = [[0, 0.1, 0.5, 1], [0, 0.7, 0.78, 1]]
    for given, knee, gaps in (
        ((*bent, 0.1, []), 1, [[2, 3]]),  # from 0.1 to 0.5 it gains no more than the error
        ((*bent, 0.1, [0.6]), 1, []),
        ((*bent, 0.05, []), 1, [[1, 2], [2, 3]]),
        ((*bent, 0.65, []), -1, []),
        (([0, 0.3, 0.6, 1], [0, 0.3, 0.6, 1], 0.01, [0.1, 0.4, 0.9]), -1, []),
        ((*(part[:3] for part in bent), 0.1, []), -1, []),
    ):
        found = page.tab.evaluate(SHAPE, list(given))
        assert (found["knee"], [gap for gap in found["gaps"] if gap[0]]) == (knee, gaps), given


def test_the_chart_and_the_curves_mark_them_and_end_in_what_would_tell(opened):
    energy, accuracy = [1, 10, 11, 12, 100, 1000], [0.2, 0.7, 0.705, 0.706, 0.8, 0.95]
    more = {"model.hidden": [10, 20, 20, 20, 20, 40], "model.depth": [1, 1, 2, 3, 1, 2]}
    frame = pd.DataFrame(
        {"trial": range(6), "task": "texture", "accuracy": accuracy, "energy_uj": energy} | more
    )
    frame = frame.assign(accuracy_se=0.03, n_weights=100, point=0)
    page = opened(frame, "show=matters")
    words = page.tab.locator("#plot text").all_text_contents()
    assert words.count("knee") == 1 and words.count("untried") == 3
    assert "knee: 70 % at 10 µJ" in page.tab.inner_text("#price").replace("\u202f", " ")
    assert "100 µJ: 80 %" not in page.tab.inner_text("#price")
    page.tab.click("#price summary >> nth=-1")
    assert "untried: 100 µJ to 1 mJ" in page.tab.inner_text("#price").replace("\u202f", " ")
    assert "- {model.hidden: 20, model.depth: 2}" not in page.tab.inner_text("#price details[open]"), (
        "measured"
    )
    assert "{model.hidden: 40, model.depth: 1}" in page.tab.inner_text("#price details[open]")
    assert page.violations() == []
    page.tab.click("#price button >> text=knee")
    assert "chosen=1.0" in page.link()


def test_the_card_of_a_pick_opens_and_is_the_second_page_of_a_report(opened):
    page = opened(points(point=0), "show=inside", parts={"cards": {"0.0@": [*CARD, ["h3", "Data"]]}})
    assert not page.tab.is_visible("#card h2")
    page.tab.click("#card summary")
    assert page.tab.inner_text("#card h2") == "A card" and page.tab.text_content("#card p") == HOSTILE[0]
    assert page.tab.locator("#card tr td").all_text_contents() == [HOSTILE[1]]
    assert page.violations() == [] and page.is_clean()
    page.open("show=inside&chosen=1.0")
    page.tab.click("#card summary")
    assert page.tab.inner_text("#card p").startswith("This file carries the model cards of its picks")
    page.open("show=all")
    sheets = page.tab.pdf(format="A4", margin=dict.fromkeys(("left", "right", "top", "bottom"), "12mm"))
    assert len(re.findall(rb"/Type\s*/Page[^s]", sheets)) == 2
    page.tab.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert page.tab.is_visible("#card h2") and not page.tab.is_visible("#design")
