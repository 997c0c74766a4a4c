import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from dse import decision
from dse.decision import decide, surface, t_h, t_p

PHI = (0, 0.5, 1, 2, 3, 7, 1e9)
THETA = (0.0, 1 / 3, 0.35, 0.5, 0.6, 2 / 3, 1.0)


def settle(sample, phi, theta):
    """The definition, step by step: label, step, decided, tie."""
    counts = [0] * len(sample[0])
    for t, spikes in enumerate(sample.tolist()):
        counts = [a + b for a, b in zip(counts, spikes, strict=True)]
        total = sum(counts)
        if total > phi and max(counts) / total >= theta:
            return counts.index(max(counts)), t, True, counts.count(max(counts)) > 1
    return counts.index(max(counts)), len(sample) - 1, False, counts.count(max(counts)) > 1


@st.composite
def responses(draw):
    shape = draw(st.tuples(st.integers(1, 5), st.integers(1, 12), st.integers(1, 4)))
    most = draw(st.sampled_from([1, 1, 3, 255]))
    output = draw(hnp.arrays(np.uint8, shape, elements=st.integers(0, most), fill=st.just(0)))
    target = draw(hnp.arrays(np.int64, shape[:1], elements=st.integers(0, shape[2] - 1)))
    return output, target


@given(responses(), st.permutations(PHI), st.permutations(THETA))
def test_surface_is_the_loop_over_every_setting(response, phi, theta):
    output, target = response
    work = np.cumsum(output.astype(np.int32), axis=1)[:, :, :2]
    found = surface(output, target, phi, theta, 2.5, work)
    for p, q in np.ndindex(len(phi), len(theta)):
        settled = [settle(sample, phi[p], theta[q]) for sample in output]
        right = [answer[0] == label for answer, label in zip(settled, target, strict=True)]
        assert found.accuracy[p, q] == np.mean(right)
        assert found.accuracy_strict[p, q] == np.mean(
            [ok and answer[2] for ok, answer in zip(right, settled, strict=True)]
        )
        steps = sum(answer[1] + 1 for answer in settled)
        assert found.decision_latency_ms[p, q] == steps / len(output) * 2.5
        assert found.undecided[p, q] == np.mean([not answer[2] for answer in settled])
        assert found.ties[p, q] == np.mean([answer[3] for answer in settled])
        done = [work[i, answer[1]] for i, answer in enumerate(settled)]
        assert found.work[p, q] == pytest.approx(np.mean(done, axis=0), rel=1e-15)


@given(responses(), st.sampled_from(PHI), st.sampled_from(THETA))
def test_decide_is_the_loop(response, phi, theta):
    output, _ = response
    expected = [settle(sample, phi, theta)[:3] for sample in output]
    assert list(zip(*(x.tolist() for x in decide(output, phi, theta)), strict=True)) == expected


def spikes_at(n_steps, n_classes, *events):
    output = np.zeros((1, n_steps, n_classes), dtype=np.uint8)
    for step, label in events:
        output[0, step, label] = 1
    return output


def one(output, target, phi, theta):
    found = surface(output, [target], [phi], [theta], 1.0)
    names = ("accuracy", "accuracy_strict", "decision_latency_ms", "undecided", "ties")
    return tuple(float(getattr(found, name)[0, 0]) for name in names)


def test_confidence_may_fall_and_rise_again():
    # Class 1, then class 0, then class 1 twice: c = 1, 1/2, 2/3, 3/4.
    output = spikes_at(6, 2, (1, 1), (2, 0), (3, 1), (5, 1))
    assert one(output, 1, 0, 0.7) == (1, 1, 2, 0, 0)
    assert one(output, 1, 1, 0.7) == (1, 1, 6, 0, 0)
    assert one(output, 1, 1, 0.6) == (1, 1, 4, 0, 0)
    assert one(output, 0, 1, 0.5) == (1, 1, 3, 0, 1)  # 1 to 1: a tie, and the lowest class wins


def test_without_spikes_nothing_is_decided_and_all_classes_tie():
    output = np.zeros((1, 4, 3), dtype=np.uint8)
    assert one(output, 0, 0, 0.0) == (1, 0, 4, 1, 1)
    assert one(output, 1, 0, 0.0) == (0, 0, 4, 1, 1)


def test_theta_zero_decides_with_the_first_spike_too_many():
    output = spikes_at(6, 2, (1, 1), (2, 0), (4, 0))
    assert one(output, 1, 0, 0.0) == (1, 1, 2, 0, 0)
    assert one(output, 0, 2, 0.0) == (1, 1, 5, 0, 0)


def test_theta_one_needs_all_spikes_in_one_class():
    assert one(spikes_at(4, 2, (1, 1), (3, 1)), 1, 1, 1.0) == (1, 1, 4, 0, 0)
    assert one(spikes_at(4, 2, (0, 0), (3, 1)), 0, 1, 1.0) == (1, 0, 4, 1, 1)


def test_phi_beyond_every_count_leaves_the_answer_to_the_end():
    assert one(spikes_at(5, 2, (0, 1), (1, 1)), 1, 2, 0.5) == (1, 0, 5, 1, 0)


