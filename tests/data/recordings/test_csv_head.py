"""Which CSV files have a line of names, and what the columns of the others are called."""

import numpy as np
import pytest

import dse
from dse.data.recordings import arrays
from dse.data.recordings.csv_head import head_of

WAVES = "\n".join(",".join(f"{x:.3f}" for x in row) for row in np.random.default_rng(1).normal(size=(30, 5)))
NAMED = None


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("time,x,y\n0.1,2,3\n0.2,3,4\n", NAMED),
        ("label,0,1,2\nsilk,1,2,3\nwool,2,3,4\n", NAMED),
        ("0,1,2\n5,9,1\n3,2,2\n", NAMED),  # as pandas writes
        ("label,0.1,0.2,0.3,0.4,0.5,0.6,0.7,0.8\nsilk,1,2,3,4,5,6,7,8\n", NAMED),  # times
        ("0,0.033,0.067,0.1,0.133,0.167,0.2,0.233\n1,2,3,4,5,6,7,8\n", NAMED),
        ("0.05,0.1,0.9,1.1,1.2,1.7,2.2,2.6\n1,0.2,3,4,5,6,7,8\n", [*"01234567"]),  # a force that grows
        ("3,7,12\n0.5,0.2,0.1\n0.3,0.2,0.2\n", NAMED),  # taxels
        ("0_0,0_1,1_0,1_1\n0.5,0.2,0.1,0.3\n", NAMED),
        (",x\n0,1.5\n1,2.5\n", NAMED),
        ("label\nsilk\nwool\nsilk\n", NAMED),
        ("0\n1.5\n2.5\n", NAMED),
        ("x,y\nx,y\n", NAMED),  # twice, as where files were put together
        ("\ufeff0.5,-1.25\n0.25,1.5\n", ["0", "1"]),  # as Excel writes UTF-8
        (WAVES, ["0", "1", "2", "3", "4"]),
        ("2,0.5,-1.25\n1,0.25,1\n2,1.5,3\n", ["label", "1", "2"]),
        ("0.5,-1.25,2\n0.25,1,1\n1.5,3,2\n", ["0", "1", "label"]),
        ("silk,5,3,9\nwool,4,4,1\nsilk,3,5,2\n", ["label", "1", "2", "3"]),
        ("512,498,530\n511,499,530\n", ["0", "1", "2"]),
        ("0,5;1,25\n0,75;-2,5\n", ["0", "1"]),
        ("  0.5   -1.25  2\n  0.25   1  1\n", ["0", "1", "label"]),
        ("left right\n1 2\n", NAMED),  # one column: blanks separate numbers alone
        ("silk\nwool\nsilk\n", ["label"]),
        ("1\n2\n1\n", ["label"]),
        ("1.5\n2.5\n", ["0"]),
    ],
)
def test_a_first_line_is_of_names_or_of_values(tmp_path, text, names):
    path = tmp_path / "x.csv"
    path.write_text(text, encoding="utf-8")
    assert head_of(path).names == names
    n_lines = len(text.strip().splitlines())
    table = arrays.read_table(path, None)
    assert len(table) == n_lines - (names is NAMED)
    assert names is NAMED or list(table.columns) == names == arrays.column_names(path)
    assert arrays.place(path, 0) == f"line {2 if names is NAMED else 1}"


def test_a_line_that_the_head_cuts_tells_nothing(tmp_path):
    rows = np.random.default_rng(2).integers(0, 2, (3, 20_000)) / 2
    np.savetxt(tmp_path / "x.csv", np.c_[[1, 0, 1], rows], delimiter=",", fmt="%.3g")
    names = head_of(tmp_path / "x.csv").names
    assert names is not None and len(names) == 20_001
    assert len(arrays.read_table(tmp_path / "x.csv", ["0" if "0" in names else "label", "20000"])) == 3


@pytest.mark.parametrize(
    ("name", "how"), [("wide.csv", {"delimiter": ",", "fmt": "%.4f"}), ("wide.csv", {}), ("wide.txt", {})]
)
def test_a_file_of_numbers_alone_is_read_with_all_its_lines(tmp_path, monkeypatch, name, how):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(3)
    walks = rng.normal(size=(40, 50)).cumsum(axis=1)
    np.savetxt(name, np.c_[np.arange(40) % 3, walks], **how)
    space = dse.load_space(dse.init(name, step_ms=4))
    signals = space.data.read(tmp_path)
    assert np.allclose(signals.values.reshape(40, 50), walks, atol=1e-3)
    assert signals.columns["label"].tolist() == (np.arange(40) % 3).tolist()


def test_a_folder_of_files_of_numbers_alone(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(3)
    for number in range(24):
        folder = tmp_path / "many" / ("silk" if number % 2 else "wool")
        folder.mkdir(parents=True, exist_ok=True)
        np.savetxt(folder / f"{number:02d}.csv", rng.normal(size=(30, 3)), delimiter=",")
    space = dse.load_space(dse.init("many", step_ms=4))
    signals = space.data.read(tmp_path)
    assert (np.diff(signals.offsets) == 30).all() and signals.n_channels == 3
    assert signals.columns["folder"].tolist() == ["silk"] * 12 + ["wool"] * 12
