"""A processor without vector instructions computes the same bits: golden networks, and a small study."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

from dse import store
from dse.config import load_space
from dse.study import explore
from tests import tiny_study
from tests.golden import FILE

GENERIC = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
ROOT = Path(__file__).resolve().parents[2]


def arrays_of_study(folder: Path) -> str:
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


def on_generic(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments],
        env={**os.environ, **GENERIC},
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )


def test_a_study_is_the_same_bit_for_bit(tmp_path: Path, n_faults: int) -> None:
    if n_faults < 100:
        pytest.skip("kernels are compiled again: only with all faults")
    lines = "import sys; from pathlib import Path; from tests.faults.test_machine import arrays_of_study"
    there = on_generic("-c", f"{lines}; print(arrays_of_study(Path(sys.argv[1])))", str(tmp_path / "there"))
    assert there.stdout.strip() == arrays_of_study(tmp_path / "here"), there.stderr


@pytest.mark.skipif(not FILE.exists(), reason="shared/reference/cuba_golden.npz is absent")
def test_golden_networks_are_golden(n_faults: int) -> None:
    if n_faults < 100:
        pytest.skip("kernels are compiled again: only with all faults")
    done = on_generic("-m", "benchmarks.golden", str(FILE))
    assert done.returncode == 0, done.stdout + done.stderr
