"""Components by name: shipped ones, those of a plugin, those of an installed distribution."""

import importlib.metadata
import pickle
import subprocess
import sys

import pytest

from dse.base import registry
from dse.base.registry import PluginError, load_plugin

MEMBERS = "n_channels = positions = encode_all = str"
ENCODER = """
from dataclasses import dataclass
from dse.base.registry import param, register

@register("encoders", "{name}")
@dataclass(frozen=True)
class {cls}:
    gain: float = param({gain}, doc="gain")
    n_channels = positions = encode_all = str
"""


@pytest.fixture(autouse=True)
def registry_as_before(monkeypatch):
    """Forget what a test loads."""
    for section in registry.SECTIONS:
        registry.known(section)
    monkeypatch.setattr(registry, "_plugins", {})
    monkeypatch.setattr(registry, "_components", {s: dict(c) for s, c in registry._components.items()})
    yield
    for name in list(sys.modules):
        if name.endswith("_of_a_test") or name.startswith(("dse_plugin_", "rooms")):
            del sys.modules[name]


def write(folder, text, name="mine.py"):
    (folder / name).write_text(text)
    return folder


def encoder(name="mine", cls="Mine", gain=1.0):
    return ENCODER.format(name=name, cls=cls, gain=gain)


def fault(name, base=None):
    with pytest.raises(PluginError) as error:
        load_plugin(name, base)
    return str(error.value)


def test_a_section_names_the_package_of_its_components():
    for section, package in registry.SECTIONS.items():
        shipped = [x for x in registry.known(section).values() if x.__module__.startswith("dse.")]
        assert all(f"{cls.__module__}.".startswith(f"{package}.") for cls in shipped)


@pytest.mark.parametrize("section", ["encoders", "hardware.kinds", "models", "recordings", "scene.motions"])
def test_shipped_components_are_found(section):
    assert registry.known(section)


def test_only_modules_that_register_are_imported(tmp_path, monkeypatch):
    for path in ("rooms/__init__.py", "rooms/deep/__init__.py", "rooms/other.py"):
        (tmp_path / path).parent.mkdir(exist_ok=True)
        (tmp_path / path).write_text("import dse.base.registry\n")
    (tmp_path / "rooms" / "deep" / "mine.py").write_text(encoder().replace("encoders", "rooms"))
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setitem(registry.SECTIONS, "rooms", "rooms")
    assert list(registry.known("rooms")) == ["mine"]
    assert "rooms.other" not in sys.modules


def test_an_unknown_section_is_refused():
    with pytest.raises(ValueError, match="unknown section 'encoder'; known: datasets, encoders, figures"):
        registry.known("encoder")
    with pytest.raises(ValueError, match="unknown section 'encoder' of Mine"):
        registry.register("encoder", "mine")(type("Mine", (), {}))


def test_a_file_is_loaded(tmp_path):
    plugin = load_plugin("mine.py", write(tmp_path, encoder()))
    assert plugin.name == "mine.py"
    assert plugin.source == str(tmp_path / "mine.py")
    assert plugin.components == (("encoders", "mine"),)
    assert registry.known("encoders")["mine"]().gain == 1.0


def test_a_file_is_loaded_once(tmp_path):
    first = load_plugin("mine.py", write(tmp_path, encoder()))
    cls = registry.known("encoders")["mine"]
    assert load_plugin(str(tmp_path / "mine.py")).components == first.components
    assert registry.known("encoders")["mine"] is cls


def test_a_copy_of_a_file_is_the_same_plugin(tmp_path):
    load_plugin("mine.py", write(tmp_path, encoder()))
    cls = registry.known("encoders")["mine"]
    (tmp_path / "copy").mkdir()
    copy = load_plugin("mine.py", write(tmp_path / "copy", encoder()))
    assert copy.source == str(tmp_path / "copy" / "mine.py")
    assert copy.components == (("encoders", "mine"),)
    assert registry.known("encoders")["mine"] is cls


def test_a_file_that_changed_replaces_what_it_registered(tmp_path):
    load_plugin("mine.py", write(tmp_path, encoder() + encoder("other", "Other")))
    plugin = load_plugin("mine.py", write(tmp_path, encoder(gain=2.0)))
    assert plugin.components == (("encoders", "mine"),)
    assert registry.known("encoders")["mine"]().gain == 2.0
    assert "other" not in registry.known("encoders")


