"""The page of a study in a real browser: its size, its first drawing, and what moving a budget takes.

    python -m benchmarks.page --browser chromium [--points 1000 10000 100000]

Design points are made up: accuracy rises with energy, weights and latency are drawn. `paint` is the first
contentful paint, `figure` when the front is drawn. After a step of a slider, median, first and worst:
`done` until counts, pick, table, front and parallel coordinates are drawn;
`shown` until the browser has put that on the screen; `CPU` is the time of the page's thread until then, which
other work on the machine hardly changes. Times are the browser's own, headless: it draws in software.
Intervals of the front are drawn once the slider rests.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table

from dse.dashboard.write import write_page

OBJECTIVES = {"accuracy": "max", "energy_uj": "min", "n_weights": "min", "latency_ms": "min"}
SLIDER_STEPS = tuple(range(150, 60, -10))

MOVED = """async ([slider, steps]) => {
  const moved = document.querySelector(slider);
  const took = [];
  for (const step of steps) {
    performance.mark("step");
    const start = performance.now();
    moved.value = step;
    moved.dispatchEvent(new Event("input", {bubbles: true}));
    const done = performance.now() - start;
    await new Promise((next) => requestAnimationFrame(() => setTimeout(next)));
    performance.mark("step");
    took.push([done, performance.now() - start]);
    await new Promise((next) => setTimeout(next, 20));
  }
  return took;
}"""


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--browser", required=True, help="path of a Chromium")
    parser.add_argument("--points", type=int, nargs="+", default=[1_000, 10_000, 100_000])
    arguments = parser.parse_args()
    from playwright.sync_api import sync_playwright

    table = Table(title="the page of a study: size, first drawing, a step of a budget's slider")
    for name in (
        "points",
        "MB",
        "paint ms",
        "figure ms",
        "step: done ms",
        "first",
        "worst",
        "shown ms",
        "first",
        "worst",
        "CPU ms",
        "first",
        "worst",
    ):
        table.add_column(name, justify="right")
    with sync_playwright() as driver, tempfile.TemporaryDirectory() as folder:
        browser = driver.chromium.launch(executable_path=arguments.browser, args=["--no-sandbox"])
        for n in arguments.points:
            path = write_page(points(n), Path(folder) / f"{n}.html", name="made up", objectives=OBJECTIVES)
            table.add_row(f"{n:,}", f"{path.stat().st_size / 1e6:.1f}", *measured(browser, path))
        browser.close()
    Console(width=140).print(table)


def points(n: int, seed: int = 0) -> pd.DataFrame:
    """Return n made-up design points of n / 100 trials."""
    rng = np.random.default_rng(seed)
    quality = rng.random(n)
    return pd.DataFrame(
        {
            "trial": np.arange(n) // 100,
            "task": "texture",
            "model.hidden": rng.integers(8, 400, n // 100 + 1)[np.arange(n) // 100],
            "phi": np.arange(n) % 10,
            "theta": (np.arange(n) // 10 % 10) / 10,
            "accuracy": 0.4 + 0.4 * quality + 0.2 * rng.random(n),
            "energy_uj": np.exp(4 * quality + rng.normal(size=n)),
            "n_weights": rng.integers(1_000, 200_000, n),
            "latency_ms": rng.uniform(1, 90, n),
        }
    )


def measured(browser: Any, path: Path) -> list[str]:
    """Return the cells of a page's row: first paint and figure, then what a step takes."""
    tab = browser.new_page(viewport={"width": 1280, "height": 720})
    tab.goto(path.as_uri())
    tab.wait_for_function("document.getElementById('plot')?.data?.length > 0")
    figure_ms = tab.evaluate("performance.now()")
    paint_ms = tab.evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime")
    took = [
        both
        for slider in range(len(OBJECTIVES))
        for both in tab.evaluate(MOVED, [f"#slider-{slider}", SLIDER_STEPS])
    ]
    tab.close()
    columns = [*np.array(took).T, np.array(cpu_ms(browser, path))]
    steps = [x for column in columns for x in (np.median(column), column[0], column.max())]
    return [f"{x:.0f}" for x in (paint_ms, figure_ms, *steps)]


def cpu_ms(browser: Any, path: Path) -> list[float]:
    """Return the CPU time of the page's thread for each step of the first slider, in a tab of its own."""
    tab = browser.new_page(viewport={"width": 1280, "height": 720})
    tab.goto(path.as_uri())
    tab.wait_for_selector("#plot .scatterlayer", state="attached")
    browser.start_tracing(page=tab, categories=["blink.user_timing"])
    tab.evaluate(MOVED, ["#slider-0", SLIDER_STEPS])
    events = json.loads(browser.stop_tracing())["traceEvents"]
    tab.close()
    marks = sorted((event for event in events if event.get("name") == "step"), key=lambda event: event["ts"])
    return [(end["tts"] - start["tts"]) / 1000 for start, end in zip(marks[::2], marks[1::2], strict=True)]


if __name__ == "__main__":
    main()
