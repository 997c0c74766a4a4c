from benchmarks.audits import COLUMNS, line
from dse.audit import probe
from tests.audit import planted


def test_a_line_holds_the_worst_of_moved_windows_and_unseen_groups():
    rows, _ = probe(planted.by_group(0))
    cells = line(rows)
    assert len(cells) == len(COLUMNS)
    unseen = [row.without for row in rows if row.probe.startswith("unseen")]
    assert cells[0] == "0.333" and cells[5] == f"{min(unseen):.3f}" and "unseen force" in cells[-1]
