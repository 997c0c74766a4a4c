"""Components outside `dse`: named by key `plugins` of a search space, loaded before any section is read."""

import pytest

from dse.base import registry
from dse.config import ConfigError, Sections, load_space
from dse.study.preview import preview
from tests.spaces import SPACE, write_space

FAMILY = '''
from dataclasses import dataclass
from dse.base.registry import param, register

@register("models", "plugged_of_a_test")
@dataclass(frozen=True)
class Plugged:
    """A family of a user."""
    width: int = param(3, low=1, doc="a number")
    fit = respond = str
'''
MODEL = "{kind: snn, hidden: {choice: [4, 8, 12]}, true_rate: 0.8}"


@pytest.fixture(autouse=True)
def clean(trusting):
    before, plugins = registry._outside(), dict(registry._plugins)
    yield
    registry._replace(before)
    registry._plugins.clear()
    registry._plugins.update(plugins)


def with_plugin(folder, plugin="plugins: [mine.py]", model="plugged_of_a_test"):
    return write_space(folder, ("seed: 3\n", f"seed: 3\n{plugin}\n"), (MODEL, model))


def test_a_file_beside_the_search_space_is_loaded_first(tmp_path):
    (tmp_path / "mine.py").write_text(FAMILY)
    path = with_plugin(tmp_path, model="{kind: plugged_of_a_test, width: {choice: [1, 2]}}")
    space = load_space(path)
    [plugin] = space.plugins
    assert (plugin.name, plugin.components) == ("mine.py", (("models", "plugged_of_a_test"),))
    design = {"encoder.thresholds": (1.0, 2.0), "model.width": 2}
    sections = space.resolve(design)
    assert sections.to_plain()["model"] == {"kind": "plugged_of_a_test", "width": 2}
    assert Sections.from_plain(sections.to_plain(), "a record") == sections
    assert preview(space)["plugins"] == ["mine.py: models plugged_of_a_test"]


def test_a_written_search_space_loads_them_from_anywhere(tmp_path):
    (tmp_path / "mine.py").write_text(FAMILY)
    space = load_space(with_plugin(tmp_path))
    (tmp_path / "results").mkdir()
    again = tmp_path / "results" / "search_space.yaml"
    again.write_text(space.to_yaml(), encoding="utf-8")
    assert load_space(again).to_yaml() == space.to_yaml()
    assert space.to_plain()["plugins"] == [str(tmp_path / "mine.py")]
    assert "plugins" not in load_space(write_space(tmp_path, text=SPACE)).to_plain()


@pytest.mark.parametrize(
    ("plugins", "content", "fault"),
    [
        ("[mine.py]", None, "plugin 'mine.py': cannot read "),
        ("[mine.py]", "1 / 0", "plugin 'mine.py': ZeroDivisionError in line 1 of "),
        ("[mine.py]", "x = 1", "plugin 'mine.py' must register a component, but it registers none"),
        ("[mine.py]", FAMILY.replace("plugged_of_a_test", "snn"), "'snn' is already registered by dse."),
        ("[mine.py, ./mine.py]", FAMILY, "plugin './mine.py' is named twice"),
        ("[no_such_module_of_a_test]", None, "plugin 'no_such_module_of_a_test': no module "),
        ("{mine: py}", None, "plugins must be a list of texts, got {'mine': 'py'}"),
    ],
)
@pytest.mark.parametrize("model", [MODEL, "plugged_of_a_test"])  # a name that the plugin would bring
def test_what_is_wrong_with_one_is_the_only_fault_and_of_its_line(tmp_path, plugins, content, fault, model):
    if content is not None:
        (tmp_path / "mine.py").write_text(content)
    path = with_plugin(tmp_path, f"plugins: {plugins}", model)
    with pytest.raises(ConfigError) as caught:
        load_space(path)
    [found] = caught.value.faults
    assert (found.path, found.line) == (str(path), 3)
    assert fault in found.message
