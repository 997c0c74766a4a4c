"""Every registered sampler keeps the contract of `dse.search.proposals.Sampler`."""

import dataclasses

import pytest

from dse.base import registry, seeds
from dse.config import load_space
from dse.search import proposals
from dse.search.limits import Exclusion
from dse.search.proposals import limited
from dse.search.space import at
from tests import families
from tests.spaces import grid, write_space

NAMES = sorted(registry.known("search.samplers"))
# The Gaussian process takes seconds per design; it has a test of its own below.
OPEN = [name for name in NAMES if name not in ("grid", "gp")]
DIRECTIONS = ("max", "min")
BATCH = 4
# Few random designs, so that the models behind the samplers are asked as well.
OPTIONS = {"tpe": {"startup": 4}, "nsga2": {"population": 4}, "nsga3": {"population": 4}}


def space_of(folder, *changes, sampler="tpe", batch=BATCH, seed=3):
    path = write_space(
        folder, *changes, ("sampler: grid, batch: 2", f"sampler: {sampler}, n_trials: 99, batch: {batch}")
    )
    return load_space(path, {"seed": str(seed)})


@pytest.fixture
def open_space(tmp_path):
    """A space with an unordered choice, an integer grid, a real and a logarithmic range."""
    changes = (
        ("true_rate: 0.8", "true_rate: {range: [0.5, 0.9]}"),
        ("epochs: 1", "epochs: {range: [1, 1000], log: true}"),
    )
    return space_of(tmp_path, *changes)


@pytest.fixture
def small_space(tmp_path):
    return space_of(tmp_path)


def start(name, space):
    cls = registry.known("search.samplers")[name]
    sampler = cls(**OPTIONS.get(name, {})).start(space, DIRECTIONS)
    return sampler


def measured(designs):
    """Return two objectives that pull apart; some designs fail."""
    values = []
    for design in designs:
        if "encoder.kind" in design:
            size = design.get("model.wide_of_a_test.width", 10 * design.get("model.near_of_a_test.k", 1))
            gain, fails = design["training.epochs"], size == 30
        else:
            size, gain = design["model.hidden"], design.get("model.true_rate", 0.7)
            fails = size == 12 and len(design["encoder.thresholds"]) == 3
        values.append(None if fails else (size * gain, float(size)))
    return values


def played(sampler, batches):
    history = []
    for _ in range(batches):
        designs = sampler.ask(BATCH)
        history += designs
        sampler.tell(designs, measured(designs))
    return history


@pytest.mark.parametrize("kinds", [False, True], ids=["one kind", "several kinds"])
@pytest.mark.parametrize("name", OPEN)
def test_designs_lie_on_their_axes_never_repeat_and_are_those_of_a_resumed_study(name, kinds, request):
    space = request.getfixturevalue("mixed" if kinds else "open_space")
    whole = played(start(name, space), 4)
    assert len(set(map(seeds.design_key, whole))) == len(whole) == 4 * BATCH
    for design in whole:
        assert set(design) == set(space.active(design))
        space.resolve(design)
    for known in (0, BATCH, 3 * BATCH):
        resumed = start(name, space)
        for first in range(0, known, BATCH):
            batch = whole[first : first + BATCH]
            resumed.tell(batch, measured(batch))
        assert resumed.ask(BATCH) == whole[known : known + BATCH]


@pytest.mark.parametrize("name", OPEN)
def test_a_batch_that_was_asked_in_part_is_asked_again(name, open_space):
    """A process that died while a batch was being written down asks for the same designs."""
    assert start(name, open_space).ask(2) == start(name, open_space).ask(BATCH)[:2]


@pytest.mark.parametrize("name", ["grid", *OPEN])
def test_a_finite_space_is_asked_to_its_end(name, small_space):
    sampler = start(name, small_space)
    designs = played(sampler, 2)
    assert sorted(map(seeds.design_key, designs)) == sorted(map(seeds.design_key, grid(small_space)))
    assert sampler.ask(BATCH) == []


