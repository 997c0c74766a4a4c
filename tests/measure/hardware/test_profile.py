from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import yaml

import dse.measure.hardware
from dse.config.faults import ConfigError
from dse.config.parts import chips
from dse.measure.hardware.profile import Evidence, Number, Profile, kinds, load, load_all, names, read
from dse.study import pricing

PROFILES = Path(dse.measure.hardware.__file__).parent / "profiles"
FILE = PROFILES / "loihi1_silicon.yaml"


def test_every_profile_of_the_package_loads():
    assert {"loihi1_silicon", "op_4.6_0.9"} <= set(names())
    for name in names():
        profile = load(name)
        assert profile.name == name
        written = (PROFILES / f"{name}.yaml").read_text()
        assert profile.text == written or "like:" in written
        assert replace(read(profile.text, name), text="") == replace(profile, text="")


def test_a_chip_that_is_like_another_says_only_what_differs(tmp_path):
    number = '{value: 64, low: 64, high: 64, unit: MHz, evidence: specification, source: "data sheet"}'
    (file := tmp_path / "mine.yaml").write_text(
        f"name: mine\nlike: mcu_m33\ndoc: my part\nclock_mhz: {number}\n"
    )
    mine, base = load(file), load("mcu_m33")
    assert (mine.name, mine.doc, mine.label, type(mine)) == ("mine", "my part", "", type(base))
    assert {x for x in mine.numbers() if getattr(mine, x) != getattr(base, x)} == {"clock_mhz"}
    assert mine.clock_mhz.value == 64
    # What a study keeps of it does not change with the profile that it is like.
    assert "like" not in mine.text and replace(read(mine.text, "x"), text="") == replace(mine, text="")


def test_a_chip_that_is_like_one_that_is_like_another(tmp_path):
    (file := tmp_path / "mine.yaml").write_text("name: mine\nlike: mcu_m33_low_power\ndoc: my part\n")
    assert replace(load(file), name="", doc="", label="", text="") == replace(
        load("mcu_m33_low_power"), name="", doc="", label="", text=""
    )
    # Rules of a search space that look at a chip before it is loaded see its kind.
    (one,) = chips([file.name], tmp_path)
    assert one.kind is type(load("mcu_m33")) and one.profile["doc"] == "my part"


def test_a_chip_that_is_like_another_is_checked_as_any(tmp_path):
    (file := tmp_path / "mine.yaml").write_text("like: mcu_m32\nname: mine\ndoc: my part\n")
    with pytest.raises(ConfigError, match=r"mine.yaml:1: .*'mcu_m32'; .* mean 'mcu_m33'"):
        load(file)
    file.write_text("like: mcu_m33\nclock_mhz: 3\nclok: 4\n")
    with pytest.raises(ConfigError) as faults:
        load(file)
    assert sorted((x.line, x.message.split()[0]) for x in faults.value.faults)[-2:] == [
        (2, "clock_mhz"),
        (3, "unknown"),
    ]


def test_every_number_of_every_profile_has_a_pedigree():
    for profile in map(load, names()):
        assert profile.numbers()
        assert profile.stated == tuple(profile.numbers())  # shipped ones lack none
        for name, figure in profile.numbers().items():
            number = getattr(profile, name)
            assert number.low <= number.value <= number.high, (profile.name, name)
            assert number.unit == figure.unit
            assert number.evidence in get_args(Evidence)
            assert number.source.strip()
            assert figure.doc


def test_the_unit_of_a_number_is_in_its_name():
    units = {
        **{"pj": "pJ", "nj": "nJ", "uj": "uJ", "ns": "ns", "us": "us", "ms": "ms"},
        **{"mw": "mW", "uw": "uW", "mhz": "MHz", "kib": "KiB", "hz": "Hz", "w": "W"},
    }
    assert len(kinds()) > 1
    for kind, cls in kinds().items():
        for name, figure in cls.numbers().items():
            assert figure.unit == units.get(name.rsplit("_", 1)[-1], "1"), (kind, name)


def test_the_figures_of_the_reference():
    profile = load("loihi1_silicon")
    assert profile.synaptic_event_pj.value == 35.5
    assert profile.static_mw == Number(104.0, 29.0, 104.0, "mW", "second-hand", profile.static_mw.source)
    assert profile.at("value")["barrier_29_us"] == 1.8
    assert profile.at("low")["static_mw"] == 29.0
    assert profile.ends["static_mw"].tolist() == [104, 29, 104]


