"""docs/core.py, which imports nothing of dse, gives the same bits as dse on a smaller quickstart."""

import ast
import importlib.util
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

import dse
from dse import store
from dse.data import dataset, preprocessing
from dse.data.dataset.cache import usual_root
from dse.data.recordings.pooling import pooling
from dse.engine.neurons.fixed_point import quantise
from dse.scene import simulate
from dse.scene.load import load_scene
from dse.search.space import design_at

ROOT = Path(__file__).resolve().parent.parent.parent
CORE, SPACE = ROOT / "docs" / "core.py", ROOT / "search_spaces" / "quickstart.yaml"
MOST_LINES = 1000


def loaded():
    """Return the program as a module."""
    spec = importlib.util.spec_from_file_location("core", CORE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


core = loaded()


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A study of a small quickstart by dse, the space as core reads it, and the data set."""
    folder = tmp_path_factory.mktemp("core")
    space = yaml.safe_load(SPACE.read_text(encoding="utf-8"))
    space["model"]["hidden"] = {"choice": [20]}
    # Two batches an epoch; warm-up and steps of the learning rate; three averaged epochs, whose sum rounds.
    space["training"] |= {"epochs": 3, "warmup_epochs": 1, "lr_every": 1, "average_epochs": 3}
    space["split"] = {"train": {"repetition": [0, 1]}, "validation": {"repetition": [2]}}
    of_core = folder / "core.yaml"
    of_core.write_text(yaml.safe_dump(space, sort_keys=False), encoding="utf-8")
    space["data"]["trials"], space["execution"]["jobs"] = 3, 1
    of_dse = folder / "dse.yaml"
    of_dse.write_text(yaml.safe_dump(space, sort_keys=False), encoding="utf-8")
    study = dse.run(str(of_dse), results=folder / "results")
    space = dse.load_space(of_dse)
    data = {}
    for target in ("texture", "profile"):
        [number] = [k for k in (0, 4) if design_at(space, k)["task.target"] == target]
        prepared = dataset.prepare(space.resolve(design_at(space, number)), folder, usual_root())
        data[target] = as_core(dataset.load(prepared), target)
    return SimpleNamespace(study=study, space=core.read_space(of_core), data=data)


def as_core(data, target):
    """Return a data set of dse as core holds it."""
    spikes = data.spikes
    n_rows = len(spikes.row_offsets) - 1
    dense = np.zeros((n_rows, spikes.n_channels), bool)
    dense[np.repeat(np.arange(n_rows), np.diff(spikes.row_offsets)), spikes.channel] = True
    return SimpleNamespace(
        spikes=dense.reshape(-1, spikes.n_steps, spikes.n_channels),
        step_ms=spikes.step_ms,
        labels={target: (np.array(data.classes), data.target)},
        train=data.train,
        validation=data.validation,
    )


def trained_by_dse(study, trial):
    """Return the weights of a trial as core holds them."""
    arrays = store.load_arrays(store.run_file(study.folder, trial, 0) / "weights.npz")
    hidden, outputs = store.fitted_of(arrays).layers
    return [hidden.weight.T, hidden.recurrent.T, outputs.weight.T]


def test_it_is_short_and_stands_alone():
    text = CORE.read_text(encoding="utf-8")
    assert text.count("\n") <= MOST_LINES
    names = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            names |= {x.name.partition(".")[0] for x in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add(node.module.partition(".")[0])
    assert names - sys.stdlib_module_names == {"numpy", "yaml"}


@pytest.mark.parametrize("trial", [7, 250])  # a smooth texture, a woven one
def test_events_and_spikes_of_a_touch(trial):
    scene, mine, space = load_scene("quickstart"), core.read_scene("quickstart"), core.read_space(SPACE)
    cell = mine.cells[trial]
    events = core.events_of(mine, cell, core.surface_of(cell[0], mine))
    block = simulate.events(scene, trial)
    assert np.array_equal(events, np.stack([block.t_us, block.x, block.y, block.polarity], axis=1))
    settings = dse.load_space(SPACE)
    pools = pooling(settings.resolve(design_at(settings, 0)).preprocessing, *mine.frame_px)
    counts, channels = preprocessing.pool([block], pools, 0, 0, 250)
    step, channel = np.nonzero(core.spikes_of(events, space, mine))
    assert np.array_equal(np.bincount(step, minlength=250), counts)
    assert np.array_equal(channel, channels)


@pytest.mark.parametrize("number", [0, 5])
def test_training_gives_the_same_weights(small, number):
    design = core.designs_of(small.space)[number]
    assert number < 4 or design["model.input_delays"] == [0, 12, 25, 50]
    weights = core.train(small.space, design, small.data[design["task.target"]])
    for mine, its in zip(weights, trained_by_dse(small.study, number), strict=True):
        assert mine.dtype == its.dtype == np.float32
        assert np.array_equal(mine, its)


@pytest.fixture(scope="module")
def tables(small):
    """Core's design points of every trial, of the weights that dse trained."""
    tables = {}
    for number, design in enumerate(core.designs_of(small.space)):
        data = small.data[design["task.target"]]
        weights = trained_by_dse(small.study, number)
        bundle = core.bundle_of(small.space, design, data, weights)
        for name, its in zip(("first", "ring", "last"), weights, strict=True):
            assert np.array_equal(bundle[name], quantise(its) * 32)
        tables[number] = core.measure(small.space, design, data, bundle)
    return tables


def test_all_design_points_have_the_same_measures(small, tables):
    points = small.study.points()
    assert sorted(points["trial"].unique()) == sorted(tables)
    for number, columns in tables.items():
        rows = points[points["trial"] == number].sort_values("point")
        for name, mine in columns.items():
            its = rows[name].to_numpy(dtype=np.float64)
            assert np.array_equal(mine.astype(np.float64), its, equal_nan=True), (number, name)


def test_a_bundle_answers_as_its_design_did(small, tables, tmp_path):
    design, data = core.designs_of(small.space)[1], small.data["texture"]
    bundle = core.bundle_of(small.space, design, data, trained_by_dse(small.study, 1))
    np.savez(tmp_path / "bundle.npz", **bundle)
    output, *_ = core.respond(dict(np.load(tmp_path / "bundle.npz")), data.spikes[data.validation])
    answers = bundle["classes"][output.sum(axis=1).argmax(axis=1)]
    names, classes = data.labels["texture"]
    assert (answers == names[classes[data.validation]]).mean() == tables[1]["accuracy"][0]


def test_the_front_has_the_rows_of_the_skyline(small, tables):
    rows = small.study.skyline().rows[["trial", "point"]]
    assert core.front(small.space, tables) == [*rows.itertuples(index=False, name=None)]


@pytest.mark.parametrize(
    "change, said",
    [
        ("training.clip_norm=1", "training.clip_norm is unknown"),
        ("model.recurrent=false", "model.recurrent must be True, got False"),
    ],
)
def test_what_it_does_not_know_is_refused_in_one_line(change, said):
    command = [sys.executable, str(CORE), str(SPACE), "0", change]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert said in done.stderr and done.stderr.count("\n") == 1
