"""Small recordings whose every number is known, one for each kind of file, and what reads them."""

import numpy as np
import pandas as pd

from dse.data.recordings.events import EventFile
from dse.data.recordings.raster import RasterFile
from dse.data.recordings.table import LongTable, Table
from dse.data.recordings.time_series import TimeSeries, WideTable

SAMPLES = pd.DataFrame(
    {
        "id": ["b", "b", "a", "b", "a"],
        "t": [0.0, 10.0, 0.0, 20.0, 10.0],
        "left": [1, 2, 30, 3, 40],
        "right": [0.5, 0.25, 7.0, 0.125, 8.0],
    }
)
LABELS = pd.DataFrame({"id": ["a", "b"], "cloth": ["silk", "wool"], "speed": [-5, 10]})
LABEL_COLUMNS = {"fabric": "cloth", "v": "speed"}
TABLE = Table("x.csv", 10, ("left", "right"), "id", "t", labels="labels.csv", columns=LABEL_COLUMNS)

LONG = pd.DataFrame(
    [
        (1000 * t, taxel, 10 * number + t + (100 if taxel == "b" else 0), cloth)
        for number, cloth in enumerate(("silk", "wool"))
        for t in range(3)
        for taxel in "ab"
    ],
    columns=["t", "taxel", "pressure", "cloth"],
)
LONG_TABLE = LongTable(
    "x.csv", 1, ("b", "a"), "t", "taxel", "pressure", time_unit="us", columns={"fabric": "cloth"}
)

WIDE = pd.DataFrame(
    {
        "cloth": ["silk", "wool"],
        **{f"l_{k}": [float(k), 10.0 + k] for k in (0, 1, 2, 10)},
        **{f"r_{k}": [100.0 + k, 200.0 + k] for k in (2, 0, 10, 1)},
    }
)
WIDE_TABLE = WideTable("x.csv", 4, ("l_", "r_"), columns={"fabric": "cloth"})

SERIES = {
    "signal": np.arange(20).reshape(10, 2),
    "offsets": np.array([0, 4, 10]),
    "label": np.array([1, 0]),
    "names": np.array(["smooth", "rough"]),
    "force": np.array([0.5, 2.0]),
}
TIME_SERIES = TimeSeries(
    "x.npz",
    step_ms=28,
    offsets="offsets",
    columns={"fabric": "label", "force": "force"},
    class_names={"fabric": "names"},
)

SPIKES = (np.random.default_rng(5).random((3, 11, 4)) < 0.3).astype(np.uint8)
RASTER = RasterFile("x.npz", step_ms=5, columns={"letter": "label"})

TAXELS = {
    "t_us": np.array([5, 5, 9, 2, 7], dtype=np.int32),
    "taxel": np.array([0, 3, 1, 2, 2], dtype=np.uint8),
    "polarity": np.array([1, 0, 1, 1, 0], dtype=np.uint8),
    "offsets": np.array([0, 3, 5]),
    "label": np.array([0, 1]),
}
EVENTS = EventFile("x.npz", width=4, taxel="taxel", polarity="polarity", columns={"object": "label"})
