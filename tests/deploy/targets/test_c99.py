"""C on this machine: every spike and decision equals the engine's, and memory is what was stated."""

import shutil
import subprocess
import sys
from dataclasses import replace
from importlib.util import find_spec
from itertools import pairwise

import numpy as np
import pytest

from dse.base.records import Layer, Network
from dse.data.encoders.receptors import Receptors
from dse.deploy import bundle
from dse.deploy.bundle import Input
from dse.deploy.c import host, replay
from dse.deploy.c.plan import plan_of
from dse.deploy.evaluate import evaluate
from dse.deploy.reference import of_recordings
from dse.deploy.targets import TargetError, c99, compare, emulator
from dse.deploy.targets.c99 import C99
from dse.deploy.verify import target_named
from dse.engine.neurons import parameters_of
from tests.deploy.c import nets
from tests.spaces import FINGERTIP, sections

NETS = (0, 3, 6, 7, 8, 9, 10, 11, 14, 16)
"""Random networks of every kind of layer, delay, rule and decay (`test_the_nets_are_of_all_kinds`)."""
SANITIZERS = ("-O0", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")

pytestmark = nets.needs_compiler


@pytest.fixture(scope="module")
def checked(tmp_path_factory):
    """Options of the compiler: sanitizers where it has them."""
    source = tmp_path_factory.mktemp("sanitizers") / "empty.c"
    source.write_text("int main(void)\n{\n    return 0;\n}\n")
    try:
        host.compiled([source], source.with_suffix(""), *SANITIZERS)
    except TargetError:
        return ("-O0",)
    return SANITIZERS


XYLO = ((nets.xylo_case, number) for number in (1, 2, 5, 7))


@pytest.mark.parametrize(("case", "number"), [*((nets.case, number) for number in NETS), *XYLO])
def test_random_networks_spike_and_decide_alike(case, number, tmp_path, checked):
    made, fired = case(number)
    C99().write(made, tmp_path)
    plan, reference = plan_of(made), nets.reference(made, fired)
    played = host.played(tmp_path, replay.of_spikes(reference), *checked)
    verdict = compare(reference, replay.run_of(played, plan, reference))
    assert verdict.kind == "faithful", verdict.reason
    assert replay.same_input(played, reference)


def test_the_nets_are_of_all_kinds():
    plans = [plan_of(nets.case(number)[0]) for number in NETS]
    layers = [layer for plan in plans for layer in plan.layers]
    matrices = [layer.forward for layer in layers]
    assert {m.form for m in matrices} == {"bytes", "words", "sparse"}
    assert {m.bits for m in matrices} == set(range(2, 9))
    assert {layer.state_bits for layer in layers} == {32, 64}
    delayed = [layer.forward for layer in layers if layer.n_later > 1]
    assert {m.form for m in delayed} == {"bytes", "sparse"}
    assert {len(plan.layers) for plan in plans} == {1, 2, 3, 4}
    assert {plan.steps_per_sample for plan in plans} == {1, 2, 3}
    assert any(plan.rule.joint for plan in plans) and any(plan.rule.least_total for plan in plans)


def test_a_delayed_weight_that_cancels_a_current_leaves_nothing(tmp_path):
    # Neuron 0 fires at once, so v = 0; a step later its halved current meets a weight of the same size.
    layer = Layer(
        np.array([[2.0, -1.0], [0.25, 0.25]], np.float32),
        None,
        {
            "decay_current": np.array([2048, 2048], np.int32),
            "decay_voltage": np.array([128, 128], np.int32),
            "threshold": np.array(64, np.int32),
        },
        delay=np.array([[0, 1], [0, 0]], np.int8),
    )
    made = nets.bundle(Network((layer,), 2, (0,), 1, "integer"), 6)
    fired = np.zeros((1, 6, 2), np.uint8)
    fired[0, 0] = 1
    reference = nets.reference(made, fired)
    assert [tuple(x) for x in reference.fired[0].tolist()] == [(0, 0, 0)]
    nets.faithful(C99(), made, reference, tmp_path)


SAMPLES = {
    "data": {"kind": "time_series", "file": "x.npz", "step_ms": 5, "columns": {"letter": "letter"}},
    "task": {"target": "letter"},
    "split": {"stratified": {"validation": 0.2}},
    "model": {"kind": "snn"},
    "training": {},
}
EVENTS = {
    **SAMPLES,
    "data": {"kind": "events", "file": "x.npz", "width": 20, "height": 6, "x": "x", "y": "y",
             "polarity": "polarity",
             "columns": {"letter": "letter"}},
}  # fmt: skip


def network(n_channels, seed=0):
    """Return a recurrent network with delays and two steps per sample that spikes a good deal."""
    rng = np.random.default_rng(seed)

    def layer(n_inputs, n, recurrent):
        weight = rng.normal(0.6, 1.0, (n, n_inputs)) * 3 / np.sqrt(n_inputs)
        ring = rng.normal(0, 1, (n, n)).astype(np.float32) if recurrent else None
        decays = (rng.integers(300, 3000, n).astype(np.int32) for _ in range(2))
        parameters = parameters_of(nets.cuba_lif.Population(*decays, 80))
        return Layer(weight.astype(np.float32), ring, parameters)

    return Network((layer(2 * n_channels, 9, True), layer(9, 3, False)), n_channels, (0, 3), 2, "integer")


def sensed(folder, encoder, window, real=False, far=False):
    """Return a bundle of four sensors with an encoder, and recordings of samples, which touch.npz holds.

    real: whether samples are no whole numbers. far: whether some are as far apart as 16 bits can be.
    """
    rng = np.random.default_rng(2)
    lengths = [25, 40, 31, 60]
    signal = np.concatenate([np.cumsum(rng.normal(0, 3, (n, 4)), axis=0) for n in lengths])
    signal = (signal if real else np.rint(signal)).astype(np.float32)
    if far:
        signal[3], signal[30] = 32767, -32768
    offsets = np.concatenate([[0], np.cumsum(lengths)])
    np.savez(folder / "touch.npz", signal=signal, offsets=offsets)
    design = sections({**SAMPLES, "data": {**SAMPLES["data"], "offsets": "offsets"}, "window": window,
                       "encoder": {"kind": "send_on_delta", **encoder}})  # fmt: skip
    fitted = {"means": (1.5, -3.0, 0.0, 12.0)} if design.encoder.learns else {}
    if isinstance(design.encoder, Receptors):  # as fitted to recordings; one sensor never moved there
        low, high = signal.min(axis=0), signal.max(axis=0)
        high[2] = low[2]
        fitted = {"low": tuple(low.tolist()), "high": tuple(high.tolist())}
    design = replace(design, encoder=replace(design.encoder, **fitted))
    made = nets.bundle(network(design.encoder.n_channels(4)), window["n_steps"], phi=3.0, theta=0.4)
    made = replace(made, sections=design, input=Input("samples", 4, 0, 0, window["n_steps"], nets.STEP_MS))
    return made, [signal[a:b] for a, b in pairwise(offsets)]


def answers_of_main(folder, text, *options):
    """Return what the program of a folder prints for recordings."""
    program = folder.parent / "touch"
    host.compiled([folder / "main.c", folder / "src" / "dse.c"], program, f"-I{folder / 'src'}", *options)
    done = subprocess.run([str(program)], input=text, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return [line.split(",") for line in done.stdout.splitlines()[1:]]


def csv(recordings):
    """Return recordings as rows of numbers, an empty line between two."""
    return "\n\n".join("\n".join(",".join(f"{x:.17g}" for x in row) for row in part) for part in recordings)


def shipped(made, folder):
    """Return the folder of the C in a bundle that was stored and read again."""
    bundle.write(made, folder / "bundle")
    target = folder / "c99"
    target.mkdir()
    C99().write(bundle.read(folder / "bundle"), target)
    return target


@pytest.mark.parametrize(
    ("encoder", "window", "real"),
    [
        ({"thresholds": [1, 4]}, {"n_steps": 20, "at": "middle"}, False),
        ({"thresholds": [0.5, 2.25], "reference": "level", "polarity": "merged"},
         {"n_steps": 25, "at": "start"}, False),
        ({"thresholds": [2.7, 6], "reference": "value"}, {"n_steps": 12, "at": "contact_onset"}, False),
        ({"thresholds": [0.7, 1.9], "reference": "level"}, {"n_steps": 20, "at": "middle"}, True),
        ({"thresholds": [1.5, 4], "start": "mean"}, {"n_steps": 25, "at": "start"}, False),
        ({"thresholds": [0.7, 1.9], "start": "mean", "reference": "value"},
         {"n_steps": 25, "at": "start"}, True),
        ({"thresholds": [0.3, 1.1]}, {"n_steps": 12, "at": "contact_onset", "onset_threshold": 2.5}, True),
        ({"kind": "quantised", "step": 0.5, "digits": 4}, {"n_steps": 20, "at": "middle"}, False),
        ({"kind": "quantised", "step": 0.3, "digits": 3, "start": "mean"},
         {"n_steps": 25, "at": "start"}, True),
        ({"kind": "receptors"}, {"n_steps": 20, "at": "middle"}, False),
        ({"kind": "receptors", "sa": False, "gain": 3.0, "spikes_per_step": 3, "smoothing_ms": 20,
          "method": "half_steps", "solver_ms": 0.7}, {"n_steps": 25, "at": "start"}, True),
    ],
)  # fmt: skip
def test_samples_are_encoded_and_answered_as_by_evaluate(encoder, window, real, tmp_path, checked):
    made, recordings = sensed(tmp_path, encoder, window, real)
    folder = shipped(made, tmp_path)
    reference = of_recordings(made, tmp_path / "touch.npz")
    assert C99().verify(made, folder, reference).kind == "faithful"
    assert len(reference.spikes_in) and all(map(len, reference.fired))
    options = (*checked, "-DDSE_REAL_SAMPLES") if real else checked
    printed = answers_of_main(folder, "a,b,c,d\n" + csv(recordings), *options)
    assert_answers(printed, tmp_path, tmp_path / "touch.npz")
    if isinstance(made.sections.encoder, Receptors) and not emulator.missing():  # doubles in software
        assert target_named("cortex_m4").verify(made, folder, reference).kind == "faithful"


@pytest.mark.parametrize(
    ("preprocessing", "window"),
    [
        ({"bin_ms": 2, "pool": 2}, {"n_steps": 20, "at": "middle"}),
        ({"bin_ms": 3, "pool": [4, 3], "stride": [2, 3], "padding": [1, 0], "pool_threshold": 2,
          "polarity": "merge", "crop": [2, 0, 16, 6], "time_ms": [5, 70]}, {"n_steps": 15, "at": "start"}),
        ({"bin_ms": 2, "pool": 2, "stride": 3, "polarity": "ignore_off", "exceeds": True},
         {"n_steps": 20, "at": "contact_onset", "onset_threshold": 6}),
    ],
)  # fmt: skip
def test_events_are_pooled_and_answered_as_by_evaluate(preprocessing, window, tmp_path, checked):
    rng = np.random.default_rng(4)
    n = 4
    parts = []
    for k in range(n):
        t_us = np.sort(rng.integers(2**33 * k, 2**33 * k + 80_000, 900))
        parts.append(
            np.column_stack(
                [t_us, rng.integers(0, 20, 900), rng.integers(0, 6, 900), rng.integers(0, 2, 900)]
            )
        )
    events = np.concatenate(parts)
    np.savez(
        tmp_path / "touch.npz",
        **dict(zip(("t_us", "x", "y", "polarity"), events.T, strict=True)),
        offsets=900 * np.arange(n + 1),
    )
    design = sections({**EVENTS, "window": window, "preprocessing": preprocessing})
    taken = Input("events", 0, 20, 6, window["n_steps"], float(preprocessing["bin_ms"]))
    fitted = network(nets.pools_of(design, taken).n_channels)
    made = replace(nets.bundle(fitted, 1), sections=design, input=taken, read_out_ms=30.0)
    folder = shipped(made, tmp_path)
    reference = of_recordings(made, tmp_path / "touch.npz")
    assert C99().verify(made, folder, reference).kind == "faithful"
    assert len(reference.spikes_in) and all(map(len, reference.fired))
    assert_answers(answers_of_main(folder, csv(parts), *checked), tmp_path, tmp_path / "touch.npz")


def test_times_of_a_sensor_are_no_times_of_simulated_trials(tmp_path):
    (tmp_path / "tip.yaml").write_text(f"{FINGERTIP}forces_n: [1.0]\ntrials: 2\n")  # of 150 ms
    scene = {"kind": "scene", "scene": str(tmp_path / "tip.yaml")}
    window = {"n_steps": 10, "at": "middle"}
    preprocessing = {"bin_ms": 5, "pool": 2}
    changes = {"data": scene, "task": {"target": "texture"}, "encoder": None, "preprocessing": preprocessing}
    design = sections({**EVENTS, "window": window, **changes})
    taken = Input("events", 0, 20, 6, 10, 5.0)
    fitted = network(nets.pools_of(design, taken).n_channels)
    made = replace(nets.bundle(fitted, 1), sections=design, input=taken)
    C99().write(made, tmp_path / "c99")
    assert "`-DRECORDED`" in (tmp_path / "c99" / "README.md").read_text()
    rng = np.random.default_rng(2)
    of_trial = np.column_stack(
        [np.sort(rng.integers(0, 150_000, 900)), *rng.integers(0, [[20], [6], [2]], (3, 900))]
    )
    of_trial[0, 0] = 0
    later = of_trial + np.array([10**9, 0, 0, 0])
    [answer] = answers_of_main(tmp_path / "c99", csv([of_trial]))
    assert answers_of_main(tmp_path / "c99", csv([of_trial, later]), "-DRECORDED") == [answer, answer]
    with pytest.raises(AssertionError, match="an event is later than a simulated trial: -DRECORDED"):
        answers_of_main(tmp_path / "c99", csv([later]))


def assert_answers(printed, folder, data_file):
    """Compare what a program printed with what `dse evaluate` answers."""
    evaluation = evaluate(folder / "bundle", data_file)
    assert [row[0] for row in printed] == [evaluation.classes[label] for label in evaluation.label]
    assert np.allclose([float(row[1]) for row in printed], evaluation.time_ms)
    assert [row[2] == "true" for row in printed] == evaluation.decided.tolist()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1,2\n", "line 1: a step must have 1 or 0 of every channel, and no more"),
        ("", "line 0: there is no row of numbers"),
        ("step,channel\n\n", "line 2: there is no row of numbers"),
        ("step,channel\nfirst,second\n", "line 2: a step must have 1 or 0 of every channel"),
        ("1\n0\n", "line 2: the recording is shorter than the window"),
    ],
)
def test_bad_recordings_are_one_line(text, message, tmp_path):
    made = nets.bundle(network(1), 3)
    C99().write(made, tmp_path / "c99")
    program = tmp_path / "touch"
    folder = tmp_path / "c99"
    host.compiled([folder / "main.c", folder / "src" / "dse.c"], program, f"-I{folder / 'src'}")
    done = subprocess.run([str(program)], input=text, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (2, f"{message}\n")


# Memory; that RAM is one number wherever it is stated: test_safety.


@pytest.mark.skipif(shutil.which("size") is None, reason="binutils are not installed")
def test_flash_of_a_kind_that_is_compiled_once(tmp_path):
    for number in (0, 6, 12):
        made, _ = nets.case(number)
        C99().write(made, tmp_path / str(number))
        stated, sizes = C99().footprint(made), host.sizes(tmp_path / str(number))
        assert stated["ram_bytes"] == sizes["ram_bytes"]
        assert stated["flash_bytes"] == pytest.approx(sizes["flash_bytes"], rel=0.12)


# Refusals.


def test_no_compiler_is_one_line(tmp_path, monkeypatch):
    c99._INSTRUCTIONS.clear()
    made, fired = nets.case(0)
    C99().write(made, tmp_path)
    monkeypatch.setenv("CC", str(tmp_path / "none"))
    with pytest.raises(TargetError, match="none"):
        C99().verify(made, tmp_path, nets.reference(made, fired))
    assert set(C99().footprint(made)) == {"ram_bytes", "table_bytes"}
    c99._INSTRUCTIONS.clear()


# Builds.


def run(*command, **options):
    """Run a command that succeeds, and return what it prints."""
    done = subprocess.run(command, capture_output=True, text=True, check=False, **options)
    assert done.returncode == 0, done.stderr
    return str(done.stdout)


@pytest.mark.skipif(find_spec("cmake") is None, reason="CMake is not installed")
def test_cmake_builds_the_program(tmp_path):
    made, fired = nets.case(10)
    C99().write(made, tmp_path / "c99")
    cmake = (sys.executable, "-c", "import sys, cmake; sys.exit(cmake.cmake())")
    build = str(tmp_path / "build")
    run(*cmake, "-S", str(tmp_path / "c99"), "-B", build, f"-DCMAKE_C_COMPILER={';'.join(host.compiler())}")
    run(*cmake, "--build", build)
    text = "\n".join(",".join(map(str, row)) for row in fired[0].tolist())
    answer = run(str(tmp_path / "build" / "touch"), input=text).splitlines()[1].split(",")[0]
    assert answer == made.classes[nets.reference(made, fired).label[0]]
