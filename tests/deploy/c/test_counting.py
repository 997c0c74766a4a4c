"""Classifiers of counts as C: the answers of the engine, in the memory that was stated."""

import functools
from dataclasses import replace

import numpy as np
import pytest

from dse.base import registry
from dse.base.records import Operations
from dse.config.settings import Training
from dse.data.dataset.assemble import New
from dse.deploy.bundle import Bundle, Input
from dse.deploy.c.counting import counting_plan_of
from dse.deploy.reference import of_new
from dse.deploy.targets import emulator
from dse.deploy.targets.c99 import C99
from dse.deploy.verify import target_named
from dse.measure.hardware.cost import cost
from dse.measure.hardware.kinds.processor import Processor
from dse.measure.hardware.profile import load as profile_named
from dse.models.counts.elm import ELM
from dse.models.counts.kernels import Kernels
from dse.models.counts.knn import KNN
from dse.models.counts.linear import Linear
from dse.models.counts.mlp import MLP
from dse.models.counts.naive_bayes import NaiveBayes
from dse.models.counts.tcn import TCN
from dse.testing.small import dataset, generators
from tests.deploy.c import nets
from tests.installed import needs_papers
from tests.spaces import RASTER, sections

pytestmark = nets.needs_compiler


@functools.cache
def fitted(model, read_out_ms=None, rises=None):
    """Return the bundle of a trained classifier, and what it answers to recordings it was not trained on."""
    rises = None if rises is None else np.array(rises)
    if isinstance(model, TCN):
        pytest.importorskip("torch")
    data = dataset(n_samples=120, n_steps=40, n_channels=9)
    data = replace(data, test=np.concatenate([data.validation, data.test]), rises=rises)
    outcome = model.fit(data, Training(), generators(1))
    design = replace(sections(RASTER), model=model)
    design = replace(design, kinds={**design.kinds, "model": type(model).__name__.lower()})
    made = Bundle(
        fitted=outcome.network,
        sections=design,
        classes=data.classes,
        read_out_ms=read_out_ms,
        input=Input("spikes", 9, 0, 0, 40, 5.0),
    )
    begins = np.zeros(len(data.target), np.int64)
    return made, of_new(made, New(data, [], None, begins), "made up")


@pytest.mark.parametrize(
    ("model", "read_out_ms"),
    [
        (KNN(), None),
        (KNN(window_ms=15, channels="each", k=7), 55.0),
        (NaiveBayes(), 101.0),
        (NaiveBayes(window_ms=5, channels="each"), None),  # more than 128 features: sums in pairs of pairs
        (MLP(window_ms=20, channels="each", hidden=(12,), epochs=20, read_outs=2), None),
        (ELM(window_ms=20, windows=3, hidden=30), None),
        (ELM(window_ms=35, windows=9, hidden=30, precision="float32"), 80.0),
    ],
)
def test_answers_are_those_of_the_engine(model, read_out_ms, tmp_path):
    made, reference = fitted(model, read_out_ms)
    verdict = nets.faithful(C99(), made, reference, tmp_path)
    assert len(set(reference.label.tolist())) > 1
    if "ram_bytes" in verdict.figures:
        assert verdict.figures["ram_bytes"] == counting_plan_of(made).ram_bytes
        assert C99().footprint(made)["flash_bytes"] == pytest.approx(verdict.figures["flash_bytes"], rel=0.05)
    assert verdict.compiler.endswith("-Os")


def test_where_nothing_varied_in_training_the_most_frequent_class_answers(tmp_path):
    made, reference = fitted(NaiveBayes(), 101.0)
    arrays = dict(made.fitted.arrays)
    arrays |= {name: np.zeros_like(arrays[name]) for name in ("variance", "smoothing")}
    arrays["log_prior"] = np.log(np.arange(1.0, 1.0 + len(made.classes)) / 10)
    made = replace(made, fitted=replace(made.fitted, arrays=arrays))
    data = reference.dataset
    again = of_new(made, New(data, [], None, np.zeros(len(data.target), np.int64)), "made up")
    assert set(again.label.tolist()) == {len(made.classes) - 1}
    nets.faithful(C99(), made, again, tmp_path)