def test_uncertainty_is_as_stated():
    profile = load("loihi1_silicon")
    for name, value in profile.at("value").items():
        share = {"pj": 0.15, "ns": 0.3, "us": 0.3}.get(name.rsplit("_", 1)[-1])
        if share is not None:
            assert profile.at("low")[name] == pytest.approx((1 - share) * value)
            assert profile.at("high")[name] == pytest.approx((1 + share) * value)


def test_draws_lie_within_the_range_and_have_the_value_as_median():
    profile = load("loihi1_silicon")
    drawn = profile.drawn(2001, np.random.default_rng(1))
    for name, values in drawn.items():
        number = getattr(profile, name)
        assert values.shape == (2001,)
        assert number.low <= values.min() <= values.max() <= number.high
        width = number.high - number.low
        assert np.median(values) == pytest.approx(number.value, abs=0.05 * width + 1e-12)


def written(tmp_path, change, name="chip.yaml"):
    data = yaml.safe_load(FILE.read_text()) | {"name": "mine"}
    change(data)
    file = tmp_path / name
    file.write_text(yaml.safe_dump(data, sort_keys=False, default_flow_style=None, width=1000))
    return file


def test_a_file_of_ones_own_loads(tmp_path):
    file = written(tmp_path, lambda data: data["static_mw"].update(value=60))
    profile = load(file)
    assert (profile.name, profile.static_mw.value) == ("mine", 60)
    assert load(str(file)).static_mw.low == 29
    assert type(profile) is kinds()["mesh"]
    assert read(profile.text, "again") == profile


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d["spike_pj"].update(unit="nJ"), "spike_pj.unit must be 'pJ', got 'nJ'"),
        (lambda d: d["cores"].update(unit="pJ"), "cores.unit must be '1'"),
        (lambda d: d["spike_pj"].update(evidence="guess"), "unknown spike_pj.evidence 'guess'; known"),
        (lambda d: d["spike_pj"].update(source=""), "spike_pj.source must state"),
        (lambda d: d["spike_pj"].update(low=100), "spike_pj must be 0 <= low <= value <= high"),
        (lambda d: d["spike_pj"].update(low=-1), "spike_pj must be 0 <= low <= value <= high"),
        (lambda d: d["spike_pj"].update(value="much"), "spike_pj.value must be a number, got 'much'"),
        (lambda d: d["spike_pj"].update(value=True), "spike_pj.value must be a number, got true"),
        (lambda d: d["spike_pj"].update(high=float("inf")), "spike_pj.high must be a finite number, got inf"),
        (lambda d: d["spike_pj"].pop("source"), "spike_pj.source is required"),
        (lambda d: d["spike_pj"].pop("unit"), "spike_pj.unit is required"),
        (lambda d: d["spike_pj"].pop("high"), "spike_pj.high is required"),
        (lambda d: d["spike_pj"].update(evidnce="memory"), "unknown key 'spike_pj.evidnce'; known: .* Did"),
        (lambda d: d["spike_pj"].update(unit="furlong"), "spike_pj.unit must be 'pJ', got 'furlong'"),
        (lambda d: d["spike_pj"].update(unit=None), "spike_pj.unit must be text, got null"),
        (lambda d: d.update(spike_pj=69.3), "spike_pj must be a mapping of keys to values, got 69.3"),
        (lambda d: d["cores"].update(high=130), "cores must be one integer"),
        (lambda d: d["cores"].update(low=1.5, value=1.5, high=1.5), "cores must be one integer"),
        (lambda d: d["cores"].update(low=0, value=0, high=0), "cores must be one integer"),
        (lambda d: d["skips_zero_weights"].update(low=2, value=2, high=2), "skips_zero_weights must be 0"),
        (lambda d: d["skips_zero_weights"].update(low=0), "skips_zero_weights must be 0 or 1"),
        (lambda d: d.update(spike_nj=d["spike_pj"]), "unknown key 'spike_nj'; .* Did you mean 'spike_"),
        (lambda d: d.pop("spike_pj"), "spike_pj is required: per spike of a neuron"),
        (lambda d: d.update(doc=""), "doc must not be empty"),
        (lambda d: d.pop("kind"), "kind is required; known: .*mesh"),
        (lambda d: d.update(kind="mush"), "unknown kind of hardware 'mush'; known: .* Did you mean 'mesh'"),
        (lambda d: d.update(kind=["mesh"]), "unknown kind of hardware"),
        (lambda d: d.update(interval_only="yes"), "interval_only must be true or false, got 'yes'"),
        (lambda d: d.update(compiler="icc"), "unknown compiler 'icc'"),
        (lambda d: d.update(name=3), "name must be text, got 3"),
        (lambda d: d.update(name="../mine"), "name must be valid as a file name, got '../mine'"),
        (lambda d: d["spike_pj"].update(high=10**400), "spike_pj.high must be a number, got '1000"),
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
    missing, unit, interval = caught.value.faults
    assert (missing.line, missing.message) == (1, "cores is required: cores of the chip")
    assert lines[unit.line - 1].startswith("spike_pj:")
    assert lines[interval.line - 1].startswith("static_mw:")


