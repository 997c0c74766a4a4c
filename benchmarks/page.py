"""The page of a study in a real browser: its size, its first drawing, and what moving a budget takes.

    python -m benchmarks.page [--browser chromium] [--trials 100 1000 10000]

Studies are made up: accuracy rises with energy, weights and latency are drawn. `paint` is the first
contentful paint, `figure` when the chart is drawn. After a step of a limit on the chart, median, first and
worst: `done` until sentence, cards and chart are drawn; `shown` until the browser has put that on the screen;
`CPU` is the time of the page's thread for the step and all that follows within `REST_MS`, such as the table,
which other work on the machine hardly changes. Times are the browser's own, headless: it draws in software.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table

from dse.show.dashboard.gather import gather_page
from dse.show.dashboard.write import write_filled

OBJECTIVES = {"accuracy": "max", "energy_uj": "min", "n_weights": "min", "latency_ms": "min"}
TASKS, CHIPS = ("texture", "profile"), ("loihi1_silicon", "mcu_cortex_m4f_nrf52840_64mhz")
STEPS, REST_MS = 9, 900

MOVED = """async ([steps, rest]) => {
  const moved = document.querySelector(".limit[data-column=energy_uj]");
  const took = [];
  for (let step = 0; step < steps; step += 1) {
    performance.mark("step");
    const start = performance.now();
    moved.dispatchEvent(new KeyboardEvent("keydown", {key: "PageDown", bubbles: true}));
    const done = performance.now() - start;
    await new Promise((next) => requestAnimationFrame(() => setTimeout(next)));
    took.push([done, performance.now() - start]);
    await new Promise((next) => setTimeout(next, rest));
    performance.mark("step");
  }
  return took;
}"""
DRAWN = ".limit[data-column=energy_uj]"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--browser", default="chromium", help="a Chromium: its path, or its name on PATH")
    parser.add_argument("--trials", type=int, nargs="+", default=[100, 1_000, 10_000])
    arguments = parser.parse_args()
    from playwright.sync_api import sync_playwright

    table = Table(title="the page of a study: size, first drawing, a step of a limit")
    for name in (
        "trials",
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
        browser = driver.chromium.launch(
            executable_path=shutil.which(arguments.browser), args=["--no-sandbox"]
        )
        for n in arguments.trials:
            made_up = points(n)
            path = write_filled(
                "page",
                gather_page(made_up, name="made up", objectives=OBJECTIVES),
                Path(folder) / f"{n}.html",
            )
            size_mb = path.stat().st_size / 1e6
            table.add_row(f"{n:,}", f"{len(made_up):,}", f"{size_mb:.1f}", *measured(browser, path))
        browser.close()
    Console(width=140).print(table)


def points(n_trials: int, seed: int = 0) -> pd.DataFrame:
    """Return design points: two tasks, families and chips, ten parameters, 20 settings of each trial."""
    rng = np.random.default_rng(seed)
    trial = np.arange(n_trials)
    chosen = {f"model.part_{k}": rng.choice([1, 2, 5, 10, 20, 50], n_trials) for k in range(8)}
    design = pd.DataFrame(
        {
            "trial": trial,
            "task": np.array(TASKS)[trial % 2],
            "family": np.array(["snn", "mlp"])[trial % 4 // 3],
            "encoder.kind": np.array(["send_on_delta", "threshold", "poisson"])[rng.integers(0, 3, n_trials)],
            "model.hidden": rng.integers(8, 400, n_trials),
            **chosen,
            "quality": rng.random(n_trials),
        }
    )
    settings = pd.DataFrame({"point": range(20), "phi": np.arange(20) % 5, "theta": np.arange(20) // 5 / 5})
    table = design.merge(settings, how="cross").merge(pd.DataFrame({"hardware": CHIPS}), how="cross")
    n, quality = len(table), table.pop("quality")
    energy_uj = np.exp(4 * quality + rng.normal(size=n))
    return table.assign(
        accuracy=0.4 + 0.4 * quality + 0.2 * rng.random(n),
        accuracy_se=0.02,
        energy_uj=energy_uj,
        energy_uj_low=energy_uj / 2,
        energy_uj_high=energy_uj * 2,
        n_weights=rng.integers(1_000, 200_000, n_trials)[table["trial"]],
        latency_ms=rng.uniform(1, 90, n),
        fits=rng.random(n_trials)[table["trial"]] < 0.8,
    )


def measured(browser: Any, path: Path) -> list[str]:
    """Return the cells of a page's row: first paint and figure, then what a step takes."""
    tab = browser.new_page(viewport={"width": 1280, "height": 720})
    tab.goto(path.as_uri())
    tab.wait_for_selector(DRAWN, state="attached")
    figure_ms = tab.evaluate("performance.now()")
    paint_ms = tab.evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime")
    took = tab.evaluate(MOVED, [STEPS, 20])
    tab.close()
    columns = [*np.array(took).T, np.array(cpu_ms(browser, path))]
    steps = [x for column in columns for x in (np.median(column), column[0], column.max())]
    return [f"{x:.0f}" for x in (paint_ms, figure_ms, *steps)]


def cpu_ms(browser: Any, path: Path) -> list[float]:
    """Return the CPU time of the page's thread for each step of a limit, in a tab of its own."""
    tab = browser.new_page(viewport={"width": 1280, "height": 720})
    tab.goto(path.as_uri())
    tab.wait_for_selector(DRAWN, state="attached")
    browser.start_tracing(page=tab, categories=["blink.user_timing"])
    tab.evaluate(MOVED, [STEPS, REST_MS])
    events = json.loads(browser.stop_tracing())["traceEvents"]
    tab.close()
    marks = sorted((event for event in events if event.get("name") == "step"), key=lambda event: event["ts"])
    return [(end["tts"] - start["tts"]) / 1000 for start, end in zip(marks[::2], marks[1::2], strict=True)]


if __name__ == "__main__":
    main()
