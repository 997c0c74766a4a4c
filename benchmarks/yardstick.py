"""A first study, untouched, beside plain readers: `dse init`, `run` and `pick` on public recordings.

    DSE_DATA=... python -m benchmarks.yardstick [--sets GunPoint ridges] [--seeds 1 2 3] [--keep FOLDER]

The sets are those inside the wheel of aeon, with their published splits (`pip install --no-deps
aeon==1.6.0`), recorded touch, split as below, and, if asked for, those of `benchmarks.made_recordings`. The
table has test accuracies: of the pick, of the best spiking design (family `snn` or `kernel_snn`), each also
trained once more (`--refit`), of the best design by validation, and of readers that do not spike: 1 nearest
neighbour and logistic regression on the samples, and ridge regression on 10 000 features of MiniRocket's
kind, in floating point (Dempster, Schmidt and Webb, KDD 2021). Gaps are to the best of these three, of what
was trained once more.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
import itertools
import os
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import dse
from benchmarks.made_recordings import MADE, made
from dse.data.recordings import arrays

SETS = {"BasicMotions": "", "GunPoint": "", "JapaneseVowels": "_eq"}
"""Of aeon's wheel: names, and the ending of the files in which recordings have one length."""
_FEATURES = 10_000
_HEAD = (
    "| set | train, test | pick | refit | spiking | refit | best by validation | 1-NN | logistic regression "
    "| kernels, ridge | gaps: pick, spiking | CPU s |"
)
Arrays = dict[str, Any]


class FirstStudy(NamedTuple):
    """Test accuracies of the pick, of the spiking pick and of the best by validation; CPU seconds."""

    pick: float
    pick_refit: float
    spiking: float
    spiking_refit: float
    best: float
    cpu_s: float


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--sets", nargs="*", choices=[*SETS, *_TOUCH, *MADE], default=[*SETS, *_TOUCH])
    parser.add_argument("--seeds", type=int, nargs="*", default=[1, 2, 3], help="which")
    parser.add_argument("--keep", type=Path, help="folder for the studies")
    arguments = parser.parse_args()
    print(f"{_HEAD}\n{'|---' * (_HEAD.count('|') - 1)}|")
    for name in arguments.sets:
        studies, readers = [], []
        for number in arguments.seeds:
            seed = number - 1
            arrays = recordings(name, seed)
            with contextlib.ExitStack() as stack:
                folder = arguments.keep or Path(stack.enter_context(tempfile.TemporaryDirectory()))
                studies.append(first_study(name, arrays, seed, folder / f"{name}_{number}"))
            readers.append(plain(arrays, seed))
        (picks, again, spiking, spiking_again, best, cpu_s), (nearest, logistic, rocket) = (
            np.array(studies).T,
            np.array(readers).T,
        )
        most = max(x.mean() for x in (nearest, logistic, rocket))
        is_train = arrays["split"] == "train"
        print(
            f"| {name} | {is_train.sum()}, {(~is_train).sum()} | {_spread(picks)} | {_spread(again)} | "
            f"{_spread(spiking)} | {_spread(spiking_again)} | "
            f"{best.mean():.3f} | {nearest.mean():.3f} | {logistic.mean():.3f} | {_spread(rocket)} | "
            f"{again.mean() - most:+.3f}, {spiking_again.mean() - most:+.3f} | {cpu_s.mean():.0f} |",
            flush=True,
        )


def _spread(values: np.ndarray) -> str:
    spread = f" ± {values.std(ddof=1):.3f}" if len(values) > 1 else ""
    return f"{values.mean():.3f}{spread}"


# ---- recordings: signals (recording, step, channel) or spikes, labels, parts, and the period of a step


def recordings(name: str, seed: int) -> Arrays:
    """Return a set."""
    if name in MADE:
        return _arrays(*made(name, seed))
    return published(name) if name in SETS else _TOUCH[name](seed)


