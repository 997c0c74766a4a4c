"""Odd inputs at the command line: one line with exit code 2 each, or said before anything is trained."""

import io
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from scipy.io import savemat

import dse
from dse.cli import main
from dse.config import load_space
from dse.data import starter
from tests.command import document
from tests.spaces import write_space


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def refused(capsys, *arguments):
    """Return the one line that a command refuses its arguments with."""
    capsys.readouterr()
    assert main(list(arguments)) == 2
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.count("\n") == 1, printed.err
    return printed.err


def notes(capsys, *arguments):
    """Return the notes of a command that is right."""
    return "\n".join(document(capsys, *arguments)["notes"])


@pytest.mark.parametrize(
    ("old", "value"),
    [
        ("true_rate: 0.8", "{range: [0, 1], step: .nan}"),
        ("true_rate: 0.8", "{range: [0, 1], step: .inf}"),
        ("seed: 3", f"0x{'f' * 100_000}"),
        ("seed: 3", "9" * 350),
        ("epochs: 1", "100000000000"),
        ("batch_size: 8", "1000000000000"),
    ],
)
def test_a_number_beyond_bounds_is_refused(tmp_path, capsys, old, value):
    key = old.split(":", maxsplit=1)[0]
    space = write_space(tmp_path, (old, f"{key}: {value}"))
    error = refused(capsys, "check", str(space))
    assert error.startswith(f"{space}:") and f"{key}" in error and len(error) < 300 + len(str(space))


DAMAGES = {
    "complex": (145, b"\x08"),  # an array without its imaginary part crashes scipy
    "no_class": (144, b"\x00"),
    "dimensions": (152, b"\x09"),
    "no_matrix": (128, b"\x14"),
    "noise": (128, bytes(range(250, 50, -1))),
}


