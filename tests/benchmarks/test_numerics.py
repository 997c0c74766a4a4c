from functools import partial

import numpy as np
import pytest

from benchmarks import hots, numerics
from benchmarks.numerics import Match, match
from dse.engine.layers import prepare, weights
from dse.engine.neurons import cuba_lif, lif
from dse_papers.models.time_surfaces import Memory, Stream, nearest


@pytest.fixture(autouse=True)
def no_recordings(monkeypatch):
    monkeypatch.delenv("DSE_DATA", raising=False)


def by_setting(rows):
    found = list(rows)
    assert all(row.cost_s > 0 for row in found)
    settings = {row.setting: row for row in found}
    assert len(settings) == len(found)
    return settings


def falling(values):
    return bool((np.diff(list(values)) < 0).all())


def test_spikes_match_that_are_nearest_to_each_other():
    expected = [np.array([10.0, 20.0, 30.0]), np.array([5.0])]
    assert match(expected, expected) == Match(0, 1, 0)
    shifted = match([expected[0] + 1, expected[1] - 2], expected)
    assert shifted == Match(0, 1, pytest.approx(5 / 4))
    # 21 is nearest to 20, which is nearer to 20.5; 36 is too far from 30.
    assert match([np.array([20.5, 21.0, 36.0]), np.zeros(0)], expected) == Match(-0.25, 2 / 7, 0.5)
    silent = [np.zeros(0)]
    assert match(silent, silent)[:2] == (0, 1)
    assert match([np.array([3.0])], silent)[:2] == (1, 0)
    assert np.isnan(match(silent, [np.array([3.0])]).time)


def test_exact_decays_are_those_of_lif_neurons():
    rows = numerics.drawn_rows(2, 60, 5, 0.2, np.random.default_rng(0))
    weight = np.random.default_rng(1).integers(-30, 60, (5, 4)).astype(np.float32) / 32
    decay = 0.0123
    layer = numerics.exact_decays(
        weights(weight, None, cuba_lif.Population(np.int32(4096), np.int32(50), 80)), 1.0, decay
    )
    found = prepare(layer, "ideal").forward(rows, keep_voltage=True)
    population = lif.Lif(tau_m_ms=-1 / np.log1p(-decay), r_m=1 / decay, threshold=80 / 64)
    potential, spikes = lif.run(numerics.dense(rows) @ weight.astype(np.float64), population, 1.0)
    assert spikes.any()
    np.testing.assert_allclose(found.voltage, potential, atol=1e-9)
    np.testing.assert_array_equal(numerics.dense(found.fired), spikes)


def test_delays_change_no_sum_and_lose_what_comes_too_late():
    rows = by_setting(numerics.delay_rows(1, n_hidden=8, n_samples=2, n_steps=200))
    assert rows["all 0"].errors == rows["undelayed"].errors
    assert all(row.errors["input"] == 0 for row in rows.values())
    assert rows["all 62"].errors["spikes"] < rows["undelayed"].errors["spikes"]
    assert rows["all beyond windows of 62 steps"].errors["spikes"] == 0


def test_factors_of_few_bits_never_grow():
    for bits in (2, 3, 4, 12):
        for period, quality in ((2.2, 1.5), (4.0, 100.0), (40.0, 20.0)):
            c, s = numerics.rounded_factors(period, quality, bits)
            assert c * c + s * s < 4096**2 and c % 2 ** (12 - bits) == s % 2 ** (12 - bits) == 0


def test_exact_solutions_are_those_of_a_diagonal():
    values = np.array([1.0, 2.0**-20, 2.0**-52])
    h, t = np.diag(values), np.ones((3, 1))
    for penalty in (0.0, 2.0**-60):
        found = numerics.solved_exactly(h, t, penalty)[:, 0]
        np.testing.assert_allclose(found, values / (values**2 + penalty), rtol=1e-15)
    h, t = np.random.default_rng(0).standard_normal((9, 4)), np.ones((9, 2))
    np.testing.assert_allclose(numerics.solved_exactly(h, t, 0.0), np.linalg.lstsq(h, t)[0], rtol=1e-9)


