import pytest

from dse.show.figures.labels import axis_title, label, short


@pytest.mark.parametrize(
    ("column", "expected"),
    [
        ("energy_uj", ("energy", "µJ")),
        ("decision_latency_ms", ("decision latency", "ms")),
        ("velocity_mm_s", ("velocity", "mm/s")),
        ("train_s", ("train", "s")),
        ("itr_bits_per_s", ("itr", "bit/s")),
        ("power_idle_w", ("power idle", "W")),
        ("n_weights", ("weights", "")),
        ("model.true_rate", ("model.true_rate", "")),
        ("preprocessing.bin_ms", ("preprocessing.bin", "ms")),
        ("theta", ("θ", "")),
        ("t_p_ms", ("t_p", "ms")),
    ],
)
def test_label(column, expected):
    assert label(column) == expected


def test_axis_title_is_safe_text():
    assert axis_title("<b>_ms") == "&lt;b&gt; (ms)"


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (0.91234, "0.912"),
        (150_000, "150\u202f000"),
        (12, "12"),
        (float("nan"), "–"),
        ("gp", "gp"),
        (True, "True"),
    ],
)
def test_short(value, expected):
    assert short(value) == expected
