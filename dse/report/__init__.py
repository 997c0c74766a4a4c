"""`dse report`: what the published systems print beside what our studies measured.

Each file of `systems/` turns what studies found for a task into rows for one published system; to add a
system, add a file there and its printed figures to `published.yaml`. Designs are chosen on validation; test
accuracy is printed beside. What holds without papers follows: families against each other, and chips.
"""

from dse.report.gather import Report, gather_marks, report
from dse.report.rows import FAMILIES, HARDWARE, Row

__all__ = ["FAMILIES", "HARDWARE", "Report", "Row", "gather_marks", "report"]
