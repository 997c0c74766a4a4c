"""Small tables of design points for the page's and the figures' tests."""

import base64
import gzip
import json
import re

import pandas as pd

from dse.show.dashboard.gather import gather_page
from dse.show.dashboard.write import write_filled

OBJECTIVES = {"accuracy": "max", "energy_uj": "min", "n_weights": "min"}

# Hand-made so that the fronts are known: over accuracy and energy rows 0, 1, 3; over all three rows
# 0, 1, 2, 3; row 4 is beaten by row 1 in everything.
ACCURACY = [0.95, 0.90, 0.85, 0.60, 0.88]
ENERGY = [50.0, 20.0, 21.0, 5.0, 30.0]
WEIGHTS = [90_000, 40_000, 10_000, 20_000, 45_000]
ON_FRONT = [True, True, True, True, False]
ON_PAIR = [True, True, False, True, False]


def held(path):
    """Return what a page that was written carries for its script."""
    text = path.read_text(encoding="utf-8")
    packed = re.findall(r'<script type="application/gzip" id="data">([A-Za-z0-9+/=]*)</script>', text)
    return json.loads(gzip.decompress(base64.b64decode(*packed)))


def write_page(frame, path, **options):
    """Write the page of a table, with the options of `gather_page`."""
    return write_filled("page", gather_page(frame, **options), path)


def points(**more):
    """Return five design points of one task; keywords add or replace columns."""
    frame = pd.DataFrame(
        {
            "trial": range(5),
            "task": "texture",
            "status": "finished",
            "reason": "",
            "model.hidden": [100, 50, 20, 25, 75],
            "phi": [0, 2, 4, 6, 8],
            "theta": 0.5,
            "accuracy": ACCURACY,
            "accuracy_se": 0.02,
            "energy_uj": ENERGY,
            "energy_uj_low": [x * 0.8 for x in ENERGY],
            "energy_uj_high": [x * 1.5 for x in ENERGY],
            "n_weights": WEIGHTS,
        }
    )
    return frame.assign(**more)


def failed(reason="loss became NaN in epoch 3", trial=9):
    """Return one failed trial: a reason, and no measurement."""
    return pd.DataFrame(
        {
            "trial": [trial],
            "task": ["texture"],
            "status": ["failed"],
            "reason": [reason],
            "model.hidden": [500],
        }
    )
