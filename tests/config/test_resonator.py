"""Mistakes about resonators in a search space: one line each, with its place, before anything is trained."""

from __future__ import annotations

from pathlib import Path

import pytest

from dse.config import ConfigError, load_space
from dse.study.preview import preview
from tests.spaces import write_space

OLD = "{kind: snn, hidden: {choice: [4, 8, 12]}, true_rate: 0.8}"
CHIPS = "hardware: [loihi1_silicon]"


@pytest.mark.parametrize(
    ("model", "fault"),
    [
        ("period: [1.5, 40]", "tiny.yaml:14: model.period must be at least 2 input steps, got 1.5"),
        (
            "period: [40, 3]",
            r"tiny.yaml:14: model.period must have bounds in increasing order, got \[40",
        ),
        (
            "quality: [5, 1]",
            r"tiny.yaml:14: model.quality must have bounds in increasing order, got \[5",
        ),
        ("share: 0", r"tiny.yaml:14: model.share must be in \(0, 1\], got 0"),
        (
            "period: [15, 200], period_unit: ms",
            "tiny.yaml:14: model.period must be at least 2 input steps of 10 ms, got 15 ms",
        ),
        (
            "period: [2, 80], period_unit: {choice: [steps, Hz]}",
            "tiny.yaml:14: model.period must be at least 2 input steps of 10 ms, got 80 Hz",
        ),
        ("period_unit: s", "tiny.yaml:14: unknown model.period_unit 's'"),
    ],
)
def test_keys(tmp_path: Path, model: str, fault: str) -> None:
    with pytest.raises(ConfigError, match=fault):
        load_space(
            write_space(
                tmp_path, (OLD, f"{{kind: snn, neuron: resonator, {model}}}"), (CHIPS, "hardware: []")
            )
        )


def test_a_chip_that_runs_none_of_the_neurons(tmp_path: Path) -> None:
    chips = "hardware: [mcu_m4, xylo_imu, loihi2_scenario, op_4.6_0.9, loihi1_silicon]"
    with pytest.raises(ConfigError) as raised:
        load_space(write_space(tmp_path, (OLD, "{kind: snn, neuron: resonator}"), (CHIPS, chips)))
    assert [str(fault) for fault in raised.value.faults] == [
        f"{tmp_path / 'tiny.yaml'}:17: hardware '{name}' cannot run neuron resonator: its neurons cannot be "
        "programmed"
        for name in ("xylo_imu", "loihi1_silicon")
    ]


@pytest.mark.parametrize(
    "model",
    [
        "{kind: snn, neuron: {choice: [cuba_lif, resonator]}, share: {choice: [0.5, 1.0]}}",
        "{choice: [knn, {kind: snn, neuron: resonator}]}",
    ],
)
def test_a_chip_that_runs_some_of_the_designs(tmp_path: Path, model: str) -> None:
    space = load_space(write_space(tmp_path, (OLD, model), (CHIPS, "hardware: [loihi1_silicon]")))
    assert space.n_designs == (6 if "share" in model else 4)
    without = "neuron resonator: the neurons of loihi1_silicon cannot be programmed"
    assert preview(space)["without_costs"] == without
    other = load_space(tmp_path / "tiny.yaml", {"hardware": "[loihi1_silicon, mcu_m4]"})
    assert "without_costs" not in preview(other)
