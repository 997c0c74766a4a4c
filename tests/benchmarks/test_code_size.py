"""Flash of the C on Cortex-M: as predicted, and how its parts are fitted."""

import numpy as np
import pandas as pd
import pytest

from benchmarks.code_size import KINDS, built, fitted
from benchmarks.gcc import GCC, by_gcc
from dse.deploy.c import code_size
from dse.deploy.c.counting import code_of
from dse.deploy.targets import emulator
from dse.deploy.verify import target_named


@pytest.mark.parametrize("compiler", ["clang", "gcc"])
@pytest.mark.parametrize("core", ["cortex_m4", "cortex_m0plus"])
def test_flash_behind_an_encoder_is_known_before_it_is_compiled(core, compiler):
    if why := emulator.missing():
        pytest.skip(why)
    if compiler == "gcc" and GCC is None:
        pytest.skip("arm-none-eabi-gcc is not installed")
    target = target_named(core)
    rows = built(by_gcc(target) if compiler == "gcc" else target, ["front ends"], 7)
    parts = target.core.parts[compiler]
    for seed, flash in enumerate(rows.flash):
        code = code_of(KINDS["front ends"](seed))
        assert code_size.flash_bytes(code, parts) == pytest.approx(flash, abs=600)
    assert {"real_samples", "samples", "receptors", "events"} <= set(rows.columns)


def test_parts_are_found_again_and_unseen_ones_stay():
    rng, bytes_of = np.random.default_rng(0), {"base": 400.0, "add_words": 90.0, "never": 7.0}
    rows = pd.DataFrame(
        {"constants": rng.integers(100, 10_000, 9), "base": 1, "add_words": rng.permutation(9)}
    )
    rows["flash"] = rows.constants + 400 * rows.base + 90 * rows.add_words
    assert fitted(rows, {"base": 500.0, "add_words": 0.0, "never": 7.0}) == pytest.approx(bytes_of)
