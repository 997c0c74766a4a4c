"""What may be compared: objectives, tasks and hardware in common; else a refusal in one sentence."""

import shutil
from pathlib import Path

import pytest

from dse import store
from dse.cli.command_line import main
from dse.skyline.constraints import ExpressionError
from dse.skyline.table import Goal
from dse.study.comparison import compare_studies
from dse.study.question import Question
from tests.dashboard.page import Page
from tests.skyline.test_compare import FIRST, GOALS, SECOND

EXAMPLE = Path(__file__).resolve().parent.parent.parent / "results" / "example"
GIVEN = [Goal(*pair) for pair in GOALS]


@pytest.fixture
def written(tmp_path):
    """Return a function that writes a table and returns its path."""

    def write(name, frame):
        frame.to_csv(tmp_path / f"{name}.csv", index=False)
        return tmp_path / f"{name}.csv"

    return write


@pytest.mark.parametrize(
    ("second", "objectives", "text"),
    [
        (SECOND, None, "tables have no objectives"),
        (SECOND.drop(columns="energy_uj"), GIVEN, "b.csv: has no numbers of energy_uj"),
        (SECOND.assign(task="speed"), GIVEN, "no task in common (a: texture; b: speed)"),
        (SECOND.drop(columns="task"), GIVEN, "no task in common (a: texture; b: none)"),
        (SECOND.assign(hardware="other"), GIVEN, "no hardware in common (a: chip; b: other); --hardware"),
    ],
)
def test_what_cannot_be_compared_is_refused(written, second, objectives, text):
    with pytest.raises(ExpressionError) as raised:
        compare_studies(written("a", FIRST), written("b", second), Question.of(objectives=objectives))
    assert text in str(raised.value)


def test_that_accuracies_are_of_other_recordings_is_said_first(written, tmp_path, page_path, new_tab, capsys):
    folders = []
    for name in ("one", "other"):
        path = tmp_path / name / "example"
        shutil.copytree(EXAMPLE, path)
        folders.append(str(path))
    space = tmp_path / "other" / "example" / "search_space.yaml"
    store.write_text(space, store.read_text(space).replace("at: middle", "at: onset"))
    assert main(["compare", *folders, "--html", str(page_path)]) == 0
    capsys.readouterr()
    page = Page(new_tab((1280, 720)), page_path).open("chosen=1.0&show=inside")
    notes = page.tab.locator("#notes li").all_text_contents()
    assert "their accuracies are of other recordings" in notes[0]
    text = page.tab.inner_text("#design")
    assert "the page of each study has" in text and "dse dashboard" not in text


def test_a_table_beside_itself_is_equal_and_is_drawn(written, capsys, page_path, new_tab):
    path = written("a", FIRST)
    arguments = ["compare", str(path), str(path), "--objectives", "accuracy:max,energy_uj:min"]
    assert main([*arguments, "--html", str(page_path), "--format", "table"]) == 0
    text = capsys.readouterr().out
    assert "Joint front" in text and "Best within a budget" in text
    page = Page(new_tab((1280, 720)), page_path).open("expert=1")
    assert page.tab.locator("#view-studies tbody tr").count() >= 2
    assert page.tab.input_value("#colour") == "study"
    assert page.tab.is_hidden("#export")
    page.tab.fill("#budget-1", "1")
    page.tab.wait_for_function(
        "document.querySelector('#view-studies').innerText.includes('within these budgets')"
    )
    assert page.faults == []