@pytest.mark.parametrize("name", ["grid", *OPEN])
def test_designs_that_cannot_meet_limits_are_passed_over(name, small_space):
    def check(design):
        return Exclusion("too large", ()) if design["model.hidden"] > 8 else None

    def started():
        return limited(start(name, small_space), check)

    sampler = started()
    first = sampler.ask(3)
    refused = list(sampler.refused)
    assert {d["model.hidden"] for d in first} <= {4, 8}
    assert all(design["model.hidden"] == 12 for design, _ in refused)
    resumed = started()
    for one in (sampler, resumed):
        for design, _ in refused:
            one.tell([design], [None])
        one.tell(first, [(0.5, float(d["model.hidden"])) for d in first])
    rest = sampler.ask(BATCH)
    assert resumed.ask(BATCH) == rest
    everything = [d for d in grid(small_space) if d["model.hidden"] <= 8]
    assert sorted(map(seeds.design_key, first + rest)) == sorted(map(seeds.design_key, everything))
    assert sampler.ask(BATCH) == []


def test_a_sampler_that_knows_no_limits_is_asked_until_it_meets_them(small_space):
    class Plain:
        def __init__(self):
            self.inner = start("grid", small_space)

        def ask(self, n):
            return self.inner.ask(n)

        def tell(self, designs, values):
            self.inner.tell(designs, values)

    sampler = limited(Plain(), lambda design: None if design["model.hidden"] == 12 else Exclusion("no", ()))
    assert [d["model.hidden"] for d in sampler.ask(99)] == [12, 12]
    assert len(sampler.refused) == 4


def test_the_grid_goes_row_by_row(small_space):
    sampler = start("grid", small_space)
    assert sampler.ask(2) + sampler.ask(99) == grid(small_space)


def test_the_grid_skips_what_was_told(small_space):
    sampler = start("grid", small_space)
    told = [grid(small_space)[0], grid(small_space)[3]]
    sampler.tell(told, measured(told))
    assert sampler.ask(99) == [design for design in grid(small_space) if design not in told]


def test_the_grid_refuses_ranges(open_space):
    with pytest.raises(ValueError, match="the grid sampler needs axes with a choice or a step"):
        start("grid", open_space)


def test_better_values_draw_the_search(tmp_path):
    """With one objective that rises along an axis, later designs lie higher than the first."""
    sampler = registry.known("search.samplers")["tpe"](startup=4).start(one_axis(tmp_path), ("max",))
    rates = []
    for _ in range(6):
        designs = sampler.ask(BATCH)
        rates += [design["model.true_rate"] for design in designs]
        sampler.tell(designs, [(rate,) for rate in rates[-len(designs) :]])
    assert sum(rates[-8:]) / 8 > sum(rates[:8]) / 8 + 0.1


def one_axis(folder):
    space = space_of(
        folder, ("0.8", "{range: [0.1, 0.9]}"), ("[accuracy:max, n_weights:min]", "[accuracy:max]")
    )
    return dataclasses.replace(space, axes={"model.true_rate": space.axes["model.true_rate"]})


def test_evolution_replays_its_generations(open_space):
    """Rebuilt from its history, NSGA-II asks what it would have asked in a study that was never stopped."""
    import optuna

    ours = played(start("nsga2", open_space), 6)
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    study = optuna.create_study(directions=["maximize", "minimize"])
    distributions = {axis.name: proposals._distribution(axis) for axis in open_space.axes.values()}
    theirs = []
    while len(theirs) < len(ours):
        seed = int(seeds.generator(open_space.seed, {}, "sampler", len(theirs)).integers(2**31))
        study.sampler = optuna.samplers.NSGAIISampler(population_size=4, seed=seed)
        batch = []
        while len(batch) < BATCH:
            trial = study.ask(distributions)
            axes = open_space.axes.values()
            design = {axis.name: proposals._to_value(axis, trial.params[axis.name]) for axis in axes}
            if design in theirs or design in [other for _, other in batch]:
                study.tell(trial, state=optuna.trial.TrialState.FAIL)
            else:
                batch.append((trial, design))
        for trial, design in batch:
            (value,) = measured([design])
            study.tell(trial, value, state=optuna.trial.TrialState.FAIL if value is None else None)
        theirs += [design for _, design in batch]
    assert ours == theirs
    generations = {trial.system_attrs.get("NSGAIISampler:generation") for trial in study.trials}
    assert len(generations) > 3


