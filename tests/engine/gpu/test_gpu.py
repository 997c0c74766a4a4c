"""The GPU engine in Triton's interpreter against the equations, automatic differentiation and the CPU engine.

On a machine with a CUDA device the test marked `gpu` runs this file once more, on the device.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from benchmarks.ours import rows_of
from dse.engine import cpu
from dse.engine import gpu as engine
from dse.engine.autograd import gradients as by_autograd
from dse.engine.layers import weights
from dse.engine.losses.count_cross_entropy import CountCrossEntropy
from dse.engine.member import Engine, Masters, Member, Report, TrainedLayer, Turn
from dse.engine.network import gradients as on_cpu
from dse.models.snn.family import SNN
from dse.models.training import FitRequest, Training
from dse.neurons import LayerSpec, cuba_lif, fixed_point
from dse.neurons.calculus import NumpyCalculus
from dse.neurons.resonator import Resonator
from dse.neurons.surrogate import exponential
from dse.records import Arithmetic, Outcome
from tests.models.snn.toy import rngs, toy

# Triton asks for this variable when it is imported and when a kernel starts; no other test is to see it.
INTERPRET = "TRITON_INTERPRET", os.environ.get("TRITON_INTERPRET", "1")
with pytest.MonkeyPatch.context() as patch:
    patch.setenv(*INTERPRET)
    pytest.importorskip("triton", reason="triton is not installed: make test-gpu")
    from dse.engine.gpu import numbers, scans, wide
    from dse.engine.gpu.layout import WIDTH, columns, matrix, panel, stages
    from dse.engine.gpu.weights import Stretch, weights_of

pytestmark = pytest.mark.skipif(
    not numbers.INTERPRETED and not torch.cuda.is_available(),
    reason="no CUDA device, TRITON_INTERPRET is not 1",
)

N, T, INPUTS = 5, 6, 12
GRADIENT_ERROR: dict[Arithmetic, float] = {"integer": 1e-5, "float32": 2e-6, "ideal": 1e-12}
"""Largest error of a gradient, as a share of its matrix's largest entry."""
PRODUCT_ERROR: dict[Arithmetic, float] = {"integer": 0.0, "float32": 1e-6, "ideal": 1e-14}
"""Largest error of a layer's weighted input, as a share of the largest one."""


def member(
    sizes: Sequence[int],
    seed: int,
    *,
    arithmetic: Arithmetic = "integer",
    ring: bool = False,
    cut: float = 0.0,
    true_rate: float = 0.6,
    clip_norm: float | None = None,
) -> Member:
    """Return a network of some layer sizes with decays, weights and units of its own."""
    rng = np.random.default_rng(seed)
    layers = []
    for depth, (n_in, n_out) in enumerate(pairwise(sizes)):
        has_ring = ring and depth < len(sizes) - 2
        layers.append(
            TrainedLayer(
                rng.normal(0.15, 0.5, (n_in, n_out)).astype(np.float32),
                rng.normal(0, 0.4, (n_out, n_out)).astype(np.float32) if has_ring else None,
                cuba_lif.Population(
                    rng.integers(0, 4097, n_out).astype(np.int32),
                    rng.integers(0, 4097, n_out).astype(np.int32),
                    80,
                ),
                exponential(80 / 64, 0.02 * (1 + depth), 3.0, cut),
                rng.uniform(0.5, 1.0, n_out).astype(np.float32),
                rng.uniform(0.5, 1.0, n_out).astype(np.float32) if has_ring else None,
            )
        )
    return Member(tuple(layers), true_rate, 0.05, arithmetic, clip_norm)


def resonating(of: Member, share: float, *, reset: bool = False) -> Member:
    """Return a member whose hidden neurons resonate, or some of them."""
    neuron = Resonator(share=share, period=(3, 12), reset=reset, current_decay=(0.1, 0.9))

    def population(layer: TrainedLayer) -> Any:
        spec = LayerSpec(layer.feed_forward.shape[1], False, 1, 1.0)
        return neuron.population(spec, np.random.default_rng(0))

    hidden = (replace(layer, population=population(layer)) for layer in of.layers[:-1])
    return replace(of, layers=(*hidden, of.layers[-1]))


