"""The documentation: every block runs, shows what it prints; every link leads somewhere; the site is built.

`WRITE_DOCS=1 pytest tests/docs` writes the outputs and the reference anew.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from dse.base import registry
from dse.cli.handbook import markdown
from tests.docs import pages
from tests.installed import needs_papers

ROOT = Path(__file__).resolve().parent.parent.parent
DOCS = ROOT / "docs"
DOCUMENTS = sorted(path for path in DOCS.glob("*.md") if path.name != "reference.md")


def write_or_compare(path, text):
    if os.environ.get("WRITE_DOCS"):
        path.write_text(text, encoding="utf-8")
    assert pages.masked(path.read_text(encoding="utf-8")) == pages.masked(text), (
        f"{path}: WRITE_DOCS=1 pytest tests/docs"
    )


@pytest.fixture(autouse=True)
def no_component_stays():
    """Components that a page registers are gone after it."""
    components = registry._outside()
    yield
    registry._replace(components)


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.stem)
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_every_block_runs_and_prints_what_is_shown(path, tmp_path, monkeypatch):
    shutil.copytree(ROOT / "results" / "example", tmp_path / "results" / "example")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    write_or_compare(path, pages.performed(path.read_text(encoding="utf-8"), pages.syntax))


@needs_papers
def test_the_reference_is_what_the_code_declares():
    write_or_compare(DOCS / "reference.md", markdown())


def test_every_page_is_in_the_menu_and_every_link_leads_somewhere():
    menu = re.findall(
        r"[\w/]+\.md", str(yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"])
    )
    elsewhere = [f"notebooks/{path.stem}.md" for path in DOCS.glob("notebooks/*.ipynb")]  # as_pages.py
    elsewhere += ["results/README.md", "results/measurements.md"]
    assert sorted(menu) == sorted([*elsewhere, *(path.name for path in DOCS.glob("*.md"))])
    for path in [*DOCUMENTS, ROOT / "CONTRIBUTING.md", ROOT / "README.md"]:
        links = re.findall(r"\]\((?!https?://|#)([^)#]+)", path.read_text(encoding="utf-8"))
        assert [link for link in links if not (path.parent / link).exists()] == [], path


def test_the_site_is_built_without_a_warning(tmp_path):
    pytest.importorskip("material")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path)]
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    assert (tmp_path / "tutorial" / "index.html").is_file()
    notebook = (tmp_path / "notebooks" / "reading_a_front" / "index.html").read_text(encoding="utf-8")
    assert "front_probability</th>" in notebook and 'src="data:image/png;base64,' in notebook
    assert 'src="../results/page.png"' in (tmp_path / "gallery" / "index.html").read_text(encoding="utf-8")
    assert 'href="../gallery/"' in (tmp_path / "results" / "index.html").read_text(encoding="utf-8")
