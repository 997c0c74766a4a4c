"""C by gcc: every spike and decision equals the engine's, and the self-test passes on a board of qemu.

Skipped where arm-none-eabi-gcc or qemu-system-arm are missing (Debian: gcc-arm-none-eabi, qemu-system-arm).
"""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from dse.deploy.run import TargetError
from dse.deploy.targets import emulated, emulator
from dse.deploy.verify import target_named
from tests.deploy.c import nets

GCC, QEMU = shutil.which("arm-none-eabi-gcc"), shutil.which("qemu-system-arm")
START = Path(__file__).parent / "qemu_start.c"
FLOATS = {"m4": ["-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"], "m33": ["-mfloat-abi=hard", "-mfpu=fpv5-sp-d16"]}
# In the emulator, what drives the program lies apart: clang says so in its source, here its object does.
APART = {
    "*(.host .host.text .host.rodata .host.data)": "*replay.o(.text .text.* .rodata .rodata.* .data .data.*)",
    "*(.host.bss)": "*replay.o(.bss.memory_*)",
}
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


def gcc(core, sources, folder, script, *options):
    """Compile by gcc and link as a script says; return the program."""
    name, program, place = core.name.removeprefix("cortex_"), folder / "program", folder / "program.ld"
    place.write_text(script)
    command = [GCC, f"-mcpu=cortex-{name}", "-mthumb", *FLOATS.get(name, []), *emulator.FLAGS, *options]
    objects = [folder / f"{source.stem}.o" for source in sources]
    for source, made in zip(sources, objects, strict=True):
        run([*command, "-ffreestanding", "-fdata-sections", "-c", source, "-o", made])
    run([*command, *objects, "-nostdlib", "-lgcc", f"-Wl,-T,{place}", "-Wl,-e,main", "-o", program])
    return program


def run(command):
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
    if done.returncode:
        raise TargetError(done.stderr)


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
def test_spikes_and_decisions_equal(core, case, number, tmp_path, monkeypatch):
    script = emulator.LINKER_SCRIPT
    for by_section, by_object in APART.items():
        script = script.replace(by_section, by_object)

    def compiled(sources, of, *options):
        return emulator.Program.read(gcc(of, sources, tmp_path, script, *options).read_bytes())

    made, fired = case(number)
    target, reference = target_named(f"cortex_{core}"), nets.reference(made, fired)
    target.write(made, tmp_path)
    by_clang = target.verify(made, tmp_path, reference).figures
    monkeypatch.setattr(emulated, "compiled", compiled)
    verdict = target.verify(made, tmp_path, reference)
    assert verdict.kind == "faithful" and verdict.n_recordings == len(fired), verdict.reason
    figures = verdict.figures
    assert by_clang["ram_bytes"] <= figures["ram_bytes"] <= by_clang["ram_bytes"] + 8  # gaps between sections
    for name in ("flash_bytes", "cycles_per_inference"):
        assert 0.5 < figures[name] / by_clang[name] < 2


@pytest.mark.skipif(GCC is None or QEMU is None, reason="arm-none-eabi-gcc or qemu-system-arm is missing")
def test_the_self_test_passes_under_qemu_and_sees_a_damaged_weight(tmp_path):
    made, _ = nets.case(6)
    target = target_named("cortex_m4")
    target.write(made, tmp_path)
    assert self_test(target.core, tmp_path) == ("PASS\n", 0)
    code = tmp_path / "src" / "dse.c"
    text = code.read_text()
    begin = text.index("weights_1[")
    table = text[begin : text.index("}", begin)]
    code.write_text(text.replace(table, re.sub(r"-?\b\d+,", "3,", table)))
    assert self_test(target.core, tmp_path) == ("FAIL\n", 1)


def self_test(core, folder):
    """Return what the self-test in a folder prints on qemu's board, and its exit code."""
    sources = [START, folder / "selftest.c", folder / "src" / "dse_selftest.c", folder / "src" / "dse.c"]
    program = gcc(core, sources, folder, BOARD, f"-I{folder / 'src'}", "-DPUT=put")
    board = ["-M", "mps2-an386", "-display", "none", "-monitor", "none", "-serial", "none"]
    command = [QEMU, *board, "-semihosting-config", "enable=on,target=native", "-kernel", str(program)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    return done.stdout + done.stderr, done.returncode
