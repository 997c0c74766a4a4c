import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from dse.measure.hardware.placement import Architecture, axon_bits, hops, neurons_per_core, place
from dse.measure.hardware.profile import load

LOIHI_1 = load("loihi1_silicon").rules
LOIHI_2 = load("loihi2_scenario").rules
PUBLISHED = (1600, 450, 11)


def net(sizes, recurrent=None, **other):
    return Architecture(tuple(sizes), recurrent or (False,) * (len(sizes) - 1), **other)


def placed(sizes, recurrent=None, rules=LOIHI_1, **other):
    return place(net(sizes, recurrent, **other), rules)


def in_practice(sizes, **other):
    found = placed(sizes, rules=LOIHI_2, **other)
    return found.low, found.high


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
    assert axon_bits(n_targets, bits, LOIHI_1) == 64 * words
    assert axon_bits(n_targets, bits, LOIHI_2) == n_targets * bits  # bytes alone


def test_the_published_network_on_loihi_1():
    # 2^20 / 1600 = 655 bits, 10 words. A: 8 bits, 70 neurons per core. A': 14 bits, 45 neurons per core.
    assert placed(PUBLISHED).cores == (7, 1)
    assert placed(PUBLISHED, delay_bits=6).cores == (10, 1)
    assert placed(PUBLISHED).misfits == ()
    assert (placed(PUBLISHED).low, placed(PUBLISHED).high) == (None, None)
    assert placed((1600, 420, 11)).cores == (6, 1)
    assert placed((1600, 421, 11)).cores == (7, 1)


def test_the_published_network_on_loihi_2():
    # B: 192 KiB / 1600 = 983 bits: 122 neurons of 8 bits, 70 of 14.
    assert placed(PUBLISHED, rules=LOIHI_2).cores == (4, 1)
    assert placed(PUBLISHED, rules=LOIHI_2, delay_bits=6).cores == (7, 1)
    # C: 720 000 / 39 200 = 18.4 and 4950 / 39 200 = 0.1; 720 000 / 17 100 = 42.1. C': times 14 / 8.
    assert in_practice(PUBLISHED) == (20, 44)
    assert in_practice(PUBLISHED, delay_bits=6) == (34, 75)


def test_public_logs_lie_within_the_range():
    assert in_practice((200, 256, 200)) == (4, 6)  # took 3 + 2
    assert in_practice((784, 128, 64, 10)) == (5, 8)  # took 3 + 1 + 1
    assert in_practice((2560, 100, 50, 10, 1)) == (10, 18)  # took 12 + 1 + 1 + 1


def test_68_of_120_cores_needs_a_delay_in_every_synapse():
    low, high = in_practice(PUBLISHED)
    assert not low <= 68 <= high
    plain = placed(PUBLISHED, rules=LOIHI_2)
    assert "no synapse stores an individual delay" in plain.assumptions
    delayed = placed(PUBLISHED, rules=LOIHI_2, delay_bits=6)
    assert delayed.low <= 68 <= delayed.high
    assert (
        "every synapse stores an individual delay, 6 bits beside the 8 of its weight" in delayed.assumptions
    )
    assert any("34 to 75 cores if a core holds 17.1 to 39.2 thousand" in x for x in delayed.assumptions)
    assert plain.misfits == delayed.misfits == ()
    assert LOIHI_2.cores == 120


def test_practice_takes_no_fewer_cores_than_fit():
    # 9000 neurons need 3 cores of 4096, however few their weights.
    found = placed((1, 9000), rules=LOIHI_2)
    assert (found.cores, found.low, found.high) == ((3,), 3, 3)


