"""A stream decides as `dse evaluate` does, on every window that it can know."""

import tracemalloc
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dse.base.records import Block, Network, Rasters, Signals
from dse.data.recordings import RecordingError
from dse.deploy.bundle import Bundle, BundleError, Input
from dse.deploy.reference import answered, decided, prepared
from dse.deploy.stream import Passed, Spiking, Stream, Windows
from dse.deploy.window import Decision
from dse.models.counts.knn import KNN
from dse.models.training import Training
from dse.testing import small
from tests.deploy import bundles
from tests.deploy.c import nets
from tests.installed import needs_papers
from tests.spaces import sections

FABRIC = {
    "data": {
        "kind": "time_series",
        "file": "fabric_slide/gratings_board.npz",
        "step_ms": 28.0,
        "offsets": "offsets",
    },
    "task": {"target": "letter"},
    "window": {"n_steps": 60, "at": "middle", "jitter_steps": 3},
    "encoder": {"kind": "send_on_delta", "thresholds": [1.0, 4.0], "reference": "level"},
    "split": {"stratified": {"validation": 0.2}},
}
RECEPTORS = FABRIC | {
    "encoder": {
        "kind": "receptors",
        "smoothing_ms": 84.0,
        "spikes_per_step": 2,
        "full_scale": 2000.0,
        "low": [0.0] * 16,
        "high": [2000.0] * 16,
    }
}
BRAILLE = FABRIC | {
    "data": {
        "kind": "raster",
        "file": "braille7_events/braille7_train_val.npz",
        "array": "spikes_packed",
        "packed": True,
        "step_ms": 5,
    },
    "window": {"n_steps": 100, "at": "start"},
    "encoder": None,
}
NEUTOUCH = FABRIC | {
    "data": {
        "kind": "events",
        "file": "neutouch_objects/neutouch_objects.npz",
        "width": 80,
        "taxel": "taxel",
        "polarity": "polarity",
    },
    "window": {"n_steps": 50, "at": "start"},
    "preprocessing": {"bin_ms": 20, "pool": [2, 1], "pool_threshold": 2},
    "encoder": None,
}
SHIPPED = {"fabric": FABRIC, "receptors": RECEPTORS, "braille": BRAILLE, "neutouch": NEUTOUCH}


def of_design(plain, recordings, n_channels, **network):
    """Return a bundle of a random network for a design."""
    rng = np.random.default_rng(4)
    fitted = bundles.network(rng, (n_channels, 12, 4), scale=0.4, recurrent=True, **network)
    made = bundles.bundle(fitted, phi=3.0, theta=0.4, input=recordings)
    return replace(made, sections=sections(plain))


def items(recordings, i):
    """Return recording i as a stream takes it."""
    if isinstance(recordings, Signals):
        return list(recordings.values[recordings.offsets[i] : recordings.offsets[i + 1]])
    if isinstance(recordings, Rasters):
        n, rows = recordings.spikes.n_steps, recordings.spikes
        out = np.zeros((n, rows.n_channels), np.uint8)
        for t in range(n):
            out[t, rows.channel[rows.row_offsets[i * n + t] : rows.row_offsets[i * n + t + 1]]] = 1
        return list(out)
    blocks = []
    for block in recordings.blocks(i):  # in pieces that end anywhere
        for part in np.array_split(np.arange(len(block.t_us)), 7):
            blocks.append(Block(*(x[part] for x in (block.t_us, block.x, block.y, block.polarity))))
    return blocks


def run(stream, recording):
    return [x for item in recording for x in stream.push(item)] + stream.end()


def fields(decision):
    return decision.answer, decision.time_ms, decision.decided


