"""Seeded damage to the files of a bundle: it is refused in one line, or is the same bundle."""

import random
import shutil
from pathlib import Path

import numpy as np
import pytest

from dse.deploy.bundle import BundleError, read, weights, write
from dse.deploy.verify import export_targets
from dse.testing.targets import small_bundle, small_recordings
from tests.faults.damage import damage
from tests.plugins import with_targets


def test_no_damaged_bundle_is_run(tmp_path, monkeypatch, n_faults, tried):
    write(small_bundle(recurrent=True, delays=(0, 2)), tmp_path / "whole")
    with_targets.load(monkeypatch)
    export_targets(tmp_path / "whole", ["arrays"], small_recordings(tmp_path / "touch.npz"))
    expected, rng, n_refused = read(tmp_path / "whole"), random.Random(24), 0
    arrays = weights(expected.fitted)
    for number in range(n_faults):
        copy = Path(shutil.copytree(tmp_path / "whole", tmp_path / "a" / "b" / "copy"))
        what = damage(rng.choice(sorted(x for x in copy.rglob("*") if x.is_file())), rng)
        try:
            bundle = read(copy)
        except BundleError as error:
            n_refused += 1
            assert "\n" not in str(error) and str(copy) in str(error), (number, what)
        else:
            found = weights(bundle.fitted)
            assert found.keys() == arrays.keys(), (number, what)
            assert all(np.array_equal(found[name], arrays[name]) for name in arrays), (number, what)
            assert (bundle.phi, bundle.theta, bundle.record, bundle.evidence, bundle.targets) == (
                expected.phi, expected.theta, expected.record, expected.evidence, expected.targets,
            ), (number, what)  # fmt: skip
        shutil.rmtree(copy)
        tried["a file of a bundle"] += 1
    assert n_refused > n_faults // 3


def test_a_changed_readme_is_refused(tmp_path):
    write(small_bundle(), tmp_path / "bundle")
    readme = tmp_path / "bundle" / "README.md"
    readme.write_text(readme.read_text().replace("fraction", "faction"))
    with pytest.raises(BundleError, match=r"README\.md: is damaged"):
        read(tmp_path / "bundle")
