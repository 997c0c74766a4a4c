"""What could pass for skill in every shipped search space: `dse audit` over all of them, one line per task.

Columns: the best reader of counts over time, beside chance; the spike total; the worst reader of windows that
are moved, without twins, and of unseen groups; and the probes that have found a shortcut.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
from rich.console import Console
from rich.table import Table

from dse.config import ConfigError, load_space
from dse.config.locate import shipped_spaces
from dse.data.dataset import cache
from dse.data.recordings import RecordingError
from dse.study.audit import AuditRow, audit, record

COLUMNS = ("chance", "counts", "total", "moved", "no twins", "unseen", "shortcuts")


def main() -> None:
    """Audit, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("spaces", nargs="*", help="names of shipped search spaces (default: all)")
    parser.add_argument("--csv", type=Path, help="file for every row of every audit")
    arguments = parser.parse_args()
    table = Table("search space", "task", *COLUMNS, "s", title="Audit of the shipped search spaces")
    rows: list[dict[str, object]] = []
    root = cache.usual_root()
    cache.tidy(root)
    for name in arguments.spaces or shipped_spaces():
        began = time.process_time()
        try:
            space = load_space(name, check_data=True)
            result = audit(space, root)
        except (ConfigError, RecordingError) as error:
            table.add_row(name, "", *["-"] * (len(COLUMNS) - 1), str(error).splitlines()[0], "")
            continue
        record.save(result, space, root)
        took = time.process_time() - began
        for task in dict.fromkeys(row.task for row in result.rows):
            of_task = [row for row in result.rows if row.task == task]
            table.add_row(name, task, *line(of_task), f"{took:.0f}")
            rows += [{"space": name, **row.columns} for row in of_task]
        print(f"{name}: {took:.0f} s of CPU time", file=sys.stderr)
    Console(width=180).print(table)
    if arguments.csv is not None:
        pd.DataFrame(rows).to_csv(arguments.csv, index=False)


def line(rows: Sequence[AuditRow]) -> list[str]:
    """Return the cells of one task."""
    accuracies = [row.accuracy for row in rows if row.probe == "counts over time"]
    totals = [row.accuracy for row in rows if row.probe == "spike total"]
    withouts = [
        [row.without for row in rows if row.probe.startswith(start) and row.without is not None]
        for start in ("position", "twins", ("unseen", "identity"))
    ]
    numbers = [rows[0].chance, max(accuracies), max(totals), *(min(x, default=None) for x in withouts)]
    shortcuts = dict.fromkeys(row.probe for row in rows if row.shortcut)
    return ["-" if x is None else f"{x:.3f}" for x in numbers] + [", ".join(shortcuts) or "none"]


if __name__ == "__main__":
    main()
