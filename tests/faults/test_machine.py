"""A processor without vector instructions computes the same bits: kernels, golden networks, a small study."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.ours import rows_of
from dse import store
from dse.config import load_space
from dse.engine import kernels
from dse.engine.layers import laid_out, weights
from dse.engine.layout import LANES, aligned
from dse.engine.neurons import cuba_lif
from dse.study import explore
from tests import tiny_study
from tests.golden import FILE

GENERIC = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
ROOT = Path(__file__).resolve().parents[2]


def arrays_of_study(folder):
    """Train the networks of a study; return a digest of all arrays of its runs."""
    folder.mkdir()
    tiny_study.write_recordings(folder / "tiny.npz")
    (folder / "tiny.yaml").write_text(tiny_study.REAL)
    study = explore.run(load_space(folder / "tiny.yaml"), folder / "results", progress=False)
    digest = hashlib.sha256()
    for path in sorted(study.folder.rglob("*.npz")):
        for name, array in sorted(store.load_arrays(path).items()):
            digest.update(f"{path.name}/{name} {array.dtype}".encode() + array.tobytes())
    return digest.hexdigest()


def bits_of_kernels():
    """Run a layer of integer neurons by its two kernels; return a digest of states, spikes and counts."""
    rng = np.random.default_rng(28)
    n_steps, n_inputs, n_neurons = 200, 30, 20
    decays = rng.integers(100, 3000, (2, n_neurons)).astype(np.int32)
    table = rng.integers(-60, 90, (n_inputs, n_neurons)) / 32
    layer = laid_out(weights(table, None, cuba_lif.Population(*decays, 80)), "integer")
    rows, n = rows_of(rng.random((1, n_steps, n_inputs)) < 0.2), layer.n_columns
    z, fired = aligned(n_steps * n, np.float32), np.zeros(n_steps * n // LANES, np.uint16)
    updates, peak = np.zeros(n_steps, np.int32), aligned(LANES, np.float64)
    kernels.gather(
        rows.offsets, rows.index, rows.times, 0, n_steps, layer.table, 0, n, layer.table_unit, z, 0, False
    )
    n_fired = kernels.scan(
        z, 0, n_steps, n, layer.keep_u, layer.keep_v, layer.cross, 0, layer.threshold, layer.scale,
        layer.integer, 0, layer.surrogate, fired, 0, n // LANES, updates, peak, z[:0],
    )  # fmt: skip
    assert n_fired > n_steps
    return hashlib.sha256(b"".join(x.tobytes() for x in (z, fired, updates, peak))).hexdigest()


def on_generic(*arguments):
    return subprocess.run(
        [sys.executable, *arguments],
        env={**os.environ, **GENERIC},
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )


def test_kernels_are_the_same_bit_for_bit(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    there = on_generic(
        "-c", "from tests.faults.test_machine import bits_of_kernels; print(bits_of_kernels())"
    )
    assert there.stdout.strip() == bits_of_kernels(), there.stderr
    assert [*tmp_path.rglob("*.nbc")], "its kernels were compiled for it"


def test_a_study_is_the_same_bit_for_bit(tmp_path, n_faults):
    if n_faults < 100:
        pytest.skip("kernels are compiled again: only with all faults")
    lines = "import sys; from pathlib import Path; from tests.faults.test_machine import arrays_of_study"
    there = on_generic("-c", f"{lines}; print(arrays_of_study(Path(sys.argv[1])))", str(tmp_path / "there"))
    assert there.stdout.strip() == arrays_of_study(tmp_path / "here"), there.stderr


@pytest.mark.skipif(not FILE.exists(), reason="shared/reference/cuba_golden.npz is absent")
def test_golden_networks_are_golden(n_faults):
    if n_faults < 100:
        pytest.skip("kernels are compiled again: only with all faults")
    done = on_generic("-m", "benchmarks.golden", str(FILE))
    assert done.returncode == 0, done.stdout + done.stderr