def gains_of(of: Member, n: int, seed: int) -> tuple[np.ndarray | None, ...]:
    """Return dropout of half of the hidden neurons, twice as strong where they are kept, and of inputs."""
    rng = np.random.default_rng(seed)
    hidden = [x.feed_forward.shape[1] for x in of.layers[:-1]]
    of_inputs = np.full((n, 1), 1.25, np.float32)
    return (of_inputs, *((rng.random((n, h)) < 0.5).astype(np.float32) * np.float32(2) for h in hidden))


MEMBERS = (
    member((INPUTS, 9, 4), 1),
    member((INPUTS, 70, 5, 4), 2, true_rate=0.8, clip_norm=1e-3, cut=0.3),
    member((INPUTS, 6, 5, 4), 3, ring=True),
    member((INPUTS, 66, 4), 4, ring=True),
    member((INPUTS, 5, 4), 5, arithmetic="float32"),
    member((INPUTS, 9, 4), 6, arithmetic="ideal", ring=True),
    replace(member((INPUTS, 70, 5, 4), 9), loss=CountCrossEntropy(), hidden_spike_penalty=0.02),
    replace(member((INPUTS, 6, 4), 10, ring=True), loss=CountCrossEntropy(0.4, 3), hidden_spike_penalty=0.1),
)
NAMES = (
    "integer",
    "integer, two hidden layers",
    "recurrent, two hidden layers",
    "recurrent",
    "float32",
    "ideal, recurrent",
    "cross-entropy, hidden spikes penalised",
    "cross-entropy at three lengths, recurrent, hidden spikes penalised",
)
RESONATORS = (
    resonating(member((INPUTS, 70, 9, 4), 11), 0.5, reset=True),
    resonating(member((INPUTS, 20, 4), 12, ring=True), 1.0),
    resonating(member((INPUTS, 9, 4), 13, arithmetic="float32"), 0.4),
    resonating(member((INPUTS, 9, 4), 14, arithmetic="ideal", ring=True), 1.0),
)
X = np.random.default_rng(10).random((N, T, INPUTS)) < 0.3
LABELS = np.array([0, 3, 1, 1, 2])


def turns_of(members: Sequence[Member], n: int = N) -> dict[int, Turn]:
    """Return a turn of each member, with learning rates of their own and dropout in every other one."""
    none: tuple[None, ...] = (None,) * 3
    return {
        k: Turn(0.01 * (k + 1), gains_of(m, n, k) if k % 2 == 0 else none[: len(m.layers)])
        for k, m in enumerate(members)
    }


def matrices(of: Masters) -> list[np.ndarray]:
    return [*of.feed_forward, *(r for r in of.recurrent if r is not None)]


def running(of: Member, masters: Masters) -> list[Any]:
    """Return the layers of a member as they run."""
    rounding = fixed_point.quantise if of.arithmetic == "integer" else np.asarray
    return [
        weights(rounding(w), None if r is None else rounding(r), x.population)
        for w, r, x in zip(masters.feed_forward, masters.recurrent, of.layers, strict=True)
    ]


def start_of(of: Member) -> Masters:
    return Masters(tuple(x.feed_forward for x in of.layers), tuple(x.recurrent for x in of.layers))


def assert_close(found: np.ndarray, expected: np.ndarray, share: float) -> None:
    bound = share * max(np.abs(expected).max(), 1e-30)
    np.testing.assert_allclose(found, expected, rtol=0, atol=bound)


def assert_same(found: Masters, expected: Masters) -> None:
    for a, b in zip(matrices(found), matrices(expected), strict=True):
        np.testing.assert_array_equal(a, b)


def assert_reports_agree(found: Report, expected: Report, share: float) -> None:
    """Losses and counts are exact: a single spike apart would change them."""
    assert found.loss == pytest.approx(expected.loss, rel=1e-12)
    assert (found.correct, found.fired) == (expected.correct, pytest.approx(expected.fired, rel=1e-12))
    assert found.gradient_norm == pytest.approx(expected.gradient_norm, rel=10 * share, abs=1e-12)


@pytest.fixture(scope="module", autouse=True)
def interpreted() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(*INTERPRET)
        yield


@pytest.fixture(scope="module")
def trained(interpreted: None) -> tuple[Any, dict[int, Report]]:
    """A cohort after one step, and its reports."""
    cohort = engine.start(MEMBERS, N, T)
    return cohort, cohort.step(rows_of(X), LABELS, turns_of(MEMBERS))


def test_tiles_hold_every_column_and_come_back() -> None:
    w = np.random.default_rng(0).random((70, 130))
    found = panel(w)
    assert found.shape == (3, 128, WIDTH) and found.sum() == pytest.approx(w.sum())
    np.testing.assert_array_equal(matrix(found, 70, 130), w)
    np.testing.assert_array_equal(columns(w)[1], w[:, 64:128])


