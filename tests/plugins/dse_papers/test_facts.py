"""What shipped search spaces hold, against the set-ups that the papers print."""

from collections.abc import Mapping

import pytest
import yaml

from dse.config import load_space, shipped_spaces
from dse.study.results import Study
from dse_papers.report.compare import paper_report
from tests.show.report.made import write

GRID = {"task.target": "texture", "model.hidden": 425, "model.true_rate": 0.9}
LENGTH = {"window.n_steps": 5000, "model.hidden": 450}
_HOTS = {
    **{"layers": 1, "clustering": "online", "radius": 2, "prototypes": 8, "prototypes_factor": 1},
    **{"tau_ms": 0.02, "filter_radius": 1, "filter_neighbours": 10, "filter_ms": 10.0},
}
LAYERS = {"model.kind": "hots", **{f"model.hots.{key}": value for key, value in _HOTS.items()}}


def study_of(folder, space, design, samples):
    """Write a study of one design of a shipped search space."""
    loaded = load_space(shipped_spaces()[space])
    sections = loaded.resolve(design)
    columns = sections.data.read(folder).columns
    classes = sorted(set(map(str, columns[sections.task.target])))
    plain = yaml.safe_load(yaml.safe_dump(_lists(sections.to_plain())))
    made = {"family": sections.kinds["model"], "task": "texture", "accuracy": 0.5}
    length = {"decision_latency_ms": float(design.get("window.n_steps", 1000))}
    counts = dict(zip(("train", "validation", "test"), samples, strict=True))
    study = write(folder / space, [{**made, **length}], plain, classes=classes, samples=counts)
    (study.folder / "search_space.yaml").write_text(loaded.to_yaml(), encoding="utf-8")
    return Study(study.folder)


def _lists(value):
    if isinstance(value, Mapping):
        return {key: _lists(x) for key, x in value.items()}
    return [_lists(x) for x in value] if isinstance(value, list | tuple) else value


@pytest.mark.parametrize(
    ("paper", "space", "design", "samples", "others"),
    [
        # 84 mm at 17.5 to 60 mm/s last 1.5 to 4.8 s
        ("002", "texture_profile_grid", GRID, (6912, 4608, 2880), {"raw length of a sample"}),
        # one length of the eleven
        ("000", "realtime_texture", LENGTH, (1485, 165, 550), {"sample lengths"}),
        ("001", "artificial_pins", LAYERS, (792, 88, 220), {"τ of the first layer"}),
    ],
)
def test_shipped_spaces_are_set_up_as_printed(tmp_path, paper, space, design, samples, others):
    rows = paper_report([study_of(tmp_path, space, design, samples)], paper).rows
    differing = {
        row.quantity.split(",")[0]: row.differs for row in rows if row.kind == "set-up" and row.setup
    }
    assert set(differing) == others, differing
    alike = [row for row in rows if row.kind == "set-up" and row.ours]
    assert len(alike) > 15
