"""Designs of a page with their documents, and a page of them in a browser."""

import itertools
import json

import numpy as np
import pandas as pd

from dse.show.dashboard.details import TABS, of_tab
from dse.show.figures.confusion import ConfusionFigure
from dse.show.figures.learning import LearningFigure
from dse.show.figures.progress import ProgressFigure, gather_progress
from dse.show.figures.raster import RecordingFigure, gather_recording
from tests.figure_data import study
from tests.page_data import OBJECTIVES

PHI = (0, 2, 4)
THETA = (0.5, 0.8)
ACCURACY = (0.5, 0.6, 0.9, 0.7, 0.9, 0.8)  # over phi and theta; of the best two the first is faster
LATENCY_MS = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0)
CHIPS = {"large chip": 1.0, "small chip": 3.0}  # µJ for every ms of decision latency
OFF_PAGE = (5, 6)  # points of trial 0 that its page does not carry
CLASSES = ("denim", "silk & wool")


def table(trials=3):
    """Return designs that answer at the end, and the decision surface of each; `OFF_PAGE` is left out."""
    rows = []
    for trial, (chip, price) in itertools.product(range(trials), CHIPS.items()):
        about = {"trial": trial, "task": "texture", "hardware": chip, "model.hidden": 10 * (trial + 1)}
        about |= {"encoder.kind": "threshold", "n_weights": 100 * (trial + 1)}
        at_end = {"accuracy": 0.85, "decision_latency_ms": 100.0, "energy_uj": 100 * price}
        rows.append(about | at_end | {"point": 0})
        for point, (phi, theta) in enumerate(itertools.product(PHI, THETA), 1):
            if trial or point not in OFF_PAGE:
                rows.append(
                    about | columns_at(point - 1, price) | {"point": point, "phi": phi, "theta": theta}
                )
    return pd.DataFrame(rows)


def columns_at(place, price):
    measured = {"accuracy": ACCURACY[place], "decision_latency_ms": LATENCY_MS[place], "accuracy_se": 0.02}
    energy = price * LATENCY_MS[place]
    return measured | {"energy_uj": energy, "energy_uj_low": energy / 2, "energy_uj_high": 2 * energy}


def plain(figure):
    found = json.loads(figure.to_json())
    found["layout"].pop("template", None)
    return found


def surface(**changes):
    on = {
        chip: {name: [columns_at(k, price)[name] for k in range(6)] for name in columns_at(0, price)}
        | {"undecided": [0.0, 0.1, 0.2, 0.3, 0.4, 0.5], "n_weights": [100] * 6}
        for chip, price in CHIPS.items()
    }
    grid = {"first_point": 1, "phi": list(PHI), "theta": list(THETA), "hardware": on, "best": 2}
    return {"weight_bits": None, "pruned_after": None} | grid | changes


def example(title="recording 7: denim", classes=CLASSES):
    output = np.zeros((20, 2), np.uint8)
    output[[1, 4, 6, 9, 12, 15], [1, 0, 0, 0, 1, 0]] = 1
    drawn = gather_recording(output, output, 5.0, classes, 0, (2.0, 0.5))
    figure = plain(RecordingFigure().draw(drawn))
    spikes = drawn.spikes.tolist()
    return {"title": title, "true": classes[0], "figure": figure, "step_ms": 5.0, "n_steps": 20} | {
        "spikes": spikes,
        "classes": list(classes),
    }


def drawn(tab, figure, *found, **files):
    """Return a figure of a study as a page holds it in a tab."""
    made = of_tab(TABS[tab], figure.draw(figure.gather(study(*found, **files))))
    return json.loads(json.dumps(made))


def confusion_of(counts, classes):
    return drawn(
        "confusion", ConfusionFigure(trial=0), classes=classes, confusion=[{"validation": np.array(counts)}]
    )


def learning_of(loss):
    return drawn("learning", LearningFigure(trial=0), history=[{"loss": np.array(loss)}])


def details(trial=0, figures=None, **parts):
    """Return a document as `dse.show.dashboard.details` gathers it."""
    recorded = {
        "confusion": confusion_of([[8, 1], [3 + trial, 8]], CLASSES),
        "learning": learning_of([2.0 + trial, 1.0, 0.5]),
    }
    own = recorded if figures is None else figures
    task = {"figures": own, "surfaces": [surface()], "examples": [example()]} | parts
    return {"trial": trial, "notes": [], "tasks": {"texture": task}}


def progress_of(frame, **more):
    """Return how a study of these points goes, with two failed and one trial stopped early of twelve."""
    growth = gather_progress(frame, OBJECTIVES, range(5), [0.1, 0.2, 0.3, 0.4, 0.5]) if len(frame) else None
    return {
        "trials": {"total": 12, "done": 8, "running": 3, "failed": 2, "stopped": 1},
        "runs": {"total": 12, "done": 8},
        "running": [{"trial": 9, "design": {"model.hidden": [8, 8], "model.true_rate": 0.25}}],
        "failed": [
            {"reason": "loss is not finite", "count": 1, "trials": [5]},
            {"reason": "x" * 500, "count": 1, "trials": [6]},
        ],
        "stopped": [{"reason": "behind the median", "count": 1, "trials": [7]}],
        "hours": 0.5,
        "time_left_s": 734.0 if growth else None,
        "sign": "2026-01-02T03:04:05+00:00",
        "is_running": None,
        "hypervolume": [
            {
                name: value if isinstance(value, str) else float(value[-1])
                for name, value in vars(curve).items()
            }
            for curve in (growth or ())
        ],
        "figure": plain(ProgressFigure().draw(growth)) if growth else None,
        **more,
    }


def hash_of(page):
    return page.tab.evaluate("Object.fromEntries(new URLSearchParams(location.hash.slice(1)))")
