"""The audit of a study on its page, in a real browser."""

from __future__ import annotations

import dataclasses
import json

import pytest

from dse.audit import AuditRow
from dse.dashboard.gather import gather_page
from dse.dashboard.write import write_filled
from tests.page_data import OBJECTIVES, points

EVIL = '<img src=x onerror="window.hacked=1">'
ROW = AuditRow(
    *("speed", "position in time", "nearest", 0.9, 0.0168, 0.17, 0.228, 0.0254, 322, True),
    *("96 % of the accuracy above chance is position", "window.jitter_steps"),
)
CLEAN = AuditRow(
    *("speed", "spike total", EVIL, 0.239, 0.0237, 0.17, None, None, 322, False, "explains 10 %", "")
)
LINES = "[...document.querySelectorAll('#audit tr')].map((line) => [...line.cells].map((c) => c.textContent))"


@pytest.fixture
def opened(shown, page_path):
    """Return a function that writes a page with an audit and opens it."""

    def open_page(audit):
        page = gather_page(points(), name="fabric", objectives=OBJECTIVES) | {"audit": audit}
        write_filled("page", page, page_path)
        return shown()

    return open_page


def test_an_audit_is_a_line_and_a_table(opened):
    page = opened(json.loads(json.dumps([ROW.columns, CLEAN.columns])))
    summary = page.tab.locator("#audit summary")
    assert summary.inner_text() == "Audit: could pass for skill: position in time"
    summary.click()
    assert page.tab.evaluate(LINES) == [
        ["probe", "accuracy", "chance", "without", "verdict"],
        ["position in timenearest", "0.900 ± 0.02", "0.170", "0.228 ± 0.03", ROW.verdict + ROW.remedy],
        [f"spike total{EVIL}", "0.239 ± 0.02", "0.170", "–", "explains 10 %"],
    ]
    assert page.tab.evaluate("[...document.querySelectorAll('#audit tr.shortcut')].length") == 1


def test_what_a_reader_knows_on_the_test_set_is_a_column(opened):
    known = dataclasses.replace(ROW, probe="counts over time", shortcut=False, test=0.83, test_se=0.02)
    page = opened(json.loads(json.dumps([known.columns, CLEAN.columns])))
    page.tab.locator("#audit summary").click()
    head, first, second = page.tab.evaluate(LINES)
    assert head[-2] == "test" and first[-2] == "0.830 ± 0.02" and second[-2] == "–"


def test_a_study_without_an_audit_has_no_such_section(opened):
    assert opened([]).tab.locator("#audit").is_hidden()
