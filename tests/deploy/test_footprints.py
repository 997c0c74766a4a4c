"""Memory and cycles of design points on targets, before they are exported."""

import pytest

from dse.cli import main
from dse.config import ConfigError, load_space
from dse.deploy.bundle import read
from dse.deploy.c import code_size
from dse.deploy.c.counting import code_of
from dse.deploy.export import bundle_of
from dse.deploy.footprints import on_targets
from dse.deploy.targets.c99 import C99
from dse.study import pricing
from tests import tiny_study
from tests.command import document
from tests.deploy.bundles import explored


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    text = tiny_study.REAL.replace("repeats: 2", "repeats: 1").replace("epochs: 4", "epochs: 1")
    text = text.replace("n_steps: 16", "n_steps: 3").replace("[0.4, 0.6]", "[0.6]")  # fewer points
    model = "model: {kind: snn, hidden: [12], input_delays: [0, 2]}\n"
    axis = "model: {kind: snn, hidden: {choice: [[4], [40]]}, arithmetic: {choice: [integer, ideal]}}\n"
    assert model in text
    text = f"{text.replace(model, axis)}targets: [c99]\n"
    return explored(tmp_path_factory.mktemp("footprints"), text)


@pytest.fixture(scope="module")
def on_c99(study):
    return on_targets(study, study.points(), ["c99"])


def test_footprints_are_those_of_every_point(study, on_c99):
    on, notes = on_c99
    assert len(on) == (study.points()["model.arithmetic"] == "integer").sum() and set(on["target"]) == {"c99"}
    assert notes and all("target c99 cannot hold" in note for note in notes)
    for _, row in on.groupby("trial").head(3).iterrows():  # decided early at several phi, and read out
        footprint = C99().footprint(bundle_of(study, {str(k): x for k, x in row.items()}))
        assert {name: row[name] for name in footprint} == footprint


def test_a_target_without_footprints_changes_no_point(study):
    points = study.points()
    assert on_targets(study, points, ["nir"])[0] is points


def test_a_budget_in_bytes_picks_a_smaller_net(study, on_c99, tmp_path, capsys):
    least, most = on_c99[0]["ram_bytes"].min(), on_c99[0]["ram_bytes"].max()
    assert least < most
    out, budget = str(tmp_path / "bundle"), ["--budget", f"ram_bytes <= {least}"]
    for extra in (["--target", "c99"], ["--export", out]):  # the search space names the same
        picked = document(capsys, "pick", study.folder, *budget, *extra)
        [row] = picked["rows"]
        assert (row["ram_bytes"], row["target"]) == (least, "c99")
    [verdict] = picked["sections"]["targets"]["rows"]
    assert (verdict["target"], verdict["verdict"]) == ("c99", "not verified")
    assert read(out).record["ram_bytes"] == least
    assert main(["pick", str(study.folder), "--budget", f"ram_bytes <= {least - 1}", "--json"]) == 3


def test_a_budget_in_cycles_picks_by_the_prediction_of_the_core(study, tmp_path, capsys):
    on, _ = on_targets(study, study.points(), ["cortex_m4"])
    on_chip = pricing.points(study.folder, ["mcu_m4"])
    on_chip = on_chip[on_chip["model.arithmetic"] == "integer"]
    assert on["cycles"].tolist() == pytest.approx((on_chip["hardware_latency_ms"] * 120e3).tolist())
    least = on["cycles"].min()
    budget = ["--budget", f"cycles <= {least * (1 + 1e-9)}"]
    pick = "pick", study.folder
    [row] = document(capsys, *pick, *budget, "--target", "cortex_m4")["rows"]
    assert row["cycles"] == pytest.approx(least)
    # No profile stands for a RISC-V core: it has no prediction, so it meets no budget in cycles.
    document(capsys, *pick, *budget, "--target", "riscv32", code=3)
    export = "--export", tmp_path / "bundle"
    [row] = document(capsys, *pick, "--target", "riscv32", *export)["rows"]
    assert row["cycles"] is None and row["ram_bytes"] > 0
    assert "cycles" not in read(tmp_path / "bundle").record


