"""The Arduino sketch on a stub of a board: it answers as the bundle does on the same stream."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from dse.deploy import bundle
from dse.deploy.bundle import Input
from dse.deploy.evaluate import evaluate
from dse.deploy.stream import Stream
from dse.deploy.targets.c99 import C99
from dse.records import Array, Block
from tests.deploy.c import nets
from tests.deploy.targets.test_c99 import EVENTS, SAMPLES, network, run
from tests.spaces import sections

pytestmark = pytest.mark.skipif(find_spec("ziglang") is None, reason="ziglang is not installed")

N_STEPS = 12
STEP_US = {"samples": 5000, "spikes": 5000, "events": 2000}
ARDUINO_H = """\
#include <stdint.h>
extern "C" {
unsigned long micros(void);
int analogRead(int pin);
bool spike_of(uint16_t channel);
bool event_of(int64_t *t_us, uint16_t *x, uint16_t *y, uint8_t *polarity);
void print_line(const char *text);
}
struct Port { void begin(unsigned long) {} void println(const char *text) { print_line(text); } };
static Port Serial;
enum { A0 = 14 };
"""
BOARD_C = """\
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
void setup(void);
void loop(void);
static unsigned long now;
static int row[64];
static bool is_read, is_over;
static void read_row(void)
{
    for (int i = 0; i < WIDTH; i++) { is_over |= scanf("%d", row + i) != 1; }
    is_read = !is_over;
}
unsigned long micros(void) { return now; }
int analogRead(int pin) { return row[pin - 14]; }
bool spike_of(uint16_t channel) { return row[channel] != 0; }
bool event_of(int64_t *t_us, uint16_t *x, uint16_t *y, uint8_t *polarity)
{
    if (!is_read) { read_row(); }
    if (is_over || (unsigned long)row[0] > now) { return false; }
    *t_us = row[0]; *x = (uint16_t)row[1]; *y = (uint16_t)row[2]; *polarity = (uint8_t)row[3];
    is_read = false;
    return true;
}
void print_line(const char *text) { puts(text); }
int main(void)
{
    setup();
    while (!is_over) {
        if (ARE_STEPS) { read_row(); if (is_over) { break; } }
        loop();
        now += STEP_US;
    }
    return 0;
}
"""


class Board:
    """A program of the sketch in a folder that `C99` wrote."""

    def __init__(self, library: Path, place: Path, front_end: str, width: int) -> None:
        sketch = (library / "examples" / "touch" / "touch.ino").read_text()
        for unused, its in (
            ("  (void)channel;\n  return false;", "  return spike_of(channel);"),
            ("  (void)t_us; (void)x; (void)y; (void)polarity;\n  return false;",
             "  return event_of(t_us, x, y, polarity);"),
        ):  # fmt: skip
            sketch = sketch.replace(unused, its)
        # The Arduino builder includes Arduino.h and compiles a sketch as C++.
        setup = 'extern "C" void setup(); extern "C" void loop();\n'
        (place / "Arduino.h").write_text(ARDUINO_H)
        (place / "touch.cpp").write_text(f"#include <Arduino.h>\n{setup}{sketch}")
        (place / "board.c").write_text(BOARD_C)
        zig = (sys.executable, "-m", "ziglang")
        strict = ("-Wall", "-Wextra", "-Werror", "-O1", f"-I{place}", f"-I{library / 'src'}")
        defines = (f"-DWIDTH={width}", f"-DSTEP_US={STEP_US[front_end]}u",
                   f"-DARE_STEPS={int(front_end != 'events')}")  # fmt: skip
        parts = [str(place / name) for name in ("touch.o", "dse.o", "board.o")]
        run(*zig, "c++", "-std=c++11", *strict, "-c", str(place / "touch.cpp"), "-o", parts[0])
        run(*zig, "cc", "-std=c99", *strict, "-c", str(library / "src" / "dse.c"), "-o", parts[1])
        run(*zig, "cc", *defines, "-c", str(place / "board.c"), "-o", parts[2])
        self._program = str(place / "touch")
        run(*zig, "cc", *parts, "-o", self._program)

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
        made = replace(nets.bundle(network(1), 1), sections=design, input=taken)
        n = nets.pools_of(made).n_channels
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
