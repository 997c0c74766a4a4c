"""RISC-V processors with whole-number instructions (RV32IMC), such as that of an ESP32-C3."""

from __future__ import annotations

import numpy as np

from dse.base.registry import register
from dse.deploy.targets.emulated import target_of
from dse.deploy.targets.emulator import Core, InstructionSet

_LOAD, _STORE, _REGISTERS = 0b0000011, 0b0100011, 0b0110011  # opcodes: loads, stores, two registers
_PRODUCT, _LONG_PRODUCT, _QUOTIENT = 2, 3, 36  # cycles beyond the first


def block(code: bytes) -> tuple[int, int, int, int, int]:
    """Return the instructions of a block, its loads, its stores, 0, and cycles of products and quotients.

    Encodings: The RISC-V instruction set manual, volume I, chapters 2 (RV32I), 7 (M) and 16 (C).
    """
    halves = np.frombuffer(code, "<u2").tolist()
    instructions = loads = stores = waits = at = 0
    while at < len(halves):
        first = halves[at]
        wide = first & 3 == 3
        if wide:
            opcode, kind = first & 0x7F, first >> 12 & 7
            loads, stores = loads + (opcode == _LOAD), stores + (opcode == _STORE)
            if opcode == _REGISTERS and halves[at + 1] >> 9 == 1:
                waits += _QUOTIENT if kind >= 4 else _LONG_PRODUCT if kind else _PRODUCT
        elif not first & 1:  # C.LW and C.SW, and those at the stack pointer
            loads, stores = loads + (first >> 13 == 0b010), stores + (first >> 13 == 0b110)
        instructions, at = instructions + 1, at + 1 + wide
    return instructions, loads, stores, 0, waits


_RV32 = InstructionSet("RISCV", ("RISCV32",), "SP", "RA", "PC", ("A0", "A1", "A2", "A3"), 0, block)
CORE = Core(
    "riscv32",
    "RV32IMC",
    _RV32,
    "RISCV32_ANY",
    ("riscv32-freestanding", "-mcpu=generic_rv32+m+c"),
    # lowRISC, Ibex documentation, "Pipeline details": two stages, products in three cycles, no cache misses.
    load=1,
    store=1,
    pipelined=False,
    branch=2,
    note=", as RISC-V has it; its cycles are those of an Ibex, whose table is published",
)
RV32IMC = register("targets", "riscv32")(target_of(CORE, __name__))
