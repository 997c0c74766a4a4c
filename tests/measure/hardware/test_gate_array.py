import dataclasses
from functools import partial

import numpy as np
import pytest

from dse.measure.hardware.cost import NotApplicable, cost
from dse.measure.hardware.profile import load, read
from tests.measure.hardware import loads

network = partial(loads.network, n_steps=1.0)
UP5K, ECP5 = load("ice40_up5k"), load("ecp5_12f")


def cycles(work, chip=UP5K):
    """Cycles per inference: at the value, and at the ends of its interval."""
    times = cost(chip, work).step_time_us
    return [round(float(x) * chip.clock_mhz.value, 9) for x in times]


def test_a_step_by_hand():
    # 30 neurons of 5 cycles; to decide 1, to end 1, 2 words to wipe; 2 words of 2 cycles, hidden or not.
    assert cycles(network((20, 23, 7), [0, 0, 0])) == [158, 154, 158]
    # A spike of an input meets 23 weights, one of the first layer 7, one of an output none.
    assert cycles(network((20, 23, 7), [1, 0, 0])) == [158 + 26 + 4, 154 + 26, 158 + 26 + 15]
    assert cycles(network((20, 23, 7), [0, 2, 3])) == [158 + 20, 154 + 20, 158 + 20]
    assert cycles(network((20, 23, 7), [0, 2, 3], recurrent=(True, False)))[0] == 158 + 2 * 33
    # Of two network steps per input step each takes half of what words take; the others' copy takes 1 cycle.
    two = dataclasses.replace(network((40, 23, 7), [0, 0, 0]), copies=2, steps_per_sample=2)
    assert cycles(two)[0] == 150 + 1 + (1 + 2 + 2 * 2 * 2 + 2) / 2


def test_energy_by_hand():
    # 10 bits for a place among 621 weights and 368 beyond: 550 + 10 x 13.2 + 12 x 4.66 + 21.9 cells.
    found = cost(UP5K, network((20, 23, 7), [0, 0, 0]))
    assert found.assumptions == ("760 cells, 8 blocks of memory and two multipliers",)
    assert found.dynamic_uj == pytest.approx(759.82 * 0.154e-6 * 158)
    at_rest_mw = 0.13 + 12e-3 * (53.6 + 759.82 * 0.061)
    assert found.idle_mw == pytest.approx(at_rest_mw)
    assert found.static_throttled_uj.value == pytest.approx(at_rest_mw * 1.0)  # for 1 ms, computing or not
    assert found.power_w.value == pytest.approx(1e-3 * (at_rest_mw + 12e-3 * 759.82 * 0.154))


def test_blocks_take_their_words_in_any_shape():
    # 4096 bits as 16 x 256 to 2 x 2048; 36 x 512 to 1 x 16384.
    shapes = [
        (256, 16),
        (257, 16),
        (256, 17),
        (2048, 2),
        (2049, 2),
        (512, 8),
        (300, 8),
        (1, 1),
        (0, 8),
        (9, 0),
        (4352, 9),  # 17 parts of 256 words
        (10500, 8),  # 21 of 512 words
        (21624, 8),  # 11 of 2048 words
    ]
    assert [UP5K.divided(*shape)[0] for shape in shapes] == [1, 2, 2, 1, 2, 1, 1, 1, 0, 0, 10, 21, 44]
    assert [ECP5.divided(*shape)[0] for shape in shapes] == [1, 1, 1, 1, 1, 1, 1, 1, 0, 0, 3, 5, 10]
    # Of 36 bits 9 are written together: a part of 12 bits takes 18 of them, and 1 x 16384 fewer blocks.
    assert ECP5.divided(12640, 12)[0] == 9 and ECP5.divided(12640, 12, is_written=True)[0] == 12


def test_a_profile_of_before_has_no_cells_for_choices():
    text = "".join(x for x in ECP5.text.splitlines(True) if not x.startswith(("written", "choice")))
    older = read(text.replace("name: ecp5_12f", "name: older"), "older.yaml")
    assert older.choice_cells is None and older.divided(12640, 12, is_written=True) == ECP5.divided(12640, 12)
    late = dataclasses.replace(network((48, 150, 7), [0, 0, 0]), delay_bits=6)
    cells = [int(cost(chip, late).assumptions[0].split()[0]) for chip in (older, ECP5)]
    choices = sum(
        ECP5.divided(*shape, name == "sums")[1]
        for name, shape in (("sums", (157 << 6, 13)), ("weights", (8250, 14)))
    )
    assert cells[1] - cells[0] == pytest.approx(choices * ECP5.choice_cells.value, abs=1)


