"""What is known before training is what training measures, or a bound of it."""

import math

import pytest
import yaml

import dse
from dse.config import load_space
from dse.data.dataset import assemble, cache, dataset_key
from dse.data.dataset.shape import Shape, announced
from dse.measure.hardware.profile import load_all
from dse.measure.numbers import Numbers
from dse.search.space import design_at
from dse.study import explore
from dse.study.known import KnownBefore
from dse.study.ledger import read_entries
from dse.study.preview import preview
from dse.study.record import RunRecord
from tests.tiny_study import REAL, write_recordings

FIXED = ["loihi1_silicon", "truenorth"]


def space(folder, **changes):
    if not (folder / "tiny.npz").exists():
        write_recordings(folder / "tiny.npz")
    plain = yaml.safe_load(REAL)
    plain["training"] = {"epochs": 1, "batch_size": 18}
    plain["search"] = {"sampler": "grid"}
    for key, value in changes.items():
        plain[key] = plain.get(key, {}) | value if isinstance(value, dict) else value
    path = folder / "real.yaml"
    path.write_text(yaml.safe_dump(plain), encoding="utf-8")
    return load_space(path)


def trained(folder):
    return [entry.design for entry in read_entries(folder / "results/real") if not entry.excluded]


@pytest.fixture
def home(tmp_path, monkeypatch):
    monkeypatch.setenv("DSE_CACHE", str(tmp_path / "cache"))
    return tmp_path


def shape_of(sections, base):
    data = assemble.find(cache.usual_root(), dataset_key(sections, base))
    assert data is not None
    of_file = sections.data.channel_positions(base)
    before = announced(sections, assemble.recordings(sections, base), of_file)
    prepared = Shape.of(data)
    assert before.positions.tolist() == prepared.positions.tolist()
    assert (before.n_outputs, before.step_ms) == (prepared.n_outputs, prepared.step_ms)
    return prepared


def known_rows(space, design):
    base = space.source.parent
    known = KnownBefore(space, load_all(space.hardware, base), lambda x: shape_of(x, base))
    return dict(known._rows(design, needs_data=True))


@pytest.mark.parametrize(
    "model",
    [
        {"hidden": [6, 4], "recurrent": {"choice": [False, True]}, "steps_per_sample": 2},
        {"hidden": [6], "input_delays": [0], "max_delay": {"choice": [1, 6]}},
        {"hidden": [6], "pruned": {"choice": [0.0, 0.5]}},
        {"hidden": [6], "neuron": "resonator"},
        {"kind": "columns", "hidden": [], "features": 2, "neighbours": 1, "input_delays": [0, 2]},
    ],
    ids=["layers", "delays", "pruned", "resonators", "columns"],
)
def test_training_measures_what_is_known(home, model):
    delaying = ["loihi1_silicon", "ice40_up5k"]
    fixed = [] if "neuron" in model else delaying if "max_delay" in model else [*FIXED, "ice40_up5k"]
    here = space(home, model=model, hardware=["mcu_m4", *fixed])
    study = explore.run(here, home / "results", progress=False)
    points = study.points()
    for place in range(here.n_designs or 0):
        for chip, row in known_rows(here, design_at(here, place)).items():
            rows = points[(points["trial"] == place) & (points["hardware"] == chip)]
            for name in set(row) & set(points.columns) - set(here.axes):
                if isinstance(row[name], str) or math.isnan(row[name][0]):
                    continue
                low, high = row[name]
                values = rows[name].astype(float)
                assert ((values >= low * (1 - 1e-12)) & (values <= high)).all(), (name, chip, row[name])