def test_no_profile(tmp_path):
    with pytest.raises(
        ConfigError, match=r"loihi_silicon: no such hardware profile; .* Did you mean 'loihi1_silicon'"
    ):
        load("loihi_silicon")
    (tmp_path / "list.yaml").write_text("- 1\n")
    with pytest.raises(ConfigError, match=r"list\.yaml:1: a profile must be a mapping"):
        load(tmp_path / "list.yaml")
    (tmp_path / "torn.yaml").write_text("name: [\n")
    with pytest.raises(ConfigError, match="not valid YAML"):
        load(tmp_path / "torn.yaml")
    (tmp_path / "empty.yaml").write_text("")
    with pytest.raises(ConfigError, match=r"empty\.yaml:1: kind is required; known: "):
        load(tmp_path / "empty.yaml")
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "folder.yaml").mkdir()
    for name in ("binary.yaml", "folder.yaml", "none.yaml"):
        with pytest.raises(ConfigError) as caught:
            load(tmp_path / name)
        (fault,) = caught.value.faults
        assert fault.path == str(tmp_path / name)


def test_a_file_must_not_have_the_name_of_a_profile_of_the_package(tmp_path):
    file = written(tmp_path, lambda data: data.update(name="op_4.6_0.9"))
    message = "name must differ from the names of shipped profiles, got 'op_4.6_0.9'"
    with pytest.raises(ConfigError, match=message):
        load(file)


def test_profiles_of_a_search_space_have_names_of_their_own(tmp_path):
    written(tmp_path, lambda data: data.update(name="one"), "one.yaml")
    written(tmp_path, lambda data: data.update(name="two"), "two.yaml")
    found = load_all(["one.yaml", "loihi1_silicon", "two.yaml"], tmp_path)
    assert [profile.name for profile in found] == ["one", "loihi1_silicon", "two"]
    assert all(isinstance(profile, Profile) for profile in found)
    written(tmp_path, lambda data: data.update(name="one"), "two.yaml")
    written(tmp_path, lambda data: data.update(name="", doc=""), "three.yaml")
    with pytest.raises(ConfigError) as caught:
        load_all(["one.yaml", "two.yaml", "three.yaml", "loihi2"], tmp_path)
    again, no_name, no_doc, unknown = map(str, caught.value.faults)
    assert "two.yaml: another profile has the name 'one' too" in again
    assert "three.yaml:1: name must not be empty" in no_name
    assert "three.yaml:4: doc must not be empty" in no_doc
    assert "loihi2: no such hardware profile; known: " in unknown


def test_readers_see_the_label_of_the_copy_or_of_the_package_or_the_name(tmp_path):
    assert pricing.label_of(tmp_path, "mcu_m4") == "Cortex-M4"
    text = load("mcu_m4").text.replace("label: Cortex-M4", "label: M4")
    (tmp_path / "hardware").mkdir()
    (tmp_path / "hardware" / "mcu_m4.yaml").write_text(text)
    assert pricing.label_of(tmp_path, "mcu_m4") == "M4"
    (tmp_path / "hardware" / "mcu_m4.yaml").write_text(text.replace("label: M4\n", ""))
    assert pricing.label_of(tmp_path, "mcu_m4") == "Cortex-M4"
    assert pricing.label_of(tmp_path, "mine") == "mine"
