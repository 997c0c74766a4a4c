"""`dse cost`: a workload file priced on hardware, as a document and as text; every mistake told at once."""

import json
import re
from pathlib import Path
from typing import get_args

import pytest
import yaml

import dse.measure.hardware
from dse.cli import main
from dse.measure.hardware.cost import cost
from dse.measure.hardware.profile import Evidence, load, names
from dse.measure.hardware.workload import load_inference
from tests.command import document

PROFILES = Path(dse.measure.hardware.__file__).parent / "profiles"
LOIHI = (PROFILES / "loihi1_silicon.yaml").read_text()
NET = "layers: [24, 50, 7]\nn_steps: 100\nmean_rate: [0.02, 0.02, 0]\nupdates: [50, 7]\n"
OPERATIONS = "macs: 12000\nadditions: 300\nn_weights: 5000\nduration_ms: 250\nnumber_bits: 8\n"


@pytest.fixture
def net(tmp_path):
    path = tmp_path / "net.yaml"
    path.write_text(NET)
    return path


def rows(capsys, *arguments):
    answer = document(capsys, "cost", *arguments)
    assert answer["schema"] == "dse/cost/1"
    return answer["rows"]


def faults(capsys, *arguments):
    assert main(["cost", *map(str, arguments)]) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    return shown.err.splitlines()


def own_profile(path, source="loihi1_silicon", **changes):
    """Write a profile like one of the package, with other keys."""
    data = yaml.safe_load((PROFILES / f"{source}.yaml").read_text()) | {"name": "mine"} | changes
    path.write_text(yaml.safe_dump(data, sort_keys=False))
    return path


def test_a_network_on_loihi(net, capsys):
    (row,) = rows(capsys, net)
    found = cost(load("loihi1_silicon"), load_inference(net).load)
    assert (row["hardware"], row["n_weights"], row["not_applicable"]) == ("loihi1_silicon", 1550, None)
    for name in ("energy_uj", "energy_throttled_uj", "step_time_us"):
        for end in ("", "_low", "_high"):
            assert row[name + end] == getattr(found, name).columns(name)[name + end]
    assert row["energy_static_uj"] == pytest.approx(found.static_uj.value)
    assert row["energy_static_throttled_uj"] == pytest.approx(104e-3 * 100e3)
    assert row["energy_static_throttled_uj_low"] == pytest.approx(29e-3 * 100e3)
    assert (row["n_cores"], row["n_cores_low"], row["n_cores_high"], row["fits"]) == (
        found.n_cores.value,
        found.n_cores.low,
        found.n_cores.high,
        True,
    )
    assert row["misfits"] == []
    assert row["hardware_latency_ms"] == pytest.approx(0.1 * row["step_time_us"])
    assert (row["decision_ms"], row["pipeline_ms"]) == (100, 2)
    assert row["latency_ms"] == pytest.approx(100 + 2 + row["step_time_us"] * 1e-3)
    assert row["evidence"] == [word for word in get_args(Evidence) if f"evidence: {word}," in LOIHI]


def test_a_network_in_print(tmp_path, capsys):
    path = tmp_path / "w.yaml"
    path.write_text("layers: [6084, 425, 12]\nn_steps: 1\nmean_rate: [0, 0, 0]\n")
    (row,) = rows(capsys, path)
    assert row["n_weights"] == 2_590_800
    assert row["fits"] is False
    (misfit,) = row["misfits"]
    assert set(misfit) == {"rule", "text", "change"}
    assert "6084 input axons" in misfit["text"]
    assert main(["cost", str(path)]) == 0
    shown = capsys.readouterr().out
    assert "  does not fit:\n" in shown and "6084 input axons" in shown


