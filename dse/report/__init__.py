"""`dse report`: published results of other systems beside the measurements of our studies.

Each file of `systems/` turns the measurements of a task into rows for one published system; to add a system,
add a file there and its published numbers to `published.yaml`. Designs are selected on validation; test
accuracy is printed beside. Further rows compare model families, and chips.

`paper_report` sets every number of one paper beside ours, from the files of `tables/`; `write_paper` makes a
folder of it, with figures.
"""

from dse.report.compare import PaperReport, PaperRow, SetupError, key_of, paper_report
from dse.report.folder import write_paper
from dse.report.gather import Report, gather_marks, report
from dse.report.rows import FAMILIES, HARDWARE, Row

__all__ = [
    "FAMILIES",
    "HARDWARE",
    "PaperReport",
    "PaperRow",
    "Report",
    "Row",
    "SetupError",
    "gather_marks",
    "key_of",
    "paper_report",
    "report",
    "write_paper",
]
