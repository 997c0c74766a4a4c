"""HOTS: layers, histograms and signatures against a slow definition; hard cases; costs counted by hand."""

import dataclasses
from functools import partial

import numpy as np
import pytest

from dse.base import seeds
from dse.base.records import Dataset, Spikes
from dse.models.training import Training
from dse_papers.models.hots import HOTS, histograms, read_out_steps
from dse_papers.models.time_surfaces import Field, Stream, nearest, surface

# A 4 x 3 grid of taxels without its corner, two planes of numbers of their own.
PLACES = np.array([(x, y) for y in range(3) for x in range(4)][:-1])
POSITIONS = np.concatenate(
    [np.column_stack([PLACES + np.array([5, 9]), np.full(11, plane)]) for plane in (2, 7)]
).astype(np.int32)


def rngs(repeat=0):
    return partial(lambda purpose, *index: seeds.generator(1, {}, purpose, repeat, *index))


def fit(data, repeat=0, **settings):
    return HOTS(**settings).fit(data, Training(), rngs(repeat))


def dataset(raster, target, positions=POSITIONS, start=0):
    """Return a data set of a (sample, step, channel) raster; even samples train, odd ones validate."""
    n, n_stored, n_channels = raster.shape
    flat = raster.reshape(-1, n_channels)
    offsets = np.concatenate([[0], np.cumsum(flat.sum(axis=1))]).astype(np.int64)
    spikes = Spikes(offsets, np.nonzero(flat)[1].astype(np.int32), n_stored, n_channels, 5.0)
    first = np.full(n, start, np.int32)
    names = tuple(f"class {c}" for c in range(int(target.max()) + 1))
    every, none = np.arange(n), np.zeros(0, np.int64)
    return Dataset(
        spikes, target.astype(np.int64), names, first, first, first, n_stored - start,
        every[::2], every[1::2], none, positions,
    )  # fmt: skip


def waves(n=36, n_steps=60, start=0):
    """Return three classes with the same rates: a wave that runs right, left or down, amid noise."""
    rng = np.random.default_rng(3)
    target = np.arange(n) // 2 % 3
    raster = rng.random((n, n_steps, 22)) < 0.02
    x, y = PLACES.T
    for i in range(n):
        place = (x, 3 - x, y)[target[i]]
        for t in range(n_steps):
            raster[i, t, :11] |= place == (t // 2 + i) % 4
    return dataset(raster, target, start=start)


def accuracy(outcome, data):
    return np.asarray((outcome.validation.label == data.target[data.validation][:, None]).mean(axis=0))


def parameters(outcome):
    return outcome.network


def answers(outcome):
    return outcome.validation


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"layers": 2, "prototypes_factor": 1.5},
        {"layers": 3, "radius": 1, "prototypes": 8, "prototypes_factor": 1.0},
        {"clustering": "online"},
        {"layers": 2, "clustering": "online", "signatures": "sample"},
        {"normalised": False, "signatures": "sample"},
        {"filter_radius": 3, "filter_neighbours": 2, "filter_ms": 10.0},
    ],
    ids=str,
)
def test_every_kind_learns_the_direction_of_a_wave(settings):
    data = waves()
    outcome = fit(data, **{"tau_ms": 20.0} | settings)
    found = accuracy(outcome, data)
    assert found[-1] >= 0.8
    assert len(found) == 20
    again = fit(data, **{"tau_ms": 20.0} | settings)
    for name, x in parameters(outcome).arrays.items():
        np.testing.assert_array_equal(x, parameters(again).arrays[name])
    np.testing.assert_array_equal(answers(outcome).label, answers(again).label)


def test_two_layers_answer_as_the_definition_does():
    data = waves(n=8, n_steps=25, start=3)
    settings = HOTS(layers=2, radius=1, radius_factor=2.6, prototypes=3, prototypes_factor=1.5, tau_ms=7.0)
    outcome = settings.fit(data, Training(), rngs())
    arrays, said = parameters(outcome).arrays, answers(outcome)
    lengths = read_out_steps(22, 20)
    x, y = (POSITIONS[:, :2] - POSITIONS[:, :2].min(axis=0)).T
    for row, i in enumerate(data.validation):
        first = i * 25 + 3
        rows = data.spikes.row_offsets[first : first + 23]
        channel = data.spikes.channel[rows[0] : rows[-1]]
        step = np.repeat(np.arange(22), np.diff(rows))
        plane = (POSITIONS[channel, 2] == 7).astype(np.int64)
        # K_rad 2.6 gives 2.6, rounded 3; K_f 1.5 gives 4.5, halves upwards 5.
        fields = Field(4, 3, 2, 1, 7000.0), Field(4, 3, 3, 3, 14_000.0)
        for field, prototypes in zip(fields, (arrays["prototypes_1"], arrays["prototypes_2"]), strict=True):
            events = Stream(step * 5000, x[channel], y[channel], plane)
            assert prototypes.shape == ({3: 3, 1: 3}[field.radius] + 2 * (field.radius == 3), field.size)
            surfaces = np.array([surface(events, j, field) for j in range(len(step))])
            plane = nearest(surfaces, prototypes)
        for k, length in enumerate(lengths):
            count = np.bincount(plane[step < length], minlength=5)
            distance = ((arrays["signatures"][k] - count / max(1, count.sum())) ** 2).sum(axis=1)
            assert said.label[row, k] == arrays["signature_class"][distance.argmin()]
            assert said.input_spikes[row, k] == (step < length).sum()


