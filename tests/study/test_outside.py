"""A study driven from outside, and two studies as one: what is recorded, refused and read back."""

import json

from dse.api.study import open as open_study
from dse.cli.command_line import main
from dse.study import explore
from dse.study.ledger import read_entries
from tests import tiny_study

TOLD = ["accuracy=0.9", "n_weights=20", "energy_uj=0.5"]


def run(folder, into="results", **changes):
    space = tiny_study.make_space(folder, execution={"jobs": 1}, **changes)
    return explore.run(space, folder / into, progress=False)


def test_designs_are_asked_for_told_and_on_the_front(tmp_path, capsys):
    folder = tmp_path / "results/tiny"
    settings = {"sampler": "grid", "batch": 4, "repeats_on_front": 2}
    space = str(tiny_study.make_space(tmp_path, execution={"jobs": 1}, search=settings).source)

    def dse(*arguments, code=0):
        assert main(list(arguments)) == code
        printed = capsys.readouterr()
        return printed.err if code else printed.out

    asked = json.loads(dse("ask", space, "--n", "2", "--results", str(folder.parent), "--json"))["rows"]
    asked += json.loads(dse("ask", space, "--results", str(folder.parent), "--json"))["rows"]
    hidden_and_rate = [(row["trial"], *row["design"].values()) for row in asked]
    assert hidden_and_rate == [(0, 4, 0.2), (1, 4, 0.8), (2, 8, 0.2)], "as the grid has them"

    tell = ("tell", str(folder))
    never = dse(*tell, "3", *TOLD, code=2)
    assert "design 3 was never asked for; designs that wait for values: 0, 1, 2" in never
    faults = dse(*tell, "1", "accuracy=1.2", "n_weights=nan", "enrgy_uj=3", code=2).splitlines()
    assert [fault.split(": ", 1)[1] for fault in faults] == [
        "objective energy_uj is missing",
        "accuracy must be within 0 and 1, got 1.2",
        "n_weights must be finite, got nan",
        "unknown column 'enrgy_uj'; `dse describe objectives` has all. Did you mean 'energy_uj'?",
    ]
    assert "'accuracy' must be COLUMN=VALUE" in dse(*tell, "1", "accuracy", code=2).replace(":", "")
    assert "needs values" in dse(*tell, "1", code=2)
    row = json.loads(dse(*tell, "1", *TOLD, "--json"))["rows"][0]
    assert (row["status"], row["origin"], row["accuracy"], row["energy_uj"]) == ("told", "told", 0.9, 0.5)
    assert "design 1 has its result" in dse(*tell, "1", *TOLD, code=2)
    dse(*tell, "0", "--failed", "the board was lost")

    study = run(tmp_path, search=settings)
    status = study.trials.set_index("trial")["status"].to_dict()
    assert status == {0: "failed", 1: "told", **dict.fromkeys(range(2, 6), "finished")}
    assert read_entries(folder)[1].values == (0.9, 20.0, 0.5)
    points = study.points()
    assert points[points["trial"] == 1]["origin"].tolist() == ["told"]
    lacking = points["accuracy_corrected"].isna()
    assert set(points["trial"][lacking]) == {1}, "nobody said how many recordings its accuracy is of"
    assert 1 in set(open_study(study.folder).skyline().rows["trial"])
    assert (study.trials.set_index("trial")["repeats"] == 2).sum() >= 1, "others are repeated"
    best = ["pick", str(folder), "--budget", "n_weights <= 20"]
    assert "trial 1 was measured elsewhere" in dse(*best, "--export", str(tmp_path / "bundle"), code=2)
    shares = json.loads(dse("skyline", str(folder), "--draws", "20", "--json"))["rows"]
    assert any(row["trial"] == 1 for row in shares)
    elsewhere = json.loads(dse("skyline", str(folder), "--hardware", "op_4.6_0.9", "--json"))["rows"]
    assert all(row["trial"] != 1 for row in elsewhere), "its costs are those of one chip"