@pytest.mark.parametrize("name", SHIPPED)
def test_every_window_of_shipped_recordings_is_decided_as_a_whole(name, shared_data):
    plain = SHIPPED[name]
    data_file = shared_data / plain["data"]["file"]
    anywhere = sections({**plain, "window": {**plain["window"], "at": "start", "jitter_steps": 10**6}})
    first = {"fabric": ("samples", 16, 64), "receptors": ("samples", 16, 96), "braille": ("spikes", 12, 12)}
    kind, n_in, n_channels = first.get(name, ("events", 0, 80))
    step_ms = 20.0 if kind == "events" else plain["data"]["step_ms"]
    frame = (80, 1) if kind == "events" else (0, 0)
    recordings = Input(kind, n_in, *frame, plain["window"]["n_steps"], step_ms)
    many = {} if name == "receptors" else {"delays": (0, 5), "steps_per_sample": 2}
    made = of_design(plain, recordings, n_channels, **many)
    new = prepared(replace(made, sections=anywhere), data_file)
    every, seen = 17, set[Any]()
    for i in range(0, new.recordings.n_recordings, new.recordings.n_recordings // 3):
        data = replace(new.dataset, test=np.array([i]))
        starts = np.arange(0, int(data.start_high[i]) + 1, every)
        expected = []
        for start in starts:
            at = replace(data, start=np.full(len(data.start), start, np.int32))
            label, time_ms, sure = decided(made, at, answered(made, at, ""))
            expected.append((made.classes[int(label[0])], float(time_ms[0]), bool(sure[0])))
        stream = Stream(made, Windows("every", every=every))
        decisions = sorted(run(stream, items(new.recordings, i)))
        assert [fields(x) for x in decisions[: len(starts)]] == expected
        assert [x.begin_ms for x in decisions[: len(starts)]] == [start * step_ms for start in starts]
        seen |= set(expected)
    assert len(seen) > 3


@pytest.mark.parametrize("number", range(24))
def test_random_classifiers_decide_as_a_whole(number):
    made, fired = nets.case(number)
    reference = nets.reference(made, fired)
    classes = next((x.classes for x in made.heads if x.name == made.head), made.classes)
    for i, recording in enumerate(fired):
        [decision] = run(Stream(made, Windows("once")), recording)
        answer = classes[reference.label[i]] if reference.label[i] >= 0 else None
        assert fields(decision) == (answer, reference.time_ms[i], reference.decided[i])


def ramp(n_steps, **changes):
    """Return a bundle whose class is the channel that spikes; its input spikes decide two steps later."""
    weight = np.eye(2, dtype=np.float32)
    decay = np.full(2, 4096, np.int32)
    layer = bundles.network(np.random.default_rng(0), (2, 2)).layers[0]
    parameters = {"decay_current": decay, "decay_voltage": decay, "threshold": np.array(32)}
    network = Network((replace(layer, weight=weight, parameters=parameters),), 2, (0,), 1, "integer")
    made = bundles.bundle(network, phi=0.0, theta=0.75, input=Input("spikes", 2, 0, 0, n_steps, 5.0))
    return replace(made, **changes)


ROWS = np.array([[0, 0], [1, 0], [0, 0], [0, 0], [1, 1], [0, 1], [0, 0], [0, 0], [0, 0], [0, 0]])


def test_where_windows_begin():
    decisions = run(Stream(ramp(4)), ROWS)  # one after the other
    assert [(x.window, x.begin_ms, x.answer, x.time_ms, x.decided) for x in decisions] == [
        (0, 0.0, "class 0", 15.0, True),
        (1, 15.0, "class 1", 20.0, False),  # one spike of each class and another: 2 of 3 are too few
    ]
    assert decisions[1].confidence == pytest.approx(2 / 3) and decisions[1].margin == pytest.approx(1 / 3)
    stream = Stream(ramp(4), Windows("once", first=4))
    assert [(x.begin_ms, x.answer) for x in run(stream, ROWS)] == [(20.0, "class 1")]
    assert stream.n_open == 0
    onset = replace(ramp(4), sections=_at_onset(ramp(4).sections, 1.0))
    assert [(x.begin_ms, x.answer) for x in run(Stream(onset), ROWS)] == [(5.0, "class 0"), (20.0, "class 1")]
    every = Stream(ramp(4), Windows("every", every=3))
    assert [x.begin_ms for x in run(every, ROWS)] == [0.0, 15.0, 30.0]
    assert every.n_open == 1  # the fourth has begun


def _at_onset(of, threshold):
    return replace(of, window=replace(of.window, at="contact_onset", onset_threshold=threshold))


def test_a_bundle_streams_a_source():
    assert list(ramp(4).stream(ROWS)) == run(Stream(ramp(4)), ROWS)
    assert list(ramp(4).stream(iter(ROWS), Windows("once", first=4))) == run(
        Stream(ramp(4), Windows("once", first=4)), ROWS
    )


def test_silence_is_answered_without_confidence():
    [decision] = run(Stream(ramp(3), Windows("once")), np.zeros((3, 2)))
    assert decision == Decision(0, 0.0, "class 0", 15.0, 0.0, 0.0, False)


def test_a_stream_is_cut_as_recordings_are():
    plain = {**FABRIC, "window": {"n_steps": 6, "at": "middle", "cut_steps": 10, "every_steps": 7}}
    made = of_design(plain, Input("samples", 16, 0, 0, 6, 28.0), 64)
    rng = np.random.default_rng(5)
    values = rng.normal(0, 5, (40, 16)).cumsum(axis=0).astype(np.float32)
    decisions = sorted(run(Stream(made), values))
    assert [x.begin_ms / 28 for x in decisions] == [2, 9, 16, 23, 30]
    for k, decision in enumerate(decisions):  # each as if its recording began there
        [alone] = run(Stream(made, Windows("once", first=2)), values[7 * k : 7 * k + 10])
        assert fields(decision) == fields(alone)


def test_another_family_answers_when_its_input_is_complete():
    data = small.dataset()
    family = KNN(window_ms=4 * data.spikes.step_ms)
    fitted = family.fit(data, Training(), small.generators(1)).network
    plain = sections({**BRAILLE, "window": {"n_steps": data.n_steps}})
    recordings = Input("spikes", data.spikes.n_channels, 0, 0, data.n_steps, data.spikes.step_ms)
    made = Bundle(
        fitted=fitted,
        sections=replace(plain, model=family),
        classes=data.classes,
        read_out_ms=8 * data.spikes.step_ms,
        input=recordings,
    )
    data = replace(data, test=data.validation)
    label, time_ms, _ = decided(made, data, answered(made, data, ""))
    rows, n = data.spikes.row_offsets, data.spikes.n_steps
    for i, sample in enumerate(data.test):
        stream = Stream(made, Windows("once"))
        seen = []
        for t in range(data.n_steps):
            row = sample * n + data.start[sample] + t
            channels = data.spikes.channel[rows[row] : rows[row + 1]].astype(np.int32)
            seen += [(t, x) for x in stream.push(Spiking(channels))]
        [(step, decision)] = seen
        assert (decision.answer, decision.time_ms) == (made.classes[label[i]], time_ms[i])
        assert (step, decision.confidence) == (7, None)


OF_EVENTS = {"bin_ms": 20, "pool": [4, 1]}
RATES = {"kind": "receptors", "full_scale": 1.0, "low": [0.0] * 40, "high": [1.0] * 40}


@pytest.mark.parametrize(
    ("model", "changes"),
    [
        pytest.param(
            {"kind": "hots", "prototypes": 4, "radius": 1},
            {"preprocessing": {**OF_EVENTS, "every_event": True}},
            marks=needs_papers,
        ),
        (
            {"kind": "elm"},
            {"preprocessing": OF_EVENTS, "encoder": RATES, "window": {"n_steps": 50, "jitter_steps": 3}},
        ),
    ],
)
def test_families_get_events_and_encoded_events_as_a_whole(model, changes, shared_data):
    recordings = Input("events", 0, 80, 1, 50, 20.0)
    design = sections({**NEUTOUCH, **changes, "model": model})
    family = design.model
    n_channels = 40 if design.encoder is None else design.encoder.n_channels(40)
    rule = {"phi": None, "theta": None, "read_out_ms": 600.0, "input": recordings}
    made = bundles.bundle(bundles.network(np.random.default_rng(0), (n_channels, 4)), **rule)
    made = replace(made, sections=design)
    new = prepared(made, shared_data / NEUTOUCH["data"]["file"])
    some, few = np.arange(0, 200, 6), np.arange(3, 200, 25)
    data = replace(new.dataset, target=np.arange(len(new.dataset.target)) % 4, train=some, validation=few)
    made = replace(made, fitted=family.fit(data, Training(), small.generators(1)).network)
    data = replace(data, test=few)
    label, time_ms, _ = decided(made, data, answered(made, data, ""))
    assert len(set(label.tolist())) > 1
    for k, i in enumerate(few):
        windows = Windows("once", first=int(new.first[i] + data.start[i]))
        [decision] = run(Stream(made, windows), items(new.recordings, i))
        assert (decision.answer, decision.time_ms) == (made.classes[label[k]], time_ms[k])


def test_memory_is_flat():
    made = ramp(50)
    stream = Stream(made, Windows("every", every=10))
    rows = np.random.default_rng(0).integers(0, 2, (500, 2))

    def play():
        for row in rows:
            stream.push(row)

    play()
    tracemalloc.start()
    play()
    before, _ = tracemalloc.get_traced_memory()
    for _ in range(4):
        play()
    after, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert after - before < 2**16  # of 2000 steps: 32 bytes a step


def test_what_cannot_run_is_one_line():
    plain = {**FABRIC, "window": {"n_steps": 6}}
    samples = Input("samples", 16, 0, 0, 6, 28.0)
    made = of_design(plain, samples, 64)
    with pytest.raises(BundleError, match=r"must say what recordings the bundle takes"):
        Stream(replace(made, input=None))
    window = {"n_steps": 6, "remove_mean": True}
    with pytest.raises(BundleError, match=r"remove_mean must be false on a stream"):
        Stream(of_design({**plain, "window": window}, samples, 64))
    threshold = {**plain, "encoder": {"kind": "threshold", "matching": "none"}}
    with pytest.raises(BundleError, match="encoder threshold must see a whole window and cannot run sample"):
        Stream(of_design(threshold, samples, 16))
    with pytest.raises(ValueError, match="every must be > 0"):
        Windows("every")


def test_items_that_do_not_fit_are_one_line():
    made = of_design({**FABRIC, "window": {"n_steps": 6}}, Input("samples", 16, 0, 0, 6, 28.0), 64)
    stream = Stream(made)
    none = np.zeros(0, np.int64)
    for item, message in (
        (np.zeros(15), "a sample must have 16 numbers, got 15"),
        (np.zeros((2, 8)), r"must have 16 numbers, got float64 of shape \(2, 8\)"),
        (np.full(16, np.nan), "must have finite numbers, got nan"),
        (np.full(16, 1e300), r"must have finite numbers, got 1e\+300"),
        (np.array(["a"] * 16), "must have 16 numbers, got <U1"),
        (Block(none, none, none, none), "the bundle takes samples, got events"),
        (Passed(3), "the bundle takes samples, got a time"),
    ):
        with pytest.raises(RecordingError, match=message):
            stream.push(item)
    with pytest.raises(RecordingError, match="a sample must have 0 or 1 of every channel, got 2"):
        Stream(ramp(4)).push(np.array([0, 2]))
    events = Stream(of_design({**NEUTOUCH, "window": {"n_steps": 6}}, Input("events", 0, 80, 1, 6, 20.0), 80))

    def block(*rows):
        return Block(*np.array(rows, np.int64).T)

    events.push(block((5, 1, 0, 1)))
    for item, message in (
        (block((4, 1, 0, 1)), "event 0 must not be earlier than the one before, at 5 us, got 4"),
        (block((9, 1, 0, 1), (8, 1, 0, 1)), "event 1 must not be earlier than .* at 9 us, got 8"),
        (block((9, 80, 0, 1)), "must have x below 80 and y below 1, got 80 and 0"),
        (block((9, 8, 1, 1)), "must have x below 80 and y below 1, got 8 and 1"),
        (block((9, 8, 0, 2)), "must have the polarity 0 or 1, got 2"),
        (Passed(3), "a time must not be earlier than the one before, at 5 us, got 3"),
        (np.zeros(80), "the bundle takes events, got a sample"),
    ):
        with pytest.raises(RecordingError, match=message):
            events.push(item)
