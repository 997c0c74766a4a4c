"""The folders of the papers in results/: audits and runs the search spaces of a paper, then compares.

`python -m benchmarks.papers 004` writes results/004_elm_receptors anew, and runs only what the folder of
studies lacks; `--table` prints the tables of results/README.md from the folders.
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
    parser.add_argument("--table", action="store_true", help="print the tables of the folders that there are")
    arguments = parser.parse_args()
    if arguments.table:
        print("\n".join(tables(RESULTS)))
        return
    for key in arguments.papers or SPACES:
        folders = [str(arguments.studies / space) for space in SPACES[key]]
        for space in SPACES[key]:
            _run("audit", space, "--format", "csv")
            _run("run", space, "--results", str(arguments.studies), "--quiet", "--format", "csv")
        _run("report", *folders, "--paper", key, "--out", str(RESULTS / f"{key}_{publication(key).name}"))


def tables(results: Path) -> list[str]:
    """Return the accuracies of the folders of papers beside the printed ones, a table per paper."""
    lines = []
    for file in sorted(results.glob("0*/compared.csv")):
        folder = file.parent
        compared = pd.read_csv(file, dtype={"printed": str, "ours": str}, keep_default_na=False)
        known = compared[(compared["kind"] == "result") & (compared["ours"] != "")]
        shares = known["quantity"].str.match("(peak )?accuracy(?! on)(?!.*,)")  # of all classes together
        ours: dict[tuple[str, str], dict[str, str]] = {}
        for row in known[shares].itertuples():
            about = ", ".join(filter(None, [row.quantity, row.condition]))
            about += "" if row.task in about else f", {row.task}"
            se = f" ± {float(row.se):.3f}" if row.se else ""
            ours.setdefault((about, row.printed or "-"), {})[row.study] = f"{float(row.ours):.3f}{se}"
        studies = list(dict.fromkeys(study for of in ours.values() for study in of))
        heads = [f"{x} ({_hours(folder / x / 'trials.parquet'):.2g} h)" for x in studies]
        cells = [("quantity", "printed", *heads), ("---",) * (2 + len(studies))]
        cells += [(*key, *(of.get(study, "-") for study in studies)) for key, of in ours.items()]
        lines += [f"### [{folder.name}]({folder.name}/README.md)", ""]
        lines += [*(f"| {' | '.join(row)} |" for row in cells), ""]
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
