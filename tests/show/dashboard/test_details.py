"""The details of a design against the table of points and the artefacts that they come from."""

import base64
import gzip
import json
import shutil

import numpy as np
import pandas as pd
import pytest

from dse import store
from dse.measure.objectives.first_spike import first_spike_ms
from dse.show.dashboard.details import MOST_EXAMPLES, gather_details, packed_details, shown_first
from dse.store import StoreError
from dse.study import explore, precision, results
from dse.study.record import load_record
from tests import tiny_study
from tests.rewriting import damage_part, rewrite

NAMES = ["felt", "silk", "wool"]
FAKE = {"kind": "fake", "hidden": [8], "mood": {"choice": ["fine", "raise"]}}
DAMAGED = "cannot be shown: a file of the study is damaged or incomplete."
HARDWARE = ["loihi1_silicon", "mcu_m4"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The folder of a study of two repeats: a spiking network, one that fails, one without output spikes."""
    path = tmp_path_factory.mktemp("details")
    space = tiny_study.make_space(
        path,
        model={"choice": [FAKE, {"kind": "knn"}]},
        hardware=HARDWARE,
        search={"sampler": "grid", "repeats": 2},
        execution={"jobs": 1},
    )
    yield explore.run(space, path / "results", progress=False).folder


@pytest.fixture
def found(folder):
    return results.open(folder)


def trial_of(found, family):
    return int(found.points().query("family == @family")["trial"].iloc[0])


def details(found, family="fake"):
    document = gather_details(found, found.points(), trial_of(found, family))
    json.dumps(document, allow_nan=False)
    [task] = document["tasks"].values()
    return document, task


def arrays_of(found, name, trial):
    return [store.load_arrays(store.run_file(found.folder, trial, repeat) / name) for repeat in range(2)]


def numbers(values):
    """Return the numbers of a plotly array as JSON holds it."""
    if isinstance(values, dict):
        flat = np.frombuffer(base64.b64decode(values["bdata"]), np.dtype(values["dtype"]))
        return flat.reshape([int(n) for n in str(values.get("shape", -1)).split(",")])
    return np.array(values, float)


def test_surfaces_are_rows_of_the_table(found):
    document, task = details(found)
    assert document["notes"] == []
    [surface] = task["surfaces"]
    assert (surface["phi"], surface["theta"]) == ([0, 4], [0.4, 0.7, 1])
    assert (surface["weight_bits"], surface["pruned_after"]) == (8, 0)
    assert list(surface["hardware"]) == HARDWARE
    points = found.points()
    for name, columns in surface["hardware"].items():
        own = points[(points["trial"] == document["trial"]) & (points["hardware"] == name)].set_index("point")
        assert {"accuracy", "accuracy_se", "decision_latency_ms", "undecided", "energy_uj"} <= set(columns)
        assert {"n_weights", "latency_ms", "energy_uj_low", "energy_uj_high"} <= set(columns)
        for i, phi in enumerate(surface["phi"]):
            for j, theta in enumerate(surface["theta"]):
                place = i * len(surface["theta"]) + j
                row = own.loc[surface["first_point"] + place]
                assert (row["phi"], row["theta"]) == (phi, theta)
                for column in (
                    "accuracy",
                    "n_weights",
                    "energy_uj",
                    "latency_ms",
                    "undecided",
                    "energy_uj_high",
                ):
                    assert columns[column][place] == pytest.approx(row[column], rel=1e-5)


def test_other_precisions_have_surfaces_and_a_figure(found):
    points = found.points()
    trial = trial_of(found, "fake")
    own = points[points["trial"] == trial]
    fewer = own.assign(weight_bits=4.0, accuracy=own["accuracy"] / 2, point=own["point"] + len(own) // 2)
    document = gather_details(found, pd.concat([points, fewer], ignore_index=True), trial)
    [task] = document["tasks"].values()
    trained, rounded = task["surfaces"]
    assert (trained["weight_bits"], rounded["weight_bits"]) == (8, 4)
    assert rounded["first_point"] == trained["first_point"] + len(own) // 2
    accuracy = np.array(trained["hardware"]["mcu_m4"]["accuracy"])
    assert rounded["hardware"]["mcu_m4"]["accuracy"] == pytest.approx(accuracy / 2, rel=1e-5)
    [line] = task["figures"]["bits"]["data"]
    assert numbers(line["x"]).tolist() == [4, 8]
    full = own[own["phi"].isna() & own["read_out_ms"].isna()]["accuracy"].iloc[0]
    assert numbers(line["y"]).tolist() == [full / 2, full]


def test_other_precisions_have_their_own_confusion_and_energy(found):
    points, trial = found.points(), trial_of(found, "fake")

    for run in store.runs_of(found.folder, trial):
        # An evaluation in which half of the spikes of the layers are gone.
        parts = {name: store.load_arrays(run / name) for name in ("confusion.npz", "read_out.npz")}
        parts["confusion.npz"]["validation"] *= 2
        parts["read_out.npz"]["work/spikes"] = parts["read_out.npz"]["work/spikes"] / 2
        precision.save(run, (4, 0.5), load_record(run), parts)
    [task] = gather_details(found, points, trial)["tasks"].values()
    [fewer] = task["precisions"]
    assert (fewer["weight_bits"], fewer["pruned_after"]) == (4, 0.5)
    own, parent = (numbers(one["figures"]["confusion"]["data"][0]["text"]) for one in (fewer, task))
    assert (own == 2 * parent).all()
    spent = [
        sum(numbers(bar["x"]).sum() for bar in one["figures"]["energy"]["mcu_m4"]["data"])
        for one in (fewer, task)
    ]
    assert spent[0] < spent[1]
    store.remove(found.folder / precision.FOLDER)


def test_a_table_that_lacks_points_or_is_of_an_earlier_version_has_no_surface(found):
    points, trial = found.points(), trial_of(found, "fake")
    holed = points.drop(points.index[(points["trial"] == trial) & (points["phi"] == 4)][0])
    document = gather_details(found, holed, trial)
    [task] = document["tasks"].values()
    assert task["surfaces"] == []
    assert document["notes"] == [f"The decision surface {DAMAGED}"]
    earlier = points.drop(columns=["weight_bits", "pruned_after"])
    [task] = gather_details(found, earlier, trial_of(found, "knn"))["tasks"].values()
    assert task["surfaces"] == [] and task["figures"]["confusion"]


def test_figures_are_of_every_repeat_on_validation(found):
    before = {path: path.stat().st_mtime_ns for path in found.folder.rglob("*")}
    document, task = details(found)
    assert {path: path.stat().st_mtime_ns for path in found.folder.rglob("*")} == before, "nothing is written"
    figures = {name: figure for name, figure in task["figures"].items() if "data" in figure}
    files = ("confusion.npz", "history.npz", "read_out.npz", "response.npz")
    matrices, histories, read_outs, answers = (arrays_of(found, x, document["trial"]) for x in files)
    [heat] = figures["confusion"]["data"]
    total = sum(arrays["validation"] for arrays in matrices)
    assert numbers(heat["text"]).astype(int).tolist() == total.tolist()
    assert figures["confusion"]["layout"]["xaxis"]["ticktext"] == NAMES
    for line, arrays in zip(figures["learning"]["data"], histories, strict=True):
        assert numbers(line["y"]).tolist() == pytest.approx(arrays["loss"].tolist())
    line, ring = figures["recognition"]["data"]
    for axis, name in (("x", "decision_latency_ms"), ("y", "accuracy")):
        assert numbers(line[axis]).tolist() == np.mean([run[name] for run in read_outs], axis=0).tolist()
    assert ring["x"][0] in numbers(line["x"])
    [bars] = figures["first_spike"]["data"]
    times_ms = np.concatenate([first_spike_ms(store.response_of(arrays)) for arrays in answers])
    target = np.concatenate([arrays["target"] for arrays in answers])
    medians = [np.median(times_ms[(target == k) & np.isfinite(times_ms)]) for k in range(3)]
    assert numbers(bars["x"]).tolist() == medians
    layout = figures["first_spike"]["layout"]
    assert layout["yaxis"]["ticktext"] == NAMES and "validation" in layout["xaxis"]["title"]["text"]
    points = found.points()
    full = points[(points["trial"] == document["trial"]) & points["point"].eq(0)]
    known = full[full["power_idle_w"].notna() & full["power_w"].notna()]
    assert figures["power"]["layout"]["yaxis"]["ticktext"] == known["hardware"].tolist()
    assert numbers(figures["power"]["data"][0]["x"]).tolist() == known["power_idle_w"].tolist()


@pytest.mark.parametrize("family", ["fake", "knn"])
def test_energy_is_that_of_the_full_read_out(found, family):
    document, task = details(found, family)
    points = found.points()
    full = points[
        (points["trial"] == document["trial"]) & points["read_out_ms"].isna() & points["phi"].isna()
    ]
    energies = task["figures"]["energy"]
    assert list(energies) == (HARDWARE if family == "fake" else ["mcu_m4"])
    for name, figure in energies.items():
        row = full[full["hardware"] == name].iloc[0]
        [bars] = figure["data"]
        assert numbers(bars["x"])[-1] == pytest.approx(row["energy_uj"], rel=1e-12)
        assert sum(numbers(bars["x"])[:-1]) == pytest.approx(row["energy_uj"], rel=1e-9)
        ends = (numbers(bars["error_x"][end])[-1] for end in ("arrayminus", "array"))
        assert list(ends) == pytest.approx(
            [row["energy_uj"] - row["energy_uj_low"], row["energy_uj_high"] - row["energy_uj"]], rel=1e-9
        )


def test_only_what_was_recorded_is_there(found):
    document, task = details(found, "knn")
    assert document["notes"] == []
    assert set(task) == {"figures", "surfaces"}
    assert set(task["figures"]) == {"confusion", "energy", "energy_at_period", "power"}
    assert task["surfaces"] == []
    _, spiking = details(found)
    assert list(spiking["figures"]["cores"]) == ["loihi1_silicon"]
    more = {"recognition", "first_spike", "learning", "cores"}
    assert set(spiking["figures"]) == set(task["figures"]) | more


def test_examples_are_what_the_first_repeat_answered(found):
    document, task = details(found)
    arrays = arrays_of(found, "response.npz", document["trial"])[0]
    response, index = store.response_of(arrays), arrays["index"].tolist()
    label = np.repeat(np.arange(3), tiny_study.N_PER_CLASS)
    examples = task["examples"]
    assert 3 <= len(examples) <= MOST_EXAMPLES
    verdicts = []
    for example in examples:
        number = int(example["title"].split(":")[0].removeprefix("recording "))
        output = response.output[index.index(number)]
        true, answer = NAMES[label[number]], NAMES[output.sum(axis=0).argmax()]
        mistake = "" if answer == true else f", classified as {answer}"
        assert (example["true"], example["classes"]) == (true, NAMES)
        assert example["title"] == f"recording {number}: {true}{mistake}"
        assert example["spikes"] == np.argwhere(output).tolist()
        assert (example["step_ms"], example["n_steps"]) == (5.0, tiny_study.N_STEPS)
        layers = next(trace for trace in example["figure"]["data"] if trace["type"] == "heatmap")
        spikes = response.spikes[index.index(number)]
        assert numbers(layers["customdata"]).tolist() == spikes.T.tolist()
        verdicts.append(answer == true)
    assert verdicts == sorted(verdicts, reverse=True)
    assert True in verdicts
    right = [example["true"] for example, verdict in zip(examples, verdicts, strict=True) if verdict]
    assert len(set(right)) == len(right)


def test_trials_that_have_no_details(found):
    points = found.points()
    failed = int(found.trials.query("status == 'failed'")["trial"].iloc[0])
    for trial in (failed, 999, -1):
        with pytest.raises(StoreError, match=f"has no finished trial {trial}$"):
            gather_details(found, points, trial)


@pytest.fixture
def copied(folder, tmp_path):
    return results.open(shutil.copytree(folder, tmp_path / "copy"))


@pytest.mark.parametrize(
    ("file", "parts"),
    [
        ("confusion.npz", {"The confusion matrix": ["confusion"]}),
        ("history.npz", {"The learning curve": ["learning"]}),
        (
            "read_out.npz",
            {
                "Accuracy over time": ["recognition"],
                "Energy by cause": ["energy", "energy_at_period", "cores", "misfits"],
            },
        ),
        ("response.npz", {"The first output spike": ["first_spike"], "An example": ["examples"]}),
    ],
)
def test_a_damaged_artefact_takes_no_more_than_its_figures(copied, file, parts):
    document, task = details(copied)
    whole = {**task["figures"], **task}
    damage_part(store.run_file(copied.folder, document["trial"], 0), file)
    damaged, rest = details(copied)
    assert damaged["notes"] == [f"{what} {DAMAGED}" for what in parts]
    left = {**rest["figures"], **rest}
    lost = {name for names in parts.values() for name in names}
    assert set(whole) - set(left) == lost & set(whole)
    assert all(left[name] == whole[name] for name in left if name != "figures")


def test_a_damaged_record_takes_its_repeat(copied):
    trial = trial_of(copied, "fake")
    one, other = (store.run_file(copied.folder, trial, repeat) for repeat in (1, 0))
    whole = one.read_bytes()
    for part in ({"heads": {"touch": {"classes": 3}}}, {"classes": [["felt"]]}, {"classes": 3}):
        rewrite(one, lambda record, part=part: record | part)
        assert len(details(copied)[1]["figures"]["learning"]["data"]) == 1
        one.write_bytes(whole)
    one.write_bytes(b"no run")
    document, task = details(copied)
    assert document["notes"] == ["The record of repeat 1 cannot be read; the figures show the other repeats."]
    assert len(task["figures"]["learning"]["data"]) == 1
    other.write_bytes(other.read_bytes()[:-40])
    document, task = details(copied)
    assert len(document["notes"]) == 2
    assert set(task["figures"]) == {"power"}, "which the table has"
    assert len(task["surfaces"]) == 1


def test_packing(found):
    points = found.points()
    order = [trial_of(found, "knn"), 999, trial_of(found, "fake")]
    packed = packed_details(found, points, order, 10**7)
    assert list(packed) == [str(order[0]), str(order[2])]
    assert packed == packed_details(found, points, order, 10**7)
    for trial, text in packed.items():
        document = json.loads(gzip.decompress(base64.b64decode(text)))
        assert document == json.loads(json.dumps(gather_details(found, points, int(trial))))
    first = len(packed[str(order[0])])
    assert list(packed_details(found, points, order, first)) == [str(order[0])]
    assert packed_details(found, points, order, first - 1) == {}


def test_a_page_on_disk_carries_surfaces_as_trained(found):
    points, trial = found.points(), trial_of(found, "fake")
    fewer = points.assign(weight_bits=4.0, point=points["point"] + 1000)
    [text] = packed_details(found, pd.concat([points, fewer], ignore_index=True), [trial], 10**7).values()
    [task] = json.loads(gzip.decompress(base64.b64decode(text)))["tasks"].values()
    assert [surface["weight_bits"] for surface in task["surfaces"]] == [8]
    assert "bits" in task["figures"]


def test_trials_of_fronts_come_first():
    page = {
        "columns": {"trial": {"values": [3, 3, 1, 2, 0]}},
        "front": [0, 1],
        "budgets": {"contenders": [0, 1, 3]},
    }
    assert shown_first(page) == [3, 2, 0, 1]
    assert shown_first(page | {"columns": {}}) == []