def test_products_of_spikes_and_rounded_weights_are_exact() -> None:
    rng = np.random.default_rng(1)
    w = rng.normal(0, 2, (130, 70)).astype(np.float32)
    w[:8, 0] = [1 / 64, 3 / 64, -1 / 64, 254 / 64, 255 / 64, -256 / 64, -258 / 64, -1e30]  # ties and clips
    x = rng.random((1, 150, 130)) < 0.5
    decay = np.zeros(70, np.int32)
    population = cuba_lif.Population(decay, decay, 80)
    layer = replace(MEMBERS[0].layers[0], feed_forward=w, unit=np.ones(70, np.float32), population=population)
    stage = stages([Member((layer,), 1, 0)])[0]
    device = wide.device()
    spikes = wide.dense(rows_of(x), 0, 1, device)
    np.testing.assert_array_equal(matrix(spikes.float().cpu().numpy(), 150, 130), x[0])
    tiles, factor = torch.arange(2, device=device, dtype=torch.int32), torch.ones(2, device=device)
    for arithmetic, share in PRODUCT_ERROR.items():
        kind = numbers.NUMBERS[arithmetic]
        held = weights_of(stage.feed_forward, [w], stage.unit, kind, device)
        held.deploy(tiles)
        z = torch.empty((2, 150, WIDTH), dtype=kind.real, device=device)
        used = fixed_point.quantise(w).astype(np.float64) if kind.integer else w.astype(np.float64)
        deployed = held.running.double().sum(dim=0).cpu().numpy().reshape(2, -1, WIDTH)
        np.testing.assert_array_equal(matrix(deployed, 130, 70), used)
        if not kind.integer:
            used[7, 0] = 0.0
            held.running[:, 7 * WIDTH] = 0.0
        held.product(spikes, z, factor, tiles, Stretch(0, 1, 150), add=False)
        assert_close(matrix(z.double().cpu().numpy(), 150, 70), x[0] @ used, share)


def test_weight_gradients_sum_every_row_of_a_long_batch() -> None:
    rng = np.random.default_rng(3)
    n_rows = 1100
    x, by_z = rng.random((1, n_rows, 70)) < 0.2, rng.normal(0, 1, (n_rows, 30)).astype(np.float32)
    stage, device = stages([member((70, 30), 0)])[0], wide.device()
    spikes = wide.dense(rows_of(x), 0, 1, device)
    tiles, factor = torch.zeros(1, dtype=torch.int32, device=device), torch.full((1,), 0.5, device=device)
    for arithmetic, share in GRADIENT_ERROR.items():
        kind = numbers.NUMBERS[arithmetic]
        held = weights_of(stage.feed_forward, [np.zeros((70, 30), np.float32)], stage.unit, kind, device)
        parts = torch.zeros((kind.n_parts, 1, n_rows, WIDTH), dtype=kind.part, device=device)
        rest = torch.tensor(columns(by_z), device=device).to(kind.real)
        for part in parts:
            part[:] = rest if kind.real is torch.float64 else rest.bfloat16()
            rest -= part
        for times in (1, 2):
            held.by_weight(spikes, parts, factor, tiles, add=times > 1)
            found = held.matrix(held.gradients, 0, 70, 30)
            assert_close(found, times * 0.5 * (x[0].T @ by_z.astype(np.float64)), share)