@pytest.mark.parametrize(
    "model",
    [
        KNN(window_ms=15, channels="each"),
        NaiveBayes(window_ms=5, channels="each"),
        MLP(window_ms=20, channels="each", hidden=(12, 9, 8, 5), epochs=20, read_outs=2),
        ELM(window_ms=20, windows=3, hidden=30),
        ELM(window_ms=20, windows=3, hidden=30, precision="float32"),
        Linear(window_ms=20),
        MLP(window_ms=20, channels="each", hidden=(12, 9), epochs=20, read_outs=2, precision="int8"),
        Kernels(window_ms=5, kernels=40, read_outs=3),
        Kernels(window_ms=5, kernels=40, thresholds=3, read_outs=3),
        TCN(window_ms=10, hidden=(12,), epochs=3, read_outs=3),
        TCN(window_ms=5, hidden=(8, 16, 12), kernel_size=4, stride=2, reads="changes", epochs=3, read_outs=1),
        Linear(window_ms=20, reads="levels"),
        MLP(
            window_ms=35,
            channels="each",
            hidden=(12,),
            epochs=20,
            read_outs=2,
            precision="int8",
            reads="levels",
        ),
    ],
)
def test_answers_on_a_core_without_hardware_for_doubles(model, tmp_path):
    if why := emulator.missing():
        pytest.skip(why)
    made, reference = fitted(model)
    target = target_named("cortex_m4")
    verdict = nets.faithful(target, made, reference, tmp_path)
    footprint = target.footprint(made)
    assert footprint["ram_bytes"] == verdict.figures["ram_bytes"]
    assert footprint["flash_bytes"] == pytest.approx(verdict.figures["flash_bytes"], abs=500)
    cycles = verdict.figures["cycles_per_inference"]
    assert _predicted(made, reference) == pytest.approx(cycles, rel=0.1)  # of small ones; benchmarks: 5 %


@pytest.mark.parametrize(
    "model",
    [
        Kernels(window_ms=5, kernels=40, read_outs=3),
        Kernels(window_ms=5, kernels=40, thresholds=3, read_outs=3),
        TCN(window_ms=15, hidden=(8, 12), epochs=3, read_outs=2, reads="levels"),
        Linear(window_ms=35, reads="levels"),
        MLP(window_ms=20, channels="each", hidden=(12,), epochs=20, read_outs=2, reads="levels"),
    ],
)
def test_what_reads_the_level_of_digits(model, tmp_path):
    nets.faithful(C99(), *fitted(model, rises=(300, -300, *[1, -2, 4] * 2, -70)), tmp_path)


@pytest.mark.parametrize("precision", ["float32", "int8"])
def test_a_perceptron_on_a_core_without_hardware_for_floats(precision, tmp_path):
    if why := emulator.missing():
        pytest.skip(why)
    model = MLP(window_ms=20, channels="each", hidden=(12, 9), epochs=20, read_outs=2, precision=precision)
    nets.faithful(target_named("cortex_m0plus"), *fitted(model), tmp_path)