def test_the_gaussian_process_resumes(tmp_path):
    space = one_axis(tmp_path)
    told = [{"model.true_rate": rate} for rate in (0.2, 0.5, 0.8)]
    asked = []
    for _ in range(2):
        sampler = registry.known("search.samplers")["gp"](startup=2).start(space, ("max",))
        sampler.tell(told, [(0.1,), (0.9,), None])
        asked.append(sampler.ask(1))
    assert asked[0] == asked[1]
    assert asked[0][0] not in told
    assert 0.1 <= asked[0][0]["model.true_rate"] <= 0.9


def test_sobol_points_fill_every_axis(tmp_path):
    (rate,) = one_axis(tmp_path).axes
    designs = start("sobol", one_axis(tmp_path)).ask(16)
    cells = sorted(int((design[rate] - 0.1) / 0.05) for design in designs)
    assert cells == list(range(16))  # one point in each sixteenth; random ones leave a third empty


def test_not_a_number_counts_as_failed(open_space):
    sampler = start("tpe", open_space)
    for values in ((float("nan"), 1.0), (float("inf"), 1.0)):
        designs = sampler.ask(1)
        sampler.tell(designs, [values])
    assert len(sampler.ask(2)) == 2


def test_failed_designs_are_not_asked_again(small_space):
    sampler = start("tpe", small_space)
    first = sampler.ask(BATCH)
    sampler.tell(first, [None] * BATCH)
    assert all(design not in first for design in sampler.ask(2))


@pytest.fixture
def known():
    families.register()


def families_of(folder, *changes, seed=3):
    search = ("sampler: grid, batch: 4", f"sampler: tpe, n_trials: 99, batch: {BATCH}")
    return load_space(write_space(folder, search, *changes, text=families.SPACE), {"seed": str(seed)})


@pytest.fixture
def mixed(tmp_path, known):
    """A space in which one kind has open ranges, another one has no axis, and the encoder is a choice too."""
    open_ranges = "width: {range: [2, 90], log: true}\n      gain: {range: [0.5, 2.0]}"
    return families_of(
        tmp_path, ("width: {choice: [4, 8, 12]}\n      gain: {range: [0.5, 2.0], step: 0.5}", open_ranges)
    )


@pytest.mark.parametrize("name", ["grid", *OPEN])
def test_a_finite_space_of_several_kinds_is_asked_to_its_end(name, tmp_path, known):
    space = families_of(
        tmp_path,
        ("gain: {range: [0.5, 2.0], step: 0.5}", "gain: 1.0"),
        ("name: {choice: [near, far]}", "name: near"),
        ("epochs: {choice: [1, 2]}", "epochs: 1"),
        ("thresholds: {choice: [[1, 2], [1, 2, 4]]}", "thresholds: [1]"),
    )
    sampler = start(name, space)
    designs = []
    while batch := sampler.ask(BATCH):
        sampler.tell(batch, [None if d["model.kind"] == "snn" else (1.0, 2.0) for d in batch])
        designs += batch
    assert space.n_designs == len(designs) == 2 * (1 + 3 + 5)
    assert sorted(map(seeds.design_key, designs)) == sorted(map(seeds.design_key, grid(space)))


