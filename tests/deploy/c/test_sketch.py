"""The Arduino sketch on a stub of a board: it answers as the bundle does on the same stream."""

from __future__ import annotations

import re
import shutil
import sys
from dataclasses import replace
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from dse.base.records import Array, Block
from dse.deploy import bundle
from dse.deploy.boards import BOARDS
from dse.deploy.bundle import Input
from dse.deploy.evaluate import evaluate
from dse.deploy.stream import Stream
from dse.deploy.targets.c99 import C99
from dse.deploy.verify import target_named
from tests.deploy.c import nets
from tests.deploy.targets.test_c99 import EVENTS, SAMPLES, network, run
from tests.spaces import sections

pytestmark = pytest.mark.skipif(find_spec("ziglang") is None, reason="ziglang is not installed")

N_STEPS = 12
STEP_US = {"samples": 5000, "spikes": 5000, "events": 2000}
BOARD = Path(__file__).parent / "board"
"""Stub headers of a board, and the board."""
CORES = ("STM32", "RP2040", "ESP32", "AVR")
ZIG = (sys.executable, "-m", "ziglang")
CC = (gcc,) if (gcc := shutil.which("gcc")) else (*ZIG, "cc")
CXX = (gxx,) if (gxx := shutil.which("g++")) else (*ZIG, "c++")


class Board:
    """A program of the sketch in a folder that `C99` wrote."""

    def __init__(
        self, library: Path, place: Path, front_end: str, width: int, core: str = "STM32", *options: str
    ) -> None:
        sketch = (library / "examples" / "touch" / "touch.ino").read_text()
        for unused, its in (
            ("  (void)channel;\n  return false;", "  return spike_of(channel);"),
            ("  (void)t_us; (void)x; (void)y; (void)polarity;\n  return false;",
             "  return event_of(t_us, x, y, polarity);"),
        ):  # fmt: skip
            sketch = sketch.replace(unused, its)
        # The Arduino builder includes Arduino.h and compiles a sketch as C++.
        setup = 'extern "C" void setup(); extern "C" void loop();\n'
        (place / "touch.cpp").write_text(f"#include <Arduino.h>\n{setup}{sketch}")
        places = (BOARD, library / "src", library / "examples" / "touch")
        strict = ("-Wall", "-Wextra", "-Werror", "-O1", *(f"-I{x}" for x in places))
        defines = (f"-DWIDTH={width}", f"-DSTEP_US={STEP_US[front_end]}u", "-DPER_PIN=1", "-DMOST=7",
                   f"-DARE_STEPS={int(front_end != 'events')}", *options)  # fmt: skip
        cpp = ("-std=c++11", "-fno-threadsafe-statics", *strict, f"-DARDUINO_ARCH_{core}", *options)
        parts = [str(place / name) for name in ("touch.o", "dse.o", "board.o")]
        run(*CXX, *cpp, "-c", str(place / "touch.cpp"), "-o", parts[0])
        run(*CC, "-std=c99", *strict, "-c", str(library / "src" / "dse.c"), "-o", parts[1])
        run(*CC, *defines, "-c", str(BOARD / "board.c"), "-o", parts[2])
        self._program = str(place / "touch")
        run(*CXX, *parts, "-o", self._program)

    def answers(self, rows: Array) -> list[str]:
        """Return what it prints, from its start on, for rows of numbers."""
        return run(
            self._program, input="\n".join(" ".join(map(str, row)) for row in rows.tolist())
        ).splitlines()


def of(front_end, window):
    """Return a bundle of 4 sensors, 3 channels of spikes, or events of a frame of 20 x 6."""
    window = {"n_steps": N_STEPS, **window}
    if front_end == "samples":
        design = sections(
            {**SAMPLES, "window": window, "encoder": {"kind": "send_on_delta", "thresholds": [1, 4]}}
        )
        taken, n = Input("samples", 4, 0, 0, N_STEPS, 5.0), 16
    elif front_end == "spikes":
        design = sections({**SAMPLES, "window": window, "encoder": None,
                           "data": {**SAMPLES["data"], "kind": "raster"}})  # fmt: skip
        taken, n = Input("spikes", 3, 0, 0, N_STEPS, 5.0), 3
    else:
        preprocessing = {"bin_ms": 2, "pool": 2, "crop": [2, 0, 16, 6], "time_ms": [4, 100000]}
        design = sections({**EVENTS, "window": window, "preprocessing": preprocessing})
        taken = Input("events", 0, 20, 6, N_STEPS, 2.0)
        n = nets.pools_of(design, taken).n_channels
    return replace(nets.bundle(network(n), N_STEPS, phi=3.0, theta=0.4), sections=design, input=taken)


