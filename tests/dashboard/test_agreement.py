"""The page and the command line on the shipped study: the same picks, and the same nearest designs."""

import json
import shlex
from pathlib import Path

from dse.cli import main

EXAMPLE = Path(__file__).resolve().parent.parent.parent / "results" / "example"
CHIPS = ("mcu_m4", "xylo_imu", "loihi1_silicon", "spinnaker2")
BUDGETS = (
    "task=texture&hardware=mcu_m4",
    "task=texture&hardware=mcu_m4&b.energy_uj=200&b.n_weights=5000",
    "task=profile&hardware=loihi1_silicon&b.spikes_per_inference=3800",
    "task=texture&hardware=spinnaker2&b.accuracy=0.9&b.energy_uj=100",
    "task=texture&hardware=mcu_m4&family=mlp&b.n_weights=200",
    "task=texture&hardware=mcu_m4&b.accuracy=0.99&b.n_weights=100",
    "task=texture&hardware=xylo_imu&b.energy_uj=10",
    "task=texture&hardware=xylo_imu&oversize=1&b.energy_uj=10",
)

FOUND = """async (fragments) => {
  const { columns, ...page } = await Data.read();
  const engine = Budgets.over({ columns, ...page });
  const named = (row) => ["trial", "point", "hardware"].map((name) => columns[name].values[row]);
  return fragments.map((fragment) => {
    const found = engine.evaluate(Object.fromEntries(new URLSearchParams(fragment)));
    const nearest = found.nearest.map(({ row }) => named(row));
    return { ...found, pick: found.pick < 0 ? null : named(found.pick), nearest };
  });
}"""


def test_eight_budgets(shown, page_path, capsys, monkeypatch):
    monkeypatch.chdir(EXAMPLE.parent)
    chips = [word for chip in CHIPS for word in ("--hardware", chip)]
    assert main(["dashboard", "example", *chips, "--html", str(page_path)]) == 0
    capsys.readouterr()
    feasible = []
    for fragment, found in zip(BUDGETS, shown().tab.evaluate(FOUND, list(BUDGETS)), strict=True):
        words = shlex.split(found["command"])
        assert words[0] == "dse" and words[-2:] == ["--export", "bundle"]
        code = main([*words[1:-2], "--json"])
        rows = json.loads(capsys.readouterr().out)["rows"]
        named = [[row["trial"], row["point"], row["hardware"]] for row in rows]
        assert (code == 0) == (found["pick"] is not None) == (found["count"] > 0), fragment
        if code == 0:
            assert found["pick"] == named[0], fragment
        else:
            assert code == 3
            assert found["nearest"] == named[:3], fragment
        feasible.append(code == 0)
    assert 3 <= sum(feasible) <= 6
