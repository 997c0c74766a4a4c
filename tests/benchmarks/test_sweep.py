"""The sweep compares like with like: designs, batches, weights and schedule are those of the engine."""

from benchmarks import grid
from dse.models.snn.train import train


def test_a_plain_loop_trains_a_design_as_the_engine_does(tmp_path, monkeypatch):
    monkeypatch.delenv("DSE_DATA", raising=False)
    space, data, recorded = grid.load(tmp_path, 2, "float32")
    assert not recorded
    number = 22
    accuracy = grid.task(space, data, [number]).train("csr loop", number)
    ((_, outcome),) = train(data, [grid.designs(space)[number]], grid.shared(space))
    found = outcome.validation.output.sum(axis=1).argmax(axis=1) == data.target[data.validation]
    assert accuracy == found.mean()
    assert 1.5 / len(data.classes) < accuracy < 1
