"""The folders of the papers in results/: audits and runs the search spaces of a paper, then compares.

`python -m benchmarks.papers 004` writes results/004_elm_receptors anew, and runs only what the folder of
studies lacks; `--table` prints the table of results/README.md from the folders.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import pandas as pd

from dse.cli import main as dse
from dse_papers.report.papers import publication

RESULTS = Path(__file__).resolve().parent.parent / "results"
SPACES = {
    "000": ("realtime_texture_small",),
    "001": ("artificial_pins_small", "natural_textures_small"),
    "002": (
        "texture_profile_contrasts",
        "texture_profile_contrasts_soft",
        "texture_profile_lags",
        "texture_profile_lags_soft",
        "texture_profile_quiet",
        "texture_profile_front",
    ),
    "003": ("threshold_icub",),
    "004": ("elm_sankar", "elm_sankar_printed_split", "elm_scene"),
}


def main() -> None:
    """Write the folders of some papers; stop at the first command that fails."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "papers", nargs="*", metavar="PAPER", help=f"any of {', '.join(SPACES)} (default: all)"
    )
    parser.add_argument("--studies", type=Path, default=RESULTS / "studies", help="folder of the studies")
    parser.add_argument("--table", action="store_true", help="print the table of the folders that there are")
    arguments = parser.parse_args()
    if arguments.table:
        print("\n".join(table(RESULTS)))
        return
    for key in arguments.papers or SPACES:
        folders = [str(arguments.studies / space) for space in SPACES[key]]
        for space in SPACES[key]:
            _run("audit", space, "--format", "csv")
            _run("run", space, "--results", str(arguments.studies), "--quiet", "--format", "csv")
        _run("report", *folders, "--paper", key, "--out", str(RESULTS / f"{key}_{publication(key).name}"))


def table(results: Path) -> list[str]:
    """Return the accuracies of the folders of papers beside the printed ones, as a table of Markdown."""
    lines = [
        "| paper | printed quantity | printed | ours | study | trained, h |",
        "|---|---|---|---|---|---|",
    ]
    for folder in sorted(results.glob("0*/compared.csv")):
        compared = pd.read_csv(folder, dtype={"printed": str, "ours": str}, keep_default_na=False)
        known = compared[(compared["kind"] == "result") & (compared["ours"] != "")]
        shares = known["quantity"].str.match("(peak )?accuracy(?! on)(?!.*,)")  # of all classes together
        for row in known[shares].itertuples():
            se = f" ± {float(row.se):.2g}" if row.se else ""
            where = f"[{folder.parent.name}]({folder.parent.name}/README.md)"
            about = ", ".join(filter(None, [row.quantity, row.condition, row.task]))
            hours = _hours(folder.parent / row.study / "trials.parquet")
            lines.append(
                f"| {where} | {about} | {row.printed or '-'} | {row.ours}{se} | {row.study} | {hours:.2g} |"
            )
    return lines


def _hours(trials: Path) -> float:
    """Return how long a study trained, on the clock."""
    rows = pd.read_parquet(trials, columns=["train_s", "repeats"])
    return float((rows["train_s"] * rows["repeats"]).sum() / 3600)


def _run(*command: str) -> None:
    print("dse", *command, file=sys.stderr)
    code = dse(command)
    if code not in (0, 3):  # 3: no honest design is left on the front, which a paper that leaks has
        sys.exit(code)


if __name__ == "__main__":
    main()
