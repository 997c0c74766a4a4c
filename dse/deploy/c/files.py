"""The files around the source: header, a program that reads recordings, how they are built."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dse.base.text import c_comment, markdown
from dse.deploy.c.arrays import laid_out, struct_bytes
from dse.deploy.c.code import Code
from dse.deploy.c.selftest import Window
from dse.deploy.c.text import NAMES, TITLE, filled, real, strings
from dse.deploy.c.weights import beside
from dse.deploy.prefix import DEFAULT, prefixed


def write(
    code: Code,
    folder: Path,
    title: str,
    version: str,
    prefix: str = DEFAULT,
    digest: str = "",
    tests: Sequence[Window] = (),
    apart: bool = False,
) -> None:
    """Write the files of a classifier into an empty folder; the same arguments give the same bytes.

    Without windows to test there is no self-test. `apart`: it loads its tables, a file weights.bin.
    """
    heading, title, source = markdown(title), c_comment(title), code.source(apart)
    names, values = strings(code.classes), _values(code, version, prefix)
    values |= {"digest": digest, "n_windows": len(tests), "tests": [x._asdict() for x in tests]}
    values |= {
        "self_test": " src/dse_selftest.c" if tests else "",
        "apart": apart,
        "more": " and a pointer" if apart else "",
    }
    if apart:
        source, block = beside(source, code.tables, names)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "weights.bin").write_bytes(block)
        values["n_words"] = -(-len(block) // 8)
    for name, template in _templates(code, bool(tests), apart).items():
        path = folder / prefixed(name, prefix).replace(_LIBRARY, prefix[:-1])
        path.parent.mkdir(parents=True, exist_ok=True)
        text = filled(template, code, **values) if template else source
        # What the user has named keeps its letters.
        text = prefixed(text, prefix).replace(NAMES, names, 1)
        path.write_text(text.replace(TITLE, heading if name == "README.md" else title, 1), encoding="utf-8")


def _templates(code: Code, has_tests: bool, apart: bool) -> dict[str, str]:
    """Return the files, each with its template; the source has none.

    The folder is a library of CMake, of Arduino and of PlatformIO, a component of ESP-IDF, a module of
    Zephyr, and a CMSIS pack.
    """
    files = {
        "src/dse.h": "dse.h",
        "src/dse.c": "",
        "main.c": "main.c",
        "CMakeLists.txt": "CMakeLists.txt",
        "README.md": "README.md",
        "zephyr/module.yml": "module.yml",
        "zephyr/Kconfig": "Kconfig",
        f"dse.{_LIBRARY}.pdsc": "pack.pdsc",
    }
    if has_tests:
        files |= {"src/dse_selftest.c": "selftest_windows.c", "selftest.c": "selftest.c"}
        files |= {"zephyr/sample/CMakeLists.txt": "sample.txt", "zephyr/sample/prj.conf": "prj.conf"}
    if not apart:
        files |= {name: name for name in ("library.properties", "library.json")}
        files |= {f"{_SKETCH}{name}": template for name, template in _sketch(code).items()}
    return files


def _sketch(code: Code) -> dict[str, str]:
    """Return the files of the sketch, each with its template."""
    if code.front_end == "events":
        return {"touch.ino": "touch_events.ino"}
    sensors = ("sensor_adc.h", "sensor_spi.h", "sensor_i2c.h") if code.front_end == "samples" else ()
    return {"touch.ino": "touch_rows.ino"} | {name: name for name in ("board.h", *sensors)}


def _values(code: Code, version: str, prefix: str) -> dict[str, Any]:
    """Return what stands in the templates of all files beside the attributes of the code."""
    encoder, front_end, at_contact = code.encoder, code.front_end, code.window == "contact_onset"
    is_whole = encoder is not None and encoder.takes_whole
    cut, apart, pools = code.cut_steps or 0, code.every_steps or 1, code.pooling
    crop = () if pools is None else (pools.start_us, min(pools.end_us, 2**62), *pools.crop)
    first = (cut - code.n_steps) // 2 if cut and code.window == "middle" else 0
    # Windows begin as in `dse.deploy.stream.Stream` as in training. Of recordings that overlap in a stream, a
    # board takes those that begin while none runs.
    begins = "at each contact" if at_contact else f"at step {first}" if cut else "after each answer"
    onset = float(code.onset_threshold)
    # Of samples it says how far a sensor moves, in float32; of others how many events there are.
    onset_text = real(float(np.float32(onset)) if front_end == "samples" else onset)
    return {
        "title": TITLE,
        "project": "dse_touch",
        "library": prefix[:-1],
        "symbol": prefix[:-1].upper(),
        "examples": ", ".join(f'"{name}"' for name in _sketch(code)),
        "version": version,
        "n_sensors": 0 if encoder is None else encoder.n_sensors,
        "takes_whole": is_whole,
        "step_ms": real(code.step_ms),
        **{f"is_{name}": front_end == name for name in _ROWS},
        "reset_comment": _KEPT[front_end],
        "has_levels": code.is_delta,
        "declared": laid_out(code.members()),
        "is_delta": is_whole and code.is_delta,
        "is_real": encoder is not None and not is_whole,
        "simulated": code.t0_us is not None,
        "begins": _WINDOWS[code.window],
        "of_reals_bytes": struct_bytes(code.members(), of_reals=True),
        "rows": _ROWS[front_end],
        "longest_line": _LONGEST_LINE[front_end],
        "onset": onset_text,
        "window_at": code.window.upper(),
        "crop": [{"name": name, "value": value} for name, value in zip(_CROP, crop, strict=False)],
        "windows": f"Windows begin {begins}" + (f" of recordings of {cut} steps." if cut else "."),
        "onset_of_contact": onset_text if at_contact else "0.0",
        "first": first,
        "cut": cut,
        "every": -(-cut // apart) * apart,
        "at_contact": at_contact,
        "touches": "touches(row)" if at_contact else "true",
    }


_CROP = ("START_US", "END_US", "CROP_X", "CROP_Y", "CROP_COLUMNS", "CROP_ROWS")
"""Constants that say which events are looked at."""
_LIBRARY, _SKETCH = "LIBRARY", "examples/touch/"
_ROWS = {
    "samples": "a row per sample: one number per sensor, separated by commas",
    "events": "a row per event: time in us, x, y, polarity (1 ON, 0 OFF)",
    "spikes": "a row per step: 1 or 0 of every channel",
}
_LONGEST_LINE = {"samples": 65536, "events": 4096, "spikes": 262144}
_KEPT = {"samples": "; levels of the encoder stay", "events": "; bins go on", "spikes": ""}
_WINDOWS = {
    "start": "begins with the recording",
    "middle": "lies in the middle of the recording",
    "contact_onset": "begins at the contact",
}
