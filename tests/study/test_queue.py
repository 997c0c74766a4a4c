"""Designs of the user's choice: read from a file, kept in order, trained once."""

import pytest

from dse.config import ConfigError
from dse.store import Book
from dse.study import explore, queue
from dse.study.ledger import read_entries
from tests.tiny_study import make_space


@pytest.fixture
def space(tmp_path, monkeypatch):
    monkeypatch.setenv("DSE_CACHE", str(tmp_path / "cache"))
    return make_space(tmp_path, execution={"jobs": 1}, search={"sampler": "grid", "batch": 2})


def written(folder, text):
    path = folder / "design.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_enqueued_designs_are_trained_first_and_once(space, tmp_path):
    folder = tmp_path / "results/tiny"
    both = "- {model.hidden: [16], model.true_rate: 0.8}\n- {model.hidden: 4, model.true_rate: 0.2}\n"
    designs = queue.read_designs(space, written(tmp_path, both))
    queue.enqueue(folder, designs)
    queue.enqueue(folder, designs[:1])  # waits already
    study = explore.run(space, tmp_path / "results", progress=False)
    entries = read_entries(folder)
    assert [e.design["model.hidden"] for e in entries] == [16, 4, 4, 8, 8, 16]
    assert [e.enqueued for e in entries] == [True, True, False, False, False, False]
    assert [e.batch for e in entries] == [0, 0, 1, 1, 2, 2]
    with Book(folder) as book:
        assert book.rows("queue") == []
    assert study.trials["status"].eq("finished").all()
    queue.enqueue(folder, designs)  # both are trained
    again = explore.run(space, tmp_path / "results", progress=False)
    assert len(again.trials) == 6
    with Book(folder) as book:
        assert book.rows("queue") == []


@pytest.mark.parametrize(
    ("text", "faults"),
    [
        (
            "model.hidden: 5\nmodel.true_rate: 0.2\n",
            ["1: model.hidden must be on its axis {'choice': [4, 8, 16]}, got 5"],
        ),
        (
            "model.hidden: 4\n",
            ["1: a design must have the axes model.hidden, model.true_rate, got model.hidden"],
        ),
        ("model.hidden: 4\nmodel.hiden: 4\n", ["2: unknown axis 'model.hiden'; known: model.hidden"]),
        (
            "- 3\n- model.true_rate: 2\n",
            ["1: a design must be a mapping", "2: model.true_rate must be on its axis"],
        ),
        ("[]\n", ["1: must hold at least one design, got none"]),
    ],
)
def test_every_fault_has_its_line(space, tmp_path, text, faults):
    path = written(tmp_path, text)
    with pytest.raises(ConfigError) as caught:
        queue.read_designs(space, path)
    lines = str(caught.value).splitlines()
    assert len(lines) == len(faults)
    for line, fault in zip(lines, faults, strict=True):
        assert line.startswith(f"{path}:{fault}")
