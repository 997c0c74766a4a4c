"""Another processor's kernels of linear algebra: the same bits, of what is said to have the same."""

import contextlib
import io
import os
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
from pandas.testing import assert_frame_equal

from dse import store
from dse.config import load_space
from dse.study import explore
from tests.tiny_study import REAL, write_recordings

ROOT = Path(__file__).resolve().parents[2]
KERNELS = "Nehalem"
SPACE = REAL.replace("[loihi1_silicon]", "[loihi1_silicon, mcu_m4, spinnaker2, xylo_imu]").replace(
    "phi: [0, 2], theta: [0.4, 0.6]", "phi: {range: [0, 12]}, theta: [0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9]"
)
RUN = """
import sys
from dse.config import load_space
from dse.study import explore, workers
from tests.in_process import InProcess

workers.Loky = InProcess
explore.run(load_space(sys.argv[1]), sys.argv[2], progress=False)
"""
PRODUCT = (
    "import numpy as np; x = np.random.default_rng(0).normal(size=(60, 60)); print((x @ x).tobytes().hex())"
)


def on(kernel, *command):
    """Return what a Python process prints with the kernels of a processor."""
    environment = {**os.environ, "OPENBLAS_CORETYPE": kernel, "OPENBLAS_NUM_THREADS": "1"}
    return subprocess.run(
        [sys.executable, *command], cwd=ROOT, env=environment, capture_output=True, text=True, check=True
    ).stdout


def test_integer_networks_and_prices_are_the_same_bits_with_the_kernels_of_another_processor(tmp_path):
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(PRODUCT, {})
    if on(KERNELS, "-c", PRODUCT) == printed.getvalue():
        pytest.skip("numpy's linear algebra has no kernels that differ here")
    write_recordings(tmp_path / "tiny.npz")
    (tmp_path / "real.yaml").write_text(SPACE, encoding="utf-8")
    studies = [tmp_path / name / "real" for name in ("other", "own")]
    on(KERNELS, "-c", RUN, str(tmp_path / "real.yaml"), str(studies[0].parent))
    explore.run(load_space(tmp_path / "real.yaml"), studies[1].parent, progress=False)
    weights = [[arrays(run) for run in sorted(study.glob("runs/*.npz"))] for study in studies]
    assert len(weights[0]) == 2 and weights[0] == weights[1]
    tables = [pd.read_parquet(study / "points.parquet") for study in studies]
    points = [table.drop(columns="train_s") for table in tables]
    assert {"energy_uj", "power_w", "hardware_latency_ms", "accuracy_corrected"} <= set(points[0])
    assert_frame_equal(*points, check_exact=True)


def arrays(path):
    """Return the weights of a run as bytes."""
    return {name: array.tobytes() for name, array in store.load_arrays(path / "weights.npz").items()}
