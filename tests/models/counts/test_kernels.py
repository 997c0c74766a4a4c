"""Random kernels against the definition, sum by sum."""

from dataclasses import replace

import numpy as np
import pytest

from dse.base.records import Parameters
from dse.models.counts.kernels import Kernels, begins
from dse.models.training import Training
from dse.testing.small import spikes_of
from tests.models.counted import rngs, textures

FAMILY = Kernels(window_ms=10.0, kernels=14, places=3, read_outs=3)


def on_and_off():
    """Return textures whose channels 0, 1 are OFF and ON of one place, 2 and 3 those of another."""
    data = textures(n=40, n_steps=40)
    positions = np.array([[0, 0, 0], [0, 0, 1], [5, 0, 0], [5, 0, 1]], np.int32)
    return replace(data, positions=positions)


def above(arrays, levels, n_bins):
    """Return the bins in which each kernel is above each of its thresholds: levels is (bin, place)."""
    found = []
    thresholds = arrays["thresholds"].reshape(len(arrays["taps"]), -1)
    for k, (taps, rising) in enumerate(zip(arrays["taps"], thresholds, strict=True)):
        dilation = int(arrays["dilations"][k % len(arrays["dilations"])])
        group = arrays["groups"][k // len(arrays["dilations"])]
        z = [sum(int(s) * int(v) for s, v in zip(group, row, strict=True)) for row in levels]
        sums = []
        is_whole = k // len(arrays["dilations"]) % 2 == 1 and 16 * dilation <= len(levels)
        for t in range(8 * dilation if is_whole and 8 * dilation <= n_bins else 0, n_bins):
            lags = [z[t - j * dilation] if t >= j * dilation else 0 for j in range(9)]
            sums.append(3 * sum(lags[j] for j in taps) - sum(lags))
        found += [sum(x > threshold for x in sums) for threshold in rising]
    return found


@pytest.mark.parametrize(("rises", "thresholds"), [(None, 1), ([-1, 1, -1, 1], 4), ([-3, 3, -200, 200], 3)])
def test_counts_are_those_of_the_definition(rises, thresholds):
    data = replace(on_and_off(), rises=None if rises is None else np.array(rises, np.int32))
    family = replace(FAMILY, thresholds=thresholds)
    outcome = family.fit(data, Training(), rngs)
    arrays = outcome.network.arrays
    signs = rises or [-1, 1, -1, 1]
    assert arrays["place"].tolist() == [0, 0, 1, 1] and arrays["sign"].tolist() == signs
    assert arrays["sign"].dtype == (np.int8 if max(signs) < 127 else np.int16)
    assert arrays["dilations"].tolist() == [1, 2, 4]  # 8 x 8 is beyond 40 bins
    rises = family.counts(data, data.validation[:3], arrays)
    lengths = arrays["lengths"]
    inputs = np.stack(list(family.inputs(arrays, rises, lengths)), axis=1)
    assert np.array_equal(inputs[:, 1], *family.inputs(arrays, rises, lengths[1:2]))
    assert (np.diff(arrays["thresholds"].reshape(14, -1)) >= 0).all()
    for n, i in enumerate(data.validation[:3]):
        first = i * data.spikes.n_steps + data.start[i]
        levels, level = [], [0, 0]
        for t in range(40):
            begin, end = data.spikes.row_offsets[first + t : first + t + 2]
            for channel in data.spikes.channel[begin:end]:
                level[channel // 2] += signs[channel]
            levels.append(list(level))
        for j, length in enumerate(lengths):
            assert inputs[n, j].tolist() == above(arrays, levels, int(length))
    assert (inputs > 0).any() and (inputs < 40).any()
    answers, n = outcome.validation, 14 * thresholds
    assert answers.n_weights.tolist() == [n * 3 + n] * 3 and answers.macs.tolist() == [n * 3] * 3
    rises = family.counts(data, data.validation, arrays)
    more = [
        x.reshape(-1, 14, thresholds)[:, :, 1:].sum() / len(x) for x in family.inputs(arrays, rises, lengths)
    ]
    assert np.allclose(answers.program.get("kernel_more", 0), more)
    in_bin = np.count_nonzero(arrays["groups"]) + 12 * 14
    assert np.allclose(answers.additions - answers.input_spikes.mean(axis=0), lengths * in_bin)


def test_kernels_of_older_versions_are_counted_from_the_first_bin():
    data = on_and_off()
    arrays = FAMILY.fit(data, Training(), rngs).network.arrays
    older = {name: values for name, values in arrays.items() if name != "whole"}
    rises, lengths = FAMILY.counts(data, data.validation, arrays), np.array([40])
    [now], [before] = (list(FAMILY.inputs(x, rises, lengths)) for x in (arrays, older))
    anew = [3, 4, 9, 10]  # of every other group of three, dilations 1 and 2
    assert begins(arrays)[anew].tolist() == [8, 16, 8, 16] and not begins(older).any()
    others = np.setdiff1d(np.arange(14), anew)
    assert np.array_equal(now[:, others], before[:, others])
    assert (now[:, anew] <= before[:, anew]).all() and (now[:, anew] < before[:, anew]).any()


def test_planes_that_are_no_pairs_all_add():
    data = on_and_off()
    three = replace(data, positions=np.array([[0, 0, 0], [0, 0, 1], [0, 0, 2], [1, 0, 0]], np.int32))
    wiring = FAMILY.wiring(three)
    assert wiring["place"].tolist() == [0, 0, 0, 1] and (wiring["sign"] == 1).all()


def test_levels_that_begin_elsewhere_are_the_same_shape():
    """Kernels of a level that is the same but for a spike before the window, in which levels begin at 0."""
    x = np.zeros((2, 40, 1), bool)
    x[1, 0] = True
    x[:, 10:20] = True
    data = replace(textures(n_channels=1), spikes=spikes_of(x, 10.0), start=np.array([5, 5]), n_steps=30)
    arrays = FAMILY._drawn(np.ones((4, 30, 1), np.int32), np.random.default_rng(0))
    rises = FAMILY.counts(data, np.arange(2), FAMILY.wiring(replace(data, positions=np.zeros((1, 3), int))))
    [found] = FAMILY.inputs(arrays, rises, np.array([30]))
    assert np.array_equal(found[0], found[1])


def test_few_bins_and_few_places():
    answers = replace(FAMILY, window_ms=100.0, kernels=2).fit(textures(n_channels=1), Training(), rngs)
    assert answers.network.arrays["dilations"].tolist() == [1] and answers.validation.label.shape == (24, 3)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("taps", np.full((14, 3), 9, np.uint8)),
        ("place", np.array([0, 0, 1, 7])),
        ("dilations", np.array([1, 2, 1 << 30])),
        ("groups", np.ones((3, 2), np.int8)),
        ("whole", np.zeros(2, np.uint8)),
        ("0/0/weight", np.ones((14, 3), np.int64)),
        ("1/0/bias", np.ones(2, np.int32)),
    ],
)
def test_arrays_of_a_file_that_do_not_fit(name, value):
    fitted = FAMILY.fit(on_and_off(), Training(), rngs).network
    FAMILY.check_fitted(fitted, 3)
    with pytest.raises(ValueError, match="must"):
        FAMILY.check_fitted(Parameters({**fitted.arrays, name: value}, 4), 3)