def test_damaged_files_of_matlab_are_refused():
    file = io.BytesIO()
    savemat(file, {"p": np.arange(48).reshape(4, 6, 2), "label": np.arange(4) % 2})
    for name, (at, new) in DAMAGES.items():
        content = bytearray(file.getvalue())
        content[at : at + len(new)] = new
        Path(f"{name}.mat").write_bytes(content)
    # In a process of its own: what crashes may not take the tests along.
    code = "import sys; from dse.cli import main; print([main(['init', x]) for x in sys.argv[1:]])"
    command = [sys.executable, "-c", code, *(f"{name}.mat" for name in DAMAGES)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.stdout.strip() == str([2] * len(DAMAGES)), done.stderr
    lines = done.stderr.splitlines()
    assert len(lines) == len(DAMAGES)
    for name, line in zip(DAMAGES, lines, strict=True):
        assert line.startswith(f"{name}.mat: the file cannot be read: it is not a MATLAB file")


def test_reading_a_matlab_file_runs_no_module_of_the_folder(capsys):
    signal, label = waves(20)
    savemat("touch.mat", {"p": signal, "label": (label == label[0]).astype(float)})
    Path("scipy.py").write_text("open('PWNED', 'w').close()")
    answered(capsys, "init", "touch.mat", "--step-ms", "4")
    assert not Path("PWNED").exists()


def test_a_table_of_a_million_columns_is_refused_at_once(capsys):
    names = ",".join(f"v{k}" for k in range(1_000_000))
    Path("wide.csv").write_text(f"{names}\n{names.replace('v', '')}\n")
    assert "at most 100000 columns, got 1000000" in refused(capsys, "init", "wide.csv", "--step-ms", "4")


def waves(n=40, n_steps=50):
    """Return recordings (n, step, 2) of two classes, and their labels."""
    rng = np.random.default_rng(1)
    hz = np.where(np.arange(n) % 2, 4.0, 22.0)[:, None, None]
    t_s = 0.004 * np.arange(n_steps)[None, :, None]
    noise = rng.normal(0, 0.05, (n, n_steps, 2))
    signal = np.sin(2 * np.pi * hz * t_s + rng.uniform(0, 6, (n, 1, 2))) + noise
    return signal, np.where(np.arange(n) % 2, "denim", "silk")


def tidy(signal, **labels):
    """Return a table with a row per sample of 4 ms."""
    parts = [
        pd.DataFrame({"trial": i, "time_s": 0.004 * np.arange(len(x)), "left": x[:, 0], "right": x[:, 1]})
        for i, x in enumerate(signal)
    ]
    return pd.concat([p.assign(**{k: v[i] for k, v in labels.items()}) for i, p in enumerate(parts)])


def test_a_published_test_set_stays_one(capsys):
    signal, label = waves()
    usage = np.where(np.arange(40) < 30, "TRAIN", "TEST")
    np.savez("touch.npz", signal=signal, fabric=label, usage=usage, session=np.arange(40) // 5)
    (row,) = document(capsys, "init", "touch.npz", "--step-ms", "4")["rows"]
    assert row["test"] == 10 and row["train"] + row["validation"] == 30 and row["validation"] >= 5
    (checked,) = answered(capsys, "check", "touch.yaml")
    assert (checked["train"], checked["test"]) == (row["train"], 10)
    # What no key could say before: validation from training recordings, by class or by whole groups.
    for group in ("", ", group: session"):
        rule = f"{{stratified: {{validation: 0.2, test: {{usage: TEST}}, seed: 2{group}}}}}"
        (checked,) = answered(capsys, "check", "touch.yaml", "--set", f"split={rule}")
        assert (checked["train"], checked["validation"], checked["test"]) == (
            24 + bool(group),
            6 - bool(group),
            10,
        )
    error = refused(
        capsys, "check", "touch.yaml", "--set", "split={train: {usage: TRAIN}, test: {usage: TEST}}"
    )
    assert "stratified: {validation: 0.2, test: {COLUMN: test}}" in error


def answered(capsys, *arguments):
    """Return the rows of a command that is right."""
    return list(document(capsys, *arguments)["rows"])


@pytest.mark.parametrize(("n_steps", "scale"), [(25, 0.76), (100, 0.19), (127, 0.15), (400, 0.15)])
def test_a_spike_counts_for_more_where_a_window_has_few_steps(n_steps, scale):
    signal, label = waves(n_steps=n_steps)
    np.savez("touch.npz", signal=signal, fabric=label)
    space = yaml.safe_load(dse.init("touch.npz", "touch.yaml", step_ms=4).read_text())
    *plain, kernels, network = space["model"]["choice"]
    assert kernels["count_scale"] == network["count_scale"] == scale
    assert not any("count_scale" in each for each in plain)


@pytest.mark.parametrize(("n", "races"), [(40, True), (2500, False)])
def test_networks_race_where_many_are_trained(n, races):
    signal, label = waves(n, 100)
    usage = np.where(np.arange(n) < n - 10, "TRAIN", "TEST")
    np.savez("touch.npz", signal=signal, fabric=label, usage=usage)
    space = dse.load_space(dse.init("touch.npz", "touch.yaml", step_ms=4))
    assert (space.search.racing is not None) is races
    assert space.search.repeats == (5 if races else 1)  # folds, of which every network is trained on each


@pytest.mark.parametrize("axis", [1, 3])
def test_packed_bits_are_read(capsys, axis):
    rng = np.random.default_rng(2)
    spikes = rng.integers(0, 2, (12, 20, 5, 2)) * (np.arange(12) % 2 + 1)[:, None, None, None].clip(0, 1)
    spikes = np.moveaxis(spikes, 1, axis)
    packed = np.packbits(spikes.astype(np.uint8), axis=axis)
    np.savez("spikes.npz", spikes_packed=packed, shape=spikes.shape, label=np.arange(12) % 2)
    assert main(["init", "spikes.npz", "--step-ms", "5"]) == 0
    capsys.readouterr()
    space = load_space("spikes.yaml")
    found = space.data.read(Path())
    assert (found.spikes.n_steps, found.spikes.n_channels) == (20, 10)
    assert len(found.spikes.channel) == spikes.sum()
    assert answered(capsys, "check", "spikes.yaml")[0]["classes"] == ["0", "1"]


@pytest.mark.parametrize(
    ("shape", "axes"),
    [
        ((30, 40, 6), None),
        ((30, 6, 40), "recording channel step"),
        ((30, 40, 90), None),  # neighbouring samples are alike
        ((90, 40, 30), "channel step recording"),
        ((30, 40, 4, 4), "recording step row column"),
        ((30, 20, 32, 32), "recording step row column"),
        ((30, 5, 6, 40), "recording row column step"),
        ((30, 40), "recording step"),
    ],
)
def test_the_axis_of_steps_is_found_by_the_signal(shape, axes):
    rng = np.random.default_rng(4)
    step = (axes or "recording step channel").split().index("step")
    signal = rng.normal(size=shape).cumsum(axis=step)
    np.savez("touch.npz", signal=signal, label=np.arange(30) % 3)
    space = dse.load_space(dse.init("touch.npz", "touch.yaml", step_ms=4))
    assert space.data.axes == axes
    signals = space.data.read(Path())
    assert (np.diff(signals.offsets) == shape[step]).all()
    assert signals.n_channels == signal.size // 30 // shape[step]


def test_a_published_test_set_in_arrays_or_folders_of_its_own_stays_one():
    rng = np.random.default_rng(6)
    x, y = rng.normal(size=(60, 40, 3)).cumsum(axis=1), np.arange(60) % 3
    np.savez("touch.npz", X_train=x[:40], y_train=np.eye(3)[y[:40]], X_test=x[40:], y_test=np.eye(3)[y[40:]])
    for number, (signal, code) in enumerate(zip(x, y, strict=True)):
        folder = Path("touch") / ("train" if number < 40 else "Test") / f"fabric_{code}"
        folder.mkdir(parents=True, exist_ok=True)
        np.save(folder / f"{number:02d}.npy", signal)
    for place in ("touch.npz", "touch"):
        space = dse.load_space(dse.init(place, "touch.yaml", step_ms=4, force=True))
        part = space.split.k_fold.test
        signals = space.data.read(Path())
        held = signals.columns["split"] == "test"
        assert part == {"split": "test"} and held.sum() == 20
        assert sorted(signals.values[:, 0]) == pytest.approx(sorted(x[:, :, 0].ravel()), abs=1e-5)


def test_labels_in_a_file_of_one_array_are_called_label():
    np.save("X.npy", np.random.default_rng(5).normal(size=(30, 50, 3)).cumsum(axis=1))
    np.save("y.npy", np.arange(30) % 3)
    space = dse.load_space(dse.init("X.npy", "touch.yaml", step_ms=4))
    assert space.data.columns == {"label": "array"} and space.data.labels == "y.npy"


def test_an_array_that_is_not_read_is_named(capsys):
    rng = np.random.default_rng(7)
    x, y = rng.normal(size=(60, 40, 3)).cumsum(axis=1), np.arange(60) % 3
    np.savez("touch.npz", X_train=x[:40], X_test=x[40:, :30], y_train=y[:40], y_test=y[40:])
    assert "not read: X_test" in notes(capsys, "init", "touch.npz", "--step-ms", "4")
    np.savez("touch.npz", X_train=x[:40], X_test=x[40:], y_train=y[:40], y_test=y[40:])
    assert "not read" not in notes(capsys, "init", "touch.npz", "--step-ms", "4", "--force")


def test_the_longer_axis_has_the_steps_where_the_signal_does_not_tell():
    rng = np.random.default_rng(4)
    signal = rng.normal(size=(30, 40, 12)) + 5 * rng.normal(size=(30, 40, 1))  # what all channels share
    np.savez("touch.npz", signal=signal, label=np.arange(30) % 3)
    assert dse.load_space(dse.init("touch.npz", "touch.yaml", step_ms=4)).data.axes is None


@pytest.fixture
def space():
    """A search space, `x.yaml`, for the arrays of `x.npz`."""
    Path("x.yaml").write_text(
        "study: x\nseed: 1\n"
        "data: {kind: time_series, file: x.npz, step_ms: 4, columns: {fabric: fabric}}\n"
        "task: {target: fabric}\nsplit: {stratified: {validation: 0.3, seed: 1}}\n"
        "encoder: {kind: send_on_delta, thresholds: [0.2]}\n"
        "model: {kind: snn, hidden: 4}\ntraining: {epochs: 1, batch_size: 8}\nhardware: [mcu_m4]\n"
    )
    signal, label = waves(120)
    np.savez("x.npz", signal=signal, fabric=label)
    return "x.yaml"


def test_recordings_as_they_should_be_are_left_in_peace(space, capsys):
    assert notes(capsys, "check", space) == ""


def doubtful(name):
    """Return arrays with a fault, and what is said of it."""
    signal, label = waves(120)
    if name == "axes":
        return {"signal": signal.transpose(0, 2, 1), "fabric": label}, "2 steps of 50 channels"
    if name == "case":
        return {"signal": signal, "fabric": np.where(np.arange(120) % 7, label, "Silk")}, "'Silk' and 'silk'"
    if name == "missing":
        return {"signal": signal, "fabric": np.where(np.arange(120) % 7, label, "nan")}, "class 'nan'"
    if name == "glitch":
        signal[17, 9, 1] = 99999
        return {"signal": signal, "fabric": label}, "channel 1 reads 99999 at step 9 of recording 17"
    lengths = np.where(np.arange(120) == 31, 21, 50)
    rows = np.concatenate([x[:n] for x, n in zip(signal, lengths, strict=True)])
    offsets = np.cumsum([0, *lengths])
    return {"signal": rows, "offsets": offsets, "fabric": label}, "recording 31 (class 'denim') has 21 steps"


@pytest.mark.parametrize("name", ["axes", "case", "missing", "glitch", "short"])
def test_what_is_doubtful_is_said_before_training(space, capsys, name):
    arrays, sentence = doubtful(name)
    np.savez("x.npz", **arrays)
    more = ("--set", "data.offsets=offsets", "--set", "window.n_steps=21") if name == "short" else ()
    assert sentence in notes(capsys, "check", space, *more)
    # A run says it too, once its data are prepared.
    assert sentence in notes(capsys, "run", space, *more, "--quiet")


def test_a_wide_signal_that_is_smooth_along_its_steps_is_not_doubtful(space, capsys):
    rng = np.random.default_rng(5)
    np.savez("x.npz", signal=rng.normal(size=(120, 50, 60)).cumsum(axis=1), fabric=waves(120)[1])
    assert "60 channels" not in notes(capsys, "check", space)


def test_a_step_in_seconds_is_doubtful(space, capsys):
    assert "the longest recording lasts 0.2 ms" in notes(
        capsys, "check", space, "--set", "data.step_ms=0.004"
    )


def test_few_validation_recordings_are_doubtful(space, capsys):
    signal, label = waves(30)
    np.savez("x.npz", signal=signal, fabric=label)
    assert "8 validation recordings has a standard error of up to 0.18" in notes(capsys, "check", space)
    folds = ("--set", "split={k_fold: {k: 5}}")
    assert notes(capsys, "check", space, *folds) == ""
    assert main(["init", "x.npz", "--step-ms", "4", "--force"]) == 0
    assert "standard error" in capsys.readouterr().out


def test_an_encoder_that_never_spikes_is_named(space, capsys):
    silent = ("--set", "encoder.thresholds={choice: [[600], [0.2]]}")
    assert "no input spikes" in notes(capsys, "check", space, *silent)
    assert "(at encoder.thresholds 600" in notes(capsys, "check", space, *silent)
    said = notes(capsys, "run", space, "--set", "encoder.thresholds=[600]", "--quiet")
    assert "no input spikes: no window has a spike" in said
    assert "1 of 1 designs get no input spikes" in said and "learning_rate" not in said


def test_a_mistyped_number_of_neurons_is_doubtful(space, capsys):
    assert "12000000 weights" in notes(capsys, "check", space, "--set", "model.hidden=2000000")


def test_blanks_around_labels_make_no_class(capsys):
    signal, label = waves()
    activity = np.where(np.arange(40) % 5, label, np.char.add(label, " "))
    tidy(signal, activity=activity).to_csv("touch.csv", index=False)
    answer = document(capsys, "init", "touch.csv")
    assert answer["rows"][0]["classes"] == ["denim", "silk"]
    assert any("'activity' are read without blanks" in note for note in answer["notes"])


def test_why_no_column_is_a_label(capsys):
    signal, label = waves(20)
    table = tidy(signal, number=np.arange(20)).reset_index(drop=True)
    for name, row, value in (("empty", 260, None), ("changing", 310, "denim")):
        table[name] = np.repeat(label, 50)
        table.loc[row : (row if value else 299), name] = value
    table.to_csv("touch.csv", index=False)
    error = refused(capsys, "init", "touch.csv")
    assert "'empty' is empty in line 262" in error and "'number' has 20 values in 20 recordings" in error
    assert "'changing' changes within a recording in line 312" in error
    table.assign(fabric=np.repeat(label, 50)).to_csv("touch.csv", index=False)
    assert "column 'empty' is empty in line 262" in refused(capsys, "init", "touch.csv", "--label", "empty")


def test_a_table_as_german_excel_writes_it_is_read(capsys):
    signal, label = waves(20)
    tidy(signal, fabric=label).to_csv("touch.csv", index=False, sep=";", decimal=",")
    (row,) = answered(capsys, "init", "touch.csv")
    assert row["recordings"] == 20 and row["classes"] == ["denim", "silk"]
    found = load_space("touch.yaml").data.read(Path())
    assert found.values == pytest.approx(signal.reshape(-1, 2)) and found.step_ms == 4
    dated = tidy(signal, fabric=label).assign(day="12.05.2023")
    dated.to_csv("dated.csv", index=False, sep=";", decimal=",")
    (row,) = answered(capsys, "init", "dated.csv")
    assert row["recordings"] == 20


def test_one_text_among_numbers_is_named_with_its_line(capsys):
    signal, label = waves(20)
    table = tidy(signal, fabric=label).reset_index(drop=True).astype({"left": object})
    table.loc[99, "left"] = "error"
    table.to_csv("touch.csv", index=False)
    assert "column 'left' must hold numbers, got 'error' in line 101" in refused(capsys, "init", "touch.csv")
    kinds = np.array(["rest", "rest", *map(str, np.arange(38) % 4)])  # labels, most of which are numbers
    tidy(waves(40)[0], kind=kinds).to_csv("kinds.csv", index=False)
    (row,) = answered(capsys, "init", "kinds.csv", "--label", "kind")
    assert "rest" in row["classes"]


def test_small_mistakes_have_a_way_out(capsys):
    Path("touch.xlsx").write_bytes(b"PK")
    assert "save the sheet as CSV" in refused(capsys, "init", "touch.xlsx")
    assert "Did you mean 'check'?" in refused(capsys, "chek", "touch.yaml")
    with pytest.raises(TypeError, match=r"dse\.data\.from_arrays"):
        dse.init(waves()[0])
    signal, label = waves(20)
    tidy(signal, fabric=label).to_csv("mein test.csv", index=False)
    assert main(["init", "mein test.csv"]) == 0
    assert "dse run 'mein test.yaml'" in capsys.readouterr().out


def test_the_file_of_init_names_no_folder_of_its_machine(tmp_path, monkeypatch, capsys):
    signal, label = waves(20)
    tidy(signal, fabric=label).to_csv("touch.csv", index=False)
    assert main(["init", "touch.csv"]) == 0
    assert str(Path.home()) not in (text := Path("touch.yaml").read_text()) and "$schema=/" not in text
    assert str(Path.cwd()) not in text
    # Where the package lies in the same folder, editors find its schema.
    monkeypatch.setattr(starter, "shipped_folder", lambda name: tmp_path / "lib" / name)
    assert main(["init", "touch.csv", "--force"]) == 0
    first = Path("touch.yaml").read_text().splitlines()[0]
    assert first == "# yaml-language-server: $schema=lib/search_spaces/schema.json"
