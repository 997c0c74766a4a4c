"""Matrices as functions of their parameters: definitions, gradients, steps of both engines, states."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.ours import rows_of
from dse.engine import cpu
from dse.engine.adam import adam
from dse.engine.layers import weights
from dse.engine.layout import blocks, packed, unpacked
from dse.engine.losses.count_cross_entropy import CountCrossEntropy
from dse.engine.member import Member, TrainedLayer, Turn
from dse.engine.network import gradients
from dse.engine.neurons import cuba_lif, fixed_point
from dse.engine.neurons.surrogate import exponential
from dse.engine.parameters import Tied, WeightNorm, Whitened, lengths, normed, whitened
from dse.engine.shared import copies_of, distinct, expanded

N_IN, N_HIDDEN, N_OUT, RATE = 20, 70, 4, 0.02
ARITHMETICS = ("integer", "float32", "ideal")


def drawn(rng, n_in, n_out, form=""):
    matrix = rng.normal(0.05, 0.5, (n_in, n_out)).astype(np.float32)
    unit = rng.uniform(0.5, 2, n_out).astype(np.float32)
    shared = None
    if form == "tied":
        shared = (np.arange(n_in)[:, None] // 3 * n_out + np.arange(n_out)).astype(np.int32)
        matrix = expanded(distinct(matrix, shared), shared)
    return TrainedLayer(
        matrix,
        None,
        cuba_lif.Population(rng.integers(100, 3000, n_out), rng.integers(50, 2000, n_out), 80),
        exponential(80 / 64, 0.03, 3.0),
        unit,
        shared=shared,
        norm_unit=3 * unit if form == "normed" else None,
        basis=basis(n_in, 50) if form == "whitened" else None,
    )


def member(arithmetic="integer", form="", seed=0, **keys):
    rng = np.random.default_rng(seed)
    last = {"tied": "", "whitened all": "whitened"}.get(form, form)
    first = {"whitened": "", "whitened all": "whitened"}.get(form, form)
    layers = drawn(rng, N_IN, N_HIDDEN, first), drawn(rng, N_HIDDEN, N_OUT, last)
    return Member(layers, 0.6, 0.05, arithmetic, **keys)


def basis(n_inputs, rank, seed=7):
    return np.random.default_rng(seed).normal(0, 0.3, (n_inputs, rank)).astype(np.float32)


def batch(n=9, n_steps=60):
    rng = np.random.default_rng(1)
    return rows_of((rng.random((n, n_steps, N_IN)) < 0.2).astype(np.uint8)), rng.integers(0, N_OUT, n)


def turn(rng, n=9):
    return Turn(RATE, (None, 2 * (rng.random((n, N_HIDDEN)) < 0.5).astype(np.float32)))


FORMS = ("", "tied", "normed", "whitened", "whitened all")


def trained(of, n_batches=3, threads=1, module=cpu):
    """Return an engine after some batches, and its reports."""
    rows, labels = batch()
    arguments = (9, 60, threads) if module is cpu else ()
    engine = module.start([of], *arguments)
    rng = np.random.default_rng(2)
    return engine, [engine.step(rows, labels, {0: turn(rng)})[0] for _ in range(n_batches)]


def forms():
    """Return forms of a (13, 37) matrix, their parameters at a point, and the definition."""
    rng = np.random.default_rng(0)
    n_rows, n = 13, 37
    number = rng.integers(-1, 6, (n_rows, n)).astype(np.int32)
    number.ravel()[:7] = np.arange(-1, 6)
    start, m = rng.normal(size=(n_rows, n)), basis(n_rows, 5)
    parameters = (
        [rng.normal(size=6)],
        [rng.normal(size=(5, n))],
        [rng.normal(size=(n_rows, n)), rng.normal(size=(1, n))],
    )
    parameters[2][0][:, 3] = 0  # a neuron without weights
    copies = copies_of(packed(number + 1, np.int32) - 1)
    return [
        ("tied", Tied(copies), parameters[0], lambda a: expanded(a, number)),
        (
            "whitened",
            Whitened(packed(start, np.float32), m, n),
            parameters[1],
            lambda a: whitened(a, start, m),
        ),
        ("normed", WeightNorm(n_rows, n), parameters[2], normed),
    ]


@pytest.mark.parametrize("number", [0, 1, 2], ids=["tied", "whitened", "normed"])
def test_a_form_is_its_definition_and_its_gradient_that_of_small_steps(number):
    name, form, parameters, definition = forms()[number]
    n_rows, n = 13, 37
    flat = [np.append(x, 0) if name == "tied" else packed(x, np.float64) for x in parameters]
    out = np.zeros(n_rows * 48)
    form.expand(flat, out)
    np.testing.assert_allclose(unpacked(out, n_rows, n), definition(*parameters), rtol=1e-5, atol=1e-6)
    assert not blocks(out, n_rows, n)[-1][:, n % 16 - 16 :].any()  # columns that pad

    weighted = np.random.default_rng(1).normal(size=(n_rows, n))
    by_parameter = [np.zeros_like(x) for x in flat]
    form.pull(flat, packed(weighted, np.float64), by_parameter)
    for k, values in enumerate(parameters):
        found = by_parameter[k][:-1] if name == "tied" else unpacked(by_parameter[k], *values.shape)
        for at in np.ndindex(values.shape):
            if name == "normed" and at[1] == 3:
                continue
            ends = []
            for sign in (1, -1):
                moved = [x.copy() for x in parameters]
                moved[k][at] += sign * 1e-5
                ends.append((weighted * definition(*moved)).sum())
            assert found[at] == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-4, abs=1e-6)


@pytest.mark.parametrize("arithmetic", ARITHMETICS)
@pytest.mark.parametrize("form", FORMS)
def test_steps_are_gradients_by_parameters_then_adam_then_the_matrix(form, arithmetic):
    """The reference keeps parameters in float64, and multiplies Jacobians that torch finds."""
    torch = pytest.importorskip("torch")
    of = replace(member(arithmetic, form, clip_norm=0.3), loss=CountCrossEntropy(0.3, 2))
    rows, labels = batch()
    engine = cpu.start([of], 9, 60)
    parameters, functions, units = [], [], []
    for k, layer in enumerate(of.layers):
        w = layer.feed_forward.astype(np.float64)
        if layer.basis is not None:
            m = torch.tensor(layer.basis.astype(np.float64))
            parameters.append([np.zeros((m.shape[1], w.shape[1]))])
            functions.append(lambda a, w=w, m=m: torch.tensor(w) + m @ a)
            units.append([layer.unit])
        elif form == "tied" and k == 0:
            assert layer.shared is not None
            number = torch.tensor(layer.shared).long()
            parameters.append([distinct(w, layer.shared)])
            functions.append(lambda a, number=number: a[number])
            units.append([np.tile(layer.unit, 7)])
        elif layer.norm_unit is not None:
            parameters.append([w, np.sqrt((w**2).sum(0, keepdims=True))])
            functions.append(lambda v, g: g * v / (v**2).sum(0, keepdim=True).sqrt())
            units.append([layer.unit, layer.norm_unit])
        else:
            parameters.append([w])
            functions.append(lambda a: a)
            units.append([layer.unit])
    moments = [[(np.zeros_like(x), np.zeros_like(x)) for x in group] for group in parameters]
    rng, same = np.random.default_rng(2), np.random.default_rng(2)
    for step in range(1, 4):
        leaves = [[torch.tensor(x, requires_grad=True) for x in group] for group in parameters]
        matrices = [f(*group) for f, group in zip(functions, leaves, strict=True)]
        masters = [m.detach().numpy().astype(np.float32) for m in matrices]
        as_run = [fixed_point.quantise(m) if arithmetic == "integer" else m for m in masters]
        found = gradients(
            rows,
            [weights(w, None, layer.population) for w, layer in zip(as_run, of.layers, strict=True)],
            [layer.surrogate for layer in of.layers],
            labels,
            true_rate=0.6,
            false_rate=0.05,
            arithmetic=arithmetic,
            gains=turn(same).gains,
            loss=of.loss,
        )
        report = engine.step(rows, labels, {0: turn(rng)})[0]
        assert (report.loss, report.correct, report.fired) == (found.loss, found.correct, found.fired)
        passes = [fixed_point.quantise_passes(m) if arithmetic == "integer" else 1.0 for m in masters]
        total = sum(
            (matrix * torch.tensor(g * p)).sum()
            for matrix, g, p in zip(matrices, found.feed_forward, passes, strict=True)
        )
        total.backward()
        by_parameter = [[x.grad.numpy() for x in group] for group in leaves]
        norm = np.sqrt(sum((g**2).sum() for group in by_parameter for g in group))
        assert report.gradient_norm == pytest.approx(norm, rel=1e-5)
        scale = min(1.0, 0.3 / norm)
        for k, group in enumerate(by_parameter):
            for p, g in enumerate(group):
                parameters[k][p], *moments[k][p] = adam(
                    parameters[k][p], scale * g, *moments[k][p], step, RATE * units[k][p]
                )
            are_weights = len(group) == 1 and of.layers[k].basis is None
            if arithmetic == "integer" and are_weights:
                parameters[k][0] = fixed_point.within_range(parameters[k][0])
            expected = functions[k](*(torch.tensor(x) for x in parameters[k])).numpy()
            if arithmetic == "integer":
                expected = fixed_point.within_range(expected)
            np.testing.assert_allclose(engine.masters(0).feed_forward[k], expected, rtol=1e-4, atol=2e-5)
        # A rounding error is not to grow into a spike: go on from the engine's own parameters.
        state = engine.state(0)
        for k, group in enumerate(parameters):
            for p, values in enumerate(group):
                flat = state[f"{k}/feed_forward/{p}/weights" if p else f"{k}/feed_forward/weights"]
                group[p] = (
                    flat[: values.size] if values.ndim == 1 else unpacked(flat, *values.shape)
                ).astype(np.float64)


@pytest.mark.parametrize("form", FORMS)
def test_both_engines_take_the_same_steps(form):
    pytest.importorskip("torch")
    from dse.engine import autograd

    of = member("ideal", form, hidden_spike_penalty=1e-3, clip_norm=0.5)
    one, reports = trained(of, 4)
    other, others = trained(of, 4, module=autograd)
    for a, b in zip(reports, others, strict=True):
        assert (a.correct, len(a.fired)) == (b.correct, len(b.fired))
        assert (a.loss, a.gradient_norm) == pytest.approx((b.loss, b.gradient_norm), rel=1e-5)
    for a, b in zip(one.masters(0).feed_forward, other.masters(0).feed_forward, strict=True):
        np.testing.assert_allclose(a, b, atol=2e-5)


@pytest.mark.parametrize("form", FORMS)
def test_a_state_goes_on_with_the_same_bits_whatever_the_threads_and_the_cohort(form):
    rows, labels = batch(9, 1000)
    results = []
    for threads, others, pauses in ((1, 0, False), (3, 2, False), (2, 1, True)):
        beside = [member("float32", "normed", 3 + k) for k in range(others)]
        members = [*beside, member("integer", form)]
        engine, rng, reports = cpu.start(members, 9, 1000, threads), np.random.default_rng(2), []
        for _ in range(4):
            reports.append(engine.step(rows, labels, dict.fromkeys(range(others + 1), turn(rng)))[others])
            if pauses:
                state = engine.state(others)
                engine = cpu.start(members, 9, 1000, threads)
                engine.restore(others, state)
        results.append((reports, engine.masters(others).feed_forward))
    for reports, masters in results[1:]:
        assert reports == results[0][0]
        for a, b in zip(masters, results[0][1], strict=True):
            np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("arithmetic", ARITHMETICS)
def test_weight_norm_keeps_what_pruning_leaves_and_moves_no_other(arithmetic):
    engine, _ = trained(member(arithmetic, "normed"))
    before = engine.masters(0)
    kept = replace(before, feed_forward=tuple(np.abs(w) > 0.3 for w in before.feed_forward))
    engine.prune(0, kept)
    after = engine.masters(0).feed_forward
    for w, mask, now in zip(before.feed_forward, kept.feed_forward, after, strict=True):
        np.testing.assert_allclose(now, w * mask, rtol=1e-5)
    rows, labels = batch()
    engine.step(rows, labels, {0: turn(np.random.default_rng(3))})
    for mask, then, now in zip(kept.feed_forward, after, engine.masters(0).feed_forward, strict=True):
        assert not now[~mask].any()
        assert (now != then)[mask].mean() > 0.9


def test_weight_norm_starts_at_the_drawn_weights_and_a_neuron_without_weights_stays():
    of = member("ideal", "normed")
    silent = of.layers[1].feed_forward.copy()
    silent[:, 1] = 0
    without = replace(of.layers[1], feed_forward=silent, unit=np.array([1, 0, 1, 1], np.float32))
    of = replace(of, layers=(of.layers[0], without))
    engine = cpu.start([of], 9, 60)
    for layer, w in zip(of.layers, engine.masters(0).feed_forward, strict=True):
        np.testing.assert_allclose(w, layer.feed_forward, rtol=1e-6)
    rows, labels = batch()
    report = engine.step(rows, labels, {0: turn(np.random.default_rng(3))})[0]
    assert np.isfinite(report.gradient_norm)
    assert not engine.masters(0).feed_forward[1][:, 1].any()


def test_the_norm_of_a_neuron_moves_only_with_its_norm_parameter():
    of = member("ideal", "normed")
    layers = tuple(replace(x, norm_unit=np.zeros_like(x.unit)) for x in of.layers)
    engine, _ = trained(replace(of, layers=layers), 5)
    for layer, w in zip(of.layers, engine.masters(0).feed_forward, strict=True):
        np.testing.assert_allclose(lengths(w), lengths(layer.feed_forward), rtol=1e-5)
        assert np.abs(w - layer.feed_forward).max() > 0.01