@pytest.mark.parametrize(
    ("model", "table"),
    [
        (KNN(window_ms=15, channels="each"), "uint8_t"),
        (KNN(window_ms=20, channels="each"), "uint16_t"),
        (NaiveBayes(window_ms=5, channels="each"), "double"),
        (MLP(window_ms=20, channels="each", hidden=(12,), epochs=20, read_outs=2), "float"),
        (ELM(window_ms=20, windows=3, hidden=30), "double"),
        (ELM(window_ms=20, windows=3, hidden=30, precision="float32"), "float"),
        (Linear(window_ms=20), "int8_t"),
    ],
)
def test_flash_is_counted_in_the_numbers_that_the_c_stores(model, table):
    made, reference = fitted(model)
    data = reference.dataset
    if table == "uint16_t":  # a count above 255
        arrays = {**made.fitted.arrays, "counts": made.fitted.arrays["counts"] + 256}
        made = replace(made, fitted=replace(made.fitted, arrays=arrays))
    [largest] = sorted(counting_plan_of(made).tables, key=lambda x: x.n_bytes)[-1:]
    bits = made.sections.model.respond(made.fitted, data, data.test).stored_bits
    assert (largest.kind, bits) == (table, 8 * largest.n_bytes // largest.values.size)


def _predicted(made, reference):
    """Return the cycles of an inference by the cost model, from what dse records of the answers."""
    data, model = reference.dataset, made.sections.model
    answers = model.respond(made.fitted, data, data.test)
    load = Operations(
        macs=answers.macs,
        additions=answers.additions,
        updates=np.zeros_like(answers.macs),
        n_weights=answers.n_weights,
        duration_ms=answers.time_ms,
        program=answers.program,
    )
    profile = profile_named("mcu_m4")
    assert isinstance(profile, Processor)
    latency_ms = cost(profile, load.mapped(lambda counts: counts[-1:])).hardware_latency_ms
    return float(np.squeeze(latency_ms) * profile.cycles_per_ms)


def test_tables_larger_than_the_flash_are_refused():
    made, _ = fitted(KNN(window_ms=5, channels="each"))
    counts = made.fitted.arrays["counts"]
    times = 2**21 // (counts.size + 2 * len(counts))
    arrays = {
        **made.fitted.arrays,
        "counts": np.concatenate([counts] * (times + 1)),
        "target": np.concatenate([made.fitted.arrays["target"]] * (times + 1)),
    }
    made = replace(made, fitted=replace(made.fitted, arrays=arrays))
    assert "the chip of profile mcu_m4 has 2097152" in target_named("cortex_m4").refusal(made)
    assert "the chip of profile mcu_m0plus has 2097152" in target_named("cortex_m0plus").refusal(made)
    assert target_named("riscv32").refusal(made) == ""  # no profile: up to the memory of the emulator


@pytest.mark.parametrize(
    ("model", "name", "reason"),
    [
        (Linear(window_ms=20), "0/0/bias", "the sums of its integers may exceed 32 bits"),
        (Kernels(window_ms=5, kernels=4), "groups", "the sums of its kernels may exceed 32 bits"),
        (TCN(epochs=1), "offset/1", "the sums of its convolutions may exceed 32 bits"),
    ],
)
def test_integers_that_may_pass_32_bits_are_refused(model, name, reason):
    made, _ = fitted(replace(model, read_outs=1))
    assert C99().refusal(made) == ""
    arrays = made.fitted.arrays
    arrays = {**arrays, name: np.full_like(arrays[name], np.iinfo(arrays[name].dtype).max)}
    if name == "groups":  # a place of very many channels
        arrays |= {"place": np.zeros(10**6, np.int64), "sign": np.ones(10**6, np.int8)}
    changed = replace(made, fitted=replace(made.fitted, arrays=arrays))
    assert reason in C99().refusal(changed)


@pytest.mark.parametrize(
    ("model", "reason"),
    [(KNN(weights="distance"), "square roots"), (ELM(nonlinearity="tanh"), "nonlinearity tanh")],
)
def test_what_needs_a_library_is_refused(model, reason):
    assert reason in C99().refusal(fitted(model)[0])


@needs_papers
@pytest.mark.parametrize(
    ("kind", "reason"), [("hots", "an exponential of every neighbour"), ("cascade", "C holds one network")]
)
def test_families_without_c_say_why(kind, reason):
    made, _ = fitted(KNN())
    sections = replace(made.sections, model=registry.known("models")[kind](), kinds={"model": kind})
    assert reason in C99().refusal(replace(made, sections=sections))
