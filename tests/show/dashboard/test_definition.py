"""Page definitions: what a file may say, every fault of one at once, and what a study's page makes of it."""

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from dse.config import ConfigError
from dse.show.dashboard.definition import Definition, FrontView, definition_for, load, shipped_definitions
from dse.show.dashboard.gather import gather_page
from dse.show.dashboard.views import view_names
from tests.page_data import OBJECTIVES, failed, points

COLUMNS = {
    "accuracy": {"values": [0.5, None]},
    "energy_uj": {"values": [3.0, 4]},
    "family": {"values": ["snn", "elm"]},
    "fits": {"values": [True, False]},
}


def written(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def faults_of(path):
    with pytest.raises(ConfigError) as caught:
        load(path)
    return str(caught.value).splitlines()


def test_the_default_page_leaves_every_choice_to_the_study():
    assert load() == load("study") == Definition(views=load().views)
    assert {"study", "paper", "deployment"} <= set(shipped_definitions())


@pytest.mark.parametrize("name", sorted(shipped_definitions()))
def test_what_is_shipped_is_right(name):
    found = load(name)
    assert set(found.views) == set(view_names()), "no part of the page is lost"
    assert set(found.design) == set(Definition().design)


def test_a_file_of_ones_own(tmp_path):
    text = """
title: mine
views: [table, front]
front: {x: n_weights, y: accuracy, log: [n_weights]}
parallel: [accuracy, energy_uj]
table: energy_uj
design: []
budgets: {energy_uj: 50, accuracy: 8e-1}
sort: energy_uj
"""
    front = FrontView("n_weights", "accuracy", ("n_weights",))
    about = {"title": "mine", "views": ("table", "front"), "design": (), "sort": "energy_uj"}
    columns = {"parallel": ("accuracy", "energy_uj"), "table": ("energy_uj",)}
    budgets = {"energy_uj": 50.0, "accuracy": 0.8}
    found = load(written(tmp_path / "mine.yaml", text))
    assert found == Definition(front=front, budgets=budgets, **about, **columns)
    assert load(written(tmp_path / "empty.yaml", "# nothing said\n")) == Definition()


def test_every_fault_at_once_with_its_line(tmp_path):
    text = """titel: mine
views: [front, tabel, front]
front:
  x: accuracy
  y: accuracy
  z: fits
  colour: red
design: energie
budgets: {accuracy: high, n_weights: .nan, fits: true}
parallel: [a, b, a]
sort: 3
"""
    path = written(tmp_path / "bad.yaml", text)
    expected = (
        ("1: unknown key 'titel'; known: title, plugins, views,", "Did you mean 'title'?"),
        ("2: unknown views[1] 'tabel'; known: audit, card, chips,", "Did you mean 'table'?"),
        ("2: views must not contain a name twice", "'front' again"),
        ("5: front.y must be another column than front.x", "'accuracy' twice"),
        ("6: unknown key 'front.z'", "known: x, y, log"),
        ("7: unknown key 'front.colour'", "known: x, y, log"),
        ("8: unknown design[0] 'energie'; known: confusion, surface,", "Did you mean 'energy'?"),
        ("9: budgets.accuracy must be a number", "'high'"),
        ("9: budgets.n_weights must be a finite number", "nan"),
        ("9: budgets.fits must be a number", "true"),
        ("10: parallel must not contain a name twice", "'a' again"),
        ("11: sort must be text", "3"),
    )
    for fault, (begins, ends) in zip(faults_of(path), expected, strict=True):
        assert fault.startswith(f"{path}:{begins}") and fault.endswith(ends), fault


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("views: []", "views must contain at least one part of the page, got []"),
        ("- front", "the file must be a mapping of keys to values, got ['front']"),
        ("title: [a", "not valid YAML"),
        ("title: a\ntitle: b", "duplicate key 'title', first on line 1"),
        ("front: [accuracy]", "front must be a mapping of keys to values, got ['accuracy']"),
        ("budgets: [energy_uj]", "budgets must be a mapping, got ['energy_uj']"),
        ("\udcff", "cannot be read: not UTF-8 text"),
    ],
)
def test_what_a_file_must_be(tmp_path, text, fault):
    (tmp_path / "bad.yaml").write_bytes(text.encode(errors="surrogateescape"))
    [found] = faults_of(tmp_path / "bad.yaml")
    assert fault in found


def test_what_cannot_be_found():
    [found] = faults_of("papre")
    assert found.startswith("papre: no such file and no shipped page of this name; known: deployment, paper")
    assert found.endswith("Did you mean 'paper'?")


_PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)


@given(content=st.dictionaries(st.sampled_from([*vars(Definition()), "x"]), _PLAIN, max_size=4))
def test_whatever_a_file_holds_is_a_definition_or_its_faults(content, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / "any.yaml"
    path.write_text(yaml.safe_dump(content, allow_unicode=False), encoding="utf-8")
    try:
        found = load(path)
    except ConfigError as error:
        assert error.faults
    else:
        assert isinstance(definition_for(found, COLUMNS, ["accuracy"])[0], dict)


def test_a_page_holds_what_its_study_has():
    wanted = Definition(
        title="mine",
        front=FrontView(x="family", y="accuracy", log=("energy_uj", "n_weights")),
        parallel=("family", "energy_uj", "latency_ms"),
        table=("latency_ms",),
        budgets={"accuracy": 0.5, "energy_uj": 5.0, "n_weights": 10.0},
        sort="fits",
    )
    page, notes = definition_for(wanted, COLUMNS, ["accuracy"])
    assert page == {
        "title": "mine",
        "views": list(load().views),
        "front": {"x": None, "y": "accuracy", "log": ["energy_uj"]},
        "parallel": ["family", "energy_uj"],
        "table": None,
        "design": list(Definition().design),
        "budgets": {"accuracy": 0.5},
        "sort": "fits",
    }
    assert notes == [
        "This study has no latency_ms, n_weights, used in the page definition.",
        "This study has no numbers to draw in family, used in the page definition.",
        "This study has no budget of energy_uj, used in the page definition.",
    ]
    # What only says true or false is no number.
    assert definition_for(Definition(front=FrontView(x="fits")), COLUMNS, [])[0]["front"]["x"] is None
    # Before the first design nothing is missing.
    page, notes = definition_for(wanted, {}, [])
    assert (page["front"]["y"], page["budgets"], notes) == (None, {}, [])


def test_a_gathered_page_has_its_definition_and_marks():
    marks = [{"name": "A", "task": "texture", "values": {"accuracy": 0.9}, "source": "s", "caption": "c"}]
    front = FrontView(y="energy_uj", x="n_cores")
    wanted = Definition(title="</script>", front=front, budgets={"accuracy": 0.7})
    page = gather_page(points(), name="fabric", objectives=OBJECTIVES, definition=wanted, marks=marks)
    found = page["definition"]
    assert (found["title"], found["budgets"]) == ("</script>", {"accuracy": 0.7})
    assert (found["front"]["y"], found["front"]["x"]) == ("energy_uj", None)
    assert "This study has no n_cores, used in the page definition." in page["notes"]
    assert page["marks"] == marks
    plain = gather_page(failed(), name="fabric", objectives=OBJECTIVES)
    assert (plain["definition"], plain["marks"]) == (definition_for(Definition(), {}, [])[0], [])
