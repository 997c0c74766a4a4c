"""Compiling C here and running it over recordings: every spike and every answer."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from dse.deploy.prefix import prefixed
from dse.records import Bools, Floats, Ints

WARNINGS = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic")
INIT, RESET, STEP, SPIKE, SAMPLE, START, EVENT, ANSWER = range(8)


class NoCompiler(RuntimeError):
    """There is no C compiler, in one sentence."""


class RunFailed(RuntimeError):
    """A compiler or a program failed, in one line."""


@dataclass(frozen=True)
class Played:
    """What C did on n recordings.

    spikes: (m, 4) recording, layer, network step, neuron; layer 0 is the input.
    label, steps, confident: (n,) answer, network steps until then, and whether the rule was met.
    counts: (n, output) output spikes within the window.
    """

    spikes: Ints
    label: Ints
    steps: Ints
    confident: Bools
    counts: Ints


def compiler() -> list[str]:
    """Return the command of a C compiler: $CC, one of the system, or that of ziglang.

    Raises:
        NoCompiler: there is none.
    """
    if os.environ.get("CC"):
        return os.environ["CC"].split()
    for name in ("cc", "gcc", "clang"):
        if (path := shutil.which(name)) is not None:
            return [path]
    if importlib.util.find_spec("ziglang") is not None:
        return [sys.executable, "-m", "ziglang", "cc"]
    raise NoCompiler("no C compiler is installed: install gcc or clang, or pip install 'dse[targets]'")


def has_compiler() -> bool:
    """Return whether there is a C compiler."""
    try:
        compiler()
    except NoCompiler:
        return False
    return True


def compiled(sources: Sequence[Path], program: Path, *options: str) -> None:
    """Compile and link sources without a warning.

    Raises:
        NoCompiler: there is none.
        RunFailed: the first complaint of the compiler.
    """
    command = [*compiler(), *WARNINGS, *options, *map(str, sources), "-o", str(program)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as error:
        raise NoCompiler(f"the C compiler {command[0]} does not run: {error.strerror}") from None
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if "error" in line] or done.stderr.splitlines()
        raise RunFailed(f"the C compiler refuses the code: {lines[0] if lines else 'no message'}")


_FOR_SIZE = "-Os"


def compiler_version() -> str:
    """Return the name and version of the compiler, such as gcc 12.2.0.

    Raises:
        NoCompiler: there is none.
    """
    command = compiler()
    told = _answer(command, "--version")
    line, *others = told.splitlines() or [Path(command[0]).name]
    numbers = re.findall(r"\d+\.\d+(?:\.\d+)*", line)
    if "clang" in line:
        name = "zig clang" if "ziglang" in command else "clang"
        return " ".join([name, *numbers[:1]])
    is_gcc = any("Free Software Foundation" in other for other in others)
    return " ".join(["gcc" if is_gcc else line.split()[0], *numbers[-1:]])


def compiler_name() -> str:
    """Return what compiled the code whose memory `sizes` reports: compiler, version, target and flags.

    Raises:
        NoCompiler: there is none.
    """
    answers = [_answer(compiler(), option).split("\n")[0] for option in ("--version", "-dumpmachine")]
    return ", ".join([x for x in answers if x] + [_FOR_SIZE])


def _answer(command: Sequence[str], option: str) -> str:
    """Return what a compiler says of itself."""
    try:
        done = subprocess.run([*command, option], capture_output=True, text=True, check=False)
    except OSError as error:
        raise NoCompiler(f"the C compiler {command[0]} does not run: {error.strerror}") from None
    return done.stdout.strip()


@dataclass(frozen=True)
class Sizes:
    """Memory of dse.c as a compiler reports it.

    ram_bytes: data and bss. flash_bytes: code, constants and data.
    """

    ram_bytes: int
    flash_bytes: int


def sizes(folder: Path, *options: str) -> Sizes | None:
    """Return the memory of the C in a folder as compiled here for size; None without the program `size`.

    Args:
        folder: of `files.write`.
        options: of the compiler, with the names of the prefix dse_.

    Raises:
        NoCompiler: there is none.
        RunFailed: the code does not compile.
    """
    if (size := shutil.which("size")) is None:
        return None
    source, prefix = classifier_in(folder)
    with tempfile.TemporaryDirectory() as temporary:
        code = Path(temporary) / "dse.o"
        plain = (_FOR_SIZE, "-c", "-fno-pie", "-fno-asynchronous-unwind-tables")
        compiled([source], code, *plain, *(prefixed(option, prefix) for option in options))
        done = subprocess.run([size, str(code)], capture_output=True, text=True, check=False)
    if done.returncode:
        return None
    text, data, bss = map(int, done.stdout.splitlines()[-1].split()[:3])
    return Sizes(data + bss, text + data)


def classifier_in(folder: Path) -> tuple[Path, str]:
    """Return the source of the classifier in a folder, and the prefix of its names."""
    [source] = (folder / "src").glob("*.c")
    return source, f"{source.stem}_"


def driven(folder: Path, place: Path, *options: str) -> tuple[list[Path], list[str]]:
    """Return the sources and options that compile the C in a folder with replay.c to drive it.

    Args:
        folder: of `files.write`.
        place: folder for replay.c with the names of the classifier.
        options: of the compiler, with the names of the prefix dse_.
    """
    source, prefix = classifier_in(folder)
    driver = place / "replay.c"
    driver.write_text(prefixed(Path(__file__).with_name("replay.c").read_text("utf-8"), prefix), "utf-8")
    return [driver, source], [f"-I{source.parent}", *(prefixed(option, prefix) for option in options)]


def played(folder: Path, commands: Sequence[Ints | Floats], *options: str) -> Played:
    """Run recordings through the C in a folder.

    Args:
        folder: of `files.write`.
        commands: per recording, int32 numbers for replay.c that begin with INIT and end with ANSWER.
        options: of the compiler, with the names of the prefix dse_.

    Raises:
        NoCompiler: there is none.
        RunFailed: the code does not compile, or the program fails.
    """
    with tempfile.TemporaryDirectory() as temporary:
        program = Path(temporary) / "replay"
        sources, all_options = driven(folder, Path(temporary), "-DDSE_TRACE", *options)
        compiled(sources, program, "-O1", *all_options)
        done = subprocess.run(
            [str(program)],
            input=np.concatenate(commands).astype(np.int32).tobytes(),
            capture_output=True,
            check=False,
        )
    if done.returncode:
        lines = done.stderr.decode(errors="replace").splitlines() or [f"exit code {done.returncode}"]
        raise RunFailed(f"the program failed: {lines[0]}")
    return parsed(np.frombuffer(done.stdout, np.int32))


def parsed(numbers: Ints) -> Played:
    """Return what replay.c has written."""
    spikes: list[Ints] = [np.zeros((0, 4), np.int64)]
    answers: list[Ints] = []
    counts: list[Ints] = []
    at = 0
    ends = np.flatnonzero(numbers == -1).tolist()
    for end in ends:
        if end < at or (end - at) % 3:  # a label or a count of -1 is no end
            continue
        rows = numbers[at:end].reshape(-1, 3)
        spikes.append(np.column_stack([np.full(len(rows), len(answers)), rows]))
        n = int(numbers[end + 4])
        answers.append(numbers[end + 1 : end + 4])
        counts.append(numbers[end + 5 : end + 5 + n])
        at = end + 5 + n
    label, steps, confident = np.array(answers, np.int64).reshape(-1, 3).T
    return Played(np.concatenate(spikes), label, steps, confident.astype(bool), np.array(counts))


def of_spikes(counts: Ints, channels: Ints) -> Ints:
    """Return the commands of a window of spikes.

    Args:
        counts: (step,) spikes of each step.
        channels: of the spikes, step by step.
    """
    parts: list[Ints] = [np.array([INIT, RESET])]
    at = 0
    for n in counts.tolist():
        block = np.empty(2 * n + 1, np.int64)
        block[0 : 2 * n : 2], block[1 : 2 * n : 2], block[-1] = SPIKE, channels[at : at + n], STEP
        parts.append(block)
        at += n
    return np.concatenate([*parts, np.array([ANSWER])])


def of_samples(values: Ints | Floats, start: int, n_steps: int) -> Ints:
    """Return the commands of a recording of samples, up to the end of its window.

    Args:
        values: (step, sensor) int32 or float32.
        start: first step of the window.
        n_steps: its length.
    """
    bits = np.ascontiguousarray(values[: start + n_steps]).view(np.int32)
    pushes = np.column_stack([np.full(len(bits), SAMPLE), bits, np.full(len(bits), STEP)])
    before = pushes[:start, :-1]
    begin, reset, end = (np.array([command]) for command in (INIT, RESET, ANSWER))
    return np.concatenate([begin, before.ravel(), reset, pushes[start:].ravel(), end])


def of_events(
    events: tuple[Ints, ...], t0_us: int, begin_us: int, bin_us: int, first: int, n_steps: int
) -> Ints:
    """Return the commands of a recording of events, up to the end of its window.

    Args:
        events: t_us, x, y and polarity.
        t0_us: time that bins are counted from.
        begin_us: start of the first bin.
        bin_us: width of a bin.
        first: first bin of the window.
        n_steps: length of the window.
    """
    t_us, x, y, polarity = (np.asarray(a, np.int64) for a in events)
    ends = begin_us + bin_us * np.arange(1, first + n_steps + 1)
    borders = [0, *np.searchsorted(t_us, ends).tolist()]
    rows = np.column_stack([np.full(len(t_us), EVENT), t_us & 0xFFFFFFFF, t_us >> 32, x, y, polarity])
    rows[:, 1] = np.where(rows[:, 1] >= 2**31, rows[:, 1] - 2**32, rows[:, 1])
    low = t0_us & 0xFFFFFFFF
    parts = [np.array([INIT, START, low - 2**32 if low >= 2**31 else low, t0_us >> 32])]
    for k, (a, b) in enumerate(pairwise(borders)):
        if k == first:
            parts.append(np.array([RESET]))
        parts += [rows[a:b].ravel(), np.array([STEP])]
    return np.concatenate([*parts, np.array([ANSWER])])