def test_weights_err_with_the_condition_number_and_less_with_ridge_and_precision():
    conditions = (1e2, 1e6, 1e10)
    rows = by_setting(numerics.elm_rows(1, conditions, (0.0, 1e-4), n_rows=40, n_hidden=8))

    def errors(of, ridge="0"):
        return [rows[f"condition {c:.0e}, ridge {ridge}: {of}"].errors["weights"] for c in conditions]

    assert falling(reversed(errors("float64")))
    assert max(errors("float64", "0.0001")) < 1e-12
    for ridge in ("0", "0.0001"):
        for double, single in zip(errors("float64", ridge), errors("float32", ridge), strict=True):
            assert double < single
    assert errors("float64")[1] < errors("normal equations")[1]


def test_coarser_grids_never_find_a_better_accuracy_and_the_finest_has_no_error():
    grids = {str(k): (numerics.grid(40, 5 * k), numerics.grid(1, 0.1 * k)) for k in (1, 2, 4)}
    rows = by_setting(numerics.decision_rows(1, n_nets=2, n=60, n_steps=800, grids=grids))
    finest, *others = rows.values()
    assert set(finest.errors.values()) == {0.0}
    lost = [row.errors["best accuracy"] for row in others]
    assert 0 <= lost[0] <= lost[1] <= lost[2]
    assert lost[2] > 0
    np.testing.assert_array_equal(numerics.grid(1, 0.25, 0.5), [0.5, 0.75, 1])


def test_decay_by_table_is_the_decay_of_the_surfaces_that_are_compared():
    events = numerics.edges_swept(0, 300)
    ((field, prototypes),) = layers = hots.stack(events, 24, 24, 2, 1)
    exact = Memory(field).surfaces(events, np.arange(300))
    by_table = partial(numerics.by_table, events, field, prototypes)
    np.testing.assert_array_equal(by_table(1, numerics.WHOLE_TAU), hots.by_kernel(events, layers)[0])
    cut = np.where(exact < np.exp(-1), 0, exact)
    np.testing.assert_array_equal(by_table(1, 1), nearest(cut, prototypes))
    binned = Memory(field).surfaces(events._replace(t_us=events.t_us // 5000 * 5000), np.arange(300))
    np.testing.assert_array_equal(by_table(5000, numerics.WHOLE_TAU), nearest(binned, prototypes))


def test_counts_of_events_and_of_steps():
    t = np.array([7, 8, 1006, 1507, 2007], np.int64)
    ones = np.ones(5, np.int32)
    events = Stream(t, ones, 0 * ones, np.array([0, 0, 0, 1, 1], np.int32))
    # Channels: (plane height + y) width + x on 2 x 1; windows begin at the first event, of 1 ms.
    expected = [[0, 2, 0, 0], [0, 0, 0, 1], [0, 0, 0, 1]]
    expected[0][1] += 1  # 1006 is 999 us after the first
    np.testing.assert_array_equal(numerics.counted(events, 2, 1, 1.0), expected)
    steps = numerics.counted_in_steps(events, 2, 1, 1.0, 0.5)
    np.testing.assert_array_equal(steps, [[0, 2, 0, 0], [0, 0, 0, 1], [0, 0, 0, 1]])


def test_the_table_has_a_row_of_heads_per_part_and_one_per_setting():
    n = len(list(numerics.rates_rows(1, 100)))
    found = numerics.table(["rates"], 1)
    assert found.row_count == n + 1
    assert next(iter(found.columns[1].cells)) == "[bold]ns / event"
    parts = ("izhikevich", "decay", "resonator", "delay", "elm", "decision", "hots", "rates")
    assert tuple(numerics.PARTS) == parts


def test_recordings_take_part_where_there_are_some(shared_data, monkeypatch):
    monkeypatch.setenv("DSE_DATA", str(shared_data))
    for rows, source in (
        (numerics.rates_rows(1, 100, (100,), (20,)), "fingers"),
        (numerics.hots_rows(1, 400, (1,), ()), "fingers"),
        (numerics.decay_rows(1, (0.3,), n_hidden=4, n_samples=2, n_steps=50), "Braille"),
    ):
        assert any(setting.startswith(source) for setting in by_setting(rows))
    output, target = numerics.recorded_answers(0, epochs=1)
    assert output.dtype == np.uint8 and output.shape == (len(target), 256, 7)