def test_practice_decides_whether_it_fits():
    # 98 neurons of 2000 bytes fill a core: 21 and 1. In practice 4e6 / 39 200 = 102.04 to 4e6 / 17 100 =
    # 233.9, and for the output 20 000 / 39 200 to 20 000 / 17 100: 103 + 1 to 234 + 2.
    found = placed((2000, 2000, 10), rules=LOIHI_2)
    assert (found.n_cores, found.low, found.high, found.misfits) == (22, 104, 236, ())
    assert "it may not fit: up to 236 cores in practice; the chip has 120" in found.assumptions
    (misfit,) = placed((2000, 2400, 10), rules=LOIHI_2).misfits
    assert misfit.text == "at least 124 cores in practice; the chip has 120"
    # 119 cores x 39 200 / 2000 = 2332 neurons beside one core of output.
    assert "at most 2332 neurons in layer 1" in misfit.change


def test_weights_are_stored_in_the_next_format():
    assert placed(PUBLISHED, weight_bits=7).cores == (7, 1)
    assert placed(PUBLISHED, weight_bits=4).cores == (4, 1)
    (misfit,) = placed((8, 8), weight_bits=9).misfits
    assert str(misfit) == "weights of 9 bits, 8 at most; fits with weights of at most 8 bits"
    (misfit,) = placed((8, 8), delay_bits=7).misfits
    assert (misfit.rule, misfit.change) == ("delay_bits", "delays of at most 6 bits")


def test_a_core_holds_no_more_neurons_than_it_has():
    assert placed((4, 1024)).cores == (1,)
    assert placed((4, 1025)).cores == (2,)


def test_a_recurrent_layer_takes_its_own_axons():
    # 450 + 1600 axons: 1048576 / 2050 = 511 bits, 7 words: 54 targets of 8 bits.
    assert placed(PUBLISHED, (True, False)).cores == (9, 1)


def test_output_axons_limit_the_neurons_of_a_core():
    # The weights of 20 inputs to all 1024 neurons fit one core; the next layer takes 9 (118 neurons each),
    # so at most 4096 / 9 = 455 neurons stay together.
    assert placed((20, 1024, 8)).cores[0] == 1
    assert placed((20, 1024, 1024)).cores == (3, 9)
    assert placed((20, 1024, 1024)).misfits == ()


@pytest.mark.parametrize(
    ("sizes", "rule", "text", "n_cores"),
    [
        ((6084, 10), "input_axons", "layer 1: 6084 input axons, 4096 per core", 1),
        (
            (20000, 10),
            "synapse_memory",
            "layer 1: the weights of one neuron exceed the synapse memory of a core",
            10,
        ),
        ((4096, 10000, 10), "input_axons", "layer 2: 10000 input axons, 4096 per core", 336),
        ((4096, 4096, 11), "cores", "138 cores; the chip has 128", 138),
    ],
)
def test_broken_limits_are_named_and_the_network_is_placed_all_the_same(sizes, rule, text, n_cores):
    found = placed(sizes)
    assert (rule, text) in [(x.rule, x.text) for x in found.misfits]
    assert found.n_cores == n_cores


def test_a_recurrent_layer_can_have_too_many_output_axons():
    # 5300 axons: 3 words, 22 neurons on 228 cores, which all send to all of them and to the output's.
    found = placed((300, 5000, 10), (True, False))
    text = "layer 1: 22 neurons on a core that send to 229 cores each, 4096 output axons per core"
    assert text in [x.text for x in found.misfits]
    assert found.cores == (228, 1)


def change_of(found, rule):
    return next(x.change for x in found.misfits if x.rule == rule)


def number_in(change, pattern):
    """Return the number of an alternative, a whole alternative of the sentence."""
    found = re.search("(?:^| or )" + re.escape(pattern).replace(r"\{\}", r"(\d+)") + "(?: or |$)", change)
    assert found, f"{pattern!r} is not in {change!r}"
    return int(found[1])


def size(layer):
    return lambda x, n: replace(x, sizes=(*x.sizes[:layer], n, *x.sizes[layer + 1 :]))


def bits(x, n):
    return replace(x, weight_bits=n)