def published(name: str) -> Arrays:
    """Return a set of aeon's wheel; it names no sampling period that matters here."""
    found = importlib.util.find_spec("aeon")
    if found is None or found.origin is None:
        raise SystemExit(f"{name} is in the wheel of aeon: pip install --no-deps aeon==1.6.0")
    folder = Path(found.origin).parent / "datasets" / "data" / name
    parts = [arrays.load(folder / f"{name}{SETS[name]}_{part}.ts") for part in ("TRAIN", "TEST")]
    signal, label = (np.concatenate([part[x] for part in parts]) for x in ("signal", "label"))
    return _arrays(signal, label, np.arange(len(label)) < len(parts[0]["label"]), 10.0)


def _arrays(signal: np.ndarray, label: np.ndarray, is_train: np.ndarray, step_ms: float) -> Arrays:
    split = np.where(is_train, "train", "test")
    return {"signal": signal, "label": label.astype(str), "split": split, "step_ms": step_ms}


def _file(name: str) -> Any:
    return np.load(Path(os.environ["DSE_DATA"]) / name, allow_pickle=False)


def _letters(_seed: int) -> Arrays:
    """Seven Braille letters, 12 taxels: the split of the file."""
    z = _file("braille7_events/braille7_train_val.npz")
    spikes = np.unpackbits(z["spikes_packed"], axis=1)[:, : z["shape"][1]]
    return _arrays(spikes, z["class_names"][z["label"]], z["split"] == "train", 5.0)


def _objects(_seed: int) -> Arrays:
    """36 grasped objects, 39 taxels of two polarities: the published split."""
    z = _file("evtouch_objects/evtouch_objects.npz")
    spikes = np.unpackbits(z["spikes_packed"], axis=-1)[..., : z["shape"][-1]].reshape(z["shape"])
    spikes = spikes.transpose(0, 3, 1, 2).reshape(len(spikes), z["shape"][-1], -1)
    return _arrays(spikes, z["label"], z["split"] == "train", 20.0)


def _fabrics(_seed: int) -> Arrays:
    """Seven fabrics, 16 taxels: repetition 0 trains, 1 tests. The length and the level tell the session."""
    z = _file("fabric_slide/fabric_slide_train_val.npz")
    begins = (z["offsets"][:-1] + z["offsets"][1:] - 128) // 2
    signal = z["signal"][begins[:, None] + np.arange(128)].astype(float)
    signal -= signal.mean(1, keepdims=True)
    return _arrays(signal, z["class_names"][z["label"]], z["repetition"] == 0, 28.0)


def _ridges(_seed: int) -> Arrays:
    """26 ridged textures, 9 taxels: strokes 0 to 27 of each train, 28 to 34 test."""
    z = _file("sankar_ridged_textures/sankar_rigid_finger_train_val.npz")
    signal = z["adc"][:, : 35 * 517].reshape(-1, 517, 9).astype(float)
    return _arrays(signal, np.repeat(z["class_names"], 35), np.tile(np.arange(35) < 28, 26), 10.0)


def _materials(seed: int) -> Arrays:
    """20 materials, 60 taxels: one of five folds tests, which one by the seed."""
    z = _file("icub_roboskin20_test/icub_roboskin20_test200.npz")
    signal, label = z["signal"], z["label"]
    signal = signal.reshape(-1, 75, 6, 10).transpose(0, 2, 1, 3).reshape(signal.shape)  # in the order of time
    place = np.empty(len(label), int)
    for each in np.unique(label):
        place[label == each] = np.random.default_rng(1).permutation(np.count_nonzero(label == each))
    return _arrays(signal.astype(float), label, place % 5 != seed % 5, 20.0)


_TOUCH: dict[str, Callable[[int], Arrays]] = {
    "letters": _letters,
    "objects": _objects,
    "fabrics": _fabrics,
    "ridges": _ridges,
    "materials": _materials,
}


# ---- the study, and plain readers


