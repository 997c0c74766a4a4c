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
from pathlib import Path
from typing import Literal

import numpy as np

from dse.base.records import Floats, Ints
from dse.deploy.c import replay
from dse.deploy.prefix import prefixed
from dse.deploy.run import TargetError

WARNINGS = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic")


_OF_SYSTEM = {"cc": ("C", "CC", ("cc", "gcc", "clang")), "c++": ("C++", "CXX", ("c++", "g++", "clang++"))}


def compiler(language: Literal["cc", "c++"] = "cc") -> list[str]:
    """Return the command of a compiler of C or C++: $CC or $CXX, one of the system, or that of ziglang.

    Raises:
        TargetError: there is none.
    """
    what, variable, names = _OF_SYSTEM[language]
    if os.environ.get(variable):
        return os.environ[variable].split()
    for name in names:
        if (path := shutil.which(name)) is not None:
            return [path]
    if importlib.util.find_spec("ziglang") is not None:
        return [sys.executable, "-m", "ziglang", language]
    raise TargetError(f"no {what} compiler: install gcc or clang, or pip install 'dse-spiking[targets]'")


def compiled(sources: Sequence[Path], program: Path, *options: str) -> None:
    """Compile and link sources without a warning."""
    done = _ran([*compiler(), *WARNINGS, *options, *map(str, sources), "-o", str(program)])
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if "error" in line] or done.stderr.splitlines()
        raise TargetError(f"the C compiler refuses the code: {lines[0] if lines else 'no message'}")


_FOR_SIZE = "-Os"


def compiler_version(language: Literal["cc", "c++"] = "cc") -> str:
    """Return the name and version of the compiler, such as gcc 12.2.0."""
    command = compiler(language)
    banner = _answer(command, "--version")
    line, *others = banner.splitlines() or [Path(command[0]).name]
    numbers = re.findall(r"\d+\.\d+(?:\.\d+)*", line)
    if "clang" in line:
        name = "zig clang" if "ziglang" in command else "clang"
        return " ".join([name, *numbers[:1]])
    is_gcc = any("Free Software Foundation" in other for other in others)
    return " ".join(["gcc" if is_gcc else line.split()[0], *numbers[-1:]])


def compiler_name() -> str:
    """Return what compiled the code whose memory `sizes` reports: compiler, version, target and flags."""
    answers = [_answer(compiler(), option).split("\n")[0] for option in ("--version", "-dumpmachine")]
    return ", ".join([x for x in answers if x] + [_FOR_SIZE])


def _answer(command: Sequence[str], option: str) -> str:
    """Return what a compiler says of itself."""
    return _ran([*command, option]).stdout.strip()


def _ran(command: Sequence[str]) -> subprocess.CompletedProcess[str]:
    try:
        return subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as error:
        raise TargetError(f"the C compiler {command[0]} does not run: {error.strerror}") from None


def sizes(folder: Path, *options: str) -> dict[str, float]:
    """Return the memory of the C in a folder as compiled here for size; nothing without the program `size`.

    ram_bytes are the memory of one classifier, flash_bytes code and constants.
    """
    if (size := shutil.which("size")) is None:
        return {}
    source, prefix = classifier_in(folder)
    with tempfile.TemporaryDirectory() as temporary:
        code, both = Path(temporary) / "dse.o", Path(temporary) / "both.c"
        both.write_text(f'#include "{source.name}"\n{prefix}t net;\n', encoding="utf-8")
        plain = (_FOR_SIZE, "-c", "-fno-pie", "-fno-asynchronous-unwind-tables", "-fno-common")
        named = (prefixed(option, prefix) for option in options)
        compiled([both], code, *plain, f"-I{source.parent}", *named)
        done = subprocess.run([size, str(code)], capture_output=True, text=True, check=False)
    if done.returncode:
        return {}
    text, data, bss = map(float, done.stdout.splitlines()[-1].split()[:3])
    return {"ram_bytes": data + bss, "flash_bytes": text + data}


def classifier_in(folder: Path) -> tuple[Path, str]:
    """Return the source of the classifier in a folder, and the prefix of its names."""
    source = min((folder / "src").glob("*.c"), key=lambda x: len(x.name))  # not that of the self-test
    return source, f"{source.stem}_"


def driven(folder: Path, place: Path, *options: str) -> tuple[list[Path], list[str]]:
    """Return the sources and options that compile the C in a folder with replay.c, put into a place.

    Options of the compiler have the names of the prefix dse_.
    """
    source, prefix = classifier_in(folder)
    driver = place / "replay.c"
    driver.write_text(prefixed(Path(__file__).with_name("replay.c").read_text("utf-8"), prefix), "utf-8")
    if (weights := folder / "weights.bin").is_file():
        content = weights.read_bytes()
        words = np.frombuffer(content + bytes(-len(content) % 8), "<u8").tolist()
        text = f"static const uint64_t weights[] = {{{', '.join(f'{x}u' for x in words)}}};\n"
        (place / "weights.h").write_text(f"#define N_WEIGHT_BYTES {len(content)}u\n{text}", "utf-8")
        options = *options, "-DDSE_WEIGHTS", f"-I{place}"
    return [driver, source], [f"-I{source.parent}", *(prefixed(option, prefix) for option in options)]


def played(folder: Path, commands: Sequence[Ints | Floats], *options: str) -> replay.Played:
    """Run recordings through the C in a folder: numbers that begin with INIT and end with ANSWER each."""
    with tempfile.TemporaryDirectory() as temporary:
        program = replaying(folder, Path(temporary), "-O1", "-DDSE_TRACE", *options)
        return replay.parsed(told(program, commands))


def replaying(folder: Path, place: Path, *options: str) -> Path:
    """Return the program, in a place, that drives the C in a folder."""
    sources, all_options = driven(folder, place, *options)
    compiled(sources, place / "replay", *all_options)
    return place / "replay"


def told(program: Path, commands: Sequence[Ints | Floats], *arguments: str) -> Ints:
    """Return what a program of `replaying` writes of recordings, int32."""
    numbers = np.concatenate(commands).astype(np.int32).tobytes()
    done = subprocess.run([program, *arguments], input=numbers, capture_output=True, check=False)
    if done.returncode:
        lines = done.stderr.decode(errors="replace").splitlines() or [f"exit code {done.returncode}"]
        raise TargetError(f"the program failed: {lines[0]}")
    return np.frombuffer(done.stdout, np.int32)
