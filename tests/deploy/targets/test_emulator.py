"""Instructions and cycles of hand-written code, counted by hand."""

import sys

import pytest

from dse.deploy.targets import TargetError, emulator
from dse.deploy.targets.emulator import Counts, Machine, compiled
from dse.deploy.targets.riscv import CORE
from dse.deploy.targets.thumb import CORES

M0, M4, M7 = (CORES[name] for name in ("cortex_m0plus", "cortex_m4", "cortex_m7"))

FUNCTIONS = {
    # 2 n + 1 instructions; n - 1 branches back and the return.
    "count_down": "1: subs r0, #1\\n bne 1b\\n bx lr",
    # The second load hides the cycle of the first.
    "add_pair": "ldr r1, [r0]\\n ldr r2, [r0, #4]\\n adds r1, r1, r2\\n str r1, [r0, #8]\\n bx lr",
    # Other instructions in between: nothing is hidden.
    "spread": "ldr r1, [r0]\\n nop\\n ldrb r2, [r0, #4]\\n adds r1, r1, r2\\n str r1, [r0, #8]\\n bx lr",
    # Two words onto the stack, two from it; the last one is the return.
    "stacked": "push {r4, lr}\\n movs r0, #7\\n pop {r4, pc}",
    "twice": "push {r3, lr}\\n bl count_down\\n movs r0, #3\\n bl count_down\\n pop {r3, pc}",
}
WIDE = {  # of ARMv7-M alone
    "magnitude": "cmp r0, #0\\n it lt\\n rsblt r0, r0, #0\\n bx lr",
    "wide": "ldr.w r1, [r0, #4]\\n ldrd r2, r3, [r0]\\n stm.w r0, {r1, r2, r3}\\n bx lr",
}


@pytest.fixture(scope="module")
def programs(tmp_path_factory):
    if why := emulator.missing():
        pytest.skip(why)
    folder = tmp_path_factory.mktemp("program")
    text = "const int first[3] = {20, 22, 0}; int changed[4] = {1, 2, 3, 4}; int zero[5];\n"
    for name, code in (FUNCTIONS | WIDE).items():
        guard = name in WIDE
        text += "#if __ARM_ARCH > 6\n" * guard
        text += f'__attribute__((naked)) void {name}(void) {{ __asm__("{code}"); }}\n'
        text += "#endif\n" * guard
    text += '__attribute__((section(".host"))) int outside[100] = {1};\n'
    (folder / "program.c").write_text(text)
    return {core.name: compiled([folder / "program.c"], core) for core in (M0, M4)}


@pytest.mark.parametrize(
    ("function", "argument", "counts", "cycles_m0", "cycles_m4"),
    [
        ("count_down", 5, Counts(11, 0, 0, 0, 5), 16, 21),
        ("count_down", 1, Counts(3, 0, 0, 0, 1), 4, 5),
        ("add_pair", emulator.RAM, Counts(5, 2, 1, 1, 1), 9, 8),
        ("spread", emulator.RAM, Counts(6, 2, 1, 0, 1), 10, 10),
        ("stacked", 0, Counts(3, 2, 2, 0, 1), 8, 7),
        # 5 of its own, 2 n + 1 of n = 2 and of n = 3; branches: 4 there and back, 1 + 2 within, 1.
        ("twice", 2, Counts(17, 2, 2, 0, 8), 29, 35),
    ],
)
def test_counts_and_cycles_by_hand(programs, function, argument, counts, cycles_m0, cycles_m4):
    for core, cycles in ((M0, cycles_m0), (M4, cycles_m4)):
        machine = Machine(programs[core.name], core)
        machine.call(function, argument)
        assert machine.counts() == counts
        assert machine.counts().cycles(core) == cycles


@pytest.mark.parametrize("argument", [5, -5])
def test_what_a_condition_skips_counts(programs, argument):
    machine = Machine(programs["cortex_m4"], M4)
    assert machine.call("magnitude", argument & 0xFFFFFFFF) == 5
    assert machine.counts().instructions == 4


def test_instructions_of_32_bits(programs):
    machine = Machine(programs["cortex_m4"], M4)
    machine.call("wide", emulator.RAM)
    assert machine.counts() == Counts(4, 3, 3, 0, 1)
    assert machine.read("changed", 12) == b"\2\0\0\0\1\0\0\0\2\0\0\0"