def test_one_class_decides_as_soon_as_phi_is_passed():
    assert one(spikes_at(3, 1, (0, 0), (1, 0)), 0, 1, 1.0) == (1, 1, 2, 0, 0)


def test_confidence_equal_to_theta_decides():
    output = np.zeros((1, 20, 3), dtype=np.uint8)
    output[0, :, 1] = 1  # 7 of 20 spikes for class 0, the rest over two classes
    output[0, 6:13, 1], output[0, 6:13, 2] = 0, 1
    output[0, :7, :], output[0, :7, 0] = 0, 1
    counts = output[0].sum(axis=0)
    assert counts.tolist() == [7, 7, 6]
    exact = surface(output, [0], [19], [0.35, 0.2 + 3 * 0.05], 1.0)
    assert exact.undecided.tolist() == [[0.0, 1.0]]


def test_more_samples_than_a_chunk():
    rng = np.random.default_rng(0)
    n = 2 * decision._CHUNK + 3
    output = (rng.random((n, 9, 3)) < 0.2).astype(np.uint8)
    target = rng.integers(0, 3, n).astype(np.uint8)
    found = surface(output, target, [0, 2], [0.5, 0.9], 1.0)
    for p, q in np.ndindex(2, 2):
        label, step, decided = decide(output, found.phi[p], found.theta[q])
        assert found.accuracy[p, q] == np.mean(label == target)
        assert found.decision_latency_ms[p, q] == np.mean(step + 1)
        assert found.undecided[p, q] == np.mean(~decided)


def test_no_work_was_asked_for():
    assert surface(spikes_at(2, 2, (0, 1)), [1], [0], [0.5], 1.0).work.size == 0


OUTPUT = np.zeros((2, 3, 2), dtype=np.uint8)
GOOD = {"output": OUTPUT, "target": [0, 1], "phi": [0], "theta": [0.5], "step_ms": 1.0}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"phi": [0, -1]}, "phi must be >= 0 and finite, got -1"),
        ({"phi": [np.nan]}, "phi must be >= 0 and finite, got nan"),
        ({"phi": [np.inf]}, "phi must be >= 0 and finite, got inf"),
        ({"phi": []}, "phi must be a non-empty list"),
        ({"theta": [1.01]}, r"theta must be in \[0, 1\], got 1.01"),
        ({"theta": [-0.1]}, r"theta must be in \[0, 1\], got -0.1"),
        ({"theta": []}, "theta must be a non-empty list"),
        ({"output": OUTPUT[:0], "target": []}, "at least one sample"),
        ({"output": OUTPUT[:, :0]}, "at least one sample, step and class"),
        ({"output": OUTPUT.astype(float)}, "must be .* uint8, got .* float64"),
        ({"output": OUTPUT[0]}, r"must be \(n, T, class\) uint8"),
        ({"target": [0]}, r"target must be \(2,\) integers"),
        ({"target": [0.0, 1.0]}, "target must be .* integers"),
        ({"target": [0, 2]}, r"target must be in 0..1, got 0..2"),
        ({"target": [-1, 0]}, r"target must be in 0..1, got -1..0"),
        ({"step_ms": 0.0}, "step_ms must be > 0"),
        ({"work": np.zeros((2, 2, 1))}, r"work must be \(2, 3, m\)"),
    ],
)
def test_wrong_input_is_named(change, message):
    with pytest.raises(ValueError, match=message):
        surface(**GOOD | change)


def test_decide_checks_its_setting():
    with pytest.raises(ValueError, match="phi must be"):
        decide(OUTPUT, -1, 0.5)
    with pytest.raises(ValueError, match="theta must be"):
        decide(OUTPUT, 0, 2)


def of(accuracy, time):
    """A surface of two phi and two theta with given accuracies and times."""
    blank = np.zeros((2, 2))
    return decision.Surface(
        phi=np.array([5.0, 1.0]),
        theta=np.array([0.9, 0.4]),
        accuracy=np.array(accuracy),
        accuracy_strict=blank,
        decision_latency_ms=np.array(time),
        undecided=blank,
        ties=blank,
        work=np.empty(0),
    )


def test_t_p_is_the_fastest_of_the_most_accurate():
    found = t_p(of([[0.9, 0.9], [0.9, 0.7]], [[300.0, 200.0], [250.0, 10.0]]))
    assert found == (200.0, 0.9, 5.0, 0.4)


def test_equal_times_go_to_the_smallest_phi_then_theta():
    assert t_p(of([[0.9, 0.9], [0.9, 0.9]], [[7.0, 7.0], [7.0, 7.0]])) == (7.0, 0.9, 1.0, 0.4)


def test_t_h_is_the_fastest_that_reaches_human_accuracy():
    some = of([[0.9, 0.65], [0.64, 0.7]], [[300.0, 20.0], [10.0, 30.0]])
    assert t_h(some) == (20.0, 0.65, 5.0, 0.4)
    assert t_h(some, accuracy=0.66) == (30.0, 0.7, 1.0, 0.4)
    assert t_h(some, accuracy=0.95) is None
