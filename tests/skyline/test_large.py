import numpy as np
import pandas as pd

from dse.cli import main


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


def test_a_large_file_has_the_front_and_the_notes_of_the_whole_table(tmp_path, monkeypatch, capsys):
    from dse.api import front

    rng = np.random.default_rng(1)
    table(500, rng).assign(more=rng.random(500)).to_parquet(tmp_path / "points.parquet", index=False)
    arguments = ["skyline", str(tmp_path / "points.parquet"), "--format", "csv", "--columns", "all"]
    arguments += ["--objectives", "accuracy:max,energy_uj:min", "--by", "family"]
    for where in (
        "n_weights <= 2",
        "hardware == 'x'",
        "fits",
        "energy_uj < 2 and family != 'a'",
        "transductive",
    ):
        with monkeypatch.context() as patch:
            assert main([*arguments, "--where", where]) == 0
            whole = capsys.readouterr()
            patch.setattr(front, "_IN_MEMORY", 100)
            assert main([*arguments, "--where", where]) == 0
        assert capsys.readouterr() == whole
