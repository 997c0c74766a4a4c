"""Designs side by side, in a real browser: their numbers, what differs, their figures on the same scales."""

import pytest

from tests.dashboard.designs import details, hash_of, learning_of

SHOWN = "chosen=0.0&compare=0.0,1.3,2.1,0.6"


def heads(page):
    return page.tab.eval_on_selector_all(
        "#compare thead th",
        "cells => cells.map((cell) => [cell.querySelector('.square').textContent, cell.dataset.key])",
    )


def line(page, title):
    """Return the cells of a row by its title."""
    found = page.tab.evaluate(
        "(title) => [...document.querySelectorAll('#compare tbody tr')]"
        ".filter((row) => row.cells[0].title === title)"
        ".map((row) => [...row.cells].slice(1).map((cell) => cell.textContent))",
        title,
    )
    assert len(found) == 1
    return found[0]


def wait_for(page, text):
    page.tab.wait_for_function(
        "(text) => document.querySelector('#compare').textContent.includes(text)", arg=text
    )


def test_designs_stand_side_by_side_as_the_front_numbers_them(opened):
    page = opened(fragment=SHOWN)
    wait_for(page, "0.800")  # a point off the page, restored from its surface
    assert heads(page) == [["1", "0.0"], ["2", "1.3"], ["3", "2.1"], ["4", "0.6"]]
    assert line(page, "accuracy") == [
        "0.850",
        "0.900 ± 0.02 (best)+0.05",
        "0.500 ± 0.02−0.35",
        "0.800 ± 0.02−0.05",
    ]
    assert line(page, "energy (µJ)") == ["100", "30 (15–60)×0.3", "10 (5–20) (best)×0.1", "60 (30–120)×0.6"]
    assert line(page, "weights") == ["100 (best)", "200×2", "300×3", "100 (best)same"]
    assert line(page, "model.hidden") == ["10", "20", "30", "10"]
    assert line(page, "φ") == ["–", "2", "0", "4"]
    assert page.tab.inner_text("#compare > .quiet") == "same: encoder.kind threshold"
    front = page.tab.evaluate(
        "document.getElementById('plot').data.filter((t) => t.marker?.symbol === 'square-open')"
        ".map((t) => [t.text[0], t.x[0], t.y[0]])"
    )
    assert front == [["1", 100, 0.85], ["2", 30, 0.9], ["3", 10, 0.5], ["4", 60, 0.8]]


def test_a_fifth_replaces_the_oldest_and_any_can_be_removed_or_chosen(opened):
    page = opened(fragment=SHOWN)
    assert page.tab.get_attribute("#design .head button", "aria-pressed") == "true"
    page.tab.evaluate("location.hash += '&chosen=1.1'")
    page.tab.wait_for_function(
        "document.querySelector('#design .head button').getAttribute('aria-pressed') === 'false'"
    )
    page.tab.click("#design .head button")
    assert [key for _, key in heads(page)] == ["1.3", "2.1", "0.6", "1.1"]
    page.tab.focus("#compare th[data-key='2.1'] [data-does=remove]")
    page.tab.keyboard.press("Enter")
    assert [key for _, key in heads(page)] == ["1.3", "0.6", "1.1"]
    assert (
        page.tab.evaluate("document.activeElement.getAttribute('aria-label')")
        == "remove Trial 0 from the comparison"
    )
    page.tab.click("#compare th[data-key='0.6'] [data-does=choose]")
    assert hash_of(page)["chosen"] == "0.6"
    for _ in range(3):
        page.tab.click("#compare [data-does=remove] >> nth=0")
    assert not page.tab.is_visible("#compare")
    assert "compare" not in hash_of(page)


def test_figures_have_the_same_scales(opened):
    losses = {0: [4.0, 1.0], 1: [40.0, 10.0, 5.0]}
    learnt = {k: details(k, figures={"learning": learning_of(loss)}) for k, loss in losses.items()}
    page = opened(documents=learnt, fragment="compare=0.1,1.1,2.1")
    page.tab.wait_for_function(
        "[...document.querySelectorAll('#compare .plot')].filter((plot) => plot.data).length === 2"
    )
    ranges, said = page.tab.evaluate(
        "[({ _fullLayout: { xaxis, yaxis } }) => [xaxis.range, yaxis.range], (plot) => plot.ariaLabel]"
        ".map((of) => [...document.querySelectorAll('#compare .plot')].map(of))"
    )
    assert ranges[0] == ranges[1] == [pytest.approx([0.9, 3.1]), pytest.approx([0, 42])]
    assert said == [
        "1, Trial 0. Learning curves over 2 epochs: loss 4 to 1.",
        "2, Trial 1. Learning curves over 3 epochs: loss 40 to 5.",
    ]
    text = page.tab.inner_text("#compare figure >> nth=2")
    assert "This file does not contain the details of this design." in text
    page = opened(documents={}, fragment="compare=0.1,2.1")
    wait_for(page, "0.500")
    assert not page.tab.is_visible("#compare select"), "nothing recorded leaves the numbers"
    assert page.tab.locator("#compare figure").count() == 0
    assert page.tab.get_attribute("#compare .scroll", "tabindex") == "0"
