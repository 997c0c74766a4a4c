"""The folder of the pages' sources: templates, scripts, styles and page definitions."""

from __future__ import annotations

from pathlib import Path

from dse.config.locate import shipped_folder


def sources() -> Path:
    """Return the folder of the page's sources: inside the installed package, or beside it in a clone."""
    return shipped_folder("dashboards")