def test_where_time_may_end_the_search_families_take_turns_first(tmp_path, known):
    search = "sampler: grid, batch: 4"
    with_time = load_space(
        write_space(tmp_path, (search, f"{search}, stop: {{minutes: 9}}"), text=families.SPACE)
    )
    space = dataclasses.replace(with_time, search=dataclasses.replace(with_time.search, stop=None))
    sampler, whole = start("grid", with_time), grid(space)
    told = whole[::5]
    sampler.tell(told, measured(told))
    designs = sampler.ask(9999)
    kinds = [space.axes["model.kind"].values.index(design["model.kind"]) for design in designs]
    assert kinds == sorted(kinds) and len({*kinds}) == 3
    assert len({design["encoder.kind"] for design in designs if design["model.kind"] == "snn"}) == 2
    assert sorted(map(seeds.design_key, designs + told)) == sorted(map(seeds.design_key, whole))
    assert all(design in whole and [*design] == [*whole[whole.index(design)]] for design in designs)


@pytest.mark.parametrize("name", OPEN)
def test_a_kind_without_axes_does_not_end_an_open_search(name, tmp_path, known):
    """What a sampler likes best may be used up long before the space is."""
    space = families_of(
        tmp_path,
        ("gain: {range: [0.5, 2.0], step: 0.5}", "gain: {range: [0.5, 2.0]}"),
        ("epochs: {choice: [1, 2]}", "epochs: 1"),
        ("thresholds: {choice: [[1, 2], [1, 2, 4]]}", "thresholds: [1]"),
    )
    sampler = start(name, space)
    keys = set()
    for _ in range(4):
        designs = sampler.ask(BATCH)
        assert len(designs) == BATCH
        keys |= set(map(seeds.design_key, designs))
        sampler.tell(designs, [(float(d["model.kind"] == "snn"), 1.0) for d in designs])
    assert len(keys) == 4 * BATCH


@pytest.mark.parametrize("name", ["tpe", "nsga2"])
def test_the_search_learns_kind_and_its_axes(name, mixed):
    """Where one kind is best and rises along an axis of its own, later designs are of it and higher."""
    sampler = registry.known("search.samplers")[name](**OPTIONS[name]).start(mixed, ("max",))
    gains = []
    for _ in range(10):
        designs = sampler.ask(BATCH)
        gains += [design.get("model.wide_of_a_test.gain", 0.0) for design in designs]
        sampler.tell(designs, [(gain,) for gain in gains[-len(designs) :]])
    assert sum(gains[-16:]) / 16 > sum(gains[:16]) / 16 + 0.5
    assert sum(gain >= 0.5 for gain in gains[-16:]) >= 13  # of that kind


def test_a_gene_of_another_kind_belongs_to_the_design(mixed):
    """What evolution sees on an axis that a design lacks does not depend on when it looks."""
    one, other = (
        proposals.OptunaSampler(mixed, DIRECTIONS, lambda seed: None, replay=BATCH) for _ in range(2)
    )
    design = {"encoder.kind": "loud_of_a_test", "model.kind": "snn", "training.epochs": 1}
    found = one._parameters(design)
    assert found == other._parameters(design)
    assert list(found) == list(mixed.axes)
    assert found != one._parameters({**design, "training.epochs": 2}) | {"training.epochs": 0}
    assert 2 <= found["model.wide_of_a_test.width"] <= 90
    assert 0.5 <= found["model.wide_of_a_test.gain"] <= 2


def test_draws_reach_both_ends_of_an_integer_axis(mixed):
    rng = seeds.generator(0, {}, "test")
    width = dataclasses.replace(mixed.axes["model.wide_of_a_test.width"], low=2, high=4)
    drawn = [at(width, rng.random()) for _ in range(3000)]
    assert all(type(value) is int for value in drawn)
    # On a logarithmic scale a number has the share of [n - 1/2, n + 1/2]: log(5/3), log(7/5), log(9/7).
    shares = [drawn.count(value) / 3000 for value in (2, 3, 4)]
    assert shares == pytest.approx([0.465, 0.306, 0.229], abs=0.03)
