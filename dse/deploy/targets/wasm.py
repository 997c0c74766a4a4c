"""WebAssembly: the C of `c99` as one module for a browser, compiled by ziglang and executed by wasmtime."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from dse.base.records import Ints
from dse.base.registry import register
from dse.deploy.bundle import Bundle
from dse.deploy.c import host, replay
from dse.deploy.c.code import Code
from dse.deploy.c.replay import Executed, Recorded
from dse.deploy.reference import Reference
from dse.deploy.run import TargetError
from dse.deploy.targets.c99 import InC
from dse.deploy.targets.emulated import MEMORY, in_memory
from dse.deploy.targets.emulator import built, check, versions

_CALLED = 16
"""Windows whose spikes are given to the module itself; a program that tells every spike has all of them."""
_HOSTILE = 2
"""Of the windows that no sensor gives (`replay.hostile`), those that it is given too."""
_FLAGS = ("-std=c99", "-Os")
# Without a C library, which ziglang would compile for half a minute at its first use.
_BARE = ("-target", "wasm32-freestanding", *_FLAGS)
_NO_ENTRY = ("-Wl,--no-entry", "-Wl,--strip-all")
_MODULE = (*_BARE, *_NO_ENTRY, "-Wl,--export=__heap_base")
_IN_MEMORY = ("memory_in", "memory_n_in", "memory_read", "memory_out", "memory_n_out")  # of memory/stdio.h
_PROGRAM = (*_BARE, *_NO_ENTRY, "-Dmain=replay", *(f"-Wl,--export={x}" for x in ("replay", *_IN_MEMORY)))
_CALLS = {replay.INIT: "init", replay.RESET: "reset", replay.STEP: "step"}
_MOST_FUEL = 2**62
_NEEDED = {"ziglang": "cross-compiler", "wasmtime": "run time"}
_REFUSED = "does not compile for WebAssembly"


@register("targets", "wasm")
@dataclass(frozen=True)
class Wasm(InC):
    """The C of c99 as a module without imports, of some ten kilobytes, run in wasmtime."""

    label: ClassVar[str] = "WebAssembly for browsers"
    extra: ClassVar[str] = "targets"
    use: ClassVar[str] = (
        "`const {instance} = await WebAssembly.instantiateStreaming(fetch('dse.wasm'))`: its exports are the "
        "functions of src/dse.h, and `dse_net`, a classifier; a sample may lie in `memory` from "
        "`__heap_base` on"
    )

    def emit(self, form: Code, bundle: Bundle, folder: Path, *options: str) -> None:
        """Write the files of `c99`, and dse.wasm: functions of src/dse.h, memory; `options` compile it."""
        check(_NEEDED)
        super().emit(form, bundle, folder)
        source, prefix = host.classifier_in(folder)
        header = source.with_suffix(".h").read_text(encoding="utf-8").partition("_TRACE")[0]
        named = [*re.findall(rf"\b({prefix}\w+)\([^)]*\);", header), f"{prefix}net"]
        with tempfile.TemporaryDirectory() as place:
            own = Path(place) / "net.c"
            own.write_text(f'#include "{source.stem}.h"\n{prefix}t {prefix}net;\n', encoding="utf-8")
            exports = [f"-Wl,--export={x}" for x in named]
            sources = [own, *sorted(source.parent.glob("*.c"))]
            options = f"-I{source.parent}", *_MODULE, *exports, *options
            built(f"{sources[-1].name} {_REFUSED}", sources, _module(folder), options)

    def executed(self, form: Code, folder: Path, reference: Reference, recorded: Recorded) -> Executed:
        """Run all recordings in wasmtime (`InC`); call the module itself with spikes of some.

        Figures: bytes of the module, its instructions per inference, from `dse_reset` to the end, and those
        of the longest step, spikes pushed.
        """
        check(_NEEDED)
        with tempfile.TemporaryDirectory() as place:
            sources, options = host.driven(folder, Path(place), "-DDSE_TRACE", *recorded.options)
            program = Path(place) / "replay.wasm"
            options = [f"-isystem{MEMORY}", *_PROGRAM, *options]
            built(f"{sources[-1].name} {_REFUSED}", sources, program, options)
            played = replay.parsed(_replayed(program, recorded.commands or replay.of_spikes(reference)))
        _, prefix = host.classifier_in(folder)
        windows = [*replay.of_spikes(reference)[:_CALLED], *replay.hostile(form)[:_HOSTILE]]
        labels, instructions, longest = _called(_module(folder), prefix, windows)
        labels, instructions = labels[:-_HOSTILE], instructions[:-_HOSTILE]
        if not np.array_equal(labels, played.label[: len(labels)]):
            raise TargetError(f"{_module(folder).name} does not answer as the program that tells its spikes")
        figures = {
            "module_bytes": float(_module(folder).stat().st_size),
            "instructions_per_inference": float(instructions.mean()),
            "instructions_of_longest_step": float(longest),
        }
        used = versions(_NEEDED)
        return Executed(played, figures, f"{used[0]}, {' '.join(_BARE)}", used)


def _module(folder: Path) -> Path:
    source, _ = host.classifier_in(folder)
    return folder / f"{source.stem}.wasm"


def _replayed(program: Path, commands: Sequence[Ints]) -> Ints:
    """Return what a program of replay.c writes of recordings, int32."""
    import wasmtime

    store = wasmtime.Store()
    loaded = wasmtime.Module.from_file(store.engine, str(program))
    exports: Any = wasmtime.Instance(store, loaded, []).exports(store)
    memory, at = exports["memory"], {name: exports[name].value(store) for name in _IN_MEMORY}

    def write(name: str, content: bytes) -> None:
        memory.write(store, content, at[name])

    def read(name: str, n_bytes: int) -> bytes:
        return bytes(memory.read(store, at[name], at[name] + n_bytes))

    def run() -> None:
        try:
            if code := exports["replay"](store):
                raise TargetError(f"the program failed: exit code {code}")
        except wasmtime.Trap as trap:
            raise TargetError(f"the program failed: {trap.message.splitlines()[-1].strip()}") from None

    return in_memory(commands, write, read, run)


def _called(module: Path, prefix: str, commands: Sequence[Ints]) -> tuple[Ints, Ints, int]:
    """Return a module's answers to windows of spikes, the instructions of each, those of the longest step."""
    import wasmtime

    config = wasmtime.Config()
    config.consume_fuel = True
    store = wasmtime.Store(wasmtime.Engine(config))
    store.set_fuel(_MOST_FUEL)
    loaded = wasmtime.Module.from_file(store.engine, str(module))
    exports: Any = wasmtime.Instance(store, loaded, []).exports(store)
    labels, taken, longest, net = [], [], 0, exports[f"{prefix}net"].value(store)
    for of_window in commands:
        numbers, before = iter(of_window.tolist()), store.get_fuel()
        since = before
        for command in numbers:
            if command == replay.SPIKE:
                exports[f"{prefix}push_spike"](store, net, next(numbers))
            elif command == replay.ANSWER:
                labels.append(exports[f"{prefix}decision"](store, net))
            else:
                exports[f"{prefix}{_CALLS[command]}"](store, net)
                left = store.get_fuel()
                longest, since = max(longest, since - left if command == replay.STEP else 0), left
        taken.append(before - store.get_fuel())
    return np.array(labels, np.int64), np.array(taken, np.int64), longest
