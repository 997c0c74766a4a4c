"""The tables of results/README.md follow from the folders of the papers, and these from today's format."""

from pathlib import Path

import pandas as pd

import dse
from benchmarks.papers import RESULTS, SPACES, tables
from dse.config.locate import shipped_spaces
from dse_papers.report.papers import publications

MOST_BYTES = 9_000_000
FOLDERS = sorted(RESULTS.glob("0*"))


def test_readme_has_the_tables_of_the_folders():
    text = (RESULTS / "README.md").read_text()
    lines = tables(RESULTS)
    assert len(lines) > 2 and "\n".join(lines) in text


def test_every_paper_has_spaces_and_every_folder_is_of_a_paper():
    assert set(SPACES) == set(publications())
    names = {f"{key}_{paper.name}" for key, paper in publications().items()}
    assert FOLDERS and {folder.name for folder in FOLDERS} <= names
    assert {space for spaces in SPACES.values() for space in spaces} <= set(shipped_spaces())


def test_a_folder_holds_what_its_text_names():
    for folder in FOLDERS:
        text = (folder / "README.md").read_text()
        images = {path.name for path in folder.glob("*.png")}
        assert images and all(f"]({name})" in text for name in images)
        compared = pd.read_csv(folder / "compared.csv")
        assert set(compared["kind"]) >= {"result", "set-up"}
        for study in filter(Path.is_dir, folder.iterdir()):
            assert set(dse.open(study).points()["trial"]), study


def test_the_folders_are_small():
    sizes = [path.stat().st_size for folder in FOLDERS for path in folder.rglob("*") if path.is_file()]
    assert sum(sizes) <= MOST_BYTES