@pytest.mark.parametrize("turns", [False, True], ids=["CUBA-LIF", "resonators beside CUBA-LIF"])
def test_integer_states_and_spikes_equal_the_definition_at_every_step(turns: bool) -> None:
    rng = np.random.default_rng(2)
    decays = [rng.integers(0, 4097, (1, WIDTH)).astype(np.int32) for _ in range(2)]
    for decay in decays:
        decay[0, :4] = 0, 4096, 1, 4095
    n_steps, n = 12, 6
    z = rng.integers(-200, 220, (n, n_steps, WIDTH)) / np.float32(32)
    z[:, :, 16:32] *= np.float32(1 / 0.9)  # off the grid, as dropout leaves it
    z[:, :, 32:48] *= np.float32(2**18)  # states beyond 32 bits
    z[:, 5:, 48:] = 0
    surrogate = exponential(80 / 64, 0.03, 3.0, cut=0.02)
    device = wide.device()

    def put(values: Any, kind: torch.dtype) -> torch.Tensor:
        return torch.tensor(np.asarray(values)).to(device=device, dtype=kind)

    slope = put(z.reshape(1, -1, WIDTH), torch.float32)
    passed, raw = torch.zeros_like(slope), torch.zeros_like(slope)
    u, v = (torch.zeros((1, n, WIDTH), dtype=torch.int64, device=device) for _ in range(2))
    n_fired, n_sent = (torch.zeros((1, n, WIDTH), dtype=torch.int32, device=device) for _ in range(2))
    population: Any = cuba_lif.Population(decays[0][0], decays[1][0], 80)
    if turns:
        neuron = Resonator(share=0.5, reset=True, period=(2.2, 20), voltage_decay=(0.1, 0.9))
        population = neuron.population(LayerSpec(WIDTH, False, 1, 1.0), rng)
    one, w = np.ones(WIDTH, np.float32), np.zeros((1, WIDTH), np.float32)
    layer = replace(MEMBERS[0].layers[0], feed_forward=w, unit=one, population=population)
    (stage,) = stages([Member((layer,), 1, 0)])
    assert (stage.cross.size > 0) == turns
    calculus = NumpyCalculus("integer")
    state, counts = population.initial_state((n, WIDTH), calculus), np.zeros((n, WIDTH), np.int64)
    for t in range(n_steps):
        scans.scan[(1, 2)](
            slope,
            passed,
            raw,
            u,
            v,
            n_fired,
            n_sent,
            put([0], torch.int32),
            put(np.arange(n * WIDTH) % 2, torch.uint8),
            *(put(x, torch.int32) for x in (stage.keep_u, stage.keep_v, stage.cross)),
            put([80], torch.int32),
            put(np.array(surrogate.exponents(80 / 64))[:, None], torch.float64),
            1,
            n,
            n_steps,
            t,
            t + 1,
            INTEGER=True,
            MASKED=True,
            STEPWISE=True,
            TURNS=turns,
        )
        state, before, fired = population.step(state, z[:, t], calculus)
        counts += fired.astype(np.int64)
        np.testing.assert_array_equal(u[0].cpu(), state[0])
        np.testing.assert_array_equal(v[0].cpu(), state[1])
        of_step = slope.view(n, n_steps, WIDTH)[:, t].cpu().numpy()
        assert_close(of_step, surrogate(before - 80 / 64), 1e-5)
        if t + 1 < n_steps:
            np.testing.assert_array_equal(raw.view(n, n_steps, WIDTH)[:, t + 1].cpu(), fired)
            kept = fired * (np.arange(WIDTH) % 2)
            np.testing.assert_array_equal(passed.view(n, n_steps, WIDTH)[:, t + 1].cpu(), kept)
    np.testing.assert_array_equal(n_fired[0].cpu(), counts)
    np.testing.assert_array_equal(n_sent[0].cpu(), counts - fired)
    assert 0 < counts.mean() < n_steps


@pytest.mark.parametrize("number", range(len(MEMBERS)), ids=NAMES)
def test_gradients_agree_with_automatic_differentiation_and_with_the_cpu(
    trained: tuple[Any, dict[int, Report]], number: int
) -> None:
    of, report = MEMBERS[number], trained[1][number]
    found = trained[0].gradients(number)
    layers, surrogates = running(of, start_of(of)), [x.surrogate for x in of.layers]
    settings: dict[str, Any] = {
        "true_rate": of.true_rate,
        "false_rate": of.false_rate,
        "arithmetic": of.arithmetic,
        "gains": turns_of(MEMBERS)[number].gains,
        "loss": of.loss,
        "hidden_spike_penalty": of.hidden_spike_penalty,
    }
    if not any(s.cut for s in surrogates):  # rounding decides what lies at a cut
        loss, feed_forward, rings = by_autograd(rows_of(X), layers, surrogates, LABELS, **settings)
        assert report.loss == pytest.approx(loss, rel=1e-6)
        for ring in rings[:1]:
            assert_close(found.recurrent[0], ring, GRADIENT_ERROR[of.arithmetic])
        for ours, theirs in zip(found.feed_forward, feed_forward, strict=True):
            assert_close(ours, theirs, GRADIENT_ERROR[of.arithmetic])
    expected = on_cpu(rows_of(X), layers, surrogates, LABELS, **settings)
    assert (report.correct, report.fired) == (expected.correct, pytest.approx(expected.fired, rel=1e-12))
    assert report.loss == pytest.approx(expected.loss, rel=1e-12)
    theirs = [*expected.feed_forward, *(r for r in expected.recurrent if r.size)]
    for ours, its in zip(matrices(found), theirs, strict=True):
        assert_close(ours, its, GRADIENT_ERROR[of.arithmetic])