def test_cycles_and_flash_are_of_the_compiler_of_the_profile_that_is_asked(study, tmp_path, capsys):
    asked = ["mcu_m4", "mcu_m4_gcc", "mcu_m33_gcc"]
    points = pricing.points(study.folder, asked)
    on, _ = on_targets(study, points, ["cortex_m4"], asked)
    of = {name: rows.reset_index(drop=True) for name, rows in on.groupby("hardware")}
    own = points[(points["hardware"] == "mcu_m4_gcc") & (points["model.arithmetic"] == "integer")]
    assert of["mcu_m4_gcc"]["cycles"].tolist() == pytest.approx((own["hardware_latency_ms"] * 120e3).tolist())
    code = code_of(bundle_of(study, {str(k): x for k, x in of["mcu_m4_gcc"].iloc[0].items()}))
    for name, compiler in (("mcu_m4", "clang"), ("mcu_m4_gcc", "gcc")):
        assert of[name]["flash_bytes"][0] == code_size.flash_bytes(code, code_size.CORTEX_M[compiler])
    # Another core says nothing of this one.
    same = ["cycles", "flash_bytes", "ram_bytes"]
    assert of["mcu_m33_gcc"][same].equals(of["mcu_m4"][same])
    waits = '{value: 2, low: 2, high: 2, unit: "1", evidence: measured, source: "a stopwatch"}'
    (file := tmp_path / "mine.yaml").write_text(
        f"name: mine\nlike: mcu_m4_gcc\ndoc: mine\nwait_factor: {waits}\n"
    )
    pick = "pick", study.folder, "--budget", "trial == 0", "--target", "cortex_m4", "--hardware"
    [row], [usual] = (document(capsys, *pick, name)["rows"] for name in (file, "mcu_m4_gcc"))
    assert row["cycles"] == pytest.approx(2 * usual["cycles"])
    assert row["flash_bytes"] == usual["flash_bytes"]


def test_a_profile_for_an_unknown_target_is_refused(study, tmp_path, capsys):
    (file := tmp_path / "mine.yaml").write_text("name: mine\nlike: mcu_m4\ndoc: mine\ntarget: cortex_m5\n")
    assert main(["pick", str(study.folder), "--target", "cortex_m4", "--hardware", str(file)]) == 2
    error = capsys.readouterr().err
    assert "'mine'" in error and "'cortex_m5'" in error and "Did you mean 'cortex_m" in error


def test_a_gate_array_of_ones_own_says_what_its_target_takes(study, tmp_path):
    own = '{value: 650, low: 650, high: 650, unit: "1", evidence: measured, source: "counted"}'
    (file := tmp_path / "mine.yaml").write_text(
        f"name: mine\nlike: ice40_up5k\ndoc: mine\ncircuit_cells: {own}\n"
    )
    cells = []
    for name in ("ice40_up5k", str(file)):
        points = pricing.points(study.folder, [name])
        cells.append(on_targets(study, points, ["ice40"], [name])[0]["cells"])
    assert set(cells[1] - cells[0]) == {100}  # of a circuit the shipped profile says 550


def test_a_gate_array_is_chosen_by_cycles_and_blocks_before_it_is_synthesised(study):
    on, notes = on_targets(study, study.points(), ["ice40"])
    assert all("integer arithmetic" in note for note in notes)
    on_chip = pricing.points(study.folder, ["ice40_up5k"])
    on_chip = on_chip[on_chip["model.arithmetic"] == "integer"]
    assert on["cycles"].tolist() == pytest.approx((on_chip["hardware_latency_ms"] * 12e3).tolist())
    # A longer input costs more; no step takes more than one in which everything spikes.
    steps = on["decision_latency_ms"] / on["decision_latency_ms"].min()
    assert (on["cycles"] > 0).all() and on["cycles"].corr(steps) > 0
    assert set(on["memory_blocks"]) <= set(range(5, 31)) and (on["cells"] > 300).all()
    assert on_chip["fits"].all() and (on_chip["energy_uj_low"] < on_chip["energy_uj_high"]).all()


def test_targets_of_a_search_space_are_known(tmp_path):
    tiny_study.write_recordings(tmp_path / "tiny.npz")
    path = tmp_path / "real.yaml"
    path.write_text(f"{tiny_study.REAL}targets: [c99, nir]\n")
    space = load_space(path)
    assert space.targets == ("c99", "nir") and space.to_plain()["targets"] == ["c99", "nir"]
    path.write_text(tiny_study.REAL)
    assert "targets" not in load_space(path).to_plain()
    path.write_text(f"{tiny_study.REAL}targets: [c98, c99, c99]\n")
    with pytest.raises(ConfigError) as caught:
        load_space(path)
    first, second = str(caught.value).splitlines()
    assert "unknown target 'c98'" in first and "Did you mean 'c99'?" in first
    assert "target 'c99' is named twice" in second
