"""What a bundle takes on this machine."""

from dataclasses import replace

import numpy as np
import pytest

from dse.cli import main
from dse.deploy import bundle, measure
from dse.deploy.bundle import Input
from dse.deploy.evaluate import evaluate
from dse.measure.hardware.counter import MeasuredPower
from tests.deploy.bundles import bundle as bundle_of
from tests.deploy.bundles import network


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("measure")
    fitted = network(np.random.default_rng(1), (4, 6, 3), steps_per_sample=2)
    made = bundle_of(fitted, input=Input("spikes", 4, 0, 0, 20, 5.0))
    window = replace(made.sections.window, n_steps=20)
    bundle.write(replace(made, sections=replace(made.sections, window=window)), folder / "bundle")
    np.savez(folder / "rows.npz", spikes=np.random.default_rng(3).integers(0, 2, (3, 50, 4)))
    return folder


def test_both_engines_take_the_steps_until_the_answer(folder, monkeypatch):
    def measured(work, rest_s):
        work()
        return MeasuredPower(1.0, 3.0)

    monkeypatch.setattr("dse.deploy.measure.measured_power", measured)
    monkeypatch.setattr("dse.deploy.measure._MOST_STEPS", 600)
    data_file = folder / "rows.npz"
    steps = sum(-(-row["time_ms"] // 5.0) for row in evaluate(folder / "bundle", data_file).answers)
    stream, c = measure.measure(bundle.read(folder / "bundle"), str(data_file))
    assert (stream.engine, len(stream.step_us), len(stream.inference_us)) == ("stream", steps, 3)
    assert c.engine == "c99" and c.reason == "" and len(c.inference_us) % 3 == 0
    assert len(c.step_us) == steps * len(c.inference_us) / 3
    for each in (stream, c):
        assert each.step_us.sum() == pytest.approx(each.inference_us.sum())
        assert each.energy_uj is not None and each.energy_uj > 0
        assert each.columns["step_us_p50"] <= each.columns["step_us_p99"]


def test_a_machine_without_a_counter_says_so(folder, monkeypatch, capsys):
    why = "this machine has no energy counter of its processor in /x"
    monkeypatch.setattr("dse.deploy.measure.measured_power", lambda *_: MeasuredPower(None, None, why))
    monkeypatch.setattr("dse.deploy.c.host.compiler", lambda: ["/no/compiler"])
    assert main(["measure", str(folder / "bundle"), "--format", "table"]) == 0
    captured = capsys.readouterr().out
    assert f"stream: energy_uj is empty: {why}" in captured
    assert "c99" in captured and "/no/compiler" in captured