def pruned(x, percent):
    return replace(x, stored=tuple(-(-n * (100 - percent) // 100) for n in x.dense))


INPUTS, LAYER_1 = "at most {} inputs", "at most {} neurons in layer 1"
BITS, PRUNED = "weights of at most {} bits", "at least {} % of the weights pruned"


@pytest.mark.parametrize(
    ("sizes", "rules", "rule", "pattern", "apply", "step", "expected"),
    [
        ((6084, 10), LOIHI_1, "input_axons", INPUTS, size(0), 1, 4096),
        # 2^20 bits / 64 per axon of one neuron.
        ((20000, 10), LOIHI_1, "synapse_memory", INPUTS, size(0), 1, 16384),
        # 4 words for each of 4096 axons hold 30 neurons; 127 cores are left beside the output's.
        ((4096, 4096, 11), LOIHI_1, "cores", LAYER_1, size(1), 1, 127 * 30),
        # 33 neurons on a core make 125 cores; they need 5 words, 2^20 / 320 = 3276 axons.
        ((4096, 4096, 11), LOIHI_1, "cores", INPUTS, size(0), 1, 3276),
        ((4096, 4096, 11), LOIHI_1, "cores", BITS, bits, 1, 6),
        ((4096, 4096, 11), LOIHI_1, "cores", PRUNED, pruned, -1, 61),
        ((4096, 4096, 4096, 11), LOIHI_1, "cores", LAYER_1, size(1), 1, 1820),
        # The last layer changes only if nothing else helps: 1024 neurons on each of 128 cores.
        ((1, 140_000), LOIHI_1, "cores", LAYER_1, size(1), 1, 128 * 1024),
        ((2000, 2400, 10), LOIHI_2, "cores", LAYER_1, size(1), 1, 2332),
        ((20000, 10), LOIHI_2, "input_axons", INPUTS, size(0), 1, 16000),
    ],
)
def test_the_smallest_change_fits_and_one_step_less_does_not(
    sizes, rules, rule, pattern, apply, step, expected
):
    change = change_of(placed(sizes, rules=rules), rule)
    n = number_in(change, pattern)
    assert n == expected
    broken = {x.rule for x in place(apply(net(sizes), n), rules).misfits}
    assert rule not in broken
    assert broken < {x.rule for x in placed(sizes, rules=rules).misfits}
    assert rule in {x.rule for x in place(apply(net(sizes), n + step), rules).misfits}


def test_the_least_change_is_told_first():
    change = change_of(placed((4096, 4096, 11)), "cores")
    assert change == (
        "at most 3810 neurons in layer 1 or at most 3276 inputs or weights of at most 6 bits "
        "or at least 61 % of the weights pruned"
    )  # 7 %, 20 %, 25 %, 61 %


def test_pruning_helps_only_where_zeros_are_skipped():
    assert "pruned" not in change_of(placed((2000, 2400, 10), rules=LOIHI_2), "cores")


def test_where_no_single_change_helps():
    # Each of 129 layers takes a core.
    sizes = (2,) * 130
    assert change_of(placed(sizes), "cores") == "more than one change"


@given(
    st.tuples(st.integers(1, 9000), st.integers(1, 9000), st.integers(1, 50)),
    st.booleans(),
    st.sampled_from([LOIHI_1, LOIHI_2]),
)
def test_a_network_with_one_misfit_fits_with_any_of_its_changes(sizes, is_recurrent, rules):
    broken = net(sizes, (is_recurrent, False))
    misfits = place(broken, rules).misfits
    assume(len(misfits) == 1)
    for pattern, apply, step in (
        (INPUTS, size(0), 1),
        (LAYER_1, size(1), 1),
        (BITS, bits, 1),
        (PRUNED, pruned, -1),
    ):
        if (pattern.split("{}")[1]) in misfits[0].change:
            n = number_in(misfits[0].change, pattern)
            assert place(apply(broken, n), rules).misfits == ()
            assert place(apply(broken, n + step), rules).misfits != ()


def test_cores_by_hand_are_taken_as_given():
    found = placed(PUBLISHED, cores=(9, 2))
    assert (found.cores, found.misfits) == ((9, 2), ())
    assert found.assumptions == ("the number of cores of each layer is set by the user",)
    by_hand = placed(PUBLISHED, rules=LOIHI_2, cores=(60, 8))
    assert (by_hand.n_cores, by_hand.low, by_hand.high) == (68, None, None)


def test_a_core_that_overflows_by_hand_is_a_misfit():
    # 450 neurons on 3 cores are 150; a core holds 70 and so 7 cores hold all.
    (misfit,) = placed(PUBLISHED, cores=(3, 1)).misfits
    assert misfit.rule == "synapse_memory"
    assert misfit.text == "layer 1: 150 neurons on a core, which holds 70 of them"
    assert misfit.change.startswith("at least 7 cores for layer 1 or ")
    assert "at most 210 neurons in layer 1" in misfit.change
    assert placed(PUBLISHED, cores=(7, 1)).misfits == ()
    assert placed(PUBLISHED, cores=(6, 1)).misfits != ()

    (misfit,) = placed((2, 1025, 4), cores=(1, 1)).misfits
    assert (misfit.rule, misfit.text) == (
        "neurons",
        "layer 1: 1025 neurons on a core, which holds 1024 of them",
    )
    assert "at least 2 cores for layer 1" in misfit.change
    (misfit,) = placed((2, 1024, 8), cores=(1, 5)).misfits
    assert misfit.rule == "output_axons"
    assert number_in(misfit.change, "at least {} cores for layer 1") == 2  # 512 neurons send to 5 cores
    assert number_in(misfit.change, "at most {} cores for layer 2") == 4  # 1024 to 4
    (misfit,) = placed(PUBLISHED, cores=(200, 1)).misfits
    assert misfit.rule == "cores"
    assert number_in(misfit.change, "at most {} cores for layer 1") == 127


def test_one_neuron_and_one_input():
    for rules in (LOIHI_1, LOIHI_2):
        found = placed((1, 1), rules=rules)
        assert (found.cores, found.misfits) == ((1,), ())
        assert hops(net((1, 1)), found.cores, rules) == ((0, 0), (0, 0))


def test_a_layer_wider_than_a_chip():
    # 137 cores of 1024 neurons; nothing but fewer neurons helps.
    found = placed((1, 140_000))
    assert found.cores == (137,)
    (misfit,) = found.misfits
    assert str(misfit) == "137 cores; the chip has 128; fits with at most 131072 neurons in layer 1"


def test_messages_travel_between_tiles():
    # Tiles of 4 cores: hidden on tiles 0 and 1 (7 cores), output core 7 on tile 1, next along y.
    found = hops(net(PUBLISHED), (7, 1), LOIHI_1)
    assert found[0] == (0, 3)  # to the three hidden cores of tile 1
    assert found[1] == pytest.approx((0, (65 + 65 + 64 + 64) / 450))  # from the four cores of tile 0
    assert found[2] == (0, 0)


def test_a_recurrent_layer_sends_to_itself():
    # 9 cores on tiles 0 0 0 0 1 1 1 1 2, output on tile 2.
    found = hops(net(PUBLISHED, (True, False)), (9, 1), LOIHI_1)
    assert found[0] == (0, 4 + 2)
    to_all = np.array([4 + 2 * 2] * 4 + [4 + 2] * 4 + [2 * 4 + 4])
    assert found[1][1] == pytest.approx((neurons_per_core(450, 9) * to_all).sum() / 450)


@given(
    st.lists(st.integers(1, 300), min_size=2, max_size=4),
    st.lists(st.booleans(), min_size=3, max_size=3),
    st.lists(st.integers(1, 40), min_size=3, max_size=3),
)
def test_hops_are_those_of_every_neuron_and_core(sizes, recurrent, cores):
    n = len(sizes) - 1
    cores = tuple(min(a, b) for a, b in zip(cores[:n], sizes[1:], strict=True))
    one = net(sizes, tuple(recurrent[:n]))
    ends = np.cumsum((0, *cores))

    def tiles(layer):
        return np.arange(ends[layer - 1], ends[layer]) // 4 if layer else np.zeros(1, int)

    for layer, found in enumerate(hops(one, cores, LOIHI_1)):
        weight = neurons_per_core(sizes[layer], len(tiles(layer))) / sizes[layer]
        to = [tiles(layer + 1)] if layer < n else []
        to += [tiles(layer)] if layer and one.recurrent[layer - 1] else []
        far = [
            sum(
                w * abs(at(a) - at(b))
                for w, a in zip(weight, tiles(layer), strict=True)
                for b in np.concatenate([*to, []])
            )
            for at in (lambda tile: tile // 4, lambda tile: tile % 4)
        ]
        assert found == pytest.approx(tuple(far))


def test_a_pruned_layer_stores_lists_of_what_is_left():
    # 1600 axons: 655 bits each, 10 words. A tenth of 450 neurons: 45 targets of 8 + 10 bits, 13 words. Two
    # cores hold 225 neurons each: 23 targets (22.5), 7 words.
    found = placed(PUBLISHED, stored=(160 * 450, 450 * 11))
    assert found.cores == (2, 1)
    assert found.assumptions == (
        "the weights that remain after pruning are spread evenly, each stored with the 10 bits of its "
        "target's index",
    )
    # Nothing removed: the dense format. Little removed: its indices take more than the weights that are gone.
    assert placed(PUBLISHED, stored=(1600 * 450, 450 * 11)).cores == (7, 1)
    assert placed(PUBLISHED, stored=(1600 * 450 - 1, 450 * 11)).cores > (7, 1)


def test_axons_without_a_target_take_no_memory():
    # 20000 axons of one neuron do not fit; with a weight on every hundredth, 200 words do.
    assert "synapse_memory" in [x.rule for x in placed((20000, 10)).misfits]
    found = placed((20000, 10), stored=(2000,))
    assert found.cores == (1,)
    assert [x.rule for x in found.misfits] == ["input_axons"]
    assert placed((20, 30), stored=(0,)).cores == (1,)


@given(
    st.integers(1, 3000),
    st.integers(1, 1024),
    st.sampled_from([1, 5, 8, 14]),
    st.floats(0.0001, 1),
    st.sampled_from([LOIHI_1, LOIHI_2]),
)
def test_a_core_is_as_full_as_can_be(axons, neurons, weight_bits, share, rules):
    """By the plain definition: so many neurons fit a core if the memory of their axons' targets does."""
    weight_bits = min(weight_bits, 8)
    stored = max(1, int(share * axons * neurons))
    one = net(
        (axons, neurons), weight_bits=weight_bits, stored=(stored,) if rules.skips_zero_weights else None
    )
    width = weight_bits
    part = 1.0
    if one.stored and stored < axons * neurons:
        width, part = weight_bits + rules.synapse_index_bits, stored / (axons * neurons)

    def taken(n):
        targets = part * n
        whole = max(1, int(np.ceil(targets - 1e-9)))
        return axons * min(targets, 1.0) * axon_bits(whole, width, rules)

    (n_cores,) = place(one, rules).cores
    per_core = -(-neurons // n_cores)
    assert per_core == 1 or taken(per_core) <= rules.synapse_memory_bits * (1 + 1e-9)
    if n_cores > 1:  # one core less would overflow it
        more = -(-neurons // (n_cores - 1))
        assert taken(more) > rules.synapse_memory_bits * (1 - 1e-9) or more > rules.neurons_per_core