def first_study(name: str, arrays: Arrays, seed: int, folder: Path) -> FirstStudy:
    """Return what an untouched study reaches."""
    folder.mkdir(parents=True)
    file = folder / f"{name}.npz"
    step_ms = arrays["step_ms"]
    columns = {key: values for key, values in arrays.items() if key != "step_ms"}
    np.savez(file, **columns)
    np.savez(folder / "test.npz", **{key: x[arrays["split"] == "test"] for key, x in columns.items()})
    began = sum(os.times()[:4])
    path = dse.init(file, folder / f"{name}.yaml", label="label", step_ms=step_ms)
    space = dse.load_space(path, {"seed": str(seed + 1)})
    study = dse.run(space, folder / "results", jobs=1, progress=False)
    cpu_s = sum(os.times()[:4]) - began
    found = []
    for budget in ((), "family == 'snn' or family == 'kernel_snn'"):
        pick = study.pick(budget)
        again = pick.bundle(("train", "validation")).predict(folder / "test.npz")
        right = again == arrays["label"][arrays["split"] == "test"]
        found += [float(pick["accuracy_test"]), float(right.mean())]
    trials = study.trials.sort_values("accuracy", ascending=False)
    return FirstStudy(*found, float(trials["accuracy_test"].iloc[0]), cpu_s)


def plain(arrays: Arrays, seed: int) -> tuple[float, float, float]:
    """Return test accuracies: 1 nearest neighbour, logistic regression, random kernels with ridge."""
    from sklearn.linear_model import LogisticRegression, RidgeClassifierCV
    from sklearn.neighbors import KNeighborsClassifier
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    signal = np.asarray(arrays["signal"], np.float32)
    x, label, is_train = signal.reshape(len(signal), -1), arrays["label"], arrays["split"] == "train"
    kernels = positive_shares(signal, is_train, np.random.default_rng(seed))
    logistic = make_pipeline(StandardScaler(), LogisticRegression(max_iter=500))
    ridge = make_pipeline(StandardScaler(), RidgeClassifierCV(np.logspace(-3, 3, 10)))
    found = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for reader, features in ((KNeighborsClassifier(1), x), (logistic, x), (ridge, kernels)):
            reader.fit(features[is_train], label[is_train])
            found.append(float(reader.score(features[~is_train], label[~is_train])))
    nearest, linear, rocket = found
    return nearest, linear, rocket


def positive_shares(signal: np.ndarray, is_train: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the share of steps in which kernels exceed a bias, (recording, feature).

    Kernels of MiniRocket: nine taps, of which three are 2 and six -1, on a few channels each, dilated; biases
    are quantiles of what a kernel gives on a training recording.
    """
    n_steps, n_channels = signal.shape[1:]
    kernels = list(itertools.combinations(range(9), 3))
    dilations = [2**k for k in range(int(np.log2(max((n_steps - 1) / 8, 1))) + 1)]
    n_biases = max(_FEATURES // (len(kernels) * len(dilations)), 1)
    train = np.flatnonzero(is_train)
    features = []
    for dilation, (i, taps) in itertools.product(dilations, enumerate(kernels)):
        n_some = int(2 ** rng.uniform(0, np.log2(min(n_channels, 9) + 1)))
        some = rng.choice(n_channels, n_some, replace=False)
        summed = signal[:, :, some].sum(2)
        padded = np.pad(summed, ((0, 0), (4 * dilation, 4 * dilation)))
        steps = [padded[:, k * dilation : k * dilation + n_steps] for k in range(9)]
        given = 3 * np.sum([steps[k] for k in taps], axis=0) - np.sum(steps, axis=0)
        if i % 2 and n_steps > 8 * dilation:
            given = given[:, 4 * dilation : n_steps - 4 * dilation]
        biases = np.quantile(given[rng.choice(train)], (np.arange(n_biases) + rng.uniform()) / n_biases % 1)
        ordered = np.sort(given, axis=1)
        above = [given.shape[1] - np.searchsorted(row, biases, "right") for row in ordered]
        features.append(np.array(above, np.float32) / given.shape[1])
    return np.concatenate(features, axis=1)


if __name__ == "__main__":
    main()
