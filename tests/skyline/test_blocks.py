import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.cli import main
from dse.skyline import blocks
from dse.skyline.constraints import ExpressionError
from dse.skyline.front import skyline

GOALS = [("accuracy", "max"), ("energy_uj", "min")]
CONDITIONS = [
    None,
    "n_weights <= 2",
    "hardware == 'x'",
    "fits",
    "energy_uj < 2 and family != 'a'",
    "transductive",
]


def table(n, rng):
    values = np.array([0.0, 1.0, 2.0, 3.0, np.nan, np.inf])
    return pd.DataFrame(
        {
            "trial": np.arange(n),
            "accuracy": rng.choice(values, n, p=[0.2, 0.2, 0.2, 0.2, 0.1, 0.1]),
            "energy_uj": rng.choice(values, n, p=[0.2, 0.2, 0.2, 0.2, 0.1, 0.1]),
            "n_weights": rng.integers(0, 4, n),
            "family": rng.choice(["a", "b"], n),
            "hardware": rng.choice(["x", "y"], n),
            "fits": pd.array(rng.choice([True, False, None], n, p=[0.2, 0.5, 0.3]), dtype="boolean"),
            "task": rng.choice(["s", "t"], n),
            "energy_uj_high": rng.choice([4.0, np.nan], n, p=[0.7, 0.3]),
            "transductive": pd.array(rng.choice([True, False], n, p=[0.2, 0.8]), dtype="boolean"),
        }
    )


@given(
    st.integers(0, 2**31), st.integers(1, 40), st.sampled_from(CONDITIONS), st.sampled_from([None, "family"])
)
def test_blocks_have_the_front_of_the_whole_table(seed, n, where, by):
    rng = np.random.default_rng(seed)
    frame = table(n, rng)
    cuts = np.sort(rng.integers(0, n + 1, 3))
    parts = [frame.iloc[a:b] for a, b in zip([0, *cuts], [*cuts, n], strict=True)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(blocks, "BLOCK", 5)
        found = blocks.skyline_of_blocks(parts, GOALS, where, by)
    pd.testing.assert_frame_equal(found.rows, skyline(frame, GOALS, where, by).rows)
    assert found.notes == [f"{n} points, compared in blocks"]


def test_memory_is_that_of_fronts_and_a_block():
    largest = 0

    def parts():
        nonlocal largest
        rng = np.random.default_rng(0)
        for _ in range(40):
            yield pd.DataFrame({"accuracy": rng.random(1000), "energy_uj": rng.random(1000)})

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(blocks, "BLOCK", 100)
        needed = blocks._needed

        def watched(frame, *others):
            nonlocal largest
            largest = max(largest, len(frame))
            return needed(frame, *others)

        patch.setattr(blocks, "_needed", watched)
        assert len(blocks.skyline_of_blocks(parts(), GOALS).rows) < 30
    assert largest == 1000


def test_no_block_has_no_front():
    with pytest.raises(ExpressionError, match="at least one block"):
        blocks.skyline_of_blocks([], GOALS)


def test_the_command_reads_a_large_file_in_blocks(tmp_path, monkeypatch, capsys):
    from dse.api import front

    table(500, np.random.default_rng(1)).to_parquet(tmp_path / "points.parquet", index=False)
    arguments = ["skyline", str(tmp_path / "points.parquet"), "--where", "n_weights <= 2", "--format", "csv"]
    arguments += ["--objectives", "accuracy:max,energy_uj:min", "--by", "family"]
    assert main(arguments) == 0
    whole = capsys.readouterr().out
    monkeypatch.setattr(front, "_IN_MEMORY", 100)
    monkeypatch.setattr(blocks, "BLOCK", 64)
    assert main(arguments) == 0
    captured = capsys.readouterr()
    assert captured.out == whole
    assert "500 points, compared in blocks" in captured.err
