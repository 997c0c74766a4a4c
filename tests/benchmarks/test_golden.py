"""The check of golden files: right files pass, every tampered array is found, other files are refused."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.golden import MODES, Case, by_definition, main, read
from tests.golden import FILE

SETTINGS = {
    "params": {
        "threshold": 1.25,
        "current_decay": 0.25,
        "voltage_decay": 0.03,
        "tau_grad": 0.03,
        "scale_grad": 3.0,
    },
    "true_rate": 0.4,
    "false_rate": 0.02,
    "delay_shift": True,
    "n_weight_layers": 2,
}


def small():
    """A golden file of one case that fires, as the definition computes it."""
    rng = np.random.default_rng(3)
    given = {
        "x": (rng.random((2, 6, 12)) < 0.4).astype(np.uint8),
        "labels": np.array([0, 2]),
        "w1": (rng.integers(-8000, 16000, (5, 6)) / 2**14).astype(np.float32),
        "w2": (rng.integers(-8000, 16000, (3, 5)) / 2**14).astype(np.float32),
    }
    arrays = dict(given)
    for mode in MODES:
        found = by_definition(Case("one", mode, SETTINGS, given))
        scale, suffix, kind = (1, "", np.float64) if mode == "ideal" else (4096, "_int", np.int32)
        for name, state in found.states.items():
            by_mode = (64, "_int", np.int16) if name[0] == "w" else (scale, suffix, kind)
            value = np.asarray(state) * by_mode[0]
            arrays[f"{mode}/{name}{by_mode[1]}"] = (
                value.transpose(0, 2, 1) if value.ndim == 3 else value
            ).astype(by_mode[2])
        for k in (1, 2):
            arrays[f"{mode}/spk{k}"] = found.spikes[k - 1].transpose(0, 2, 1).astype(np.uint8)
            arrays[f"{mode}/grad_w{k}"] = found.gradients[k - 1]
        arrays[f"{mode}/out"] = found.output.transpose(0, 2, 1).astype(np.uint8)
        arrays[f"{mode}/rate"] = found.output.mean(axis=1)
        arrays[f"{mode}/loss"] = np.float64(found.loss)
        assert all(spikes.any() for spikes in found.spikes)
    return {"index_json": json.dumps({"one": SETTINGS})} | {f"one/{key}": x for key, x in arrays.items()}


def written(folder, arrays):
    np.savez(folder / "file.npz", **arrays)
    return str(folder / "file.npz")


def test_a_right_file_passes(tmp_path, capsys):
    assert main([written(tmp_path, small())]) == 0
    said = capsys.readouterr().out
    assert said.count("│ ok") == 2 * len(MODES) and "6 checks" in said


@pytest.mark.parametrize(
    ("key", "by", "kind"),
    [
        ("quant/cur1_int", 1, "states"),
        ("slayerfloat/vol2_int", 1, "states"),
        ("quant/w1_int", 2, "states"),
        ("ideal/vol1", 1e-9, "states"),
        ("ideal/vol1", np.nan, "states"),
        ("slayerfloat/spk1", 1, "spikes"),
        ("quant/out", 1, "output"),
        ("ideal/rate", 1e-6, "rates"),
        ("quant/loss", 1e-5, "loss"),
        ("ideal/grad_w2", 1e-3, "gradients"),
    ],
)
def test_a_tampered_array_is_named(key, by, kind, tmp_path, capsys):
    arrays = small()
    tampered = np.array(arrays[f"one/{key}"])
    tampered.flat[0] += np.asarray(by).astype(tampered.dtype)
    assert main([written(tmp_path, arrays | {f"one/{key}": tampered})]) == 1
    mode, _ = key.split("/")
    assert f"the first: one, {mode}, definition: {kind} " in capsys.readouterr().out


def test_one_mode_alone_is_enough(tmp_path):
    arrays = {key: x for key, x in small().items() if "ideal" not in key and "slayerfloat" not in key}
    assert [case.mode for case in read(Path(written(tmp_path, arrays)))] == ["quant"]
    assert main([written(tmp_path, arrays)]) == 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"one/quant/spk1": None}, "has no 'one/quant/spk1'"),
        ({"one/w2": None}, "has no 'one/w2'"),
        ({"index_json": None}, "has no 'index_json'"),
        ({"index_json": "no json"}, "is no golden file"),
        ({"index_json": json.dumps({"two": SETTINGS})}, "case two must have at least one mode"),
        ({"index_json": json.dumps({"one": {**SETTINGS, "params": {}}})}, "has no 'current_decay'"),
        ({"one/labels": np.array([0, 3])}, "labels must be whole numbers from 0 to 2"),
        ({"one/x": np.full((2, 6, 12), 2)}, "x must be 0 or 1"),
        ({"one/ideal/out": np.zeros((2, 12, 3))}, r"out must be numbers (2, 3, 12), got float64 (2, 12, 3)"),
    ],
)
def test_another_layout_is_refused_in_one_line(change, message, tmp_path, capsys):
    arrays = {key: x for key, x in (small() | change).items() if x is not None}
    assert main([written(tmp_path, arrays)]) == 2
    said = capsys.readouterr().err
    assert message in said and said.count("\n") == 1 and "file.npz" in said


def test_a_file_that_cannot_be_read_is_refused_in_one_line(tmp_path, capsys):
    whole = Path(written(tmp_path, small())).read_bytes()
    for name, content in {"text": b"no zip", "half": whole[: len(whole) // 2], "empty": b""}.items():
        (tmp_path / name).write_bytes(content)
    np.save(tmp_path / "one.npy", np.zeros(3))
    for name in ("text", "half", "empty", "one.npy", "absent", "."):
        assert main([str(tmp_path / name)]) == 2
        said = capsys.readouterr().err
        assert "cannot be read as npz" in said and said.count("\n") == 1


def test_the_shared_file_passes():
    if not FILE.exists():
        pytest.skip("shared/reference/cuba_golden.npz is absent")
    assert main([str(FILE)]) == 0