@pytest.mark.parametrize("number", range(len(MEMBERS)), ids=NAMES)
def test_a_step_is_adam_s(trained: tuple[Any, dict[int, Report]], number: int) -> None:
    of, report, turn = MEMBERS[number], trained[1][number], turns_of(MEMBERS)[number]
    before = matrices(start_of(of))
    passing = [fixed_point.quantise_passes(w) if of.arithmetic == "integer" else 1.0 for w in before]
    steps = [
        g.astype(np.float64) * p for g, p in zip(matrices(trained[0].gradients(number)), passing, strict=True)
    ]
    norm = np.sqrt(sum((g**2).sum() for g in steps))
    assert report.gradient_norm == pytest.approx(norm, rel=1e-6)
    clip = min(1.0, of.clip_norm / norm) if of.clip_norm else 1.0
    units = [x.unit for x in of.layers] + [x.recurrent_unit for x in of.layers if x.recurrent is not None]
    after = matrices(trained[0].masters(number))
    for w, g, unit, found in zip(before, steps, units, after, strict=True):
        moved = turn.learning_rate * unit * clip * g / (np.abs(clip * g) + 1e-8)  # Adam's first step
        np.testing.assert_allclose(found, w - moved, rtol=0, atol=1e-6)
        assert (found != w).any()


def test_several_steps_follow_the_cpu_and_those_without_a_turn_stay() -> None:
    members = [MEMBERS[k] for k in (0, 1, 2, 4)]
    ours, theirs = engine.start(members, N, T), cpu.start(members, N, T)
    for step, (n, live) in enumerate(((N, (0, 1, 2, 3)), (3, (1, 3)), (4, (0, 1)))):
        turns = {k: turn for k, turn in turns_of(members, n).items() if k in live}
        x = np.random.default_rng(step).random((n, T, INPUTS)) < 0.3
        before = [ours.masters(k) for k in range(4)]
        found, expected = (c.step(rows_of(x), LABELS[:n], turns) for c in (ours, theirs))
        assert set(found) == set(live)
        for k in range(4):
            if k not in live:
                assert_same(ours.masters(k), before[k])
                continue
            assert_reports_agree(found[k], expected[k], GRADIENT_ERROR[members[k].arithmetic])
            for a, b in zip(matrices(ours.masters(k)), matrices(theirs.masters(k)), strict=True):
                np.testing.assert_allclose(a, b, rtol=0, atol=1e-4)  # Adam magnifies gradients near 0


def test_resonators_train_as_on_the_cpu_and_change_no_bit_of_cuba_lif_beside_them() -> None:
    members = [MEMBERS[0], *RESONATORS]
    ours, theirs, alone = (
        engine.start(members, N, T), cpu.start(members, N, T), engine.start(MEMBERS[:1], N, T)
    )  # fmt: skip
    turns = turns_of(members)
    for step in range(2):
        x = np.random.default_rng(step).random((N, T, INPUTS)) < 0.3
        reports, expected = (c.step(rows_of(x), LABELS, turns) for c in (ours, theirs))
        assert alone.step(rows_of(x), LABELS, {0: turns[0]})[0] == reports[0]
        for k, of in enumerate(members):
            assert_reports_agree(reports[k], expected[k], 1e-5)
            if not step:
                layers, surrogates = running(of, start_of(of)), [x.surrogate for x in of.layers]
                rates: dict[str, Any] = {"true_rate": of.true_rate, "false_rate": of.false_rate}
                rates |= {"arithmetic": of.arithmetic, "gains": turns[k].gains}
                exact = on_cpu(rows_of(x), layers, surrogates, LABELS, **rates)
                its = [*exact.feed_forward, *(r for r in exact.recurrent if r.size)]
                for a, b in zip(matrices(ours.gradients(k)), its, strict=True):
                    assert_close(a, b, GRADIENT_ERROR[of.arithmetic])
            assert all(fired > 0 for fired in reports[k].fired)
            for a, b in zip(matrices(ours.masters(k)), matrices(theirs.masters(k)), strict=True):
                np.testing.assert_allclose(a, b, rtol=0, atol=1e-4)  # Adam magnifies gradients near 0
    assert_same(ours.masters(0), alone.masters(0))
    before = start_of(members[1]).feed_forward
    assert all((a != b).any() for a, b in zip(ours.masters(1).feed_forward, before, strict=True))


