"""Whether plugins of this repository are installed: tests of what they hold are skipped without them."""

import importlib.metadata

import pytest

from dse.base import registry

PAPERS = any(
    entry.dist is not None and entry.dist.name == "dse-papers"
    for entry in importlib.metadata.entry_points(group=registry.ENTRY_POINTS)
)
needs_papers = pytest.mark.skipif(not PAPERS, reason="the plugin dse-papers is not installed")
