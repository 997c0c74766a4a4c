"""C for a processor: cross-compiled, executed in an emulator, its instructions counted.

The emulator, Unicorn, executes instructions and knows no time. Every basic block that it enters is counted,
so that the number of instructions is exact: those that pass through the pipeline. One of an IT block whose
condition fails passes as well and counts too. Cycles follow from the instructions by a rule (`Core`).
"""

from __future__ import annotations

import ctypes
import functools
import importlib
import importlib.metadata
import importlib.util
import struct
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from dse.base.records import Ints
from dse.deploy.run import TargetError

FLAGS = ("-std=c99", "-O2")
"""Options of the compiler, which `instructions` of a profile rest on too."""
FLASH, RAM, HOST = 0x0800_0000, 0x2000_0000, 0x6000_0000
"""Where a program lies: code and constants, variables, and what drives it."""
MOST_FLASH_BYTES = _RAM_BYTES = 1 << 24
_HOST_BYTES = 1 << 25
_STACK_BYTES = 1 << 16
_UNUSED = 0xA5  # what the stack holds before anything is pushed
_OWN = 4  # rows of numbers of the counter of blocks that are not of blocks
_EXIT = HOST + _HOST_BYTES - 0x1000  # where a called function returns to

LINKER_SCRIPT = f"""\
/* Where the emulator has the program. HOST holds what drives the program, which is not part of it. */
MEMORY {{
    FLASH : ORIGIN = {FLASH:#x}, LENGTH = {MOST_FLASH_BYTES:#x}
    RAM : ORIGIN = {RAM:#x}, LENGTH = {_RAM_BYTES - _STACK_BYTES:#x}
    HOST : ORIGIN = {HOST:#x}, LENGTH = {_HOST_BYTES - 0x1000:#x}
}}
SECTIONS {{
    .host : {{ *(.host .host.text .host.rodata .host.data) }} > HOST
    .host.bss (NOLOAD) : {{ *(.host.bss) }} > HOST
    .text : {{ *(.text .text.*) *(.rodata .rodata.* .srodata .srodata.*) }} > FLASH
    .data : {{ *(.data .data.* .sdata .sdata.*) }} > RAM
    .bss : {{ *(.bss .bss.* .sbss .sbss.*) *(COMMON) }} > RAM
    /DISCARD/ : {{ *(.ARM.exidx* .ARM.extab*) }}
}}
"""


@dataclass(frozen=True)
class InstructionSet:
    """What cores share that have the same instructions.

    architecture: name of the emulator's. modes: of the emulator.
    stack, link, counter: registers, as the emulator calls them. arguments: of a call; the first returns.
    code_bit: what is added to addresses of code.
    block: the code of a block -> its instructions, its loads and stores in words, loads whose cycle the next
        load or store hides, cycles of waiting.
    """

    architecture: str
    modes: tuple[str, ...]
    stack: str
    link: str
    counter: str
    arguments: tuple[str, ...]
    code_bit: int
    block: Callable[[bytes], tuple[int, int, int, int, int]]


@dataclass(frozen=True)
class Core:
    """A processor core.

    name: of the compiler and, in capitals, of the emulator.
    label: what it is called.
    instructions: that it has.
    emulated: name of the emulator's model; of a core that it lacks, one with the same instructions.
    target: of the compiler, with its options.
    load, store: cycles of a load or a store beyond that of every instruction.
    pipelined: whether a load or store directly after a load hides the load's cycle.
    branch: cycles of a taken branch beyond that of every instruction.
    pace: cycles of this core per cycle of the rule.
    profile: hardware profile that predicts its cycles; '' for none.
    note: about it, for `dse describe`.
    parts: compiler -> bytes of the parts of the code (dse.deploy.c.code_size); of others, flash is not known
        before it is compiled.
    """

    name: str
    label: str
    instructions: InstructionSet
    emulated: str
    target: tuple[str, ...]
    load: int = 1
    store: int = 0
    pipelined: bool = True
    branch: int = 2
    pace: float = 1.0
    profile: str = ""
    note: str = ""
    parts: Mapping[str, Mapping[str, float]] = field(default_factory=dict, hash=False, repr=False)

    @property
    def options(self) -> tuple[str, ...]:
        """Options of the compiler for this core."""
        return "-target", *self.target, *FLAGS


_NEEDED = {"ziglang": "cross-compiler", "unicorn": "emulator"}