def run(cohort: Engine, turns: Mapping[int, Turn]) -> list[dict[int, Report]]:
    return [cohort.step(rows_of(X[:, :5]), LABELS, turns) for _ in range(2)]


def test_a_member_is_bitwise_the_same_alone_and_beside_others_even_diverging_ones() -> None:
    members = [
        MEMBERS[0],
        MEMBERS[3],
        member((INPUTS, 66, 4), 7, arithmetic="ideal"),
        member((INPUTS, 3, 4), 8, ring=True),
    ]
    turns = turns_of(members)
    turns[2] = replace(turns[2], learning_rate=1e30)
    turns[3] = replace(turns[3], learning_rate=1e3)
    order = [2, 3, 1, 0]
    together = engine.start([members[k] for k in order], N, 5)
    reports = run(together, {place: turns[k] for place, k in enumerate(order)})
    for k in (0, 1):
        alone = engine.start([members[k]], N, 5)
        assert [r[0] for r in run(alone, {0: turns[k]})] == [r[order.index(k)] for r in reports]
        assert_same(together.masters(order.index(k)), alone.masters(0))
    diverged = matrices(together.masters(0))
    assert max(np.abs(w).max() for w in diverged) > 1e29
    assert all(np.isfinite(w).all() for k in (2, 3) for w in matrices(together.masters(k)))


def test_chunks_and_slabs_change_nothing_but_the_order_of_sums(monkeypatch: pytest.MonkeyPatch) -> None:
    members = [*MEMBERS[:2], MEMBERS[7]]
    turns = turns_of(members)
    whole = engine.start(members, N, T)
    first = whole.step(rows_of(X), LABELS, turns)
    monkeypatch.setattr(wide, "CHUNK_ROWS", 3 * T)
    monkeypatch.setattr(wide, "SLAB_BYTES", 1)
    assert wide.slabs(MEMBERS, 100) == [[k] for k in (0, 1, 6, 2, 3, 7, 4, 5)]
    cut = engine.start(members, N, T)
    second = cut.step(rows_of(X), LABELS, turns)
    for k in range(3):
        assert_reports_agree(second[k], first[k], 1e-6)
        for a, b in zip(matrices(cut.gradients(k)), matrices(whole.gradients(k)), strict=True):
            assert_close(a, b, 1e-6)


def test_members_of_one_kind_share_a_slab() -> None:
    assert wide.slabs(MEMBERS, 100) == [[0, 1, 6], [2, 3, 7], [4], [5]]


