"""Where the pages' own sources lie: templates, scripts, styles and page definitions."""

from __future__ import annotations

from pathlib import Path


def sources() -> Path:
    """Return the folder of the page's sources: inside the installed package, or beside it in a clone."""
    package = Path(__file__).resolve().parent.parent
    installed = package / "_dashboards"
    return installed if installed.is_dir() else package.parent / "dashboards"