def test_class_signatures_are_the_means_of_those_of_the_samples():
    data = waves()
    mean, each = (parameters(fit(data, signatures=kind)).arrays for kind in ("class", "sample"))
    np.testing.assert_array_equal(mean["prototypes_1"], each["prototypes_1"])
    assert each["signatures"].shape == (20, 18, 16)
    target = data.target[data.train]
    np.testing.assert_array_equal(each["signature_class"], target)
    expected = np.stack([each["signatures"][:, target == c].mean(axis=1) for c in range(3)], axis=1)
    np.testing.assert_allclose(mean["signatures"], expected, atol=1e-7)


def test_costs_by_hand():
    # One plane of 4 x 3 places, radius 2: 5 x 5 numbers; radius 4 in the second layer: 7 x 5 x 2 planes.
    raster = np.zeros((4, 40, 12), dtype=bool)
    raster[:, ::4, 5] = True
    raster[::2, 1::4, 6] = True
    raster[1, :, 0] = True
    grid = np.column_stack([np.arange(12) % 4, np.arange(12) // 4, np.zeros(12, np.int64)])
    data = dataset(raster, np.array([0, 0, 1, 1]), grid)
    outcome = fit(data, layers=2, prototypes=2, prototypes_factor=1.0, signatures="sample")
    said = answers(outcome)
    prototypes = 2 * 25 + 2 * 70
    assert said.n_weights.tolist() == [prototypes + 2 * 2] * 20
    events = (40 + 10 + 10 - 0) / 2  # of the two validation samples
    assert said.input_spikes[:, -1].tolist() == [50, 10]
    assert said.additions[-1] == events
    assert said.macs[-1] == events * ((2 + 1) * 25 + (2 + 1) * 70) + 2 * 2 + 2
    assert (np.diff(said.macs) >= 0).all()
    assert said.time_ms.tolist() == [10.0 * k for k in range(1, 21)]
    filtered = answers(fit(data, filter_radius=1, filter_neighbours=1, filter_ms=5.0, prototypes=2))
    # Radius 1 has 5 places. Channel 0 sees itself one step before; channel 5 has nobody within 5 ms.
    assert filtered.additions[-1] == 39 / 2 + 5 * events
    np.testing.assert_array_equal(filtered.input_spikes, said.input_spikes)


def test_input_lengths_are_even_and_the_last_is_the_window():
    assert read_out_steps(40, 20).tolist() == list(range(2, 41, 2))
    assert read_out_steps(3, 20).tolist() == [1, 2, 3]
    assert read_out_steps(1, 20).tolist() == [1]
    assert read_out_steps(250, 20)[[0, -1]].tolist() == [13, 250]
    assert read_out_steps(5000, 50).tolist() == list(range(100, 5001, 100))


def with_times(data, t_us):
    """Return the same spikes at times of their own within their steps of 5 ms."""
    return dataclasses.replace(data, spikes=dataclasses.replace(data.spikes, t_us=t_us.astype(np.int32)))


def step_of(data):
    return np.repeat(
        np.arange(len(data.spikes.row_offsets) - 1) % data.spikes.n_steps, np.diff(data.spikes.row_offsets)
    )


@pytest.mark.parametrize("clustering", ["kmeans", "online"])
def test_events_at_the_starts_of_their_steps_are_the_binned_spikes(clustering):
    data = waves(start=3)
    settings = {"clustering": clustering, "filter_radius": 3, "filter_neighbours": 2, "filter_ms": 10.0}
    binned, timed = fit(data, **settings), fit(with_times(data, 5000 * step_of(data)), **settings)
    for name, x in parameters(binned).arrays.items():
        np.testing.assert_array_equal(x, parameters(timed).arrays[name])
    np.testing.assert_array_equal(answers(binned).label, answers(timed).label)


def test_microseconds_tell_apart_what_bins_do_not():
    """In every step two neighbours fire, 40 us apart: which of them comes first is the class."""
    n, n_steps = 24, 30
    target = np.arange(n) // 2 % 2
    raster = np.zeros((n, n_steps, 22), dtype=bool)
    raster[:, :, :2] = True
    data = dataset(raster, target)
    spikes = data.spikes
    order = np.stack([[0, 1] if c == 0 else [1, 0] for c in target]).repeat(n_steps, axis=0).ravel()
    channel = order.astype(np.int32)
    timed = with_times(data, 5000 * step_of(data) + np.tile([1000, 1040], n * n_steps))
    timed = dataclasses.replace(timed, spikes=dataclasses.replace(timed.spikes, channel=channel))
    settings = {"tau_ms": 0.02, "prototypes": 4, "radius": 1}
    # The first event of a step sees nobody; the second sees its neighbour at exp(-40 / 20).
    surfaces = parameters(fit(timed, **settings)).arrays["prototypes_1"]
    assert np.isclose(surfaces, np.exp(-2), rtol=1e-6).any(axis=1).sum() == 2
    assert accuracy(fit(timed, **settings), timed)[-1] == 1.0
    assert spikes.t_us is None and accuracy(fit(data, **settings), data)[-1] == 0.5
    # 40 us are within a filter of 40 us and not within one of 39: only second events pass, or none.
    for span_ms, passed in ((0.04, 0.5), (0.039, 0.0)):
        health = fit(timed, filter_radius=1, filter_neighbours=1, filter_ms=span_ms, **settings).health
        assert health["hots_events_kept"] == passed


def test_histograms_count_what_came_within_each_length():
    found = histograms(np.array([0, 1, 1, 4]), np.array([1, 0, 1, 2]), np.array([1, 3, 5]), 3)
    assert found.tolist() == [[0, 1, 0], [1, 2, 0], [1, 2, 1]]


def test_answers_see_no_more_than_their_input_length():
    data = waves()
    outcome = fit(data)
    counts = np.diff(data.spikes.row_offsets).reshape(-1, 60)
    kept = np.where(np.arange(60) < 30, counts, 0)  # nothing fires after half the window
    spikes = dataclasses.replace(
        data.spikes,
        row_offsets=np.concatenate([[0], np.cumsum(kept)]),
        channel=data.spikes.channel[np.repeat(np.tile(np.arange(60) < 30, len(counts)), counts.ravel())],
    )
    half = HOTS().respond(parameters(outcome), dataclasses.replace(data, spikes=spikes), data.validation)
    np.testing.assert_array_equal(half.label[:, :10], answers(outcome).label[:, :10])
    assert (half.input_spikes[:, 10:] == half.input_spikes[:, 9:10]).all()


def test_more_prototypes_than_events():
    raster = np.zeros((2, 5, 22), dtype=bool)
    raster[0, [1, 3], [0, 4]] = True
    raster[1, 2, 4] = True
    outcome = fit(dataset(raster, np.array([0, 0])), prototypes=200, layers=2)
    assert outcome.health["hots_prototypes"] == 4  # the two events of each layer have surfaces that differ
    assert (answers(outcome).label == 0).all()


def test_a_class_absent_from_training_is_never_answered():
    data = waves()
    target = data.target.copy()
    target[data.train[target[data.train] == 1]] = 2
    outcome = fit(dataclasses.replace(data, target=target))
    assert parameters(outcome).arrays["signature_class"].tolist() == [0, 2]
    assert not (answers(outcome).label == 1).any()


@pytest.mark.parametrize("clustering", ["kmeans", "online"])
def test_no_events_at_all(clustering):
    silent = dataset(np.zeros((6, 9, 22), dtype=bool), np.array([0, 0, 1, 1, 2, 2]))
    outcome = fit(silent, clustering=clustering, layers=3, filter_radius=2)
    assert (answers(outcome).label == 0).all()  # all signatures are equally near
    assert answers(outcome).macs.tolist() == [3 * 1 + 1] * 9
    assert outcome.health["hots_events_kept"] == 1.0


def test_what_does_not_fit_is_refused():
    data = waves()
    with pytest.raises(ValueError, match="at least one training sample, got none"):
        fit(dataclasses.replace(data, train=data.train[:0]))
    network = parameters(fit(data))
    other = dataset(np.zeros((1, 60, 11), dtype=bool), np.array([0]), POSITIONS[:11])
    with pytest.raises(ValueError, match="samples must have 22 channels, got 11"):
        HOTS().respond(network, other, np.array([0]))
    short = dataset(np.zeros((1, 7, 22), dtype=bool), np.array([0]))
    with pytest.raises(ValueError, match="windows must have 20 input lengths, got 7"):
        HOTS().respond(network, short, np.array([0]))


def test_held_out_samples_are_not_learnt_from():
    data = waves()
    flipped = data.target.copy()
    flipped[data.validation] = 0
    first, second = fit(data), fit(dataclasses.replace(data, target=flipped))
    for name, x in parameters(first).arrays.items():
        np.testing.assert_array_equal(x, parameters(second).arrays[name])


def test_fewer_read_outs_are_some_of_the_many():
    data = waves()
    many, few = (answers(fit(data, read_outs=n)) for n in (20, 10))
    assert few.time_ms.tolist() == many.time_ms[1::2].tolist()
    np.testing.assert_array_equal(few.label, many.label[:, 1::2])


def test_the_radius_is_capped():
    arrays = parameters(fit(waves(), layers=2, radius=2, radius_max=1, prototypes=4)).arrays
    assert arrays["prototypes_1"].shape == (4, 3 * 3 * 2)
    assert arrays["prototypes_2"].shape == (8, 3 * 3 * 4)