def touches(front_end, seed=3):
    """Return recordings, each of rest, a contact, and rest."""
    rng = np.random.default_rng(seed)
    recordings = []
    for strength in rng.choice([4, 10, 40], 10):
        rest, contact = (int(n) for n in rng.integers(10, 40, 2))
        force = np.concatenate([np.zeros(rest), np.ones(contact), np.zeros(rng.integers(5, 30))])
        where = rng.permutation([True, True, rng.random() < 0.5, False])
        if front_end == "samples":
            noise = rng.integers(-1, 2, (len(force), 4))
            recordings.append(
                (
                    300 + force[:, None] * rng.integers(4, 4 + strength, (len(force), 4)) * where + noise
                ).astype(int)
            )
        elif front_end == "spikes":
            recordings.append(
                (rng.random((len(force), 3)) < 0.1 + force[:, None] * rng.random(3)).astype(int)
            )
        else:
            counts = rng.poisson(0.5 + strength * force)
            t_us = np.concatenate(
                [np.sort(k * 2000 + rng.integers(0, 2000, n)) for k, n in enumerate(counts)]
            )
            recordings.append(np.column_stack([t_us, *rng.integers(0, [[20], [6], [2]], (3, len(t_us)))]))
    return recordings


def streamed(made, rows):
    """Return the answers of the bundle itself, window by window; of events from time 0 on."""
    if made.input is not None and made.input.kind == "events":
        stream = Stream(made, t0_us=0)
        t_us, x, y, polarity = rows.T
        decisions = stream.push(
            Block(t_us, x.astype(np.int32), y.astype(np.int32), polarity.astype(np.uint8))
        )
    else:
        stream = Stream(made)
        decisions = [decision for row in rows for decision in stream.push(row)]
    cut, every = made.sections.window.cut_steps, made.sections.window.every_steps
    apart = -(-cut // every) if cut and every else 1  # what a board has no room for
    return [x.answer for x in sorted(decisions) if x.window % apart == 0]


RULES = {
    "restart": {"at": "start"},
    "onset": {"at": "contact_onset", "onset_threshold": 3},
    "middle of recordings": {"at": "middle", "cut_steps": 31},
    "apart": {"at": "middle", "cut_steps": 20, "every_steps": 27},
    "overlapping": {"at": "start", "cut_steps": 20, "every_steps": 8},
    "onset in recordings": {"at": "contact_onset", "onset_threshold": 3, "cut_steps": 40},
}


@pytest.mark.parametrize(
    ("front_end", "rule"),
    [*(("samples", rule) for rule in RULES), ("spikes", "onset"), ("spikes", "middle of recordings"),
     ("events", "restart"), ("events", "onset")],
)  # fmt: skip
def test_a_sketch_answers_as_the_bundle_on_a_stream(front_end, rule, tmp_path):
    made = of(front_end, RULES[rule])
    C99().write(made, tmp_path / "dse_touch")
    recordings = touches(front_end)
    if front_end == "events":
        ends = np.cumsum([0, *(part[-1, 0] // 2000 * 2000 + 2000 for part in recordings)])
        recordings = [part + np.array([end, 0, 0, 0]) for part, end in zip(recordings, ends, strict=False)]
    rows = np.concatenate(recordings)
    answers = streamed(made, rows)
    printed = Board(tmp_path / "dse_touch", tmp_path, front_end, rows.shape[1]).answers(rows)
    assert len(answers) >= 3 and len(set(answers)) > 1
    assert printed[: len(answers)] == answers and len(printed) <= len(answers) + 1  # events: the last bin


@pytest.mark.parametrize(
    ("front_end", "core", "sensor"),
    [*((kind, core, "ADC") for kind in ("samples", "spikes") for core in CORES),
     ("samples", "STM32", "SPI"), ("samples", "RP2040", "I2C"), ("samples", "ESP32", "SPI")],
)  # fmt: skip
def test_boards_and_sensors_give_the_same_answers(front_end, core, sensor, tmp_path):
    made = of(front_end, RULES["onset in recordings"])
    C99().write(made, tmp_path / "dse_touch")
    rows = np.concatenate(touches(front_end))
    answers = streamed(made, rows)
    board = Board(tmp_path / "dse_touch", tmp_path, front_end, rows.shape[1], core, f"-DSENSOR_{sensor}")
    assert len(answers) >= 3 and board.answers(rows)[: len(answers)] == answers


def test_rows_that_found_no_room_begin_a_recording_anew(tmp_path):
    made = of("samples", RULES["restart"])
    C99().write(made, tmp_path / "dse_touch")
    rows = np.concatenate(touches("samples"))
    board = Board(tmp_path / "dse_touch", tmp_path, "samples", rows.shape[1], "STM32", "-UMOST", "-DMOST=11")
    printed = board.answers(rows)
    # Where it waits for more rows than the ring has room for, it says so, and answers of full windows follow.
    assert "late" in printed and set(printed) - {"late"} and len(printed) < 2 * len(streamed(made, rows))


@pytest.mark.parametrize("sensor", ["adc", "spi", "i2c", "mux"])
def test_a_sensor_reads_every_taxel(sensor, tmp_path):
    C99().write(of("samples", {}), tmp_path / "dse_touch")
    sketch = tmp_path / "dse_touch" / "examples" / "touch"
    (sketch / "touch.ino").write_text(
        f"""#define DSE_SENSORS 40u
typedef int32_t dse_sample_t;
#include "sensor_{sensor.replace("mux", "adc")}.h"
#include <string>
static dse_sample_t row[DSE_SENSORS];
void setup() {{ begin_sensor(); }}
void loop() {{
  read_sensor(row);
  for (unsigned i = 0; i < DSE_SENSORS; i++) Serial.println(std::to_string(row[i]).c_str());
}}
"""
    )
    options = ("-UPER_PIN", "-DPER_PIN=16") if sensor == "mux" else ()
    board = Board(tmp_path / "dse_touch", tmp_path, "samples", 40, "AVR", "-UMOST", "-DMOST=0", *options)
    numbers = np.random.default_rng(4).integers(0, 1024, (1, 40))
    assert board.answers(numbers)[:40] == [str(x) for x in numbers[0]]


@pytest.mark.parametrize("front_end", ["samples", "spikes"])
def test_a_board_at_rest_answers_a_contact_as_evaluate(front_end, tmp_path):
    made = of(front_end, {**RULES["onset"], "onset_threshold": 2.5 if front_end == "samples" else 2})
    bundle.write(made, tmp_path / "bundle")
    C99().write(made, tmp_path / "dse_touch")
    recordings = [part for seed in range(3) for part in touches(front_end, seed)]
    numbers = np.concatenate(recordings)
    offsets = np.cumsum([0, *map(len, recordings)])
    board = Board(tmp_path / "dse_touch", tmp_path, front_end, numbers.shape[1])
    key = {"samples": "signal", "spikes": "spikes"}[front_end]
    first = []
    for k, (a, b) in enumerate(pairwise(offsets)):
        np.savez(tmp_path / f"{k}.npz", **{key: numbers[None, a:b].astype(np.float32)})
        evaluation = evaluate(tmp_path / "bundle", tmp_path / f"{k}.npz")
        first.append(evaluation.classes[evaluation.label[0]])
        assert board.answers(numbers[a:b])[0] == first[-1]
    assert len(set(first)) > 1


def test_the_folder_is_an_arduino_library(tmp_path):
    C99().write(of("samples", {}), tmp_path)
    # What the Arduino library specification asks for: src is compiled, the sketch has its folder's name.
    properties = dict(x.split("=", 1) for x in (tmp_path / "library.properties").read_text().splitlines())
    assert {"name", "version", "author", "maintainer", "sentence", "paragraph", "category"} <= set(properties)
    assert properties["includes"] == "dse.h" and re.fullmatch(r"\d+\.\d+\.\d+", properties["version"])
    assert sorted(x.name for x in (tmp_path / "src").iterdir()) == ["dse.c", "dse.h", "dse_selftest.c"]
    assert (tmp_path / "examples" / "touch" / "touch.ino").is_file()
    assert properties["architectures"] == "*"


@pytest.mark.parametrize("board", [x for x in BOARDS.values() if x.environment], ids=lambda x: x.name)
@pytest.mark.parametrize("front_end", STEP_US)
def test_a_sketch_compiles_for_the_core_of_a_board(board, front_end, tmp_path):
    core = {"nucleo-l476": "STM32", "pico": "RP2040", "esp32-c3": "ESP32"}[board.name]
    C99().write(of(front_end, RULES["onset in recordings"]), tmp_path)
    sketch = tmp_path / "examples" / "touch"
    (tmp_path / "touch.cpp").write_text(f"#include <Arduino.h>\n{(sketch / 'touch.ino').read_text()}")
    places = tuple(f"-I{x}" for x in (BOARD, tmp_path / "src", sketch))
    of_core = [x for x in target_named(board.target).core.options if not x.startswith("-std")]
    options = ("-std=c++11", "-Wall", "-Wextra", "-Werror", *of_core, *places)
    sensors = ("ADC", "SPI", "I2C") if front_end == "samples" else ("ADC",)
    for sensor in sensors:
        defines = (f"-DARDUINO_ARCH_{core}", f"-DSENSOR_{sensor}", "-c", "-o", str(tmp_path / "o"))
        run(*ZIG, "c++", *defines, *options, str(tmp_path / "touch.cpp"))