def test_counts_of_one_function_and_from_a_moment_on(programs):
    machine = Machine(programs["cortex_m4"], M4)
    machine.call("twice", 2)
    assert machine.counts_of("count_down").instructions == 12
    assert machine.counts_of("twice").instructions == 5
    machine.forget()
    assert machine.counts() == Counts(0, 0, 0, 0, 0)
    machine.call("count_down", 1)
    assert machine.counts().instructions == 3


def test_memory(programs):
    program = programs["cortex_m4"]
    machine = Machine(program, M4)
    assert program.ram_bytes == 4 * 4 + 5 * 4
    assert program.flash_bytes == program.sections[".text"][1] + 4 * 4  # initial values lie there too
    assert "outside" in program.symbols and machine.stack_bytes == 0
    machine.call("stacked", 0)
    assert machine.stack_bytes == 8
    machine.write("changed", b"\1\2", at=4)
    assert machine.read("changed", 8) == b"\1\0\0\0\1\2\0\0"
    with pytest.raises(TargetError, match="changed has 16 bytes, got 17"):
        machine.write("changed", bytes(17))


def test_cycles_of_a_core_without_published_tables():
    # 8 cycles by the rule of a Cortex-M4, of which the Cortex-M7 does 5.01 in the time of 3.40.
    assert Counts(5, 2, 1, 1, 1).cycles(M7) == pytest.approx(8 * 3.40 / 5.01)


def test_code_that_does_not_compile(tmp_path, programs):
    (tmp_path / "broken.c").write_text("int f(void) { return x; }\n")
    with pytest.raises(TargetError, match=r"broken.c does not compile for Cortex-M4: .*undeclared"):
        compiled([tmp_path / "broken.c"], M4)


def test_code_that_no_processor_runs(programs):
    machine = Machine(programs["cortex_m4"], M4)
    with pytest.raises(TargetError, match="add_pair fails at 0x"):
        machine.call("add_pair", 0x1000)


def test_without_compiler_or_emulator(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name == "unicorn" else name)
    assert emulator.missing() == "unicorn, the emulator, is not installed: pip install 'dse-spiking[targets]'"
    with pytest.raises(TargetError, match="unicorn, the emulator"):
        compiled([], M4)


def test_an_emulator_that_cannot_be_imported_is_missing(monkeypatch, tmp_path):
    (tmp_path / "unicorn.py").write_text('raise ImportError("no library\\nfor this processor")\n')
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "unicorn", raising=False)
    assert emulator.missing().endswith("the emulator, is installed but cannot be imported: no library")


RISCV = {
    # 2 n + 1 instructions; n - 1 branches back and the return.
    "count_down": "1: addi a0, a0, -1\\n bnez a0, 1b\\n ret",
    "moved": "lw a1, 0(a0)\\n lbu a2, 4(a0)\\n sh a1, 8(a0)\\n sw a2, 12(a0)\\n ret",
    "stacked": "addi sp, sp, -16\\n sw ra, 12(sp)\\n li a0, 7\\n lw ra, 12(sp)\\n addi sp, sp, 16\\n ret",
    "computed": "mul a1, a0, a0\\n mulhu a2, a0, a0\\n div a3, a1, a0\\n remu a0, a1, a0\\n ret",
}


@pytest.mark.parametrize(
    ("function", "argument", "counts", "cycles"),
    [
        ("count_down", 5, Counts(11, 0, 0, 0, 5), 21),
        ("moved", emulator.RAM, Counts(5, 2, 2, 0, 1), 11),
        ("stacked", 0, Counts(6, 1, 1, 0, 1), 10),
        ("computed", 9, Counts(5, 0, 0, 0, 1, 77), 84),
    ],
)
def test_riscv(function, argument, counts, cycles, tmp_path):
    if why := emulator.missing():
        pytest.skip(why)
    text = "int changed[4] = {1, 2, 3, 4};\n"
    for name, code in RISCV.items():
        text += f'__attribute__((naked)) void {name}(void) {{ __asm__("{code}"); }}\n'
    (tmp_path / "program.c").write_text(text)
    machine = Machine(compiled([tmp_path / "program.c"], CORE), CORE)
    machine.call(function, argument)
    assert machine.counts() == counts and machine.counts().cycles(CORE) == cycles
