"""C on emulated processors: every spike and decision of random networks equals the engine's."""

import numpy as np
import pytest

from dse.deploy.c import replay
from dse.deploy.c.plan import plan_of
from dse.deploy.targets import emulator
from dse.deploy.verify import target_named
from tests.deploy.c import nets


@pytest.mark.parametrize(
    ("target", "case", "number"),
    [
        (target_named("cortex_m4"), nets.case, 9),
        (target_named("cortex_m4"), nets.case, 1),
        (target_named("cortex_m0plus"), nets.case, 14),
        (target_named("cortex_m33"), nets.case, 2),
        (target_named("cortex_m4"), nets.xylo_case, 1),
        (target_named("riscv32"), nets.case, 9),
        (target_named("riscv32"), nets.case, 1),
    ],
)
def test_spikes_and_decisions_equal(target, case, number, tmp_path):
    if why := emulator.missing():
        pytest.skip(why)
    made, fired = case(number)
    verdict = nets.faithful(target, made, nets.reference(made, fired), tmp_path)
    assert [name.split()[0] for name in verdict.run_by] == ["ziglang", "unicorn"]
    figures = verdict.figures
    assert figures["ram_bytes"] == plan_of(made).ram_bytes
    # Random networks are small, and their code is most of it.
    if "flash_bytes" in (before := target.footprint(made)):
        assert before["flash_bytes"] == pytest.approx(figures["flash_bytes"], rel=0.15)
    assert 0 < figures["stack_bytes"] < 300
    assert figures["cycles_per_inference"] > figures["instructions_per_inference"] * 0.9 > 0
    assert 3.5 < figures["instructions_per_synapse"] < 40
    assert 0 < figures["instructions_per_neuron_step"] < 100


def test_an_inference_ends_with_its_answer():
    made, fired = nets.case(4)
    reference = nets.reference(made, fired)
    per_sample = reference.n_steps // reference.dataset.n_steps
    whole = replay.of_spikes(reference)
    ends = replay.of_spikes(reference, np.full(len(fired), reference.n_steps))
    assert all(np.array_equal(a, b) for a, b in zip(whole, ends, strict=True))
    for commands, window, spikes in zip(replay.of_spikes(reference, [3] * 6), whole, fired, strict=True):
        until = -(-3 // per_sample)
        assert np.array_equal(commands[:-1], window[: len(commands) - 1])
        assert commands[-2] == replay.STEP and commands[-1] == replay.ANSWER
        assert len(commands) == 3 + until + 2 * spikes[:until].sum()


@pytest.mark.parametrize("number", [1, 9, 14])
def test_a_module_of_web_assembly_has_every_spike_and_no_imports(number, tmp_path):
    target = target_named("wasm")
    if why := emulator.missing({"ziglang": "cross-compiler", "wasmtime": "run time"}):
        pytest.skip(why)
    import wasmtime

    made, fired = nets.case(number)
    verdict = nets.faithful(target, made, nets.reference(made, fired), tmp_path)
    module = tmp_path / "dse.wasm"
    assert verdict.figures["module_bytes"] == module.stat().st_size < 20_000
    assert verdict.figures["instructions_per_inference"] > 1000
    read = wasmtime.Module.from_file(wasmtime.Engine(), str(module))
    assert not read.imports
    assert {"memory", "__heap_base", "dse_step", "dse_decision"} <= {x.name for x in read.exports}
