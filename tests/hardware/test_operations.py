import numpy as np
import pytest
import yaml

import dse.hardware.profile
from dse.config.faults import ConfigError
from dse.hardware import operations
from dse.hardware.operations import energy_uj
from dse.hardware.profile import load

NAME = "op_4.6_0.9"


def test_energy_by_hand():
    # 1000 MACs and 2000 additions: 4600 + 1800 pJ; low end 230 + 60 pJ.
    value, low, high = energy_uj(load(NAME), 1000, 2000)
    assert (float(value), float(low), float(high)) == pytest.approx((6.4e-3, 2.9e-4, 6.4e-3))


def test_leading_axes_and_nothing_done():
    macs, additions = np.array([[0, 1e6], [2e6, 0]]), np.array([[0, 0], [1e6, 1e6]])
    value, low, high = energy_uj(load(NAME), macs, additions)
    assert value.tolist() == [[0.0, 4.6], [pytest.approx(10.1), pytest.approx(0.9)]]
    assert (low <= value).all() and (value <= high).all() and low.shape == (2, 2)


@pytest.mark.parametrize("bad", [-1.0, np.nan, np.inf])
def test_counts_that_are_none(bad):
    with pytest.raises(ValueError, match="macs must be finite and >= 0"):
        energy_uj(load(NAME), [1.0, bad], 0.0)
    with pytest.raises(ValueError, match="additions must be finite and >= 0"):
        energy_uj(load(NAME), 0.0, bad)


def test_it_is_a_profile_of_another_kind():
    profile = load(NAME)
    assert isinstance(profile, operations.OperationProfile)
    assert NAME in dse.hardware.profile.names()
    assert {profile.mac_pj.evidence, profile.addition_pj.evidence} == {"convention"}
    assert not isinstance(load("loihi1_silicon"), operations.OperationProfile)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d["mac_pj"].update(unit="nJ"), "mac_pj.unit must be 'pJ', got 'nJ'"),
        (lambda d: d.pop("addition_pj"), "addition_pj is missing"),
        (lambda d: d.pop("mac_pj"), "mac_pj is missing"),
        (
            lambda d: d.update(static_mw=d["mac_pj"]),
            "unknown number 'static_mw'; known: name, doc, mac_pj, addition",
        ),
        (lambda d: d["mac_pj"].update(low=5), "mac_pj must be 0 <= low <= value <= high"),
    ],
)
def test_a_wrong_number_is_named(tmp_path, change, message):
    data = {"name": "mine", "doc": "mine"} | {
        key: vars(getattr(load(NAME), key)).copy() for key in ("mac_pj", "addition_pj")
    }
    change(data)
    file = tmp_path / "mine.yaml"
    file.write_text(yaml.safe_dump(data, sort_keys=False))
    with pytest.raises(ConfigError, match=message):
        load(file)
