"""What a served study tells of single designs, and the bundle that a reader takes home, from a real study."""

import io
import json
import shutil
import tempfile
import zipfile
from dataclasses import replace

import pytest

from dse import store
from dse.deploy import bundle
from dse.deploy.card import card
from dse.deploy.export import bundle_of, export
from dse.deploy.verdict import Verdict
from dse.measure.objectives.accuracy import wilson_se
from dse.show.dashboard import study as pages
from dse.show.dashboard.cards import gather_cards, parts
from dse.show.dashboard.details import gather_details
from dse.show.dashboard.site import page_server
from dse.show.dashboard.study import write_page
from dse.study import explore, results
from tests import tiny_study
from tests.page_data import held
from tests.plugins import with_targets
from tests.rewriting import damage_part, rewrite
from tests.serving import ask, served


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("pages")
    moods = {"choice": ["fine", "raise"]}
    space = tiny_study.make_space(
        path, model={"kind": "fake", "hidden": [8], "mood": moods}, execution={"jobs": 1}
    )
    yield explore.run(space, path / "results", progress=False).folder


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    """Where temporary folders are made."""
    path = tmp_path / "temporary"
    path.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(path))
    return path


def serving(folder):
    return served(page_server(folder, "127.0.0.1", 0))


def test_a_card_is_that_of_the_bundle_in_parts(folder):
    found = results.open(folder)
    row = found.points().query("trial == 0 and point == 3").iloc[0].to_dict()
    text = card(bundle_of(found, row), {})
    with serving(folder) as server:
        status, _, body = ask(server, query().replace("bundle.zip", "card.json"))
        assert status == 200 and json.loads(body)["parts"] == parts(text)
        assert ask(server, query(point=9999).replace("bundle.zip", "card.json"))[0] == 404
    key = f"0.3@{row['hardware']}"
    assert gather_cards(found, [row, row | {"trial": 99}]) == {key: parts(text)}, (
        "none of a design that is gone"
    )


def test_parts_of_a_card_have_no_marks():
    text = (
        "# A \\[0\\]\n\nOne `word`.\n\n    dse run\n\n- x\n- **y**\n\n| | |\n| --- | --- |\n| a \\| b | c |\n"
    )
    assert parts(text) == [
        ["h2", "A [0]"],
        ["p", "One word."],
        ["code", "dse run"],
        ["ul", ["x", "y"]],
        ["table", [["a | b", "c"]]],
    ]


def query(trial=0, point=3, hardware="loihi1_silicon"):
    return f"/bundle.zip?trial={trial}&point={point}&hardware={hardware}"


def state(folder):
    return {path: (path.stat().st_mtime_ns, path.stat().st_size) for path in folder.rglob("*")}


def test_the_bundle_is_the_one_that_pick_exports(folder, temporary, tmp_path):
    before = state(folder)
    found = results.open(folder)
    points = found.points()
    row = points[(points["trial"] == 0) & (points["point"] == 3)].iloc[0]
    export(found, row.to_dict(), tmp_path / "exported")
    with serving(folder) as server:
        status, headers, body = ask(server, query())
        assert ask(server, query())[2] == body
    assert status == 200
    assert headers["Content-Disposition"] == 'attachment; filename="trial_0_point_3.zip"'
    with zipfile.ZipFile(io.BytesIO(body)) as archive:
        assert all(name.startswith("trial_0_point_3/") for name in archive.namelist())
        archive.extractall(tmp_path / "unpacked")
    for name in ("bundle.json", "README.md"):
        sent = (tmp_path / "unpacked" / "trial_0_point_3" / name).read_text()
        assert sent == (tmp_path / "exported" / name).read_text()
    read = bundle.read(tmp_path / "unpacked" / "trial_0_point_3")
    assert (read.phi, read.theta, read.record["point"]) == (row["phi"], row["theta"], 3)
    assert list(temporary.iterdir()) == []
    assert state(folder) == before