def test_designs_beyond_a_limit_are_written_down_and_not_trained(home):
    limits = ["n_weights <= 60", "model.input_delays != '[0, 2]' or model.hidden > 5"]
    axes = {"hidden": {"choice": [3, 7, 9]}, "input_delays": {"choice": [[0], [0, 2]]}}
    here = space(home, model=axes, limits=limits)
    # 4 channels, 3 classes: 7 weights per hidden neuron, 11 with two copies of the channels.
    row = preview(here)
    assert (row["excluded"], row["excluded_by"]) == (4, dict(zip(limits, (3, 1), strict=True)))
    study = explore.run(here, home / "results", progress=False)
    assert [(d["model.hidden"], d["model.input_delays"]) for d in trained(home)] == [(3, [0]), (7, [0])]
    table = study.trials.set_index("trial")
    assert table["status"].value_counts().to_dict() == {"excluded": 4, "finished": 2}
    first = table[table["status"] == "excluded"].iloc[0]
    assert first["reason"] == (
        "cannot meet model.input_delays != '[0, 2]' or model.hidden > 5: "
        "model.input_delays is '[0, 2]', model.hidden is 3"
    )
    assert set(study.points()["trial"]) == set(table.index[table["status"] == "finished"])


def test_what_a_gate_array_cannot_hold_is_not_trained(home):
    axes = {"hidden": {"choice": [7, 3000]}, "input_delays": [0]}
    here = space(home, model=axes, limits=["fits"], hardware=["ice40_up5k"])
    table = explore.run(here, home / "results", progress=False).trials.set_index("model.hidden")
    assert table["status"].to_dict() == {7: "finished", 3000: "excluded"}


def test_a_study_goes_on_under_other_limits(home):
    axes = {"hidden": {"choice": [3, 7, 9]}, "input_delays": [0]}
    explore.run(space(home, model=axes, limits=["n_weights <= 30"]), home / "results", progress=False)
    again = explore.run(space(home, model=axes, limits=["n_weights <= 50"]), home / "results", progress=False)
    assert [d["model.hidden"] for d in trained(home)] == [3, 7]
    assert again.trials["status"].value_counts().to_dict() == {"finished": 2, "excluded": 1}


def test_a_stopped_search_under_limits_goes_on_as_if_it_had_not_stopped(home):
    axes = {"hidden": {"range": [1, 60]}, "true_rate": {"range": [0.3, 0.9]}, "input_delays": [0]}
    limits = ["n_weights <= 49"]  # 7 per hidden neuron

    def searched(folder, n_trials):
        search = {"sampler": "tpe", "startup": 2, "n_trials": n_trials, "batch": 2}
        here = space(home, model=axes, search=search, limits=limits)
        table = explore.run(here, home / folder, progress=False).trials
        assert table["model.hidden"][table["status"] == "finished"].le(7).all()
        assert (table["status"] == "finished").sum() == n_trials
        return list(table[["trial", "model.hidden", "status", "reason"]].itertuples(index=False, name=None))

    whole = searched("whole", 4)
    assert whole[: len(first := searched("parts", 2))] == first
    assert searched("parts", 4) == whole


def test_a_fault_names_file_line_and_what_is_known(tmp_path):
    with pytest.raises(dse.ConfigError) as caught:
        limits = ["accuracy >= 0.9", "n_wieghts < 3", "fits", "n_weights"]
        space(tmp_path, limits=limits, hardware=[], objectives=["accuracy"])
    lines = str(caught.value).splitlines()
    assert len(lines) == 4
    assert "column 'accuracy' is known only after training" in lines[0]
    assert any("Did you mean 'n_weights'?" in line for line in lines)
    assert any("column 'fits' needs a hardware profile" in line for line in lines)
    assert all(f"{tmp_path / 'real.yaml'}:" in line for line in lines)


def test_a_trained_design_meets_limits_on_some_chip(home):
    here = space(home, limits=["energy_uj <= 5", "fits"], hardware=FIXED, objectives=["accuracy"])
    known = KnownBefore(here, load_all(here.hardware, here.source.parent), lambda _: None)

    def meets(**chips):
        columns = {chip: {"energy_uj": x, "fits": True} for chip, x in chips.items()}
        numbers = Numbers({"accuracy": 0.5}, columns)
        record = RunRecord(trial=0, repeat=0, design={}, seed=0, numbers=numbers)
        return known.meets(design_at(here, 0), [record])

    assert meets(loihi1_silicon=9.0, truenorth=5.0) and not meets(loihi1_silicon=9.0, truenorth=6.0)
    assert not meets(truenorth=math.nan)
