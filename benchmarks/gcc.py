"""The C of target `c99` by arm-none-eabi-gcc instead of clang, for the emulator of a core.

Debian has it as gcc-arm-none-eabi and libnewlib-arm-none-eabi.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

from dse.deploy.c import host
from dse.deploy.run import TargetError
from dse.deploy.targets.emulated import MEMORY, Emulated
from dse.deploy.targets.emulator import FLAGS, LINKER_SCRIPT, Core, Program


def _found() -> str | None:
    """Return the compiler; None where it or its C library, newlib, is missing."""
    if (gcc := shutil.which("arm-none-eabi-gcc")) is None:
        return None
    done = subprocess.run([gcc, "-print-file-name=libc.a"], capture_output=True, text=True, check=False)
    return gcc if Path(done.stdout.strip()).is_file() else None


GCC = _found()
_FLOATS = {
    "cortex_m4": ("-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"),
    "cortex_m7": ("-mfloat-abi=hard", "-mfpu=fpv5-sp-d16"),
    "cortex_m33": ("-mfloat-abi=hard", "-mfpu=fpv5-sp-d16"),
}
_LIBRARIES = "-lc", "-lgcc"
"""Of newlib, `memset`, which gcc calls for loops that clear; of gcc, doubles and divisions."""
_APART = {
    "*(.host .host.text .host.rodata .host.data)": "*replay.o(.text .text.* .rodata .rodata.* .data .data.*)",
    "*(.host.bss)": "*replay.o(.bss.memory_*)",
}
"""What drives the program lies apart: clang says so in its source, here its object does."""


def by_gcc(target: Emulated) -> Emulated:
    """Return the target of a core whose C gcc compiles."""

    def program(self: Emulated, folder: Path, *options: str) -> Program:
        with tempfile.TemporaryDirectory() as place:
            sources, all_options = host.driven(folder, Path(place), *options)
            return compiled(sources, self.core, f"-isystem{MEMORY}", *all_options)

    made: Emulated = type("ByGcc", (type(target),), {"program": program})()
    return made


def compiled(sources: Sequence[Path], core: Core, *options: str) -> Program:
    """Compile sources for a core and link them (`dse.deploy.targets.emulator.compiled`)."""
    script = LINKER_SCRIPT
    for by_section, by_object in _APART.items():
        script = script.replace(by_section, by_object)
    with tempfile.TemporaryDirectory() as folder:
        return Program.read(linked(sources, core, Path(folder), script, *options).read_bytes())


def linked(sources: Sequence[Path], core: Core, folder: Path, script: str, *options: str) -> Path:
    """Compile sources for a core and link them as a script says; return the program, in a folder.

    Raises:
        TargetError: the compiler is missing or refuses them.
    """
    if GCC is None:
        raise TargetError("arm-none-eabi-gcc or its newlib is not installed")
    cpu = core.name.replace("cortex_", "cortex-")
    command = [GCC, f"-mcpu={cpu}", "-mthumb", *_FLOATS.get(core.name, ()), *FLAGS, *options]
    program, place = folder / "program", folder / "program.ld"
    place.write_text(script)
    objects = [str(folder / f"{source.stem}.o") for source in sources]
    for source, made in zip(sources, objects, strict=True):
        _run([*command, "-ffreestanding", "-fdata-sections", "-c", str(source), "-o", made])
    _run([*command, *objects, "-nostdlib", *_LIBRARIES, f"-Wl,-T,{place}", "-Wl,-e,main", "-o", str(program)])
    return program


def _run(command: Sequence[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise TargetError(done.stderr)
