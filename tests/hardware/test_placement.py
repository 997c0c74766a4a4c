import numpy as np
import pytest

from dse.hardware.placement import axon_bits, hops, neurons_per_core, place
from dse.hardware.profile import load

LIMITS = load("loihi1_silicon").at("value")


def cores(sizes, recurrent=None, bits=8):
    return place(sizes, recurrent or (False,) * (len(sizes) - 1), bits, LIMITS)


@pytest.mark.parametrize(
    ("n_targets", "bits", "words"),
    [
        (1, 8, 1),
        (6, 8, 1),
        (7, 8, 2),
        (64, 8, 9),
        (65, 8, 10),
        (70, 8, 10),
        (71, 8, 11),
        (128, 8, 18),
        (45, 14, 10),
    ],
)
def test_an_axon_takes_words_per_block_of_64_targets(n_targets, bits, words):
    assert axon_bits(n_targets, bits) == 64 * words


def test_the_published_network_takes_eight_cores():
    # hardware notes, section 6, case A: 70 neurons per core, so 7 cores, and 1 for the output.
    assert cores((1600, 450, 11)).cores == (7, 1)
    assert cores((1600, 420, 11)).cores == (6, 1)
    assert cores((1600, 421, 11)).cores == (7, 1)
    assert cores((1600, 450, 11)).misfits == ()


def test_weights_are_stored_in_the_next_format():
    assert cores((1600, 450, 11), bits=7).cores == (7, 1)
    assert cores((1600, 450, 11), bits=4).cores == (4, 1)
    assert "weights of 9 bits, 8 at most" in cores((8, 8), bits=9).misfits


def test_a_core_holds_no_more_neurons_than_it_has():
    assert cores((4, 1024)).cores == (1,)
    assert cores((4, 1025)).cores == (2,)


def test_a_recurrent_layer_takes_its_own_axons():
    # 450 + 1600 axons: 1048576 / 2050 = 511 bits, 7 words: 54 targets of 8 bits.
    assert cores((1600, 450, 11), (True, False)).cores == (9, 1)


def test_output_axons_limit_the_neurons_of_a_core():
    # The weights of 20 inputs to all 1024 neurons fit one core; the next layer takes 9 (118 neurons each),
    # so at most 4096 / 9 = 455 neurons stay together.
    assert cores((20, 1024, 8)).cores[0] == 1
    placement = cores((20, 1024, 1024))
    assert placement.cores == (3, 9)
    assert placement.misfits == ()


@pytest.mark.parametrize(
    ("sizes", "message"),
    [
        ((6084, 10), "layer 1: 6084 input axons, 4096 per core"),
        ((20000, 10), "layer 1: the weights of one neuron exceed the synapse memory"),
        ((4096, 10000, 10), "layer 2: 10000 input axons"),
        ((4096, 4096, 11), "cores, the chip has 128"),
    ],
)
def test_broken_limits_are_named_and_the_network_is_placed_all_the_same(sizes, message):
    placement = cores(sizes)
    assert any(message in x for x in placement.misfits)
    assert placement.n_cores >= len(sizes) - 1


def test_neurons_are_spread_evenly():
    assert neurons_per_core(450, 7).tolist() == [65, 65, 64, 64, 64, 64, 64]


def test_messages_travel_between_tiles():
    # Tiles of 4 cores: hidden on tiles 0 and 1 (7 cores), output core 7 on tile 1, next along y.
    found = hops(cores((1600, 450, 11)), (1600, 450, 11), (False, False), LIMITS)
    assert found[0].tolist() == [0, 3]  # to the three hidden cores of tile 1
    assert found[1] == pytest.approx([0, (65 + 65 + 64 + 64) / 450])  # from the four cores of tile 0
    assert found[2].tolist() == [0, 0]


def test_a_recurrent_layer_sends_to_itself():
    sizes, recurrent = (1600, 450, 11), (True, False)
    placement = cores(sizes, recurrent)
    assert placement.cores == (9, 1)  # tiles 0 0 0 0 1 1 1 1 2, output on tile 2
    found = hops(placement, sizes, recurrent, LIMITS)
    assert found[0].tolist() == [0, 4 + 2]
    to_all = np.array([4 + 2 * 2] * 4 + [4 + 2] * 4 + [2 * 4 + 4])
    assert found[1, 1] == pytest.approx((neurons_per_core(450, 9) * to_all).sum() / 450)


def test_far_tiles_lie_along_x_too():
    # 62 neurons per core (8 words for each of 2048 axons): the 17th core is on tile 4, at x = 1, y = 0.
    sizes = (2048, 1026)
    placement = cores(sizes)
    assert placement.cores == (17,)
    assert hops(placement, sizes, (False,), LIMITS)[0].tolist() == [1, 4 * (1 + 2 + 3)]


def test_a_pruned_layer_stores_lists_of_what_is_left():
    # 1600 axons: 655 bits each, 10 words. A tenth of 450 neurons: 45 targets of 8 + 10 bits, 13 words. Two
    # cores hold 225 neurons each: 23 targets (22.5), 7 words.
    sizes, nothing = (1600, 450, 11), (False, False)
    assert place(sizes, nothing, 8, LIMITS).cores == (7, 1)
    assert place(sizes, nothing, 8, LIMITS, (160 * 450, 450 * 11)).cores == (2, 1)
    # Nothing removed: the dense format. Little removed: its indices take more than the weights that are gone.
    assert place(sizes, nothing, 8, LIMITS, (1600 * 450, 450 * 11)).cores == (7, 1)
    assert place(sizes, nothing, 8, LIMITS, (1600 * 450 - 1, 450 * 11)).cores > (7, 1)


def test_axons_without_a_target_take_no_memory():
    # 20000 axons of one neuron do not fit; with a weight on every hundredth, 200 words do.
    assert "layer 1: the weights of one neuron exceed" in " ".join(cores((20000, 10)).misfits)
    found = place((20000, 10), (False,), 8, LIMITS, (2000,))
    assert found.cores == (1,)
    assert found.misfits == ("layer 1: 20000 input axons, 4096 per core",)
    assert place((20, 30), (False,), 8, LIMITS, (0,)).cores == (1,)
