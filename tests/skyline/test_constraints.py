import numpy as np
import pandas as pd
import pytest

from dse.skyline.constraints import Budget, ExpressionError, matches, named_columns, split_budgets

FRAME = pd.DataFrame(
    {
        "energy_uj": [10.0, 50.0, np.nan, 90.0],
        "model.hidden": [50, 100, 100, 200],
        "task": ["texture", "texture", "speed", None],
        "fits": [True, False, True, True],
        "layers": [[50], [50, 20], [100], [200]],
        "mixed": ["a", 1, "b", 2],
        "empty": [None, None, None, None],
        "wide": pd.array([1, None, 3, 4], dtype="Int64"),
    }
)


@pytest.mark.parametrize(
    ("expression", "rows"),
    [
        ("energy_uj <= 50", [0, 1]),
        ("energy_uj < 50", [0]),
        ("50 <= energy_uj", [1, 3]),
        ("10 < energy_uj <= 90", [1, 3]),
        ("energy_uj != 50", [0, 3]),
        ("model.hidden == 100", [1, 2]),
        ("model.hidden >= energy_uj", [0, 1, 3]),
        ("task == 'texture'", [0, 1]),
        ("task != 'texture'", [2]),
        ("task < 'texture'", [2]),
        ("task in ['speed', 'texture']", [0, 1, 2]),
        ("task not in ('speed',)", [0, 1]),
        ("model.hidden in [50, 200]", [0, 3]),
        ("model.hidden not in [50]", [1, 2, 3]),
        ("fits == True", [0, 2, 3]),
        ("not fits == True", [1]),
        ("fits and wide > 1", [2, 3]),
        ("not fits", [1]),
        ("wide > 1", [2, 3]),
        ("empty == 3", []),
        ("empty == 'x'", []),
        ("energy_uj > -1", [0, 1, 3]),
        ("energy_uj < +1e3 and task == 'texture' and fits == True", [0]),
        ("energy_uj == 10 or (task == 'speed' and not model.hidden > 100)", [0, 2]),
        ("not (energy_uj < 60 or fits == True)", []),
    ],
)
def test_conditions_select_rows(expression, rows):
    assert np.flatnonzero(matches(expression, FRAME)).tolist() == rows


@pytest.mark.parametrize(
    ("expression", "message"),
    [
        ("", "must read like"),
        ("energy_uj <=", "must read like"),
        ("energy_uj = 5", "must read like"),
        ("(" * 500 + ")" * 500, "must read like"),
        ("energy", "'energy' is not a comparison"),
        ("energy_uj", "'energy_uj' is not a comparison"),
        ("energy_uj + 1", "is not a comparison"),
        ("energy_uj + 1 < 2", "'energy_uj \\+ 1' must be a column, a number"),
        ("abs(energy_uj) < 2", "must be a column, a number"),
        ("__import__('os').system('true') == 0", "must be a column, a number"),
        ("energy_uj.__class__ == 0", "unknown column 'energy_uj.__class__'"),
        ("energy < 2", "unknown column 'energy'. Did you mean 'energy_uj'. Known: "),
        ("energy_uj < None", "'None' must be a column"),
        ("energy_uj is 5", "may only use =="),
        ("energy_uj in 5", "must be followed by a list"),
        ("energy_uj in [abs(1)]", "must be a column, a number"),
        ("energy_uj < 'small'", "compares text with a number"),
        ("task == 3", "compares text with a number"),
        ("energy_uj < task", "compares text with a number"),
        ("layers == 50", "column 'layers' must hold either text or numbers"),
        ("mixed == 'a'", "column 'mixed' must hold either text or numbers"),
        ("energy_uj < -'a'", "must be a column"),
        ("energy_uj < True and (lambda: 1)", "is not a comparison"),
    ],
)
def test_what_is_no_condition_is_named(expression, message):
    with pytest.raises(ExpressionError, match=message):
        matches(expression, FRAME)


def test_no_rows_give_no_rows():
    assert matches("energy_uj < 1 and task == 'x'", FRAME.iloc[:0]).tolist() == []


def test_budgets_are_split_from_conditions():
    budgets, rest = split_budgets(
        ["energy_uj<=50 and 1e5 >= n_weights", "task == 'texture'", "energy_uj<=50"]
    )
    assert budgets == [Budget("energy_uj", "<=", 50.0), Budget("n_weights", "<=", 1e5)]
    assert rest == ["task == 'texture'"]
    assert [str(x) for x in budgets] == ["energy_uj<=50", "n_weights<=100000"]


@pytest.mark.parametrize(
    "text", ["a < 1 or b < 2", "a < b", "1 < a < 2", "a != 3", "fits == True", "a in [1]"]
)
def test_what_has_no_single_limit_is_a_condition(text):
    assert split_budgets([text]) == ([], [text])


@pytest.mark.parametrize(
    ("operator", "direction", "excess"),
    [("<=", "min", [0, 0, 3]), (">=", "max", [2, 0, 0]), ("==", "", [2, 0, 3])],
)
def test_excess_is_what_a_limit_is_missed_by(operator, direction, excess):
    budget = Budget("x", operator, 5.0)
    assert budget.direction == direction
    assert budget.excess(np.array([3.0, 5.0, 8.0])).tolist() == excess


@pytest.mark.parametrize(
    ("operator", "met"),
    [
        ("<", [True, False, False]),
        ("<=", [True, True, False]),
        ("==", [False, True, False]),
        (">=", [False, True, True]),
        (">", [False, False, True]),
    ],
)
def test_a_budget_is_met_as_its_operator_says(operator, met):
    assert Budget("x", operator, 5.0).met(np.array([4.0, 5.0, 6.0])).tolist() == met


@pytest.mark.parametrize(
    ("expression", "columns"),
    [
        ("energy_uj <= 50", {"energy_uj"}),
        ("not fits", {"fits"}),
        (
            "family != 'fits' and not (task == 'transductive' or 3 < model.hidden)",
            {"family", "task", "model.hidden"},
        ),
        ("model.fits == 1", {"model.fits"}),
        ("fits_well == True or transductive_x > 2", {"fits_well", "transductive_x"}),
        ("task in ['fits', name]", {"task", "name"}),
        ("'fits' == \"transductive\"", set()),
    ],
)
def test_a_condition_names_columns_not_words(expression, columns):
    assert named_columns([expression]) == columns
    assert named_columns([expression, "a < 1"]) == {*columns, "a"}


def test_what_is_no_condition_names_no_columns():
    with pytest.raises(ExpressionError, match="must read like"):
        named_columns(["fits ="])


def test_a_column_of_costs_says_how_to_get_them():
    frame = pd.DataFrame({"accuracy": [0.5]})
    with pytest.raises(ExpressionError, match=r"'energy_uj' needs costs, .*: add --hardware NAME"):
        matches("energy_uj <= 3", frame)
