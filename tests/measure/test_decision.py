import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from dse.measure import decision
from dse.measure.decision import at, decide, early, early_at, on_border, surface, t_c, t_h, t_p

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
        ({"work": np.zeros((2, 2, 1))}, r"work must have shape \(2, 3, m\)"),
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
    return decision.DecisionSurface(
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


def test_undecided_samples_count_as_wrong_where_asked():
    # Sample 0 decides at once, sample 1 never: at the end both are right.
    output = np.concatenate([spikes_at(4, 2, (0, 0)), spikes_at(4, 2, (1, 0), (2, 1), (3, 1))])
    found = surface(output, [0, 1], [0], [0.0, 1.0], 1.0)
    assert found.accuracy.tolist() == [[0.5, 0.5]] == found.accuracy_strict.tolist()
    found = surface(output, [0, 1], [0, 2], [0.6], 1.0)
    assert t_p(found) == (4.0, 1.0, 2.0, 0.6) and t_h(found) == t_p(found)
    assert t_p(found, strict=True) == (1.5, 0.5, 0.0, 0.6)
    assert t_h(found, strict=True) is None
    assert t_h(found, 0.5, strict=True) == (1.5, 0.5, 0.0, 0.6)


def test_t_h_is_the_fastest_that_reaches_human_accuracy():
    some = of([[0.9, 0.65], [0.64, 0.7]], [[300.0, 20.0], [10.0, 30.0]])
    assert t_h(some) == (20.0, 0.65, 5.0, 0.4)
    assert t_h(some, accuracy=0.66) == (30.0, 0.7, 1.0, 0.4)
    assert t_h(some, accuracy=0.95) is None


@given(responses(), st.data(), st.permutations(PHI), st.permutations(THETA))
def test_early_is_the_surface_of_every_shorter_output(response, data, phi, theta):
    output, target = response
    lengths = data.draw(st.lists(st.integers(1, output.shape[1]), min_size=1, max_size=6))
    found = early(output, target, lengths, phi, theta, 2.5)
    for j, length in enumerate(lengths):
        part = output[:, :length]
        whole = surface(part, target, phi, theta, 2.5)
        assert found["time_ms"][j] == length * 2.5
        assert found["accuracy"][j] == np.mean(part.sum(axis=1, dtype=int).argmax(axis=1) == target)
        assert found["accuracy_best"][j] == whole.accuracy.max()
        assert (found["t_p_ms"][j], found["accuracy_best"][j], found["phi_p"][j], found["theta_p"][j]) == t_p(
            whole
        )
        human = t_h(whole)
        strict = t_p(whole, strict=True)
        assert (found["t_p_strict_ms"][j], found["accuracy_best_strict"][j]) == strict[:2]
        late = t_h(whole, strict=True)
        assert np.isnan(found["t_h_strict_ms"][j]) if late is None else found["t_h_strict_ms"][j] == late[0]
        setting = found["t_h_ms"][j], found["phi_h"][j], found["theta_h"][j]
        assert np.isnan(setting).all() if human is None else setting == (human[0], human[2], human[3])


def test_early_by_hand():
    # Class 1 spikes at step 1, class 0 at steps 3, 4 and 5: right from step 4 on, a tie before.
    output = spikes_at(6, 2, (1, 1), (3, 0), (4, 0), (5, 0))
    found = early(output, [0], [1, 2, 3, 4, 6], [0, 2], [0.0, 0.7], 10.0)
    assert found["time_ms"].tolist() == [10, 20, 30, 40, 60]
    assert found["accuracy"].tolist() == [
        1,
        0,
        0,
        1,
        1,
    ]  # without spikes the lowest class, which is right here
    assert found["accuracy_best"].tolist() == [1, 0, 0, 1, 1]
    assert found["t_p_ms"].tolist() == [10, 20, 20, 40, 50]
    assert (found["phi_p"][-1], found["theta_p"][-1]) == (2, 0)
    assert found["t_h_ms"][[0, 3, 4]].tolist() == [10, 40, 50] and np.isnan(found["t_h_ms"][[1, 2]]).all()


def test_early_in_hard_cases():
    silent = np.zeros((3, 4, 2), dtype=np.uint8)
    found = early(silent, [0, 1, 1], [1, 4], [1e9], [0.0, 1.0], 1.0)
    assert found["accuracy"].tolist() == [1 / 3, 1 / 3] == found["accuracy_best"].tolist()
    assert found["t_p_ms"].tolist() == [1, 4] and np.isnan(found["t_h_ms"]).all()
    one_step = early(np.ones((2, 1, 1), np.uint8), [0, 0], [1], [0, 5], [1.0], 1.0)
    names = ("time_ms", "accuracy", "accuracy_best", "t_p_ms")
    assert [float(one_step[name][0]) for name in names] == [1, 1, 1, 1]


def test_early_of_more_samples_than_a_chunk_and_of_a_view():
    rng = np.random.default_rng(0)
    n = decision._CHUNK + 3
    output = (rng.random((n, 9, 6)) < 0.2).astype(np.uint8)
    target = rng.integers(0, 3, n)
    found = early(output[..., 2:5], target, [5, 9], [0, 2], [0.5, 0.9], 1.0)
    for j, length in enumerate((5, 9)):
        part = surface(output[:, :length, 2:5].copy(), target, [0, 2], [0.5, 0.9], 1.0)
        assert (found["t_p_ms"][j], found["accuracy_best"][j]) == t_p(part)[:2]


@pytest.mark.parametrize(
    ("lengths", "message"),
    [
        ([], "lengths must be a non-empty list of integers"),
        ([1.0], "lengths must be a non-empty list of integers"),
        ([[1]], "lengths must be a non-empty list of integers"),
        ([0, 1], r"lengths must be in 1..3, got 0"),
        ([1, 4], r"lengths must be in 1..3, got 4"),
    ],
)
def test_wrong_lengths_are_named(lengths, message):
    with pytest.raises(ValueError, match=message):
        early(OUTPUT, [0, 1], lengths, [0], [0.5], 1.0)


def test_t_c_is_the_shortest_length_near_the_peak():
    times = [100, 200, 300, 400]
    assert t_c(times, [0.1, 0.6, 0.75, 0.8]) == 300  # 0.72 is enough, 10 % of the peak below it
    assert t_c(times, [0.1, 0.71, 0.6, 0.79]) == 400
    assert t_c(times, [0.1, 0.72, 0.5, 0.8]) == 200, "accuracy may fall again"
    assert t_c(times[::-1], [0.8, 0.5, 0.72, 0.1]) == 200
    assert t_c(times, [0.1, 0.6, 0.75, 0.8], within=0) == 400
    assert t_c([5], [0.3]) == 5 and t_c(times, [0, 0, 0, 0]) == 100
    assert t_c([1, 2], [0.1 * 3 * 0.9, 0.3]) == 1, "equal but for rounding"


def test_t_c_passes_over_what_is_not_known():
    nan = float("nan")
    assert t_c([1, 2, 3], [nan, 0.5, 0.5]) == 2
    assert np.isnan(t_c([1, 2], [nan, nan])) and np.isnan(t_c([], []))


@pytest.mark.parametrize(
    ("given_", "message"),
    [
        (([1, 2], [0.5]), r"time_ms and accuracy must both be \(k,\), got \(2,\) and \(1,\)"),
        (([1], [0.5], 1.0), r"within must be in \[0, 1\), got 1"),
        (([1], [0.5], -0.1), r"within must be in \[0, 1\), got -0.1"),
    ],
)
def test_t_c_checks_its_input(given_, message):
    with pytest.raises(ValueError, match=message):
        t_c(*given_)


def spikes_of_first(n_steps, *times):
    """Return a sample of two classes in which class 0 fires at some steps."""
    output = np.zeros((1, n_steps, 2), np.uint8)
    output[0, list(times), 0] = 1
    return output


@pytest.mark.parametrize(
    ("phi", "theta", "hit"),
    [
        ([0, 1, 2], [0.5, 1.0], False),  # decides after its first spike, and nothing is sooner
        ([1, 2], [0.5, 1.0], True),  # phi = 0 would be sooner
        ([1], [0.5, 1.0], False),  # phi is no range
        ([0, 1], [0.6, 1.0], True),  # theta = 0.5 might be sooner
        ([0, 1], [0.5], False),
    ],
)
def test_a_best_setting_on_the_border_of_its_grid(phi, theta, hit):
    decisions = surface(spikes_of_first(6, 1, 3, 5), [0], phi, theta, 1.0)
    assert on_border(decisions, t_p(decisions), 2) is hit


def test_the_largest_phi_is_no_border_if_nothing_is_decided_there():
    # The first spike is wrong; after two more the sample is right.
    output = spikes_of_first(6, 2, 4)
    output[0, 0, 1] = 1
    short = surface(output, [0], [0, 2], [0.5], 1.0)
    assert t_p(short).phi == 2 and on_border(short, t_p(short), 2)
    whole = surface(output, [0], [0, 3], [0.5], 1.0)
    assert t_p(whole).phi == 3 and not on_border(whole, t_p(whole), 2), "it answers at the end anyway"


def test_another_set_is_read_at_a_chosen_setting():
    chosen = t_p(surface(spikes_of_first(6, 1, 3), [0], [1, 0], [0.9, 0.5], 2.0))
    assert (chosen.phi, chosen.theta, chosen.decision_latency_ms) == (0, 0.5, 4.0)
    other = surface(spikes_of_first(6, 4), [1], [1, 0], [0.9, 0.5], 2.0)
    assert at(other, chosen) == (10.0, 0.0, 0.0, 0.5)


@given(responses(), responses())
def test_each_length_is_read_at_its_own_setting(chosen_on, other):
    output, target = chosen_on
    more, more_target = other
    n_steps = min(output.shape[1], more.shape[1])
    lengths = np.arange(1, n_steps + 1)
    chosen = early(output, target, lengths, [0, 2], [0.3, 0.7], 1.0)
    settings = np.stack([chosen["phi_h"], chosen["theta_h"]], axis=1)
    time_ms, accuracy = early_at(more, more_target, lengths, 1.0, settings)
    for k, (phi, theta) in enumerate(settings):
        if np.isnan(phi):
            assert np.isnan(time_ms[k]) and np.isnan(accuracy[k])
            continue
        answers = decide(more[:, : lengths[k]], phi, theta)
        assert time_ms[k] == pytest.approx((answers.step + 1).mean())
        assert accuracy[k] == (answers.label == more_target).mean()


@given(st.integers(0, 2**31))
def test_single_answers_average_to_the_surface(seed):
    rng = np.random.default_rng(seed)
    n, n_steps, n_classes = rng.integers(1, 6), rng.integers(1, 12), rng.integers(1, 4)
    output = (rng.random((n, n_steps, n_classes)) < 0.3).astype(np.uint8)
    target = rng.integers(0, n_classes, n)
    phi, theta = np.array([3.0, 0.0, 1.0]), np.array([0.5, 1.0, 0.0])
    right = decision.right_at(output, target, phi, theta)
    surface = decision.surface(output, target, phi, theta, 1.0)
    np.testing.assert_allclose(right.mean(axis=0), surface.accuracy)
    for i in range(n):
        one = decision.surface(output[i : i + 1], target[i : i + 1], phi, theta, 1.0)
        assert (right[i] == (one.accuracy == 1)).all()
