"""Faults of finished designs in one sentence each."""

import pandas

from dse.study.health import failures, faults

FINE = {"status": "finished", "collapsed_outputs": 0, "saturated_neurons": 0, "missed_initial_rates": 0}


def test_each_kind_of_fault_is_counted_once_and_names_what_to_change():
    rows = [
        FINE,
        FINE | {"collapsed_outputs": 0.5, "saturated_neurons": 3},
        FINE | {"collapsed_outputs": 1},
        FINE | {"status": "failed", "missed_initial_rates": None},
    ]
    trials = pandas.DataFrame([{"trial": k, **row} for k, row in enumerate(rows)])
    collapsed, saturated = faults(trials)
    assert collapsed.startswith(
        "2 of 3 designs give one answer to nearly every validation sample "
        "(collapsed_outputs > 0, first in trial 1): lower training.learning_rate"
    )
    assert "1 of 3 designs have neurons that fire in nearly every step (saturated_neurons > 0, " in saturated
    (missed,) = faults(trials.assign(collapsed_outputs=0, saturated_neurons=0, missed_initial_rates=1))
    assert "first in trial 0): compare initial_rate_hidden with model.initial_rate" in missed


def test_designs_that_were_not_trained_did_not_fail():
    rows = [FINE, *({"status": status, "reason": status} for status in ("excluded", "failed", "failed"))]
    assert failures(pandas.DataFrame(rows)) == ["2 of 3 designs failed; the first: failed"]
    assert failures(pandas.DataFrame(rows[:2])) == []


def test_dropout_on_counts_that_move_together_is_named_with_what_to_change():
    rows = [FINE | {"collinear_dropout": k, "effective_rank": 2.0} for k in (True, False, True)]
    (said,) = faults(pandas.DataFrame([{"trial": k, **row} for k, row in enumerate(rows)]))
    assert said.startswith("2 of 3 designs silence hidden neurons whose counts rise and fall together")
    assert "set training.dropout to 0, and model.whitened to output" in said


def test_sound_designs_and_families_without_such_columns_have_none():
    assert faults(pandas.DataFrame([{"trial": 0, **FINE}])) == []
    assert faults(pandas.DataFrame([{"trial": 0, "status": "finished", "accuracy": 0.5}])) == []
    assert faults(pandas.DataFrame([{"trial": 0, "status": "failed"}])) == []
