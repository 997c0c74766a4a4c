import numpy as np
import pytest

from dse import store
from dse.base.records import Operations, Workload
from dse.measure.hardware.plan import NotApplicable
from dse.measure.hardware.profile import load, names
from dse.show.figures.core_map import CoresFigure
from tests.figure_data import study


def gathered(chip, load):
    runs = [store.work_arrays(load.mapped(lambda counts: np.stack([0 * counts, counts])))]
    return CoresFigure(chip.name, 0).gather(study(chip=chip, read_out=runs))


def workload(*sizes):
    n = len(sizes)
    return Workload(sizes, (False,) * (n - 1), np.array(10.0), np.ones(n), None, 5.0)


def test_layers_are_spread_as_the_chip_places_them():
    net, chip = workload(700, 1500, 10), load("loihi1_silicon")
    found = gathered(chip, net)
    placement = chip.plan(net, chip.ends).placement
    assert found.layers == ("layer 1", "output")
    assert [len(cores) for cores in found.neurons] == list(placement.cores)
    assert [int(cores.sum()) for cores in found.neurons] == [1500, 10]
    assert len(found.neurons[0]) > 1
    assert (found.n_cores, found.on_chip, found.misfits) == (placement.n_cores, 128, ())
    figure = CoresFigure().draw(found)
    cells = {trace.name: trace for trace in figure.data}
    first, output, free = cells.values()
    n_hidden = len(found.neurons[0])
    assert list(cells) == [f"layer 1: {n_hidden}", "output: 1", "free"]
    assert [int(np.isfinite(trace.z).sum()) for trace in figure.data] == [n_hidden, 1, 128 - found.n_cores]
    words = [word for row in output.text for word in row if word]
    assert words == [f"core {n_hidden}: output, 10 of 10 neurons (100%)"]
    assert np.isfinite(first.z[0, :n_hidden]).all()
    assert not free.showlegend
    assert figure.layout.annotations[0].text.startswith(f"{found.n_cores} of 128 cores")


def test_what_does_not_fit_is_drawn_as_if_the_chip_went_on():
    found = gathered(load("loihi1_silicon"), workload(3000, 100_000, 10))
    assert found.n_cores > found.on_chip
    figure = CoresFigure().draw(found)
    assert "free" not in [trace.name for trace in figure.data]
    told = figure.layout.annotations[0].text
    assert "Does not fit: " in told
    assert max(map(len, told.split("<br>"))) <= 60
    assert figure.layout.margin.b > 60


def test_the_range_of_practice_is_told():
    chip = next(chip for name in names() if (chip := load(name)) and _has_range(chip))
    found = gathered(chip, workload(700, 1500, 10))
    assert found.high > found.n_cores
    told = CoresFigure().draw(found).layout.annotations[0].text
    assert f"{found.low} to {found.high}" in told


def _has_range(chip):
    return "practice_weights_per_core" in chip.numbers() and chip.practice_weights_per_core.low > 0


@pytest.mark.parametrize(
    ("name", "load_of"),
    [
        ("mcu_m4", workload(20, 10, 3)),
        ("op_4.6_0.9", workload(20, 10, 3)),
        ("loihi1_silicon", Operations(*5 * [np.array(1.0)])),
    ],
)
def test_hardware_without_cores_and_a_classifier_that_the_chip_cannot_run(name, load_of):
    with pytest.raises(NotApplicable):
        gathered(load(name), load_of)