def test_two_heads_train_as_on_the_cpu() -> None:
    members = [replace(MEMBERS[k], heads=(2, 2)) for k in (0, 2, 7)]
    labels = np.stack([LABELS % 2, 2 + LABELS // 2 % 2], axis=1)
    ours, theirs = engine.start(members, N, 3), cpu.start(members, N, 3)
    turns = turns_of(members)
    soft = np.repeat([[0.7, 0.3, 0.1, 0.9]], len(labels), axis=0)
    turns |= {k: replace(turns[k], soft=soft) for k in (1, 2)}  # they have a teacher
    found, expected = (c.step(rows_of(X[:, :3]), labels, turns) for c in (ours, theirs))
    for k, of in enumerate(members):
        assert_reports_agree(found[k], expected[k], GRADIENT_ERROR[of.arithmetic])
        cpu_gradients = on_cpu(
            rows_of(X[:, :3]),
            running(of, start_of(of)),
            [x.surrogate for x in of.layers],
            labels,
            true_rate=of.true_rate,
            false_rate=of.false_rate,
            arithmetic=of.arithmetic,
            gains=turns[k].gains,
            heads=(2, 2),
            loss=of.loss,
            hidden_spike_penalty=of.hidden_spike_penalty,
            soft=turns[k].soft,
        )
        theirs_ = [*cpu_gradients.feed_forward, *(r for r in cpu_gradients.recurrent if r.size)]
        for a, b in zip(matrices(ours.gradients(k)), theirs_, strict=True):
            assert_close(a, b, GRADIENT_ERROR[of.arithmetic])


def test_pruned_weights_stay_at_0_as_on_the_cpu() -> None:
    members = [MEMBERS[0], member((INPUTS, 5, 4), 7), member((INPUTS, 6, 4), 8, ring=True)]  # two in a slab
    rng = np.random.default_rng(20)
    ours, theirs = engine.start(members, N, 3), cpu.start(members, N, 3)
    turns = turns_of(members)
    kept = {}
    for step in range(2):
        if step == 1:
            for k in (1, 2):
                start = start_of(members[k])
                kept[k] = Masters(
                    tuple(rng.random(w.shape) < 0.5 for w in start.feed_forward),
                    tuple(None if r is None else rng.random(r.shape) < 0.5 for r in start.recurrent),
                )
                ours.prune(k, kept[k])
                theirs.prune(k, kept[k])
        found, expected = (c.step(rows_of(X[:, :3]), LABELS, turns) for c in (ours, theirs))
        for k, of in enumerate(members):
            assert_reports_agree(found[k], expected[k], 10 * GRADIENT_ERROR[of.arithmetic])
    for k in (1, 2):
        for w, stays in zip(matrices(ours.masters(k)), matrices(kept[k]), strict=True):
            assert (w[~stays] == 0).all() and (w[stays] != 0).all()
    alone = engine.start([members[0]], N, 3)
    for _ in range(2):
        alone.step(rows_of(X[:, :3]), LABELS, {0: turns[0]})
    assert_same(ours.masters(0), alone.masters(0))


def test_members_go_on_from_their_states_beside_others_to_the_same_bits() -> None:
    members = [member((INPUTS, 66, 4), 7), member((INPUTS, 6, 4), 8, ring=True), MEMBERS[4], MEMBERS[0]]
    turns, x = turns_of(members), rows_of(X[:, :3])
    rng = np.random.default_rng(21)
    whole = engine.start(members, N, 3)
    for k in (0, 1):
        start = start_of(members[k])
        ring = tuple(None if r is None else rng.random(r.shape) < 0.5 for r in start.recurrent)
        whole.prune(k, Masters(tuple(rng.random(w.shape) < 0.5 for w in start.feed_forward), ring))
    whole.step(x, LABELS, turns)
    states = [whole.state(k) for k in range(4)]
    expected = whole.step(x, LABELS, turns)
    order = [3, 1, 0]
    again = engine.start([members[k] for k in order], N, 3)
    for place, k in enumerate(order):
        again.restore(place, states[k])
    reports = again.step(x, LABELS, {place: turns[k] for place, k in enumerate(order)})
    for place, k in enumerate(order):
        assert reports[place] == expected[k]
        assert_same(again.masters(place), whole.masters(k))


@pytest.mark.parametrize(
    "x",
    [
        np.zeros((2, 5, INPUTS), bool),
        np.ones((2, 5, INPUTS), bool),
        np.ones((1, 1, INPUTS), bool),
        np.zeros((0, 5, INPUTS), bool),
    ],
    ids=["silence", "every input fires", "one sample of one step", "no samples"],
)
def test_extreme_batches_train_as_on_the_cpu(x: np.ndarray) -> None:
    n, t, _ = x.shape
    clipped = [replace(layer, feed_forward=8 * layer.feed_forward) for layer in MEMBERS[0].layers]
    members = [replace(MEMBERS[0], layers=tuple(clipped)), MEMBERS[2]]
    turns, labels = turns_of(members, n), np.zeros(n, np.int64)
    ours, theirs = (start(members, max(1, n), t) for start in (engine.start, cpu.start))
    found, expected = (c.step(rows_of(x), labels, turns) for c in (ours, theirs))
    for k in range(2):
        if n:
            assert_reports_agree(found[k], expected[k], 1e-6)
        for a, b in zip(matrices(ours.masters(k)), matrices(theirs.masters(k)), strict=True):
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-5)


def test_what_does_not_fit_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ValueError, match=r"must have the same inputs, got \[5, 12\]"):
        engine.start([member((5, 3, 4), 0), MEMBERS[0]], N, T)
    cohort = engine.start(MEMBERS[:1], N, T)
    with pytest.raises(ValueError, match=r"rows have 5 inputs, the layer has 12"):
        cohort.step(rows_of(np.ones((N, T, 5))), LABELS, turns_of(MEMBERS[:1]))
    monkeypatch.setattr(engine, "missing", lambda device: f"needs what {device} lacks")
    with pytest.raises(engine.DeviceUnavailable, match=r"device 'cuda' needs what cuda lacks"):
        engine.start(MEMBERS[:1], N, T)