@pytest.mark.parametrize("content", [NET, OPERATIONS], ids=["network", "operations"])
def test_every_profile_has_a_row_of_the_same_columns(tmp_path, capsys, content):
    path = tmp_path / "w.yaml"
    path.write_text(content)
    chosen = [text for name in names() for text in ("--hardware", name)]
    found = rows(capsys, path, *chosen, "--contacts-per-hour", 60, "--battery-mwh", 100, "--draws", 5)
    assert [row["hardware"] for row in found] == names()
    always = set.intersection(*map(set, found))
    assert all(name.startswith("energy_") for row in found for name in set(row) - always)
    for row in found:
        if row["not_applicable"]:
            assert row["energy_uj_low"] is row["n_cores"] is row["power_mw_low"] is None
        else:
            assert 0 <= row["energy_uj_low"] <= row["energy_uj_q05"] <= row["energy_uj_q95"] * (1 + 1e-9)
            assert row["energy_uj_q95"] <= row["energy_uj_high"] * (1 + 1e-9)
            known = {
                row[name] is not None for name in ("power_mw_low", "n_cores_low", "latency_ms_low", "fits")
            }
            assert len(known) == 1


def test_what_a_chip_cannot_run_is_said(tmp_path, capsys):
    path = tmp_path / "w.yaml"
    path.write_text(OPERATIONS)
    assert (
        main(["cost", str(path), "--hardware", "loihi1_silicon", "--hardware", "op_4.6_0.9", "--json"]) == 0
    )
    answer = json.loads(capsys.readouterr().out)
    chip, counted = answer["rows"]
    assert chip["not_applicable"] == "loihi1_silicon runs only networks of spiking layers"
    assert chip["energy_uj"] is chip["fits"] is chip["misfits"] is None
    assert counted["energy_uj"] == pytest.approx(12000 * 4.6e-6 + 300 * 0.9e-6)
    assert (
        counted["n_cores"] is counted["latency_ms"] is counted["fits"] is counted["energy_static_uj"] is None
    )
    assert answer["notes"] == [
        "loihi1_silicon: not applicable, loihi1_silicon runs only networks of spiking layers",
        "op_4.6_0.9: dynamic energy only; the profile has no static power, time, cores or limits",
    ]


def test_a_profile_of_intervals_gives_no_value(net, tmp_path, capsys):
    chip = own_profile(tmp_path / "chip.yaml", interval_only=True)
    (row,) = rows(
        capsys, net, "--hardware", chip, "--contacts-per-hour", 1, "--battery-mwh", 9, "--draws", 20
    )
    (known,) = rows(capsys, net, "--contacts-per-hour", 1, "--battery-mwh", 9, "--draws", 20)
    assert row["hardware"] == "mine"
    assert row["n_cores"] is None
    for name in ("energy_uj", "energy_dynamic_uj", "energy_spike_uj", "latency_ms", "power_mw", "battery_h"):
        assert row[name] is None
        assert (row[f"{name}_low"], row[f"{name}_high"]) == (known[f"{name}_low"], known[f"{name}_high"])
    assert row["energy_uj_q50"] is None
    assert row["energy_uj_low"] < row["energy_uj_q05"] < row["energy_uj_q95"] < row["energy_uj_high"]
    assert main(["cost", str(net), "--hardware", str(chip)]) == 0
    assert "mine: no numbers are published, so costs are intervals" in capsys.readouterr().out


def test_a_battery_that_nothing_draws_from(net, tmp_path, capsys):
    still = {"value": 0, "low": 0, "high": 0, "unit": "mW", "evidence": "assumption", "source": "none"}
    chip = own_profile(tmp_path / "chip.yaml", static_mw=still)
    arguments = ["cost", str(net), "--hardware", str(chip), "--contacts-per-hour", "0", "--battery-mwh", "5"]
    answer = document(capsys, *arguments)
    assert (answer["rows"][0]["power_mw"], answer["rows"][0]["battery_h"]) == (0, None)
    assert answer["notes"] == ["mine: draws no power, so a battery lasts for ever (null in JSON)"]


