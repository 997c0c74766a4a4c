"""`dse report`: published results of other systems beside the measurements of our studies.

Each file of `systems/` turns the measurements of a task into rows for one published system; to add a system,
add a file there and its published numbers to `published.yaml`. Designs are selected on validation; test
accuracy is printed beside. Further rows compare model families, and chips.
"""

from dse.report.gather import Report, gather_marks, report
from dse.report.rows import FAMILIES, HARDWARE, Row

__all__ = ["FAMILIES", "HARDWARE", "Report", "Row", "gather_marks", "report"]
