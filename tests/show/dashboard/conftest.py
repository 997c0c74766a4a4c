"""Pages in a browser: written once for each content, opened by each test that looks at them."""

import base64
import gzip
import json

import pytest

from dse.show.dashboard.gather import gather_page
from dse.show.dashboard.write import write_filled
from tests.page_data import OBJECTIVES
from tests.show.dashboard.designs import details, table
from tests.show.dashboard.page import Page


@pytest.fixture
def shown(new_tab, page_path):
    """Return a function that opens what was written to `page_path`; the browser may complain of no page."""
    pages = []

    def show(fragment="", *, size=(1280, 720), scheme="light"):
        if pages:
            pages[0].tab.set_viewport_size({"width": size[0], "height": size[1]})
        tab = pages[0].tab if pages else new_tab(size, scheme)
        pages.append(Page(tab, page_path))
        return pages[-1].open(fragment)

    yield show
    assert [fault for page in pages for fault in page.faults] == []


@pytest.fixture(scope="module")
def written():
    """The pages of a module by what they are of."""
    return {}


@pytest.fixture
def opened(shown, page_path, written):
    """Return a function that writes a page and opens it: of some designs with documents, or of a table.

    documents: details by trial. parts: what the page holds beside. forest: whether importances are computed,
    which takes longer than a browser. Others are options of `gather_page`.
    """

    def open_page(
        frame=None,
        fragment="",
        *,
        documents=None,
        parts=None,
        forest=False,
        size=(1280, 720),
        scheme="light",
        **options,
    ):
        if documents is None:
            documents = {0: details(0), 1: details(1)} if frame is None else {}
        frame = table() if frame is None else frame
        options = {"name": "fabric", "objectives": OBJECTIVES, "results": "results/fabric"} | options
        key = json.dumps([frame.to_csv(), documents, parts, forest, str(options)])
        if key not in written:
            with pytest.MonkeyPatch.context() as patch:
                if not forest:
                    patch.setattr("dse.show.dashboard.gather.gather_importance", lambda *_: [])
                page = gather_page(frame, **options) | (parts or {})
            packed = {
                str(trial): base64.b64encode(gzip.compress(json.dumps(document).encode())).decode()
                for trial, document in documents.items()
            }
            write_filled("page", page | {"details": packed}, page_path)
            written[key] = page_path.read_bytes()
        page_path.write_bytes(written[key])
        return shown(fragment, size=size, scheme=scheme)

    return open_page