def missing(needed: Mapping[str, str] = _NEEDED) -> str:
    """Return why no program can be compiled and executed here, by packages that are needed; '' if it can."""
    for name, what in needed.items():
        if importlib.util.find_spec(name) is None:
            return f"{name}, the {what}, is not installed: pip install 'dse-spiking[targets]'"
        try:
            importlib.import_module(name)
        except ImportError as error:
            reason = str(error).partition("\n")[0]
            return f"{name}, the {what}, is installed but cannot be imported: {reason}"
    return ""


def check(needed: Mapping[str, str] = _NEEDED) -> None:
    """Raise TargetError if something is missing."""
    if why := missing(needed):
        raise TargetError(why)


def versions(needed: Mapping[str, str] = _NEEDED) -> tuple[str, ...]:
    """Return the names and versions of the compiler and the emulator."""
    return tuple(f"{name} {importlib.metadata.version(name)}" for name in needed)


def compiler_name() -> str:
    """Return the compiler and its version and options."""
    return f"{versions()[0]}, {' '.join(FLAGS)}"


def compiled(sources: Sequence[Path], core: Core, *options: str) -> Program:
    """Compile sources for a core and link them."""
    check()
    with tempfile.TemporaryDirectory() as folder:
        script, program = Path(folder) / "program.ld", Path(folder) / "program"
        script.write_text(LINKER_SCRIPT)
        shared = (
            *core.options,
            "-ffreestanding",
            "-fno-sanitize=all",
            *options,
            f"-Wl,-T,{script}",
            "-Wl,-e,0",
        )
        alone = *shared, "-nostdlib", "-Wl,--no-gc-sections"
        # What it lacks alone, such as a division, the compiler's own library has.
        linked = *shared, "-Wl,--gc-sections", "-Wl,-e,main"
        built(f"{sources[0].name} does not compile for {core.label}", sources, program, alone, linked)
        return Program.read(program.read_bytes())


def built(refused: str, sources: Sequence[Path], program: Path, *attempts: Sequence[str]) -> None:
    """Compile sources by the first options with which no symbol is undefined; `refused` begins an error."""
    command = [sys.executable, "-m", "ziglang", "cc", *map(str, sources), "-o", str(program)]
    for options in attempts:
        done = subprocess.run([*command, *options], capture_output=True, text=True, check=False)
        if "undefined symbol" not in done.stderr:
            break
    if done.returncode:
        reason = next((x for x in done.stderr.splitlines() if "error" in x), done.stderr.strip())
        raise TargetError(f"{refused}: {reason}")


@dataclass(frozen=True)
class Program:
    """A linked program.

    sections: name -> address, size and content; None of what starts as 0.
    symbols: name -> address and size.
    """

    sections: Mapping[str, tuple[int, int, bytes | None]]
    symbols: Mapping[str, tuple[int, int]]

    @classmethod
    def read(cls, elf: bytes) -> Program:
        """Return the program in a 32-bit ELF file."""
        table, size, number, names = (
            struct.unpack_from(kind, elf, at)[0]
            for kind, at in (("<I", 32), ("<H", 46), ("<H", 48), ("<H", 50))
        )
        rows = [struct.unpack_from("<10I", elf, table + i * size) for i in range(number)]

        def text(strings: int, at: int) -> str:
            start = rows[strings][4] + at
            return elf[start : elf.index(b"\0", start)].decode()

        sections: dict[str, tuple[int, int, bytes | None]] = {}
        symbols: dict[str, tuple[int, int]] = {}
        for row in rows:
            name, kind, flags, address, offset, length, link = row[:7]
            if kind == 2:  # symbols
                for at in range(offset, offset + length, 16):
                    label, value, extent, info = struct.unpack_from("<IIIB", elf, at)
                    if info & 15 in (1, 2):  # a variable or a function, whose lowest bit says Thumb
                        symbols[text(link, label)] = (value & ~1 if info & 15 == 2 else value, extent)
            elif flags & 2 and length:  # in memory
                content = None if kind == 8 else elf[offset : offset + length]
                sections[text(names, name)] = (address, length, content)
        return cls(sections, symbols)

    def within(self, start: int, length: int) -> int:
        """Return the bytes of the sections that lie within some memory."""
        return sum(size for at, size, _ in self.sections.values() if start <= at < start + length)

    @property
    def flash_bytes(self) -> int:
        """Code, constants, and the initial values of variables."""
        initial = sum(
            size for at, size, content in self.sections.values() if RAM <= at < HOST and content is not None
        )
        return self.within(FLASH, MOST_FLASH_BYTES) + initial

    @property
    def ram_bytes(self) -> int:
        """Variables, without the stack."""
        return self.within(RAM, _RAM_BYTES)


