"""Temporal convolutions against the definition, tap by tap; what they learn; what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from dse.base.records import Parameters
from dse.config import settings
from dse.models.counts.linear import Linear
from dse.models.counts.tcn import TCN
from dse.models.training import Training, TrainingDiverged
from dse.testing.expect import same
from tests.models.counted import data_of, rngs, textures
from tests.spaces import SPACE, faults_of, write_space

pytestmark = pytest.mark.usefixtures("torch")

FAMILY = TCN(window_ms=20.0, hidden=(5, 4), kernel_size=3, epochs=2, read_outs=3)


def digits():
    """Return textures whose channels are digits of two places; what they add up to passes 8 bits."""
    data = textures(n=40, n_steps=40)
    positions = np.array([[0, 0, 0], [0, 0, 1], [5, 0, 0], [5, 0, 1]], np.int32)
    return replace(data, positions=positions, rises=np.array([-3, 3, -200, 170], np.int32))


def order(n=90, rare=False):
    """Return spikes of two channels, one after the other, and which came first; half validate."""
    rng = np.random.default_rng(5)
    target, first = np.arange(n) % 2, rng.integers(0, 20, n)
    x = np.zeros((n, 32, 2 + rare), bool)
    x[0, 0, 2:] = True
    x[np.arange(n), first, target] = x[np.arange(n), first + 4, 1 - target] = True
    return data_of(x, list(target), np.arange(n // 2), np.arange(n // 2, n))


def sums(arrays, family, seen):
    """Return what the last layer sums up to by each bin: seen is (bin, place) integers of a recording."""
    shifts = arrays["level_shifts"].tolist()
    x = [[min(max(v >> s, -128), 127) for v, s in zip(row, shifts, strict=True)] for row in seen]
    for k, shift in enumerate(arrays["filter_shifts"].tolist()):
        weight, bias = arrays[f"filter/{k}"].tolist(), arrays[f"offset/{k}"].tolist()
        passed = []
        for t in range(family.stride - 1, len(x), family.stride):
            y = list(bias)
            for j in range(family.kernel_size):
                then = x[t - j * 2**k] if t >= j * 2**k else [0] * len(x[0])
                for i, value in enumerate(then):
                    y = [a + value * w for a, w in zip(y, weight[j * len(then) + i], strict=True)]
            passed.append([min(max(value, 0) >> shift, 127) for value in y])
        x = passed
    return np.cumsum(x, axis=0)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"reads": "levels"},
        {"reads": "changes", "stride": 2, "kernel_size": 4},
        {"reads": "counts", "stride": 3, "hidden": (6,), "read_outs": 2},
    ],
)
def test_inputs_of_the_readout_are_those_of_the_definition(changes):
    data, family = digits(), replace(FAMILY, **changes)
    outcome = family.fit(data, Training(), rngs)
    arrays = outcome.network.arrays
    counts = family.counts(data, data.validation[:4], arrays)
    lengths, depth = arrays["lengths"], family.stride ** len(family.hidden)
    found = np.stack(list(family.inputs(arrays, counts, lengths)), axis=1)
    for n, i in enumerate(data.validation[:4]):
        row = i * data.spikes.n_steps + data.start[i]
        bins = []
        for t in range(0, 40, 2):
            begin, end = data.spikes.row_offsets[[row + t, row + t + 2]]
            spikes = data.spikes.channel[begin:end]
            if family.reads == "counts":
                bins.append(np.bincount(spikes, minlength=4))
            else:
                bins.append(np.bincount(spikes // 2, data.rises[spikes], minlength=2).astype(int))
        seen = np.cumsum(bins, axis=0) if family.reads == "levels" else np.array(bins)
        expected = sums(arrays, family, seen.tolist())
        for j, length in enumerate(lengths.tolist()):
            assert (
                found[n, j].tolist()
                == (expected[length // depth - 1] if length >= depth else 0 * expected[0]).tolist()
            )
    assert (found > 0).any()
    weights = sum(arrays[f"filter/{k}"].size for k in range(len(family.hidden)))
    assert outcome.validation.n_weights.tolist() == [weights + 3 * family.hidden[-1]] * len(lengths)
    assert outcome.validation.stored_bits == 8


def test_macs_are_the_weights_each_time_that_a_layer_computes():
    family = replace(FAMILY, stride=2)
    macs = family.fit(textures(n_steps=40), Training(), rngs).validation.macs
    times = np.array([7, 14, 20])
    assert macs.tolist() == (3 * 4 * 5 * (times // 2) + 3 * 5 * 4 * (times // 4) + 4 * 3).tolist()


def test_it_learns_an_order_that_counts_do_not_show():
    data = order()
    answers = TCN(window_ms=10.0, hidden=(8,), read_outs=1).fit(data, Training(), rngs).validation
    target = data.target[data.validation]
    assert (answers.label[:, -1] == target).mean() > 0.95
    counted = Linear(window_ms=400.0, read_outs=1).fit(data, Training(), rngs).validation
    assert (counted.label[:, -1] == target).mean() < 0.7


def test_threads_change_no_bit_and_are_given_back(torch):
    alone = FAMILY.fit(textures(), Training(), rngs)
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        again = FAMILY.fit(textures(), Training(), rngs)
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)
    assert same(alone.network, again.network) and same(alone.history, again.history)


def test_an_input_that_hardly_varies_takes_no_weights_of_others():
    """A channel spikes once in one recording: over its own deviation, its weights would be the largest."""
    answers = TCN(window_ms=10.0, hidden=(8,), read_outs=1).fit(order(rare=True), Training(), rngs).validation
    assert (answers.label[:, -1] == order().target[order().validation]).mean() > 0.95


def test_one_class_is_answered():
    data = textures()
    alone = data.train[data.target[data.train] == 1]
    assert (FAMILY.fit(replace(data, train=alone), Training(), rngs).validation.label == 1).all()


def test_what_cannot_be_trained():
    with pytest.raises(ValueError, match=r"model\.stride 3 leaves the last of 2 layers none of 5 bins"):
        replace(FAMILY, window_ms=50.0, stride=3).fit(textures(), Training(), rngs)
    with pytest.raises(TrainingDiverged, match="learning rate 1e"):
        replace(FAMILY, learning_rate=1e30, epochs=4).fit(textures(), Training(), rngs)


@pytest.mark.parametrize(
    ("keys", "fault"),
    [
        ("hidden: [8, 8, 8, 8]", "model.hidden must have 1 to 3 layers, got 4"),
        ("hidden: 65", "model.hidden[0] must be in [4, 64], got 65"),
        ("kernel_size: 9", "model.kernel_size must be in [3, 8], got 9"),
        ("stride: 0", "model.stride must be in [1, 3], got 0"),
        ("reads: signal", "unknown model.reads 'signal'; known: counts, levels, changes"),
    ],
)
def test_a_wrong_key_is_one_line(tmp_path, keys, fault):
    before = next(line for line in SPACE.splitlines() if line.startswith("model:"))
    [line] = faults_of(write_space(tmp_path, (before, f"model: {{kind: tcn, {keys}}}")))
    assert fault in line


def test_without_torch_a_space_is_refused_in_one_line(tmp_path, monkeypatch, capsys):
    from dse.cli import main

    before = next(line for line in SPACE.splitlines() if line.startswith("model:"))
    path = write_space(tmp_path, (before, "model: tcn"))
    monkeypatch.setattr(settings, "find_spec", lambda name: None)
    assert main(["check", str(path)]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert line.endswith(
        "'tcn' needs the package torch, which is not installed: pip install 'dse-spiking[torch]'"
    )


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("filter/0", np.zeros((12, 4), np.int8)),
        ("filter/1", np.zeros((15, 4), np.int16)),
        ("offset/1", np.zeros(5, np.int32)),
        ("level_shifts", np.zeros(3, np.uint8)),
        ("filter_shifts", np.full(2, 32, np.uint8)),
        ("place", np.array([0, 1, 2, 7])),
        ("0/0/weight", np.ones((4, 3), np.int64)),
    ],
)
def test_arrays_of_a_file_that_do_not_fit(name, value):
    fitted = FAMILY.fit(textures(), Training(), rngs).network
    FAMILY.check_fitted(fitted, 3)
    with pytest.raises(ValueError, match="must"):
        FAMILY.check_fitted(Parameters({**fitted.arrays, name: value}, 4), 3)
