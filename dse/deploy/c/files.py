"""The files around the source: header, a program that reads recordings, how they are built."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dse.deploy.c.plan import Frame, SendOnDeltaPlan
from dse.deploy.c.text import filled, real
from dse.text import c_comment, markdown


@dataclass(frozen=True)
class Code:
    """A classifier as C.

    frame: its input and answers.
    source: the text of dse.c, but for its title.
    n_outputs: output neurons that are counted; 0: none.
    steps_per_sample: network steps per input step.
    ram_bytes: static data. table_bytes: constant data of the classifier.
    what: what it is, and in which arithmetic, in a sentence.
    """

    frame: Frame
    source: str
    n_outputs: int
    steps_per_sample: int
    ram_bytes: int
    table_bytes: int
    what: str


def write(code: Code, folder: Path, title: str, version: str) -> None:
    """Write the files of a classifier into an empty folder.

    Args:
        code: what is written.
        folder: it is empty or missing.
        title: a line about the classifier.
        version: of dse.
    """
    heading, title = markdown(title), c_comment(title)
    for place in ("src", "examples/touch"):
        (folder / place).mkdir(parents=True)
    project = "dse_touch"
    for name, text in (
        ("src/dse.h", header(code, title)),
        ("src/dse.c", code.source.replace("TITLE", title, 1)),
        ("main.c", program(code.frame, title)),
        ("CMakeLists.txt", filled("CMakeLists.txt", project=project)),
        ("library.properties", filled("library.properties", project=project, version=version)),
        ("examples/touch/touch.ino", filled(f"touch_{code.frame.front_end}.ino", title=title)),
        ("README.md", readme(code, heading)),
    ):
        (folder / name).write_text(text, encoding="utf-8")


def header(code: Code, title: str) -> str:
    """Return dse.h."""
    plan = code.frame
    declaration, comment, defines, kept = {
        "samples": (
            _PUSH_SAMPLES,
            "a sample of every sensor",
            _samples_defines(plan),
            "; levels of the encoder stay",
        ),
        "events": (_PUSH_EVENTS, "every event of the step", "#define DSE_EVENTS\n", "; bins go on"),
        "spikes": ("", "dse_push_spike(channel) of every spike of the step", "", ""),
    }[plan.front_end]
    text = filled(
        "dse.h",
        title=title,
        n_channels=plan.n_channels,
        n_classes=len(plan.classes),
        n_outputs=code.n_outputs,
        n_steps=plan.n_steps,
        steps_per_sample=code.steps_per_sample,
        step_ms=real(plan.step_ms),
        push_comment=comment,
        push_declaration=declaration,
        defines=defines,
        reset_comment=kept,
    )
    return text.replace("dse_push(...);               dse_push_spike", "dse_push_spike")


def program(plan: Frame, title: str) -> str:
    """Return main.c, which reads recordings from stdin."""
    at = plan.window
    onset = plan.onset_threshold
    constants = [
        f"#define WINDOW_AT_{at.upper()}",
        f"#define ONSET {real(float(np.float32(onset)) if plan.front_end == 'samples' else float(onset))}",
    ]
    if plan.pooling is not None:
        x, y, columns, rows = plan.pooling.crop
        constants += [
            f"#define BIN_US {plan.pooling.bin_us}",
            f"#define START_US {plan.pooling.start_us}",
            f"#define END_US {min(plan.pooling.end_us, 2**62)}",
            f"#define CROP_X {x}",
            f"#define CROP_Y {y}",
            f"#define CROP_COLUMNS {columns}",
            f"#define CROP_ROWS {rows}",
        ]
        if plan.t0_us is not None:
            constants += [
                "#ifndef RECORDED /* trials begin at 0; recordings with their first event */",
                f"#define T0_US {plan.t0_us}",
                f"#define N_BINS {plan.n_bins}",
                "#endif",
            ]
    return filled(
        "main.c",
        title=title,
        rows=_ROWS[plan.front_end],
        constants="\n".join(constants),
        longest_line=_LONGEST_LINE[plan.front_end],
        reading=filled(f"main_{plan.front_end}.c"),
    )


def readme(code: Code, title: str) -> str:
    """Return README.md of the folder."""
    plan = code.frame
    why = f"\nSpikes are pushed because {plan.no_front_end}.\n" if plan.no_front_end else ""
    if plan.encoder is not None:
        why = (
            "\nSamples are whole numbers; `-DDSE_REAL_SAMPLES` makes them `float`, and the encoder then "
            "computes in `double`.\n"
            if isinstance(plan.encoder, SendOnDeltaPlan) and plan.encoder.takes_whole
            else "\nSamples are whole numbers; `-DDSE_REAL_SAMPLES` makes them `float`. The encoder computes "
            "in `double`, the network in integers.\n"
            if plan.encoder.takes_whole
            else "\nThe encoder's thresholds are no multiples of 1/32: it computes in `double`, the network "
            "in integers.\n"
        )
    if plan.t0_us is not None:
        why += (
            "\nTimes are those of simulated trials, which begin at 0; with `-DRECORDED`, those of a sensor's "
            "recordings, whose steps begin with the first event.\n"
        )
    window = {
        "start": "begins with the recording",
        "middle": "lies in the middle of the recording",
        "contact_onset": "begins at the contact",
    }[plan.window]
    return filled(
        "README.md",
        title=title,
        what=code.what,
        rows=_ROWS[plan.front_end],
        why=why,
        window=window,
        n_steps=plan.n_steps,
        step_ms=real(plan.step_ms),
        ram_bytes=code.ram_bytes,
        table_bytes=code.table_bytes,
    )


_ROWS = {
    "samples": "a row per sample: one number per sensor, separated by commas",
    "events": "a row per event: time in us, x, y, polarity (1 ON, 0 OFF)",
    "spikes": "a row per step: 1 or 0 of every channel",
}
_LONGEST_LINE = {"samples": 65536, "events": 4096, "spikes": 262144}
_PUSH_SAMPLES = """\
/* One sample of every sensor: the spikes that it gives belong to this step. */
void dse_push(const dse_sample_t *sample);
"""
_PUSH_EVENTS = """\
/* Bins are counted from a time; without a call, from the first event. */
void dse_start(int64_t t_us);

/* An event, in the order of time; polarity: 1 ON, 0 OFF. Returns 0, and does nothing, if it belongs to a
 * later step: dse_step() first. */
uint8_t dse_push(int64_t t_us, uint16_t x, uint16_t y, uint8_t polarity);
"""


def _samples_defines(plan: Frame) -> str:
    if plan.encoder is None:
        return ""
    reals = (
        "#ifndef DSE_REAL_SAMPLES /* the thresholds are not on an integer grid */\n"
        "#define DSE_REAL_SAMPLES\n#endif\n"
    )
    always = "" if plan.encoder.takes_whole else reals
    return (
        f"#define DSE_SENSORS {plan.encoder.n_sensors}u\n{always}"
        "#ifdef DSE_REAL_SAMPLES\ntypedef float dse_sample_t; /* the encoder computes in double */\n"
        "#else\ntypedef int32_t dse_sample_t; /* magnitude below 2^24 */\n#endif\n"
    )
