"""Designs side by side, in a real browser: their numbers, and what differs."""

from tests.dashboard.designs import hash_of

SHOWN = "chosen=0.0&compare=0.0,1.3,2.1,0.6"
KEYS = "document.querySelectorAll('#compare [data-key]')"


def heads(page):
    return page.tab.evaluate(f"[...{KEYS}].map((cell) => cell.dataset.key)")


def line(page, title):
    """Return the cells of a row by its title."""
    rows = page.tab.evaluate(
        "[...document.querySelectorAll('#compare tbody tr')]"
        ".map((row) => [...row.cells].map((c) => c.textContent))"
    )
    [found] = [cells for name, *cells in rows if name == title]
    return found


def test_designs_stand_side_by_side_as_the_chart_numbers_them(opened):
    page = opened(fragment=SHOWN)
    said = "document.querySelector('#compare').textContent.includes('0.800')"
    page.tab.wait_for_function(said)  # a point off the page, restored from its surface
    assert heads(page) == ["0.0", "1.3", "2.1", "0.6"]
    accuracy = ["0.850", "0.900 ± 0.02+0.05", "0.500 ± 0.02−0.35", "0.800 ± 0.02−0.05"]
    assert line(page, "accuracy") == accuracy
    assert line(page, "energy (µJ)") == ["100", "30 (15–60)×0.3", "10 (5–20)×0.1", "60 (30–120)×0.6"]
    assert line(page, "weights") == ["100", "200×2", "300×3", "100same"]
    assert line(page, "model.hidden") == ["10", "20", "30", "10"]
    assert line(page, "φ") == ["–", "2", "0", "4"]
    assert "encoder.kind" not in page.tab.inner_text("#compare"), "which is the same"
    places = [(100, 0.85), (30, 0.9), (10, 0.5), (60, 0.8)]
    assert [page.marked(str(k + 1)) for k in range(4)] == [[place] for place in places]


def test_a_fifth_replaces_the_oldest_and_any_can_be_removed_or_chosen(opened):
    page = opened(fragment=f"{SHOWN}&show=inside")
    button = "#design .head button"
    assert page.tab.get_attribute(button, "aria-pressed") == "true"
    page.tab.evaluate("location.hash += '&chosen=1.1'")
    page.tab.wait_for_function(f"document.querySelector({button!r}).getAttribute('aria-pressed') === 'false'")
    page.tab.click(button)
    assert heads(page) == ["1.3", "2.1", "0.6", "1.1"]
    page.tab.focus("#compare [data-key='2.1'] button >> nth=1")
    page.tab.keyboard.press("Enter")
    assert heads(page) == ["1.3", "0.6", "1.1"]
    page.tab.click("#compare [data-key='0.6'] button >> nth=0")
    assert hash_of(page)["chosen"] == "0.6"
    for _ in range(3):
        page.tab.click("#compare [aria-label^=remove] >> nth=0")
    assert not page.tab.is_visible("#compare") and "compare" not in hash_of(page)
