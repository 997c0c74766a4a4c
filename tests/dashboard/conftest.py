"""A page of designs with their documents, in a browser."""

from __future__ import annotations

import base64
import gzip
import json

import pytest

from dse.dashboard.gather import gather_page
from dse.dashboard.write import write_filled
from tests.dashboard.designs import OBJECTIVES, details, table
from tests.dashboard.page import Page


@pytest.fixture
def shown(new_tab, page_path):
    """Return a function that opens what was written to `page_path`; the browser may complain of no page."""
    pages = []

    def show(fragment="", *, size=(1280, 720), scheme="light"):
        tab = pages[0].tab if pages else new_tab(size, scheme)
        pages.append(Page(tab, page_path))
        return pages[-1].open(fragment)

    yield show
    assert [fault for page in pages for fault in page.faults] == []


@pytest.fixture
def opened(shown, page_path):
    """Return a function that writes a page with details of trials and opens it."""

    def open_page(
        documents=None, fragment="", *, frame=None, name="fabric", scheme="light", size=(1280, 720)
    ):
        documents = {0: details(0), 1: details(1)} if documents is None else documents
        page = gather_page(table() if frame is None else frame, name=name, objectives=OBJECTIVES)
        packed = {
            str(trial): base64.b64encode(gzip.compress(json.dumps(document).encode())).decode()
            for trial, document in documents.items()
        }
        write_filled("page", page | {"details": packed}, page_path)
        return shown(fragment, size=size, scheme=scheme)

    return open_page
