"""Sentences about decision settings, from records of runs."""

import numpy as np

from dse.config.space import DecisionGrid
from dse.measure.numbers import Numbers
from dse.study.health import remarks
from dse.study.record import RunRecord


def record(trial, columns, **heads):
    of_heads = {name: Numbers(of_head, {}) for name, of_head in heads.items()}
    numbers = None if columns is None else Numbers(columns, {}, of_heads)
    return RunRecord(trial=trial, repeat=0, design={}, seed=0, numbers=numbers)


def grid(*phi):
    return DecisionGrid(np.array(phi, np.int64), np.array([0.5, 1.0]))


INSIDE = {"t_p_on_border": 0.0, "output_spikes_most": 9}
BORDER = {"t_p_on_border": 1.0, "output_spikes_most": 9}


def test_nothing_is_said_of_what_is_inside_failed_or_has_no_grid():
    trials = {0: [record(0, INSIDE)], 1: [record(1, None)], 2: [record(2, {"accuracy": 1.0})]}
    assert remarks(grid(0, 5), trials) == remarks(grid(8, 9), trials) == []


def test_a_best_setting_on_the_border_is_one_line():
    trials = {k: [record(k, INSIDE), record(k, BORDER)] for k in (5, 3, 1, 0)} | {2: [record(2, INSIDE)]}
    [line] = remarks(grid(0, 5), trials)
    assert line.startswith("decision: the best setting of trials 0, 1, 3 and 1 more lies on the border of")
    joint = {4: [record(4, {}, texture=INSIDE, profile=BORDER)]}
    assert remarks(grid(0, 5), joint)[0].startswith("decision: the best setting of trial 4 lies on")


def test_a_phi_that_no_sample_exceeds_is_one_line():
    [line] = remarks(grid(9, 12), {0: [record(0, INSIDE)]})
    assert line == (
        "decision: phi must be below the most output spikes of a sample, but its smallest value, 9, is not "
        "in trial 0: nothing is decided there before the end of the input"
    )
