"""Small tables of design points that several tests use."""

import numpy as np
import pandas as pd
from hypothesis import strategies as st

from dse.skyline.front import Draws


def table(**columns):
    return pd.DataFrame(columns)


OBJECTIVES = [("accuracy", "max"), ("energy_uj", "min")]


ROWS = st.lists(
    st.tuples(
        st.sampled_from([0.5, 0.7, 0.9, np.nan, np.inf]),
        st.sampled_from([1.0, 2.0, 3.0, np.nan, -np.inf]),
        st.sampled_from([10, 20]),
        st.sampled_from(["texture", "speed"]),
    ),
    max_size=12,
)


POINTS = table(
    accuracy=[0.95, 0.9, 0.9, 0.8, np.nan],
    energy_uj=[100.0, 40.0, 30.0, 20.0, 1.0],
    n_weights=[200_000, 90_000, 120_000, 50_000, 1],
    task=["texture", "texture", "texture", "speed", "texture"],
)


def leaky():
    """Return three points of which the best has seen its labels, and one that does not say."""
    frame = pd.DataFrame({"trial": [0, 1, 2, 3], "accuracy": [1.0, 0.8, 0.7, 0.9], "size": [1, 2, 1, 3]})
    return frame.assign(transductive=pd.array([True, False, False, None], "boolean"))


# Three designs: a is cheap, b dear and accurate, c beaten by b unless the figures say otherwise.
UNCERTAIN = pd.DataFrame(
    {
        "trial": [0, 1, 2],
        "accuracy": [0.8, 0.9, 0.85],
        "energy_uj": [10.0, 20.0, 21.0],
        "n_weights": [1, 2, 3],
    }
)


DRAWN = np.array([[9.0, 18, 19], [11.0, 22, 21], [10.0, 20, 22], [10.0, 21, 20]])


GOALS = [("accuracy", "max"), ("energy_uj", "min")]


def energies(drawn):
    """Return draws of energy_uj, (draw, row of the whole table)."""
    return Draws(("energy_uj",), lambda rows: {"energy_uj": drawn[:, rows.index]})


# Two designs on two chips: the better one does not fit chip y, and nothing fits chip z.
CHIPS = pd.DataFrame(
    {
        "trial": [0, 1, 0, 1, 0, 1],
        "hardware": ["x", "x", "y", "y", "z", "z"],
        "fits": pd.array([True, True, False, True, False, False], dtype="boolean"),
        "accuracy": [0.9, 0.8] * 3,
        "n_weights": [10, 20] * 3,
        "energy_uj": [2.0, 1.0, 5.0, 9.0, 3.0, 4.0],
    }
)


# The best design has seen its labels, the next does not fit its chip; the words of these columns also
# occur in names of families and of other columns.
WORDS = pd.DataFrame(
    {
        "trial": [0, 1, 2],
        "family": ["snn", "snn", "mlp"],
        "accuracy": [0.99, 0.9, 0.8],
        "energy_uj": [1.0, 1.0, 2.0],
        "transductive": [True, False, False],
        "hardware": ["chip"] * 3,
        "fits": [True, False, True],
        "fits_well": [True] * 3,
        "model.fits": [1] * 3,
        "transductive_x": [1] * 3,
        "model.transductive": ["no"] * 3,
    }
)
NAMING_OTHERS = (
    "family != 'transductive_x'",
    "family != 'fits'",
    "family not in ['fits', 'transductive']",
    "fits_well",
    "fits_well == True",
    "model.fits == 1",
    "model.fits <= 1",
    "transductive_x < 2",
    "model.transductive == 'no'",
    "energy_uj < 9 and not (family == 'fits' or family == 'transductive')",
)
