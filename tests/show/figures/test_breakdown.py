from dataclasses import replace

import numpy as np
import pytest

from dse import store
from dse.base.records import Workload
from dse.measure.hardware.cost import cost
from dse.measure.hardware.profile import load
from dse.show.figures import NothingRecorded
from dse.show.figures.breakdown import EnergyFigure
from tests.figure_data import study

CHIP = load("loihi1_silicon")


def gathered(*loads, chip=CHIP, pace="flat"):
    runs = [store.work_arrays(load.mapped(lambda counts: np.stack([0 * counts, counts]))) for load in loads]
    return EnergyFigure(chip.name, 0, pace).gather(study(chip=chip, read_out=runs))


def workload(scale=1.0):
    return Workload(
        (16, 8, 3), (False, False), np.array(100.0), scale * np.array([200.0, 40.0, 10.0]), None, 5.0
    )


def test_parts_add_up_to_the_total():
    priced = cost(CHIP, workload())
    found = gathered(workload())
    assert found.energy_uj == pytest.approx(float(priced.energy_uj.value))
    assert found.dynamic_uj.sum() == pytest.approx(float(priced.dynamic_uj))
    assert found.dynamic_uj.sum() + found.static_uj == pytest.approx(found.energy_uj)
    assert found.energy_uj_low < found.energy_uj < found.energy_uj_high
    assert (np.diff(found.dynamic_uj) <= 0).all() and (found.dynamic_uj > 0).all()


def test_at_the_sensor_s_period_the_static_energy_is_that_of_waiting_too():
    priced = cost(CHIP, workload())
    flat, paced = (gathered(workload(), pace=pace) for pace in ("flat", "period"))
    assert paced.energy_uj == pytest.approx(float(priced.energy_throttled_uj.value))
    assert paced.dynamic_uj.sum() + paced.static_uj == pytest.approx(paced.energy_uj)
    assert paced.static_uj > flat.static_uj and paced.dynamic_uj.tolist() == flat.dynamic_uj.tolist()


def test_repeats_are_averaged():
    once, thrice = (cost(CHIP, workload(scale)) for scale in (1.0, 3.0))
    found = gathered(workload(), workload(3.0))
    assert found.energy_uj == pytest.approx((float(once.energy_uj.value) + float(thrice.energy_uj.value)) / 2)
    assert found.dynamic_uj.sum() == pytest.approx((float(once.dynamic_uj) + float(thrice.dynamic_uj)) / 2)


def test_drawing():
    found = gathered(workload())
    figure = EnergyFigure().draw(found)
    [bars] = figure.data
    names = list(figure.layout.yaxis.ticktext)
    assert names[-2:] == ["static", "total"]
    assert "synaptic event" in names
    assert list(bars.x) == [*found.dynamic_uj, found.static_uj, found.energy_uj]
    assert bars.error_x.array[-1] == found.energy_uj_high - found.energy_uj
    assert bars.error_x.arrayminus[-1] == found.energy_uj - found.energy_uj_low
    assert not any(bars.error_x.array[:-1])
    assert figure.layout.xaxis.title.text == "energy of an inference (µJ)"
    # Numbers stand within the figure, right of what they are of.
    assert all(0 <= note.x < 0.7 for note in figure.layout.annotations)


def test_a_profile_of_intervals_has_a_total_without_a_value():
    chip = replace(CHIP, interval_only=True)
    found = gathered(workload(), chip=chip)
    with pytest.raises(NothingRecorded, match="must have an energy at the sensor's period"):
        gathered(workload(), chip=chip, pace="period")
    assert np.isnan([found.energy_uj, found.static_uj]).all()
    figure = EnergyFigure().draw(found)
    assert list(figure.layout.yaxis.ticktext) == ["total"]
    [bars] = figure.data
    assert (bars.base[0], bars.base[0] + bars.x[0]) == pytest.approx(
        (found.energy_uj_low, found.energy_uj_high)
    )
    assert "nan" not in figure.to_json().lower()
