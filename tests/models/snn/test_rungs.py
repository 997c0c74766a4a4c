"""Trainings that pause at rungs: they end with the bits of one that never paused."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from dse import store
from dse.base.records import Outcome
from dse.engine.losses.count_cross_entropy import CountCrossEntropy
from dse.engine.neurons.lif import Lif
from dse.engine.neurons.resonator import Resonator
from dse.engine.neurons.xylo_lif import XyloLif
from dse.models.snn.columns import Columns
from dse.models.snn.family import SNN
from dse.models.training import FitRequest, Rung, Span, Training
from tests.models.snn.test_train import SHARED, assert_same, own, settled
from tests.models.snn.toy import toy


def base(**keys):
    return Training(**{"epochs": 30, "batch_size": 20, "learning_rate": 0.1, "lr_every": 7, **keys})


PLAIN = {
    0: (SNN(hidden=(12,), pruned=0.4), base(warmup_epochs=13.5, average_epochs=14)),
    1: (SNN(hidden=(9, 7), recurrent=True, pruned=0.3, prune_epoch=0.2), base(clip_norm=0.5, dropout=0.3)),
    2: (SNN(hidden=(10,), max_delay=9, delayed_layers="all"), base(average_epochs=3)),
    3: (SNN(hidden=(8,), neuron=Resonator()), base(step_unit="weight", learning_rate=0.005)),
    4: (SNN(hidden=(8,), arithmetic="ideal", loss=CountCrossEntropy()), base(teacher="mlp", epochs=24)),
    5: (SNN(hidden=(6,), arithmetic="float32", hidden_spike_penalty=1e-4), base(epochs=10)),
    6: (SNN(hidden=(7,), max_axonal_delay=9, learnt_decays="neuron", pruned=0.4), base(keep="best")),
    7: (SNN(hidden=(9,), regions=3, start="contrasts", rounding="dithered"), base(average_epochs=12)),
    8: (SNN(hidden=(9,), regions=3, threshold_exponents=(2, 1), recurrent=True), base(clip_norm=0.5)),
}
STAGED = {
    0: (SNN(hidden=(12,), whitened="output"), base(output_epochs=9, average_epochs=25)),
    1: (SNN(hidden=(9, 7), whitened="all", arithmetic="float32"), base(output_epochs=9, dropout=0.3)),
    2: (SNN(hidden=(10,), weight_norm=True, pruned=0.3, prune_epoch=0.2), base(output_epochs=9, clip_norm=1)),
    3: (
        SNN(hidden=(8,), weight_norm=True, recurrent=True),
        base(output_epochs=9, lr_schedule="cosine", warmup_epochs=3),
    ),
    4: (SNN(hidden=(10,), max_delay=9, delayed_layers="all"), base(output_epochs=9, epochs=24)),
    5: (
        SNN(hidden=(9,), regions=3, start="contrasts", whitened="output", rounding="dithered"),
        base(output_epochs=9),
    ),
}
CHANGED = {
    "event_dropout": 0.1,
    "dilation": (0.8, 1.2),
    "dilation_keeps_label": True,
    "channel_shift": 1,
    "blend": 0.5,
    "input_dropout": 0.2,
}
AUGMENTED = {
    0: (SNN(hidden=(12,)), base(**CHANGED)),
    1: (Columns(features=3, neighbours=2), base(**CHANGED, average_epochs=12)),
}
WITHOUT_KERNEL = {
    0: (SNN(hidden=(4,), neuron=XyloLif(), recurrent=True, pruned=0.2), base(epochs=6)),
    1: (SNN(hidden=(5,), neuron=Lif(), arithmetic="float32"), base(epochs=5, dropout=0.4, average_epochs=4)),
}


def span(data, designs, states, until):
    requests = [FitRequest(m.placed(data.positions), t, own(k)) for k, (m, t) in designs.items()]
    part = Span([partial(dict, states[k]) for k in designs if k in states], until)
    numbers = list(designs)
    return {numbers[k]: done for k, done in SNN.fit_span(data, requests, SHARED, span=part)}


def whole(data, designs):
    return {k: settled(outcome) for k, outcome in span(data, designs, {}, None).items()}


@pytest.mark.parametrize(
    ("designs", "ends"),
    [
        (PLAIN, (10, 20, None)),
        (STAGED, (5, 10, 20, None)),
        (AUGMENTED, (10, 20, None)),
        (WITHOUT_KERNEL, (1, 3, None)),
    ],
    ids=["kernels", "staged", "augmented", "without_kernel"],
)
def test_spans_through_files_give_the_bits_of_one_training(designs, ends, tmp_path):
    data = toy(n_channels=6, n_steps=24, n=30, margin=2)
    expected, ended = whole(data, designs), {}
    left, states = designs, {}
    for until in ends:
        done = span(data, left, states, until)
        ended |= {k: each for k, each in done.items() if isinstance(each, Outcome)}
        left = {k: design for k, design in left.items() if k not in ended}
        for k in left:
            assert done[k].epochs == until
            store.save_arrays(tmp_path / f"{k}.npz", done[k].state)
            states[k] = store.load_arrays(tmp_path / f"{k}.npz")
        # The rest of the way in two cohorts in place of one.
        if until is not None and len(left) > 2:
            halves = [dict(list(left.items())[part::2]) for part in (0, 1)]
            apart = [span(data, half, states, None) for half in halves]
            for k, outcome in (apart[0] | apart[1]).items():
                assert_same(settled(outcome), expected[k])
    assert ended.keys() == designs.keys()
    for k, outcome in ended.items():
        assert_same(settled(outcome), expected[k])


def test_a_rung_is_what_a_training_of_so_many_epochs_gives_and_on_the_way_states_are_the_same():
    data, design = toy(), (SNN(hidden=(12,)), base(epochs=5))
    (rung,) = span(data, {0: design}, {}, 3).values()
    assert isinstance(rung, Rung) and rung.outcome is not None
    short = whole(data, {0: (design[0], replace(design[1], epochs=3))})[0]
    assert_same(rung.outcome, short)
    on_the_way = [
        each
        for _, each in SNN.fit_span(
            data, [FitRequest(*design, own(0))], SHARED, span=Span(is_due=lambda: True)
        )
    ]
    assert [each.epochs for each in on_the_way[:-1]] == [1, 2, 3, 4]
    state = on_the_way[2].state
    assert state.keys() == rung.state.keys()
    for name in state.keys() - {"seconds"}:
        np.testing.assert_array_equal(state[name], rung.state[name])
    assert_same(settled(on_the_way[-1]), whole(data, {0: design})[0])
    # A rung that is reached already is given again, without a step.
    (again,) = span(data, {0: design}, {0: rung.state}, 3).values()
    assert_same(again.outcome, rung.outcome)


def test_designs_at_different_epochs_cannot_go_on_together():
    data, design = toy(), (SNN(hidden=(12,)), base(epochs=5))
    states = {k: span(data, {k: design}, {}, k + 1)[k].state for k in (0, 1)}
    with pytest.raises(ValueError, match=r"go on from the same epoch, got \[1, 2\]"):
        span(data, {0: design, 1: design}, states, None)