@dataclass(frozen=True)
class Counts:
    """What a core executed, of the code in flash.

    instructions: those that passed through the pipeline.
    loads, stores: words that they moved. hidden: loads whose cycle the next load or store hides.
    branches: taken ones.
    waits: cycles of the unit for floats beyond that of every instruction: divisions, fused products.
    """

    instructions: int
    loads: int
    stores: int
    hidden: int
    branches: int
    waits: int = 0

    def cycles(self, core: Core) -> float:
        """Return the cycles by the rule of a core, without wait states of the memory."""
        loads = self.loads - (self.hidden if core.pipelined else 0)
        beyond = core.load * loads + core.store * self.stores + core.branch * self.branches + self.waits
        return core.pace * (self.instructions + beyond)


class Machine:
    """A processor with a program in its memory."""

    def __init__(self, program: Program, core: Core, steps: tuple[str, str] = ("", "")) -> None:
        """Put a program into the memory of a core.

        Args:
            program: linked for it.
            core: which.
            steps: names of the functions that end a step and that begin a window: what is called from the
                end of a step to that of the next is taken together (`longest_step`).
        """
        import unicorn
        from unicorn.unicorn_py3.unicorn import uclib

        of, self.program, self._set = core.instructions, program, core.instructions
        self._names = importlib.import_module(f"unicorn.{of.architecture.lower()}_const")
        mode = sum(getattr(unicorn, f"UC_MODE_{name}") for name in of.modes)
        self._uc: Any = unicorn.Uc(getattr(unicorn, f"UC_ARCH_{of.architecture}"), mode)
        self._uc.ctl_set_cpu_model(getattr(self._names, f"UC_CPU_{core.emulated}"))
        for start, length in ((FLASH, MOST_FLASH_BYTES), (RAM, _RAM_BYTES), (HOST, _HOST_BYTES)):
            self._uc.mem_map(start, length)
        for at, _, content in program.sections.values():
            if content is not None:
                self._uc.mem_write(at, content)
        self._uc.mem_write(RAM + _RAM_BYTES - _STACK_BYTES, bytes([_UNUSED]) * _STACK_BYTES)
        code = program.within(FLASH, MOST_FLASH_BYTES)
        # Rows of the counter's own (`_counter`), then per half-word of code the entries of the block that
        # begins there, its bytes, its exits by a branch, and its cycles before `pace`; 0: not known yet.
        self._blocks = np.zeros((_OWN + (code + 1) // 2, 4), np.int64)
        self._core, (step, reset) = core, (self.program.symbols.get(x, (0, 0))[0] for x in steps)
        self._blocks[0, 0], self._blocks[1] = code, (step, reset, core.branch, 0)
        self.forget()
        handle = ctypes.c_size_t()
        failed = uclib.uc_hook_add(
            self._uc._uch,
            ctypes.byref(handle),
            unicorn.UC_HOOK_BLOCK,
            ctypes.c_void_p(_counter().address),
            ctypes.c_void_p(self._blocks.ctypes.data),
            ctypes.c_uint64(1),  # everywhere: an empty range
            ctypes.c_uint64(0),
        )
        if failed:
            raise TargetError(f"the emulator refuses to count blocks: error {failed}")

    def call(self, function: str, *arguments: int) -> int:
        """Call a function with up to four whole numbers; return what it returns."""
        import unicorn

        of, uc = self._set, self._uc
        uc.reg_write(self._register(of.stack), RAM + _RAM_BYTES)
        uc.reg_write(self._register(of.link), _EXIT | of.code_bit)
        for name, value in zip(of.arguments, arguments, strict=False):
            uc.reg_write(self._register(name), value)
        try:
            uc.emu_start(self.program.symbols[function][0] | of.code_bit, _EXIT)
        except unicorn.UcError as error:
            at = uc.reg_read(self._register(of.counter))
            raise TargetError(f"{function} fails at {at:#x}: {error}") from None
        return int(uc.reg_read(self._register(of.arguments[0])))

    def _register(self, name: str) -> int:
        number: int = getattr(self._names, f"UC_{self._set.architecture}_REG_{name}")
        return number

    def write(self, variable: str, content: bytes, at: int = 0) -> None:
        """Write into a variable, from byte `at` on."""
        address, size = self.program.symbols[variable]
        if at + len(content) > size:
            raise TargetError(f"{variable} has {size} bytes, got {at + len(content)}")
        self._uc.mem_write(address + at, content)

    def read(self, variable: str, length: int | None = None) -> bytes:
        """Return a variable's content, or its first bytes."""
        address, size = self.program.symbols[variable]
        return bytes(self._uc.mem_read(address, size if length is None else length))

    @property
    def stack_bytes(self) -> int:
        """The most stack that any call so far needed."""
        stack = np.frombuffer(self._uc.mem_read(RAM + _RAM_BYTES - _STACK_BYTES, _STACK_BYTES), np.uint8)
        used = np.flatnonzero(stack != _UNUSED)
        return int(_STACK_BYTES - used[0]) if used.size else 0

    def counts(self) -> Counts:
        """Return what was executed so far."""
        return self._counted(self._entered)

    def counts_of(self, function: str) -> Counts:
        """Return what was executed of a function so far, without those that it calls."""
        address, size = self.program.symbols[function]
        first = (address - FLASH) // 2
        entered = self._entered
        return self._counted(entered[(entered >= first) & (entered < first + (size + 1) // 2)])

    def longest_step(self, run: Callable[[], object]) -> float:
        """Return the most cycles of a step in what a run calls, which is repeated if it enters new blocks."""
        while True:
            for at in self._entered[self._blocks[_OWN + self._entered, 3] == 0].tolist():
                instructions, loads, stores, hidden, waits = self._set.block(self._code(at))
                counts = Counts(instructions, loads, stores, hidden, 0, waits)
                self._blocks[_OWN + at, 3] = round(counts.cycles(self._core) / self._core.pace)
            self._blocks[2] = 0
            run()
            _, longest, is_new, _ = self._blocks[2].tolist()
            if not is_new:
                return float(longest * self._core.pace)

    def forget(self) -> None:
        """Count from here on."""
        self._blocks[_OWN:, :3] = 0
        self._blocks[0, 1:] = -1, 4 * (_OWN - 1), 0

    @property
    def _entered(self) -> Ints:
        return np.flatnonzero(self._blocks[_OWN:, 0])

    def _code(self, at: int) -> bytes:
        """Return the block that begins at a half-word of the code."""
        return bytes(self._uc.mem_read(FLASH + 2 * at, int(self._blocks[_OWN + at, 1])))

    def _counted(self, entered: Ints) -> Counts:
        totals, branches = np.zeros(5, np.int64), 0
        last = int(self._blocks[0, 2]) // 4 - _OWN  # it has returned, but no block came after it
        for at in entered.tolist():
            times, _, left, _ = self._blocks[_OWN + at].tolist()
            totals += times * np.array(self._set.block(self._code(at)), np.int64)
            branches += left + (at == last)
        instructions, loads, stores, hidden, waits = totals.tolist()
        return Counts(instructions, loads, stores, hidden, branches, waits)


@functools.cache
def _counter() -> Any:
    """Return the compiled function that the emulator calls before every block.

    Of the first rows of its numbers, 0: the bytes of code, the end of the block before, where that block is
    counted; 1: where the functions begin that end a step and begin a window, cycles of a branch, and which of
    them runs; 2: cycles since the last step, those of the longest, whether those of a block were not known;
    3: counted for the block before the first.
    """
    import numba

    types: Any = numba.types

    def count(_: Any, address: int, size: int, blocks: Any) -> None:
        within = address - FLASH
        if 0 <= within < blocks[0]:
            at = 4 * (_OWN + (within >> 1))
            blocks[at] += 1
            blocks[at + 1] = size
            blocks[8] += blocks[at + 3]
            if blocks[at + 3] == 0:
                blocks[10] = 1
            if blocks[1] != address:  # the block before ended in a branch that was taken
                blocks[blocks[2] + 2] += 1
                blocks[8] += blocks[6]
            blocks[1] = address + size
            blocks[2] = at
            if address == blocks[4]:
                blocks[7] = 1
            elif address == blocks[5]:
                blocks[7] = 2
        elif blocks[7]:  # it has returned
            if blocks[7] == 1:
                blocks[9] = max(blocks[9], blocks[8])
            blocks[7] = blocks[8] = 0

    arguments = (types.voidptr, types.int64, types.int32, types.CPointer(types.int64))
    return numba.cfunc(types.void(*arguments), cache=True)(count)
