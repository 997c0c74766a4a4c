"""The files around the source: header, a program that reads recordings, how they are built."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dse.deploy.c.plan import Frame, SendOnDeltaPlan
from dse.deploy.c.text import NAMES, TITLE, filled, real, strings
from dse.deploy.prefix import DEFAULT, prefixed
from dse.preprocessing import Pooling
from dse.text import c_comment, markdown


@dataclass(frozen=True)
class Code:
    """A classifier as C.

    frame: its input and answers.
    source: the text of dse.c, but for its title and the names of classes.
    n_outputs: output neurons that are counted; 0: none.
    steps_per_sample: network steps per input step.
    ram_bytes: static data; of_reals_bytes: where samples are real numbers.
    table_bytes: constant data of the classifier.
    needs_double: whether it computes in double, whatever samples are.
    what: what it is, and in which arithmetic, in a sentence.
    """

    frame: Frame
    source: str
    n_outputs: int
    steps_per_sample: int
    ram_bytes: int
    of_reals_bytes: int
    table_bytes: int
    needs_double: bool
    what: str


def write(code: Code, folder: Path, title: str, version: str, prefix: str = DEFAULT) -> None:
    """Write the files of a classifier into an empty folder; the same arguments give the same bytes.

    Args:
        code: what is written.
        folder: it is empty or missing.
        title: a line about the classifier.
        version: of dse.
        prefix: of the names (`dse.deploy.prefix`).
    """
    heading, title = markdown(title), c_comment(title)
    names = strings(code.frame.classes)
    for name, text in (
        ("src/dse.h", header(code)),
        ("src/dse.c", code.source),
        ("main.c", program(code.frame)),
        ("CMakeLists.txt", _cmake(code, prefix)),
        ("library.properties", _library(code, version)),
        ("examples/touch/touch.ino", sketch(code.frame)),
        ("README.md", readme(code)),
    ):
        path = folder / prefixed(name, prefix)
        path.parent.mkdir(parents=True, exist_ok=True)
        # What the user has named keeps its letters.
        text = prefixed(text, prefix).replace(NAMES, names, 1)
        path.write_text(text.replace(TITLE, heading if name == "README.md" else title, 1), encoding="utf-8")


def header(code: Code) -> str:
    """Return dse.h; `TITLE` stands for the title, here and below."""
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
        title=TITLE,
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


def program(plan: Frame) -> str:
    """Return main.c, which reads recordings from stdin."""
    constants = [f"#define WINDOW_AT_{plan.window.upper()}", f"#define ONSET {_onset(plan)}"]
    if plan.pooling is not None:
        constants += [f"#define BIN_US {plan.pooling.bin_us}", *_crop(plan.pooling)]
        if plan.t0_us is not None:
            constants += [
                "#ifndef RECORDED /* trials begin at 0; recordings with their first event */",
                f"#define T0_US {plan.t0_us}",
                f"#define N_BINS {plan.n_bins}",
                "#endif",
            ]
    return filled(
        "main.c",
        title=TITLE,
        rows=_ROWS[plan.front_end],
        constants="\n".join(constants),
        longest_line=_LONGEST_LINE[plan.front_end],
        reading=filled(f"main_{plan.front_end}.c"),
    )


def sketch(plan: Frame) -> str:
    """Return touch.ino: windows begin as in `dse.deploy.stream.Stream` as in training.

    Of recordings that overlap in a stream, a board takes those that begin while none runs.
    """
    at_contact, cut, apart = plan.window == "contact_onset", plan.cut_steps or 0, plan.every_steps or 1
    first = (cut - plan.n_steps) // 2 if cut and plan.window == "middle" else 0
    constants = [
        f"#define ONSET {_onset(plan) if at_contact else '0.0'}",
        f"#define WINDOW_FIRST {first}u",
        f"#define RECORDING {cut}u",
        f"#define EVERY {-(-cut // apart) * apart}u",
        *([] if plan.pooling is None else _crop(plan.pooling)),
    ]
    begins = "at each contact" if at_contact else f"at step {first}" if cut else "after each answer"
    return filled(
        f"touch_{plan.front_end}.ino",
        title=TITLE,
        windows=f"Windows begin {begins}" + (f" of recordings of {cut} steps." if cut else "."),
        constants="\n".join(constants),
        window=filled("window.ino"),
        contact=filled("contact.ino") if at_contact else "",
        touches="touches()" if at_contact else "true",
    )


def _onset(plan: Frame) -> str:
    """Return the number of events or spikes of a contact, or how far a sensor moves, in float32."""
    threshold = plan.onset_threshold
    return real(float(np.float32(threshold)) if plan.front_end == "samples" else float(threshold))


def _crop(pools: Pooling) -> list[str]:
    """Return the constants that say which events are looked at."""
    values = (pools.start_us, min(pools.end_us, 2**62), *pools.crop)
    names = ("START_US", "END_US", "CROP_X", "CROP_Y", "CROP_COLUMNS", "CROP_ROWS")
    return [f"#define {name} {value}" for name, value in zip(names, values, strict=True)]


def _cmake(code: Code, prefix: str) -> str:
    """Return CMakeLists.txt; in a project of several classifiers it adds the library alone."""
    library = prefix[:-1]
    rounded = f"target_compile_options({library} PRIVATE -ffp-contract=off)"
    if "FP_CONTRACT" in code.source:
        rounded = f'if(CMAKE_C_COMPILER_ID MATCHES "GNU|Clang")\n    {rounded}\nendif()\n'
    else:
        rounded = ""
    return filled("CMakeLists.txt", project=_PROJECT, library=library, rounded=rounded)


def _library(code: Code, version: str) -> str:
    """Return library.properties; the double of AVR has 32 bits."""
    architectures = ",".join(_OF_64_BIT_DOUBLE) if code.needs_double else "*"
    return filled("library.properties", project=_PROJECT, version=version, architectures=architectures)


def readme(code: Code) -> str:
    """Return README.md of the folder."""
    plan = code.frame
    why = f"\nSpikes are pushed because {plan.no_front_end}.\n" if plan.no_front_end else ""
    if plan.encoder is not None:
        why = (
            "\nSamples are whole numbers; `-DDSE_REAL_SAMPLES` makes them `float`, and the encoder then "
            f"computes in `double` and takes {code.of_reals_bytes} bytes of RAM.\n"
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
        title=TITLE,
        what=code.what,
        rows=_ROWS[plan.front_end],
        why=why,
        window=window,
        n_steps=plan.n_steps,
        step_ms=real(plan.step_ms),
        ram_bytes=code.ram_bytes,
        table_bytes=code.table_bytes,
        rounding=_ROUNDING if "FP_CONTRACT" in code.source else "",
    )


_PROJECT = "dse_touch"
_OF_64_BIT_DOUBLE = (
    *("esp32", "esp8266", "mbed", "mbed_edge", "mbed_giga", "mbed_nano", "mbed_nicla", "mbed_opta"),
    *("mbed_portenta", "mbed_rp2040", "nrf52", "renesas_portenta", "renesas_uno", "rp2040", "sam", "samd"),
    *("stm32", "zephyr"),
)
"""Architectures of Arduino whose double has 64 bits."""
_ROUNDING = """
Products are rounded before they are added, as in training: `dse.c` tells gcc and clang so; other compilers
need their option for it. Where it needs a `double` of 64 bits and finds one of 32, it does not compile.
"""
_ROWS = {
    "samples": "a row per sample: one number per sensor, separated by commas",
    "events": "a row per event: time in us, x, y, polarity (1 ON, 0 OFF)",
    "spikes": "a row per step: 1 or 0 of every channel",
}
_LONGEST_LINE = {"samples": 65536, "events": 4096, "spikes": 262144}
_PUSH_SAMPLES = """\
/* One sample of every sensor: the spikes that it gives belong to this step. Returns 0, and does nothing, if a
 * value is no finite number. */
uint8_t dse_push(const dse_sample_t *sample);
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
