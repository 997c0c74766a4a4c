"""Cortex-M processors: their cores, and what their instructions, Thumb and Thumb-2, do."""

from __future__ import annotations

from typing import Any

import numpy as np

from dse.base.registry import register
from dse.deploy.c.code_size import CORTEX_M, CORTEX_M0_PLUS
from dse.deploy.targets.emulated import target_of
from dse.deploy.targets.emulator import Core, InstructionSet


def block(code: bytes) -> tuple[int, int, int, int, int]:
    """Return the instructions of a block, its loads and stores in words, loads that another one hides, waits.

    Encodings: Arm, ARMv7-M architecture reference manual, A5.
    """
    halves = np.frombuffer(code, "<u2").tolist()
    instructions = loads = stores = hidden = waits = at = 0
    after_load = False
    while at < len(halves):
        first = halves[at]
        wide = first >> 11 in (0b11101, 0b11110, 0b11111)
        load, store, single = _moved(first, halves[at + 1]) if wide else _moved_by_half(first)
        hidden += after_load and single
        after_load = bool(load) and single
        instructions, loads, stores = instructions + 1, loads + load, stores + store
        waits += _waits(first, halves[at + 1]) if wide else 0
        at += 1 + wide
    return instructions, loads, stores, hidden, waits


def _moved_by_half(code: int) -> tuple[int, int, bool]:
    """Return the words that a 16-bit instruction loads and stores, and whether it moves a single one."""
    top = code >> 12
    if code >> 11 == 0b01001:
        return 1, 0, True
    if top == 0b0101:
        load = code >> 9 & 7 >= 3
    elif top in (0b0110, 0b0111, 0b1000, 0b1001):
        load = bool(code >> 11 & 1)
    elif top == 0b1100 or code & 0xF600 == 0xB400:
        words = (code & 0xFF).bit_count() + (top == 0b1011 and code >> 8 & 1)
        return (words, 0, False) if code >> 11 & 1 else (0, words, False)
    else:
        return 0, 0, False
    return int(load), int(not load), True


def _moved(first: int, second: int) -> tuple[int, int, bool]:
    """Return the same of a 32-bit instruction."""
    load = bool(first >> 4 & 1)
    if first >> 9 == 0b1110100:
        words = 2 if first >> 6 & 1 else second.bit_count()
        return (words, 0, False) if load else (0, words, False)
    if first >> 9 == 0b1111100:
        return int(load), int(not load), True
    if first >> 9 == 0b1110110 and second & 0x0E00 == 0x0A00 and first & 0x01A0:  # floats; not two registers
        alone = first >> 8 & 1 and not first >> 5 & 1
        words = 1 + (second >> 8 & 1) if alone else second & 0xFF
        return (words, 0, False) if load else (0, words, False)
    return 0, 0, False


def _waits(first: int, second: int) -> int:
    """Return the cycles of a 32-bit instruction beyond one: of floats, divided or multiplied and added."""
    if first >> 8 != 0b11101110 or second & 0x0E10 != 0x0A00:
        return 0
    operation = first >> 4 & 0b1011
    if operation == 0b1000 or (operation == 0b1011 and first & 15 == 1 and second & 0xC0 == 0xC0):
        return 13  # quotient, or square root
    return 2 if operation in (0b0000, 0b0001, 0b1001, 0b1010) else 0


THUMB = InstructionSet("ARM", ("THUMB", "MCLASS"), "SP", "LR", "PC", ("R0", "R1", "R2", "R3"), 1, block)


def _core(name: str, label: str, emulated: str, unit: str = "", **fields: Any) -> Core:
    """Return a core; unit: of the compiler, what computes with floats of 32 bits; doubles are software."""
    abi, with_unit = ("eabihf", f"+{unit}") if unit else ("eabi", "")
    target = f"thumb-freestanding-{abi}", f"-mcpu={name}{with_unit}"
    fields = {"parts": CORTEX_M, "profile": name.replace("cortex", "mcu")} | fields
    return Core(name, label, THUMB, f"ARM_{emulated}", target, **fields)


CORES = {
    core.name: core
    for core in (
        # Arm, Cortex-M0+ technical reference manual, Table 3.1, without wait states.
        _core(
            "cortex_m0plus",
            "Cortex-M0+",
            "CORTEX_M0",
            store=1,
            pipelined=False,
            branch=1,
            parts=CORTEX_M0_PLUS,
            note="; the core has no instruction for divisions or long products",
        ),
        # Arm, Cortex-M3 technical reference manual, Table 18.1; the Cortex-M4 has the same pipeline.
        # Its floating-point instructions: Cortex-M4 technical reference manual, Table 7.1.
        _core("cortex_m4", "Cortex-M4", "CORTEX_M4", "vfp4d16sp"),
        # No tables are published: by the ratio of CoreMark per MHz, 3.40 of a Cortex-M4 to 5.01 and 4.02. The
        # emulator lacks the unit for doubles that many a Cortex-M7 has.
        _core("cortex_m7", "Cortex-M7", "CORTEX_M7", "fp_armv8d16sp", pace=3.40 / 5.01),
        _core("cortex_m33", "Cortex-M33", "CORTEX_M33", "fp_armv8d16sp", pace=3.40 / 4.02),
    )
}
TARGETS = {name: register("targets", name)(target_of(core, __name__)) for name, core in CORES.items()}
globals().update({cls.__name__: cls for cls in TARGETS.values()})  # where pickle looks for classes
