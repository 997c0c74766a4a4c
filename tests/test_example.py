"""The shipped study, results/example, is that of its search space; docs/tutorial.md reads it.

If a format changes: make it anew, as CONTRIBUTING says.
"""

from pathlib import Path

import dse

ROOT = Path(__file__).resolve().parent.parent
EXAMPLE = ROOT / "results" / "example"
MOST_BYTES = 5_600_000


def test_it_is_small():
    sizes = [
        path.stat().st_size for path in EXAMPLE.rglob("*") if path.is_file() and path.name != "page.html"
    ]
    assert 100_000 < sum(sizes) <= MOST_BYTES


def test_it_is_the_study_of_its_search_space():
    study = dse.open(EXAMPLE)
    trials = study.trials
    assert set(trials["status"]) == {"finished"}
    assert len(trials) == dse.load_space("example", {}).n_designs
    points = study.points()
    assert set(points["hardware"]) == {"mcu_m4", "loihi1_silicon", "spinnaker2"}
