import numpy as np
import pandas as pd
import pytest

from dse.show.dashboard import gather as gather_module
from dse.show.dashboard.gather import gather_page
from tests.page_data import ACCURACY, OBJECTIVES, ON_FRONT, failed, points
from tests.skyline.tables import GOALS, WORDS


def gather(frame, objectives=OBJECTIVES, **more):
    return gather_page(frame, name="fabric", objectives=objectives, **more)


def rows(mask):
    return np.flatnonzero(mask).tolist()


def test_a_page_of_points():
    frame = pd.concat([points(), failed()], ignore_index=True)
    before = frame.copy(deep=True)
    page = gather(frame)
    pd.testing.assert_frame_equal(frame, before)
    assert page["front"] == rows(ON_FRONT) and page["state"] is None
    assert page["columns"]["accuracy"] == {"label": "accuracy", "unit": "", "values": ACCURACY}
    assert page["intervals"]["energy_uj"]["high"][1] == 10
    assert page["design"] == ["trial", "model.hidden", "phi", "theta"]
    assert page["counts"] == {"finished": 5, "failed": 1}
    assert page["period"] is None
    paced = gather(points(energy_throttled_uj=[5.0, 2.0, 1.0, 3.0, 4.0]))
    assert paced["period"] == {"energy": "energy_uj", "instead": "energy_throttled_uj"}
    assert paced["budgets"]["contenders"] == [0, 1, 2, 3], "of the front at either pace"
    assert paced["budgets"]["ranges"][0]["ends"]["energy_throttled_uj"] == [1, 5]


@pytest.mark.parametrize("column", ["task", "hardware"])
def test_tasks_and_hardware_have_a_front_each(column):
    both = pd.concat([points(**{column: "a"}), points(**{column: "b"}, accuracy=0.1)], ignore_index=True)
    front = gather(both)["front"]
    assert [row for row in front if row < 5] == rows(ON_FRONT)
    assert [row for row in front if row >= 5] == [7, 8]


def test_what_has_seen_the_labels_is_on_no_front_and_is_told():
    leaky = pd.array([None, True, False, False, None], dtype="boolean")
    page = gather(points(transductive=leaky))
    assert page["front"] == [0, 2, 3, 4]
    [told] = [note for note in page["notes"] if "transductive" in note]
    assert told.startswith("1 of 5 points are transductive and excluded from fronts")
    assert gather(points(transductive="no"))["front"] == rows(ON_FRONT)


@pytest.mark.parametrize("family", ["fits", "transductive_x"])
def test_names_of_families_let_nothing_onto_a_front(family):
    frame = WORDS.assign(family=family, task="fits")
    page = gather(frame, dict(GOALS))
    assert page["front"] == [2]
    ends = page["budgets"]["ranges"][0]["ends"]["accuracy"]
    assert ends == [0.8, 0.9], "what has seen its labels bounds no budget"


@pytest.mark.parametrize(
    ("frame", "title"),
    [
        (pd.DataFrame(), "No design yet"),
        (points().iloc[:0], "No design yet"),
        (failed(), "Every trial failed"),
        (points().drop(columns=list(OBJECTIVES)), "Nothing to compare"),
        (points(accuracy=np.nan, energy_uj=np.nan, n_weights=np.nan), "Nothing to compare"),
    ],
)
def test_nothing_to_draw_is_said(frame, title):
    assert gather(frame)["state"]["title"] == title


@pytest.mark.parametrize(
    ("frame", "remark"),
    [
        (points().drop(columns="energy_uj"), "Column energy_uj is missing from this study"),
        (points(n_weights=1000), "n_weights is 1\u202f000 for all designs, so it does not distinguish them."),
        (points(energy_uj=[50, np.nan, 21, 5, np.inf]), "2 of 5 points have no value of energy_uj"),
        (points().iloc[:1], "There is one design point so far"),
    ],
)
def test_remarks(frame, remark):
    assert any(note.startswith(remark) for note in gather(frame)["notes"])


def test_a_row_without_an_objective_is_on_no_front_of_it():
    page = gather(points(energy_uj=[50, np.nan, 21, 5, 30]))
    assert 1 not in page["front"] and page["columns"]["energy_uj"]["values"][1] is None


def test_a_large_table_is_thinned_but_its_front_is_whole(monkeypatch):
    many = pd.concat(
        [points(accuracy=0.1, energy_uj=60.0, n_weights=10**6)] * 40 + [points()], ignore_index=True
    ).assign(trial=range(205))
    monkeypatch.setattr(gather_module, "MAX_POINTS", 50)
    page = gather(many)
    trials = page["columns"]["trial"]["values"]
    assert len(trials) == 50
    assert {trials[row] for row in page["front"]} >= {200, 201, 202, 203}
    assert any(note.startswith("50 of 205 points are shown") for note in page["notes"])


def test_values_keep_six_digits_and_whole_numbers_but_budgeted_ones_keep_all():
    page = gather(points(accuracy=[1 / 3] * 5, undecided=1 / 3, n_weights=[123_456_789.0] * 5))
    assert page["columns"]["accuracy"]["values"][0] == 1 / 3
    assert page["columns"]["undecided"]["values"][0] == 0.333333
    assert page["columns"]["n_weights"]["values"][0] == 123_456_789


@pytest.mark.parametrize(
    ("frame", "objectives", "message"),
    [
        (points(), {"accuracy": "up"}, "directions must be 'max' or 'min', got 'accuracy': 'up'"),
        (pd.concat([points(), points()], axis=1), OBJECTIVES, "columns must be unique, got 'trial' twice"),
    ],
)
def test_wrong_input(frame, objectives, message):
    with pytest.raises(ValueError, match=message):
        gather(frame, objectives)


def test_costs_that_a_family_cannot_have_on_a_chip_are_no_warning():
    """Who else lacks a number is warned of: here one row of a family that has them."""
    frame = points(family=["snn", "snn", "snn", "elm", "elm"], hardware="loihi")
    for rows_without, n in (([3, 4], 0), ([0], 1)):
        frame.loc[rows_without, "energy_uj"] = None
        lacks = [note for note in gather(frame)["notes"] if "no value" in note]
        assert len(lacks) == n and all(note.startswith("1 of 5 points have no value") for note in lacks)
