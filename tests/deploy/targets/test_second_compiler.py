"""C by gcc: the engine's spikes and decisions, cycles as predicted, and the self-test on a board of qemu.

Skipped where they are missing (Debian: gcc-arm-none-eabi, libnewlib-arm-none-eabi, qemu-system-arm).
"""

import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.gcc import GCC, by_gcc, linked
from benchmarks.instructions import counted, made_network, made_of_counts
from dse.deploy.verify import target_named
from dse.measure.hardware.profile import load
from tests.deploy.c import nets

QEMU = shutil.which("qemu-system-arm")
START = Path(__file__).parent / "qemu_start.c"
# On the board, where it has memory: 4 MiB each of code and data.
BOARD = """
SECTIONS {
    .text 0 : { KEEP(*(.vectors)) *(.text .text.* .rodata .rodata.*) }
    .data 0x20000000 : { *(.data .data.*) }
    .bss : { *(.bss .bss.*) *(COMMON) }
    _stack_top = 0x20400000;
    /DISCARD/ : { *(.ARM.exidx* .ARM.extab*) }
}
"""


@pytest.mark.skipif(GCC is None, reason="arm-none-eabi-gcc is not installed")
@pytest.mark.parametrize(
    ("core", "case", "number"),
    [
        ("m4", nets.case, 9),
        ("m4", nets.case, 1),
        ("m0plus", nets.case, 14),
        ("m33", nets.case, 2),
        ("m4", nets.xylo_case, 1),
    ],
)
def test_spikes_and_decisions_equal(core, case, number, tmp_path):
    made, fired = case(number)
    target, reference = target_named(f"cortex_{core}"), nets.reference(made, fired)
    target.write(made, tmp_path)
    by_clang = target.verify(made, tmp_path, reference).figures
    figures = nets.seen_faithful(by_gcc(target), made, reference, tmp_path).figures
    assert by_clang["ram_bytes"] <= figures["ram_bytes"] <= by_clang["ram_bytes"] + 8  # gaps between sections
    for name in ("flash_bytes", "cycles_per_inference"):
        assert 0.5 < figures[name] / by_clang[name] < 2
    before = target.footprint(made, replace(load(f"mcu_{core}"), compiler="gcc"))
    assert before["flash_bytes"] == pytest.approx(figures["flash_bytes"], abs=400)


@pytest.mark.skipif(GCC is None, reason="arm-none-eabi-gcc is not installed")
@pytest.mark.parametrize(
    ("core", "of", "seeds"),
    [
        ("m4", "networks", range(4)),
        ("m4", "counts", range(5)),
        ("m4", "integers", range(3)),
        ("m4", "convolutions", range(3)),
        ("m33", "networks", (4,)),
        ("m7", "integers", (2,)),
    ],
)
def test_cycles_lie_in_the_interval_of_the_profile(core, of, seeds):
    target, profile = by_gcc(target_named(f"cortex_{core}")), load(f"mcu_{core}_gcc")
    low, high = profile.at("low"), profile.at("high")
    for seed in seeds:
        made = made_network(seed) if of == "networks" else made_of_counts(seed, of)
        work, _, cycles = counted(target, *made)
        assert sum(n * low[kind] for kind, n in work.items()) < cycles
        assert sum(n * high[kind] for kind, n in work.items()) > cycles


@pytest.mark.skipif(GCC is None or QEMU is None, reason="arm-none-eabi-gcc or qemu-system-arm is missing")
def test_the_self_test_passes_under_qemu_and_sees_a_damaged_weight(tmp_path):
    made, _ = nets.case(6)
    target = target_named("cortex_m4")
    target.write(made, tmp_path)
    assert self_test(target.core, tmp_path) == ("PASS\n", 0)
    nets.spoil(tmp_path / "src" / "dse.c")
    assert self_test(target.core, tmp_path) == ("FAIL\n", 1)


def self_test(core, folder):
    """Return what the self-test in a folder prints on qemu's board, and its exit code."""
    sources = [START, folder / "selftest.c", folder / "src" / "dse_selftest.c", folder / "src" / "dse.c"]
    program = linked(sources, core, folder, BOARD, f"-I{folder / 'src'}", "-DPUT=put")
    board = ["-M", "mps2-an386", "-display", "none", "-monitor", "none", "-serial", "none"]
    command = [QEMU, *board, "-semihosting-config", "enable=on,target=native", "-kernel", str(program)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    return done.stdout + done.stderr, done.returncode