def test_a_bundle_whose_targets_were_run_is_shown_and_sent(folder, temporary, tmp_path):
    study = tmp_path / "study"
    shutil.copytree(folder, study)
    points = results.open(study).points()
    row = points[(points["trial"] == 0) & (points["point"] == 3)].iloc[0]
    made = export(results.open(study), row.to_dict(), tmp_path / "exported")
    (tmp_path / "c99").mkdir()
    (tmp_path / "c99" / "dse.c").write_text("int x;\n")
    targets = {
        "c99": Verdict("faithful", n_recordings=18, run_by=("gcc 12.2.0",)),
        "nir": Verdict("approximate", "leaks round", 18, 0.25, 0.5, 3),
        "xylo": Verdict("unsupported", "it needs neurons of kind xylo_lif"),
    }
    files = {name: {"dse.c": tmp_path / "c99" / "dse.c"} for name in ("c99", "nir")}
    bundle.write(replace(made, targets=targets), study / "bundles" / "one", files)
    bundle.write(replace(made, targets=targets), study / "bundles" / "two", files)
    edited = study / "bundles" / "two" / "bundle.json"
    edited.write_text(edited.read_text().replace("approximate", "faithful"))  # by hand: not shown
    with serving(study) as server:
        told = json.loads(ask(server, query().replace("bundle.zip", "card.json"))[2])["parts"]
        body = ask(server, query())[2]
        others = ask(server, query(point=4))[2]
    assert told == parts((study / "bundles" / "one" / "README.md").read_text()), "the card of its bundle"
    tag, (_, *verdicts) = told[-1]
    assert tag == "table" and [row[0] for row in verdicts] == ["c99", "nir", "xylo"]
    assert "faithful (gcc 12.2.0); all decisions and spikes of 18 recordings" in verdicts[0][2]
    assert verdicts[2][2] == "unsupported; it needs neurons of kind xylo_lif"
    with zipfile.ZipFile(io.BytesIO(body)) as archive:
        assert archive.read("trial_0_point_3/targets/c99/dse.c") == b"int x;\n"
    with zipfile.ZipFile(io.BytesIO(others)) as archive:
        assert not any("targets/" in name for name in archive.namelist())


def test_the_bundle_has_the_targets_of_the_search_space(folder, temporary, tmp_path, monkeypatch):
    with_targets.load(monkeypatch)
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    space = store.read_text(copy / "search_space.yaml")
    for target, status, text in (
        ("arrays", 200, b""),
        ("stubborn", 422, b"A target of the search space cannot be written on the machine"),
    ):
        store.write_text(copy / "search_space.yaml", f"{space}targets: [{target}]\n")
        with serving(copy) as server:
            answer, _, body = ask(server, query())
        assert (answer, text in body) == (status, True), body
        if status == 200:
            with zipfile.ZipFile(io.BytesIO(body)) as archive:
                assert "trial_0_point_3/targets/arrays/network.npz" in archive.namelist()
                assert b"**not verified**" in archive.read("trial_0_point_3/README.md")
    assert list(temporary.iterdir()) == []


@pytest.mark.parametrize(
    "path",
    [
        query(trial=1),  # failed
        query(trial=999),
        query(point=9999),
        query(hardware="mcu_m4"),
        query(hardware=""),
        query(hardware="../../hardware"),
        "/bundle.zip?trial=0&point=3",
    ],
)
def test_no_such_point(folder, temporary, path):
    with serving(folder) as server:
        assert ask(server, path)[::2] == (404, b"The study has no such design point.\n")
    assert list(temporary.iterdir()) == []


SPOILT = "This design cannot be exported: an artefact is damaged, or the disk is full."
CHANGED = "The study has changed since this point was evaluated; reload the page."


def damage_points(copy):
    points = results.open(copy).points()
    with store.noted(copy / "points.parquet") as path:
        store.write_table(path, points.assign(phi=points["phi"] + 1))


