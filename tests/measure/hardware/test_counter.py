"""Power from energy counters that a test writes."""

from __future__ import annotations

from pathlib import Path

import pytest

from dse.measure.hardware import counter
from dse.measure.hardware.counter import MeasuredPower, measured_power

RANGE_UJ = 1000_000_000


class Machine:
    """Two packages whose counters and clock move only with `pass_s`."""

    def __init__(self, root: Path) -> None:
        self.root, self.now_s = root, 100.0
        self.energy_uj = {"intel-rapl:0": 5_000_000, "intel-rapl:1": RANGE_UJ - 1_000_000}
        for zone, name in (
            *zip(self.energy_uj, ("package-0", "package-1"), strict=True),
            ("intel-rapl:0:0", "core"),  # a part of package 0
            ("intel-rapl:2", "psys"),
        ):
            (root / zone).mkdir(parents=True)
            (root / zone / "name").write_text(f"{name}\n")
            (root / zone / "energy_uj").write_text("7\n")
            (root / zone / "max_energy_range_uj").write_text(f"{RANGE_UJ}\n")
        self.pass_s(0, 0)

    def pass_s(self, seconds: float, watts: float) -> None:
        self.now_s += seconds
        for zone, energy in self.energy_uj.items():
            self.energy_uj[zone] = (energy + round(seconds * watts * 1e6)) % RANGE_UJ
            (self.root / zone / "energy_uj").write_text(f"{self.energy_uj[zone]}\n")


@pytest.fixture
def machine(tmp_path, monkeypatch):
    made = Machine(tmp_path)
    monkeypatch.setattr(counter.time, "perf_counter", lambda: made.now_s)
    monkeypatch.setattr(counter.time, "sleep", lambda seconds: made.pass_s(seconds, 10.0))
    return made


def test_power_is_energy_over_time_of_all_packages(machine):
    calls = []

    def work():
        calls.append(machine.now_s)
        machine.pass_s(0.4, 30.0)

    found = measured_power(work, 4.0, machine.root)
    assert found.idle_w == pytest.approx(20.0), "one counter has started again at 0"
    assert found.running_w == pytest.approx(60.0)
    assert len(calls) == 3, "work of less than a second is repeated"


def test_a_machine_without_a_counter_says_so(tmp_path):
    found = measured_power(lambda: None, 1.0, tmp_path)
    assert found == MeasuredPower(
        None, None, f"this machine has no energy counter of its processor in {tmp_path}"
    )


def test_a_counter_that_cannot_be_read_says_why(machine):
    (machine.root / "intel-rapl:0" / "energy_uj").write_text("none\n")
    found = measured_power(lambda: None, 1.0, machine.root)
    assert found.idle_w is None and found.reason.startswith(f"the energy counter in {machine.root} cannot be")
    (machine.root / "intel-rapl:0" / "energy_uj").unlink()
    assert measured_power(lambda: None, 1.0, machine.root).reason.endswith("No such file or directory")