def test_draws_of_counts_of_each_step_are_those_of_the_whole(tmp_path, capsys):
    path = tmp_path / "w.yaml"
    n_steps = 3000  # more draws times steps than are priced together
    found = []
    for spikes in ([1] * n_steps, 1):
        content = {"layers": [3, 4], "n_steps": n_steps, "spikes": [spikes, 0], "updates": [4]}
        path.write_text(yaml.safe_dump(content))
        found += rows(capsys, path, "--draws", 1000)
    each, mean = found
    for name in ("energy_uj_q05", "energy_uj_q50", "energy_throttled_uj_q95"):
        assert each[name] == pytest.approx(mean[name], rel=1e-12)


def test_text_has_a_table_for_each_hardware(net, capsys):
    assert main(["cost", str(net), "--hardware", "loihi1_silicon", "--hardware", "op_4.6_0.9"]) == 0
    head, loihi, counted = capsys.readouterr().out.split("\n\n")[:3]
    assert head == "24-50-7, W_t 1550 weights of 8 bits, 100 steps of 1 ms, mean counts"
    lines = loihi.splitlines()
    assert lines[0].startswith("loihi1_silicon: Intel Loihi 1")
    assert lines[1].split() == ["value", "low", "high"]
    cells = {" ".join(line.split()[:-4]): line.split()[-4:] for line in lines if " uJ " in line}
    assert cells["neuron access"] == ["uJ", "0.2918", "0.2481", "0.3356"]
    assert cells["dynamic"][1] == "0.5484"
    assert "  fits" in lines
    fitted = LOIHI.count("evidence: fitted,")
    assert fitted > 0
    assert re.search(rf"^  evidence: .*\b{fitted} fitted, ", lines[-1])
    assert "evidence: 2 convention" in counted
    assert "cores" not in counted


def test_every_mistake_at_once(net, tmp_path, capsys):
    net.write_text("layers: [24, 50]\nn_steps: -1\nmean_rate: [2, 0]\n")
    upside_down = own_profile(tmp_path / "chip.yaml")
    upside_down.write_text(upside_down.read_text().replace("low: 58.905", "low: 580"))
    found = faults(capsys, net, "--hardware", "loihi1", "--hardware", upside_down, "--battery-mwh", 1)
    assert found[0].startswith("--battery-mwh: needs --contacts-per-hour")
    assert found[1] == f"{net}:2: n_steps must be in [0, 1000000000], got -1"
    assert found[2] == f"{net}:3: mean_rate[0] must be in [0, 1], got 2.0"
    assert found[3].startswith("loihi1: no such hardware profile; known: ")
    assert "spike_pj must be 0 <= low <= value <= high, got [580, 69.3, 79.695]" in found[4]
    assert len(found) == 5


@pytest.mark.parametrize(
    ("arguments", "fault"),
    [
        (
            ["--contacts-per-hour", "36001"],
            "--contacts-per-hour: contacts must not overlap: 36000 of 100 ms each fit into an hour, "
            "got 36001 (on loihi1_silicon)",
        ),
        (
            ["--hardware", "op_4.6_0.9", "--hardware", "op_4.6_0.9"],
            "op_4.6_0.9: another profile has the name 'op_4.6_0.9' too",
        ),
    ],
)
def test_one_mistake_is_one_line(net, capsys, arguments, fault):
    assert faults(capsys, net, *arguments) == [fault]


def test_static_energy_is_that_of_the_chip_and_that_of_the_cores_in_use(net, capsys):
    chip, other = rows(capsys, net, "--hardware", "loihi1_silicon", "--hardware", "odin")
    for name in ("static", "static_throttled"):
        for end in ("", "_low", "_high"):
            whole, share = chip[f"energy_{name}_uj{end}"], chip[f"energy_{name}_share_uj{end}"]
            assert share == pytest.approx(whole * 2 / 128)  # a core per layer, of 128
            assert other[f"energy_{name}_share_uj{end}"] is None, "one core is the whole chip"
