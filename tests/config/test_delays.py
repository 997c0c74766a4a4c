"""Mistakes about delays in a search space: one line each, with its place, before any training."""

from __future__ import annotations

from pathlib import Path

import pytest

from dse.config import ConfigError, load_space
from tests.spaces import write_space

OLD = "{kind: snn, hidden: {choice: [4, 8, 12]}, true_rate: 0.8}"
CHIPS, RUNS = "hardware: [loihi1_silicon]", "execution: {jobs: 1}"


def model(keys: str) -> tuple[str, str]:
    return OLD, f"{{kind: snn, {keys}}}"


@pytest.mark.parametrize(
    ("keys", "fault"),
    [
        ("max_delay: 63", r"tiny.yaml:14: model.max_delay must be in \[0, 62\], got 63"),
        (
            "max_delay: 16",
            "tiny.yaml:14: model.max_delay must be below the network steps of the window, 16: later spikes "
            "are lost, got 16",
        ),
        (
            "input_delays: {choice: [[0], [0, 16]]}",
            "tiny.yaml:14: model.input_delays must be below the steps of the window, 16: later spikes are "
            "lost, got 16",
        ),
        ("max_delay: 9, delayed_layers: last", "tiny.yaml:14: unknown model.delayed_layers 'last'"),
        (
            "max_delay: 9, input_delays: [0, 5]",
            r"tiny.yaml:14: model.input_delays must be \[0\] where synapses have delays",
        ),
    ],
)
def test_keys(tmp_path: Path, keys: str, fault: str) -> None:
    with pytest.raises(ConfigError, match=fault):
        load_space(write_space(tmp_path, model(keys)))


def test_network_steps_count(tmp_path: Path) -> None:
    assert load_space(write_space(tmp_path, model("max_delay: 31, steps_per_sample: 2"))).n_designs
    longer = ("n_steps: 16", "n_steps: {choice: [8, 17]}")  # one length of two is enough
    assert load_space(write_space(tmp_path, model("input_delays: [0, 16]"), longer)).n_designs == 4


def test_a_device_and_chips_without_them(tmp_path: Path) -> None:
    chips = "hardware: [mcu_m4, xylo_imu, loihi2_scenario, spinnaker2, asic45_memory, loihi1_silicon]"
    space = write_space(
        tmp_path, model("max_delay: 9"), (CHIPS, chips), (RUNS, "execution: {jobs: 1, device: cuda}")
    )
    with pytest.raises(ConfigError) as raised:
        load_space(space)
    assert [str(fault) for fault in raised.value.faults] == [
        f"{space}:14: model.max_delay must be 0 on execution.device cuda, got 9",
        f"{space}:17: hardware 'xylo_imu' cannot delay synapses (model.max_delay 9)",
        f"{space}:17: hardware 'spinnaker2' cannot delay synapses (model.max_delay 9)",
    ]


def test_a_chip_that_runs_some_of_the_designs(tmp_path: Path) -> None:
    keys = model("max_delay: {choice: [0, 9]}")
    assert load_space(write_space(tmp_path, keys, (CHIPS, "hardware: [xylo_imu]"))).n_designs == 4
