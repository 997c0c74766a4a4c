from pathlib import Path

import pytest
import yaml

import dse.hardware
from dse.config.faults import ConfigError
from dse.hardware.profile import Number, load, names

FILE = Path(dse.hardware.__file__).parent / "profiles" / "loihi1_silicon.yaml"


def test_every_profile_of_the_package_loads():
    assert "loihi1_silicon" in names()
    for name in names():
        assert load(name).name == name


def test_the_figures_of_the_reference():
    profile = load("loihi1_silicon")
    assert profile.synaptic_event_pj.value == 35.5
    assert profile.static_mw == Number(104.0, 29.0, 104.0, "mW", "measured", profile.static_mw.source)
    assert profile.at("value")["barrier_29_us"] == 1.8
    assert profile.at("low")["static_mw"] == 29.0


def test_uncertainty_is_as_stated():
    profile = load("loihi1_silicon")
    for name, value in profile.at("value").items():
        share = {"pj": 0.15, "ns": 0.3, "us": 0.3}.get(name.rsplit("_", 1)[-1])
        if share is not None:
            assert profile.at("low")[name] == pytest.approx((1 - share) * value)
            assert profile.at("high")[name] == pytest.approx((1 + share) * value)


def written(tmp_path, change):
    data = yaml.safe_load(FILE.read_text())
    change(data)
    file = tmp_path / "chip.yaml"
    file.write_text(yaml.safe_dump(data, sort_keys=False, default_flow_style=None, width=1000))
    return file


def test_a_file_of_ones_own_loads(tmp_path):
    file = written(tmp_path, lambda data: data["static_mw"].update(value=60))
    assert load(file).static_mw.value == 60
    assert load(str(file)).static_mw.low == 29


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d["spike_pj"].update(unit="nJ"), "spike_pj.unit must be 'pJ', got 'nJ'"),
        (lambda d: d["cores"].update(unit="pJ"), "cores.unit must be '1'"),
        (
            lambda d: d["spike_pj"].update(evidence="guess"),
            "evidence is unknown, got 'guess'; known: measured",
        ),
        (lambda d: d["spike_pj"].update(source=""), "spike_pj.source must say where"),
        (lambda d: d["spike_pj"].update(low=100), "spike_pj must be 0 <= low <= value <= high"),
        (lambda d: d["spike_pj"].update(low=-1), "spike_pj must be 0 <= low <= value <= high"),
        (
            lambda d: d["spike_pj"].update(value="much"),
            "spike_pj: low, value and high must be finite numbers",
        ),
        (lambda d: d["spike_pj"].update(value=True), "must be finite numbers"),
        (lambda d: d["spike_pj"].update(high=float("inf")), "must be finite numbers"),
        (lambda d: d["spike_pj"].pop("source"), "spike_pj must hold exactly value, low, high, unit"),
        (lambda d: d.update(spike_pj=69.3), "spike_pj must hold exactly"),
        (lambda d: d["cores"].update(high=130), "cores must be one whole number"),
        (lambda d: d["cores"].update(low=1.5, value=1.5, high=1.5), "cores must be one whole number"),
        (lambda d: d["cores"].update(low=0, value=0, high=0), "cores must be one whole number"),
        (
            lambda d: d["skips_zero_weights"].update(low=2, value=2, high=2),
            "skips_zero_weights must be 0 or 1",
        ),
        (lambda d: d["skips_zero_weights"].update(low=0), "skips_zero_weights must be 0 or 1"),
        (lambda d: d.update(spike_nj=d["spike_pj"]), "unknown number 'spike_nj'; .* Did you mean 'spike_"),
        (lambda d: d.pop("spike_pj"), "spike_pj is missing"),
        (lambda d: d.update(doc=""), "doc must be text"),
    ],
)
def test_a_wrong_number_is_named(tmp_path, change, message):
    file = written(tmp_path, change)
    with pytest.raises(ConfigError, match=message) as caught:
        load(file)
    assert len(caught.value.faults) == 1


def test_every_fault_is_reported_at_once_with_its_line(tmp_path):
    def change(data):
        data["spike_pj"]["unit"] = "nJ"
        data["static_mw"]["low"] = 200
        data.pop("cores")

    file = written(tmp_path, change)
    lines = file.read_text().splitlines()
    with pytest.raises(ConfigError) as caught:
        load(file)
    first, second, third = caught.value.faults
    assert lines[first.line - 1].startswith("spike_pj:")
    assert lines[second.line - 1].startswith("static_mw:")
    assert third.message == "cores is missing"


def test_no_profile(tmp_path):
    with pytest.raises(
        ConfigError, match=r"loihi_silicon: no hardware profile; .* Did you mean 'loihi1_silicon'"
    ):
        load("loihi_silicon")
    (tmp_path / "list.yaml").write_text("- 1\n")
    with pytest.raises(ConfigError, match=r"list\.yaml:1: a profile must be a mapping"):
        load(tmp_path / "list.yaml")
    (tmp_path / "torn.yaml").write_text("name: [\n")
    with pytest.raises(ConfigError, match="not valid YAML"):
        load(tmp_path / "torn.yaml")