def test_a_file_leaves_nothing_beside_it(tmp_path):
    load_plugin("mine.py", write(tmp_path, encoder()))
    assert [path.name for path in tmp_path.iterdir()] == ["mine.py"]


def test_objects_of_a_file_are_unpickled_by_another_process_that_loaded_it(tmp_path):
    plugin = load_plugin("mine.py", write(tmp_path, encoder()))
    (tmp_path / "object.pickle").write_bytes(pickle.dumps(registry.known("encoders")["mine"](gain=3.0)))
    code = (
        "import pickle, sys; from pathlib import Path; from dse.base import registry; "
        f"registry.load_plugin({plugin.source!r}); "
        f"print(pickle.loads(Path({str(tmp_path / 'object.pickle')!r}).read_bytes()).gain)"
    )
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == "3.0"


def test_a_module_is_loaded(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    write(tmp_path, encoder(), "mine_of_a_test.py")
    plugin = load_plugin("mine_of_a_test")
    assert (plugin.name, plugin.source) == ("mine_of_a_test", "mine_of_a_test")
    assert plugin.components == (("encoders", "mine"),)
    assert load_plugin("mine_of_a_test") == plugin


def test_a_module_that_was_imported_before_is_a_plugin_all_the_same(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    write(tmp_path, encoder(), "mine_of_a_test.py")
    importlib.import_module("mine_of_a_test")
    assert load_plugin("mine_of_a_test").components == (("encoders", "mine"),)


def test_shipped_components_that_a_plugin_imports_are_not_its_own(tmp_path):
    text = "import dse.models.counts.knn\n" + encoder()
    assert load_plugin("mine.py", write(tmp_path, text)).components == (("encoders", "mine"),)


def test_a_missing_file(tmp_path):
    text = f"plugin 'mine.py': cannot read {tmp_path / 'mine.py'}: No such file or directory"
    assert fault("mine.py", tmp_path) == text


def test_a_missing_module():
    text = "plugin 'mine_of_a_test': no module 'mine_of_a_test' is installed; a file is named with its ending"
    assert fault("mine_of_a_test").startswith(text)


def test_neither_a_module_nor_a_file():
    assert fault("my-module") == "plugin 'my-module' must be the name of a module or a path that ends in .py"


@pytest.mark.parametrize(
    ("last_line", "reason"),
    [
        ("gain = 1 / 0", "ZeroDivisionError in line 10 of {path}: division by zero"),
        ("import nowhere", "ModuleNotFoundError in line 10 of {path}: No module named 'nowhere'"),
        ("gain = (", "SyntaxError in line 10 of {path}: '(' was never closed"),
        ("raise SystemExit(1)", "SystemExit in line 10 of {path}: 1"),
    ],
)
def test_a_file_that_fails_registers_nothing(tmp_path, last_line, reason):
    before = registry.known("encoders")
    write(tmp_path, encoder() + last_line)
    assert fault("mine.py", tmp_path) == f"plugin 'mine.py': {reason.format(path=tmp_path / 'mine.py')}"
    assert registry.known("encoders") == before
    load_plugin("mine.py", write(tmp_path, encoder()))
    assert "mine" in registry.known("encoders")


def test_a_changed_file_that_fails_leaves_what_was_loaded(tmp_path):
    load_plugin("mine.py", write(tmp_path, encoder()))
    write(tmp_path, encoder(gain=2.0) + "1 / 0")
    assert "ZeroDivisionError" in fault("mine.py", tmp_path)
    assert registry.known("encoders")["mine"]().gain == 1.0


def test_a_module_that_fails_is_imported_anew(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    write(tmp_path, encoder(), "part_of_a_test.py")
    write(tmp_path, "import part_of_a_test\n1 / 0\n", "mine_of_a_test.py")
    where = tmp_path / "mine_of_a_test.py"
    assert fault("mine_of_a_test").endswith(f"ZeroDivisionError in line 2 of {where}: division by zero")
    assert "mine" not in registry.known("encoders")
    assert load_plugin("part_of_a_test").components == (("encoders", "mine"),)


def test_a_shipped_name_is_taken(tmp_path):
    write(tmp_path, encoder("threshold"))
    assert fault("mine.py", tmp_path).endswith(
        f"ValueError in line 5 of {tmp_path / 'mine.py'}: "
        "encoders 'threshold' is already registered by dse.data.encoders.threshold"
    )
    assert registry.known("encoders")["threshold"].__module__ == "dse.data.encoders.threshold"


def test_a_shipped_name_is_taken_before_it_is_imported(tmp_path):
    write(tmp_path, encoder("threshold"))
    code = f"from dse.base import registry; registry.load_plugin({str(tmp_path / 'mine.py')!r})"
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "encoders 'threshold' is already registered by dse.data.encoders.threshold" in answer.stderr


def test_the_name_of_another_plugin_is_taken(tmp_path):
    load_plugin("mine.py", write(tmp_path, encoder()))
    write(tmp_path, encoder(gain=2.0), "other.py")
    assert "encoders 'mine' is already registered by plugin 'mine.py'" in fault("other.py", tmp_path)


@pytest.mark.parametrize(
    ("section", "members", "lacks"),
    [
        ("objectives", "columns = ()", "needs, measure"),
        ("models", "fit = str", "respond"),
        ("losses", "value = gradient = str", "lengths"),
        ("encoders", "n_channels = str", "positions, encode_all"),
        ("neurons", "label = ''; population = str", "Populations"),
        ("neurons", "label = population = Populations = str", "Populations.to_threshold, Populations.step"),
    ],
)
def test_a_component_that_lacks_what_its_section_calls_is_refused(tmp_path, section, members, lacks):
    text = encoder().replace('"encoders"', f'"{section}"').replace(MEMBERS, members)
    text = text.replace("Populations = str", "Populations = type('P', (), {'initial_state': str})")
    write(tmp_path, text)
    assert fault("mine.py", tmp_path).endswith(f"{section} 'mine' must have {lacks}")
    assert "mine" not in registry.known(section)


def test_what_a_protocol_declares_is_not_had(tmp_path):
    text = encoder().replace('"encoders"', '"neurons"').replace("class Mine:", "class Mine(Neuron):")
    text = text.replace(MEMBERS, "label = ''")
    write(tmp_path, f"from dse.engine.neurons import Neuron\n{text}")
    assert fault("mine.py", tmp_path).endswith("neurons 'mine' must have population, Populations")


@pytest.fixture
def distribution(tmp_path, monkeypatch):
    """Return a function that makes a distribution with an entry point to a module of some text."""

    def make(text, entry="mine"):
        write(tmp_path, text, "mine_of_a_test.py")
        folder = tmp_path / "mine_of_a_test-1.0.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: mine-of-a-test\nVersion: 1.0\n")
        (folder / "entry_points.txt").write_text(f"[dse.components]\n{entry} = mine_of_a_test\n")
        monkeypatch.syspath_prepend(tmp_path)
        done = {f"{registry.ENTRY_POINTS} {section}" for section in ("", "encoders", "losses")}
        monkeypatch.setattr(registry, "_imported", registry._imported - done)
        monkeypatch.setattr(registry, "_entry_points", registry._entry_points.__wrapped__)

    return make


def test_an_installed_distribution_is_found(distribution):
    distribution(encoder())
    assert "mine" in registry.known("encoders")


def test_an_entry_point_with_the_name_of_a_section_waits_for_it(distribution):
    distribution(encoder(), "encoders")
    assert registry.known("losses") and "mine_of_a_test" not in sys.modules
    assert "mine" in registry.known("encoders") and "mine_of_a_test" not in registry.named_plugins()


def test_a_plugin_of_the_clone_that_is_not_installed_is_named(monkeypatch):
    monkeypatch.setitem(registry.ELSEWHERE, "dse-other", {"models": ("strange", "snn")})
    assert "plugin dse-other: pip install ./plugins/dse-other" in registry.elsewhere("models", "strange")
    assert registry.elsewhere("models", "snn") == registry.elsewhere("encoders", "strange") == ""


def test_a_distribution_that_fails_is_a_warning(distribution):
    distribution("1 / 0")
    with pytest.warns(UserWarning, match="distribution mine-of-a-test, entry point mine: plugin"):
        assert "threshold" in registry.known("encoders")
    assert "threshold" in registry.known("encoders")  # and no second warning
