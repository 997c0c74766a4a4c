"""Whether to spike: what a study says of the shipped one, on a schedule, and of moved windows."""

from pathlib import Path

import numpy as np

from dse.config import load_space
from dse.data.given import from_arrays
from dse.study import rivals
from dse.study.explore import run
from dse.study.question import Question
from dse.study.results import Study

EXAMPLE = Study(Path(__file__).resolve().parent.parent.parent / "results" / "example")


def test_on_a_microcontroller_the_shipped_study_says_what_its_table_says(monkeypatch):
    found = {one.task: one for one in rivals.of_study(EXAMPLE, Question(hardware=("mcu_m4",)))}
    points = EXAMPLE.points()
    points = points[points["hardware"] == "mcu_m4"]
    for task, one in found.items():
        here = points[points["task"] == task]
        for finalist in one.finalists:
            of_family = here[here["family"] == finalist.family]
            assert finalist.accuracy >= of_family["accuracy"].max() - 2 * finalist.se
            row = of_family[(of_family["trial"] == finalist.trial)]
            assert np.isclose(row["accuracy"], finalist.accuracy).any()
    assert found["profile"].answer == "do not spike"  # mlp: 0.90 for 226 uJ; snn: 0.82 for 15 mJ
    assert found["texture"].answer == "spike for accuracy, not for energy"
    monkeypatch.setattr(rivals, "of_study", lambda *_: list(found.values()))
    said = rivals.sentences(EXAMPLE, Question(hardware=("mcu_m4",)))
    assert said == [text for one in found.values() for text in rivals.worded(one)]
    assert said[0].startswith("texture on mcu_m4: spike for accuracy, not for energy. ") and len(said) == 4
    (short,) = rivals.brief(EXAMPLE, Question(hardware=("mcu_m4",)))
    assert (
        "texture on Cortex-M4: spike for accuracy, not for energy; profile on Cortex-M4: do not spike"
        in short
    )


def test_on_a_duty_cycle_power_is_compared_and_budgets_count():
    asked = Question(hardware=("mcu_m4",), contacts_per_hour=60, where=("task == 'profile'",))
    (found,) = rivals.of_study(EXAMPLE, asked)
    assert found.cost == "power_mw"
    energy = found.finalists[0].cost
    assert 0 < energy.low < energy.median < energy.high
    assert list(rivals.of_study(EXAMPLE, asked, ["family == 'mlp'"])) == []  # spiking has no rival


def test_a_chip_of_spiking_networks_runs_nothing_else():
    (found,) = rivals.of_study(EXAMPLE, Question(hardware=("loihi1_silicon",), where=("task == 'profile'",)))
    assert found.unable == ("mlp", "naive_bayes") and not found.odds
    (said,) = rivals.worded(found)
    assert said.endswith("mlp, naive_bayes do not run or fit")


def test_moved_windows_and_unseen_groups_are_compared_too(tmp_path):
    """A study as it is trained, of which both sides are evaluated on moved windows and on sessions."""
    rng = np.random.default_rng(0)
    label = np.tile([0, 1], 30)
    phase = rng.uniform(0, 6, (60, 1))
    signals = np.sin(np.arange(60) * (0.1 + 0.3 * label[:, None]) + phase)
    columns = {"label": label, "session": np.arange(60) // 20}
    data = from_arrays(signals, columns, step_ms=4, file=tmp_path / "waves")
    space = {
        "data": data,
        "task": {"target": "label"},
        "window": {"n_steps": 40, "at": "middle"},
        "split": {"stratified": {"validation": 0.4}},
        "evaluation": {"shifts": [-5, 5], "leave_out": "session"},
        "encoder": {"kind": "send_on_delta", "thresholds": [0.2]},
        "model": {"choice": [{"kind": "snn", "hidden": 8}, {"kind": "mlp", "hidden": 4}]},
        "training": {"epochs": 4},
        "hardware": "mcu_m4",
    }
    study = run(load_space(space), tmp_path, progress=False)
    (found,) = rivals.of_study(study)
    assert [odds.on for odds in found.odds] == ["accuracy", "accuracy_shifted", "accuracy_unseen"]
    said = rivals.worded(found)
    assert len(said) == 4 and "on moved windows" in said[2] and "in unseen groups" in said[3]
    assert all(np.isfinite([odds.cheaper, odds.more_accurate, odds.best]).all() for odds in found.odds)