def test_designs_train_on_the_device_as_on_the_cpu() -> None:
    data = toy(n=24, n_steps=15)
    training = Training(epochs=2, batch_size=8, learning_rate=0.05, dropout=0.2)
    models = [SNN(hidden=(9,)), SNN(hidden=(6, 5)), SNN(hidden=(5,), recurrent=True)]
    designs = [FitRequest(model, training, rngs(k)) for k, model in enumerate(models)]
    on_gpu, on_cpu = (dict(SNN.fit_cohort(data, designs, rngs(9), device)) for device in ("cuda", "cpu"))
    for number in range(3):
        a, b = on_gpu[number], on_cpu[number]
        assert isinstance(a, Outcome) and isinstance(b, Outcome)
        np.testing.assert_allclose(a.history["loss"][0], b.history["loss"][0], rtol=1e-6)
        for x, y in zip(a.network.layers, b.network.layers, strict=True):
            np.testing.assert_allclose(x.weight, y.weight, atol=1e-3 * np.abs(y.weight).max())


ROOT = Path(__file__).resolve().parents[3]


def compile_all(capability: int, most_shared_bytes: int) -> None:
    """Compile every kernel that a step of MEMBERS launches, as it is launched; no device is needed."""
    import triton
    from triton.backends.compiler import GPUTarget
    from triton.compiler import ASTSource
    from triton.runtime.jit import JITFunction

    type_names = {
        torch.float32: "fp32",
        torch.float64: "fp64",
        torch.bfloat16: "bf16",
        torch.int32: "i32",
        torch.int64: "i64",
        torch.uint8: "u8",
    }
    seen = set()

    def launch(self: Any, *args: Any, grid: Any, warmup: bool, **given: Any) -> None:
        values = dict(zip(self.arg_names, args, strict=False)) | given
        constants = {k: v for k, v in values.items() if k.isupper()}
        signature = {
            name: "constexpr"
            if name in constants
            else f"*{type_names[values[name].dtype]}"
            if isinstance(values[name], torch.Tensor)
            else "i32"
            for name in self.arg_names
        }
        options = {k: v for k, v in given.items() if k not in self.arg_names}
        key = str((self.fn.__name__, signature, constants, options))
        if key in seen:
            return
        seen.add(key)
        named = {(self.arg_names.index(k),): v for k, v in constants.items()}
        aligned = [k for k in self.arg_names if k not in constants and k not in self.do_not_specialize]
        attributes = {(self.arg_names.index(k),): [["tt.divisibility", 16]] for k in aligned}
        source = ASTSource(self, signature, named, attributes)
        done = triton.compile(source, target=GPUTarget("cuda", capability, 32), options=options)
        assert done.metadata.shared <= most_shared_bytes, f"{key} needs {done.metadata.shared} bytes"

    JITFunction.run = launch  # type: ignore[method-assign]
    cohort = wide.WideEngine([*MEMBERS, *RESONATORS], N, T, torch.device("cpu"))
    for slab in cohort._slabs:
        places = range(len(slab._members))
        gains = {k: gains_of(slab._members[k], N, 0) for k in places}
        x = wide.dense(rows_of(X), 0, N, torch.device("cpu"))
        slab.accumulate(x, LABELS, T, gains, {}, add=True)
        for level, on in zip(slab._levels, slab._tiles(places), strict=True):
            for held in level.weights:
                held.squared_norms(on.every)
                held.update(on.every, torch.zeros((3, level.stage.n_tiles)))
    print(len(seen), "kernels")


def child(code: Sequence[str], tmp_path: Path) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "TRITON_INTERPRET": "0", "TRITON_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, *code]
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)


@pytest.mark.slow
@pytest.mark.parametrize(("capability", "shared_kib"), [(86, 99), (90, 227)], ids=["8.6", "9.0"])
def test_every_kernel_compiles_for_a_device(capability: int, shared_kib: int, tmp_path: Path) -> None:
    module = f"import runpy; runpy.run_path({str(Path(__file__))!r})"
    done = child(["-c", f"{module}['compile_all']({capability}, {shared_kib * 1024})"], tmp_path)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout.split()[-2]) >= 20


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_everything_above_holds_on_the_device(tmp_path: Path) -> None:
    done = child(["-m", "pytest", "-q", "-m", "not gpu and not slow", __file__], tmp_path)
    assert done.returncode == 0 and "skipped" not in done.stdout, done.stdout + done.stderr