def tell_labels(copy):
    encoder = {"kind": "threshold", "matching": "own_label"}
    rewrite(store.run_file(copy, 0, 0), lambda x: x | {"sections": x["sections"] | {"encoder": encoder}})


@pytest.mark.parametrize(
    ("harm", "status", "said"),
    [
        (lambda copy: damage_part(store.run_file(copy, 0, 0), "weights.npz"), 422, SPOILT),
        (lambda copy: store.run_file(copy, 0, 0).unlink(), 422, SPOILT),
        (damage_points, 409, CHANGED),
        (tell_labels, 422, "This design cannot be deployed: "),
    ],
)
def test_what_cannot_be_exported_is_said_without_its_path(folder, temporary, tmp_path, harm, status, said):
    copy = shutil.copytree(folder, tmp_path / "copy")
    if said == CHANGED:
        harm(copy)
    with serving(copy) as server:
        if said != CHANGED:
            assert ask(server, "/data.json")[0] == 200  # the table is read before
            harm(copy)
        found, _, body = ask(server, query())
    assert (found, body.decode().startswith(said)) == (status, True)
    assert str(tmp_path) not in body.decode() and list(temporary.iterdir()) == []


@pytest.mark.parametrize("where", ["disk", "folder"])
def test_a_full_disk_or_no_folder_leaves_nothing_behind(folder, temporary, tmp_path, monkeypatch, where):
    def full(*_):
        raise OSError(28, "No space left on device", "/secret")

    if where == "disk":
        monkeypatch.setattr(bundle.store, "save_arrays", full)
    else:
        monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "gone"))
    with serving(folder) as server:
        assert ask(server, query())[::2] == (422, f"{SPOILT}\n".encode())
    assert list(temporary.iterdir()) == []


def test_the_document_of_a_trial(folder):
    found = results.open(folder)
    with serving(folder) as server:
        status, _, body = ask(server, "/design.json?trial=0")
        assert json.loads(body) == json.loads(json.dumps(gather_details(found, found.points(), 0)))
        for trial in (1, 999):
            said = ask(server, f"/design.json?trial={trial}")[::2]
            assert said == (404, b"The study has no finished trial of this number.\n")
    assert status == 200


def test_before_the_first_trial_there_is_none(folder, tmp_path):
    (tmp_path / "search_space.yaml").write_bytes((folder / "search_space.yaml").read_bytes())
    with serving(tmp_path) as server:
        assert ask(server, "/design.json?trial=0")[0] == 404
        assert ask(server, query())[0] == 404


def test_a_page_on_disk_carries_details(folder, tmp_path):
    page = held(write_page(results.open(folder), tmp_path / "page.html"))
    assert list(page["details"]) == ["0"]


def test_a_study_whose_limits_exclude_all_designs_has_a_page(tmp_path):
    tiny_study.make_space(tmp_path, limits=["family == 'none'"])
    assert tiny_study.run_folder(tmp_path) == 0
    page = held(write_page(results.open(tmp_path / "results" / "tiny"), tmp_path / "page.html"))
    assert "details" not in page


def test_a_deterministic_design_is_as_uncertain_as_its_recordings_are_few(folder):
    study = results.open(folder)
    points = study.points().assign(repeats=3, accuracy=0.75, accuracy_se=0.0)
    n = store.read_record(store.run_file(folder, int(points["trial"].iloc[0]), 0))["samples"]
    shown = pages.with_recordings(study, points)
    error = float(wilson_se(round(0.75 * n["validation"]), n["validation"]))
    assert shown["accuracy_se"].tolist() == pytest.approx([error] * len(points))
    spread = pages.with_recordings(study, points.assign(accuracy_se=0.4))
    assert set(spread["accuracy_se"]) == {0.4}, "a larger spread over seeds stays"
    once = points.assign(repeats=1, accuracy_se=0.1)
    assert set(pages.with_recordings(study, once)["accuracy_se"]) == {0.1}, "Wilson's is there already"