def test_what_does_not_fit_says_by_what_and_what_would():
    assert cost(UP5K, network((48, 24, 7), [0, 0, 0])).fits
    [misfit] = cost(UP5K, network((300, 90, 3), [0, 0, 0])).misfits
    assert misfit.rule == "memory_blocks" and misfit.text == "60 blocks of memory, 30 at most"
    assert misfit.change == "12288 weights of 8 bits, what belongs to each included, instead of 27270"
    assert cost(UP5K, network((300, 12288 // 303, 3), [0, 0, 0])).fits
    [misfit] = cost(UP5K, network((3, 3000, 3), [0, 0, 0])).misfits
    assert misfit.change.startswith("fewer neurons: ")
    # Where the other memories alone are too many, no number of weights would fit.
    [misfit] = cost(UP5K, network((1000, 3000, 3), [0, 0, 0])).misfits
    assert misfit.change == "fewer neurons: 39 are for states"
    assert not cost(ECP5, network((300, 300, 3), [0, 0, 0])).fits
    assert cost(ECP5, network((300, 90, 3), [0, 0, 0])).fits
    # Delays of synapses lengthen every weight, and hold sums of later steps.
    late = dataclasses.replace(network((48, 150, 7), [0, 0, 0]), delay_bits=4)
    assert not cost(UP5K, late).fits and cost(UP5K, dataclasses.replace(late, delay_bits=0)).fits
    # Copies of the inputs hold those of the steps before.
    long = dataclasses.replace(network((64, 100, 7), [0, 0, 0]), copies=4, n_slots=4000)
    assert not cost(UP5K, long).fits and cost(UP5K, dataclasses.replace(long, n_slots=20)).fits
    small = read(UP5K.text.replace("5280", "600").replace("name: ice40_up5k", "name: small"), "small.yaml")
    [misfit] = cost(small, network((20, 23, 7), [0, 0, 0])).misfits
    assert (misfit.rule, misfit.text) == ("cells", "760 logic cells, 600 at most")


def test_a_row_holds_its_weights_of_0_until_lists_of_the_others_take_fewer_bits():
    whole = network((48, 24, 7), [9, 5, 1])
    most = dataclasses.replace(whole, stored=(900, 150), synapses=(18.75, 6.25, 0.0))
    assert cycles(most) == cycles(whole)
    assert cost(UP5K, most).assumptions == cost(UP5K, whole).assumptions
    # 120 weights of 8 bits and 5 for their neuron, and where each of 79 lists begins: 2 blocks in place of 3.
    few = dataclasses.replace(whole, stored=(96, 24), synapses=(2.0, 1.0, 0.0))
    assert cycles(whole)[0] - cycles(few)[0] == 9 * (24 - 2 - 3) + 5 * (7 - 1 - 3)
    blocks = [int(cost(UP5K, work).assumptions[0].split(", ")[1].split()[0]) for work in (whole, few)]
    assert blocks[0] - blocks[1] == 1
    many = network((12_000, 90, 3), [0, 0, 0])
    assert not cost(UP5K, many).fits
    [misfit] = cost(UP5K, dataclasses.replace(many, stored=(400, 90))).misfits
    assert misfit.change.startswith("fewer channels, copies of them or neurons: ")


def test_resonators_are_none_of_its_neurons():
    with pytest.raises(NotApplicable, match="ice40_up5k cannot run resonators"):
        cost(UP5K, dataclasses.replace(network((20, 23, 7), [0, 0, 0]), resonators=(3, 0)))


@pytest.mark.parametrize("key", ["steps_per_sample", "n_slots"])
def test_a_load_without_a_step_is_none(key):
    with pytest.raises(ValueError, match=f"{key} must be >= 1, got 0"):
        dataclasses.replace(network((3, 3), [0, 0]), **{key: 0}).check()


def test_every_step_costs_alike():
    work = network((20, 23, 7), np.array([[1.0, 2, 3], [0, 0, 0]]), n_steps=np.array([1.0, 1.0]))
    assert cost(UP5K, work).hardware_latency_ms * 12e3 == pytest.approx([188 + 20, 158])
