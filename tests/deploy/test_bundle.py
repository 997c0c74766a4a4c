"""The bundle's folder: what is in it, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from dse.base import registry
from dse.base.records import Head, Layer, Network, Parameters
from dse.deploy.bundle import Bundle, BundleError, read, weights, write
from dse.engine.neurons.fixed_point import quantise
from tests.deploy.bundles import document
from tests.layers import cuba_parameters
from tests.spaces import RASTER, sections


@pytest.fixture
def made():
    rng = np.random.default_rng(1)
    decay = np.full(3, 1024, np.int32)
    ring = rng.normal(size=(3, 3)).astype(np.float32)
    weight = np.array([[-9.0, 9.0], [1 / 64, 3 / 64], [0.5, -1 / 3]], np.float32)
    network = Network((Layer(weight, ring, cuba_parameters(decay, decay, 80)),), 2, (0,), 1, "integer")
    return Bundle(
        fitted=network,
        sections=sections({**RASTER, "model": {"kind": "snn", "hidden": [3]}}),
        classes=("felt", "silk", "wool"),
        phi=4.0,
        theta=0.7,
        record={"trial": 3, "accuracy": 0.9, "fits": True},
        evidence={"study": "tiny"},
    )


def test_a_bundle_survives_the_disk(made, tmp_path):
    write(made, tmp_path / "b")
    found = read(tmp_path / "b")
    for name in ("sections", "classes", "phi", "theta", "record", "evidence"):
        assert getattr(found, name) == getattr(made, name)
    assert np.array_equal(found.fitted.layers[0].weight, made.fitted.layers[0].weight)
    assert sorted(path.name for path in (tmp_path / "b").iterdir()) == [
        "README.md",
        "bundle.json",
        "statement.json",
        "weights.npz",
    ]
    text = (tmp_path / "b" / "README.md").read_text()
    assert "felt, silk, wool" in text and "with more than 4 of them" in text
    assert "| accuracy, validation | 0.9 |" in text and "Known failures" not in text


def test_the_card_names_the_commonest_mistakes_first_and_the_licence(made, tmp_path):
    counts = [[8, 2, 0], [0, 10, 0], [1, 3, 1]]
    evidence = {**made.evidence, "confusion": {"of": "test", "counts": counts}, "licence": "CC-BY-4.0"}
    record = {"energy_uj": 12345.6, "energy_uj_low": 7.25, "energy_uj_high": 20000.0}
    write(replace(made, evidence=evidence, record=record), tmp_path / "b")
    text = (tmp_path / "b" / "README.md").read_text()
    assert [line for line in text.splitlines() if line.endswith("samples")] == [
        "- wool is taken for silk: 3 of 5 test samples",
        "- felt is taken for silk: 2 of 10 test samples",
        "- wool is taken for felt: 1 of 5 test samples",
    ]
    assert "Licence of the recordings: CC-BY-4.0." in text and "| 12346 (7.25 to 20000) |" in text


@pytest.mark.parametrize(
    ("confusion", "message"),
    [
        ({"of": "test", "counts": [[1, 2], [3, 4]]}, "confusion.counts must have 3 rows"),
        ({"of": "test", "counts": [[1, 2, 3], [4, 5, 6, 7], [8, 9, 0]]}, "rows of one length"),
        ({"of": "all", "counts": []}, "unknown confusion.of 'all'"),
        ([1], "confusion must be a mapping"),
    ],
)
def test_evidence_that_no_card_can_state_is_refused(made, tmp_path, confusion, message):
    write(made, tmp_path / "b")
    document(evidence__confusion=confusion)(tmp_path / "b")
    with pytest.raises(BundleError, match=message):
        read(tmp_path / "b")


def test_names_in_a_card_are_no_links(made, tmp_path):
    evidence = {"study": "[a](b)", "licence": "[c](d)", "warnings": ["`[e](f)`"]}
    write(replace(made, evidence=evidence), tmp_path / "b")
    text = (tmp_path / "b" / "README.md").read_text()
    assert all(f"[{x}](" not in text for x in "ace")


def test_eight_bits_hold_exactly_what_runs(made):
    arrays = weights(made.fitted)
    [layer] = made.fitted.layers
    for name, matrix in (("weight", layer.weight), ("recurrent", layer.recurrent)):
        stored = arrays[f"0/{name}_8bit"]
        assert stored.dtype == np.int8
        assert np.array_equal(stored.astype(np.float32) / 32, quantise(matrix))
    assert arrays["0/weight_8bit"][0].tolist() == [-128, 127]


def test_exporting_again_replaces_a_bundle_and_nothing_else(made, tmp_path):
    write(made, tmp_path / "b")
    write(replace(made, phi=None, theta=None), tmp_path / "b")
    assert read(tmp_path / "b").phi is None
    assert "at the end of the window" in (tmp_path / "b" / "README.md").read_text()
    (tmp_path / "empty").mkdir()
    write(made, tmp_path / "empty")
    assert read(tmp_path / "empty").phi == 4
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter.tex").write_text("years of work")
    with pytest.raises(BundleError, match="thesis: exists and is not a bundle"):
        write(made, tmp_path / "thesis")
    assert (tmp_path / "thesis" / "chapter.tex").read_text() == "years of work"


def test_another_family_answers_at_a_time_for_one_head(made, tmp_path):
    heads = (
        Head("fabric", ("felt", "silk"), np.array([0, 0, 1])),
        Head("speed", ("slow", "fast"), np.array([0, 1, 0])),
    )
    fitted = Parameters({"counts": np.arange(6).reshape(2, 3), "names": np.array(["a", "b"])}, 4)
    given = replace(
        made,
        fitted=fitted,
        sections=sections({**RASTER, "model": {"kind": "knn"}}),
        phi=None,
        theta=None,
        read_out_ms=250.0,
        heads=heads,
        head="speed",
    )
    write(given, tmp_path / "b")
    found = read(tmp_path / "b")
    assert found.fitted.n_channels == 4 and set(found.fitted.arrays) == {"counts", "names"}
    assert np.array_equal(found.fitted.arrays["counts"], fitted.arrays["counts"])
    assert (found.read_out_ms, found.head) == (250.0, "speed")
    for head, put in zip(found.heads, heads, strict=True):
        assert (head.name, head.classes) == (put.name, put.classes)
        assert head.of_class.tolist() == put.of_class.tolist() and head.of_class.dtype == np.int64
    text = (tmp_path / "b" / "README.md").read_text()
    assert "a classifier of slow, fast" in text
    assert "The class that the classifier names after 250 ms." in text
    assert "family `knn`" in text and "`own/counts`, `own/names`" in text


def test_a_net_that_is_read_out_early_says_when(made, tmp_path):
    write(replace(made, phi=None, theta=None, read_out_ms=40.0), tmp_path / "b")
    assert "most output spikes after 40 ms (lowest on ties)" in (tmp_path / "b" / "README.md").read_text()


PLUGIN = """from dataclasses import dataclass
from dse.base.registry import register
@register("encoders", "of_a_bundle")
@dataclass(frozen=True)
class OfABundle:
    order: int = 2
    n_channels = positions = encode_all = str
"""


@pytest.fixture
def plugin(tmp_path, monkeypatch):
    encoders = registry.known("encoders")
    monkeypatch.setattr(registry, "_plugins", {})
    monkeypatch.setattr(registry, "_components", {**registry._components, "encoders": encoders})
    path = tmp_path / "mine.py"
    path.write_text(PLUGIN)
    return path


def test_a_bundle_carries_its_plugins_and_loads_them(trusting, made, plugin, tmp_path):
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "mine.py").write_text("x = 1\n")
    plugins = (str(plugin), str(tmp_path / "other" / "mine.py"), "json")
    write(replace(made, plugins=plugins), tmp_path / "b")
    assert "of_a_bundle" not in registry.known("encoders")
    plugin.unlink()
    bundle = read(tmp_path / "b")
    assert bundle.plugins == (
        str(tmp_path / "b" / "plugins" / "mine.py"),
        str(tmp_path / "b" / "plugins" / "_mine.py"),
        "json",
    )
    component = registry.known("encoders")["of_a_bundle"]
    loaded = registry.plugin_of(component)
    assert loaded is not None and loaded.source == bundle.plugins[0]
    assert registry.plugin_of(Bundle) is None
    write(bundle, tmp_path / "again")
    assert (tmp_path / "again" / "plugins" / "mine.py").read_text() == PLUGIN


@pytest.mark.parametrize(
    ("text", "message"),
    [("damaged", r"plugins/mine\.py: is damaged"), (None, r"plugins/mine\.py: is missing")],
)
def test_a_plugin_that_has_changed_is_not_run(made, plugin, tmp_path, text, message):
    write(replace(made, plugins=(str(plugin),)), tmp_path / "b")
    copy = tmp_path / "b" / "plugins" / "mine.py"
    if text is None:
        copy.unlink()
    else:
        copy.write_text(text)
    with pytest.raises(BundleError, match=message):
        read(tmp_path / "b")
    assert "of_a_bundle" not in registry.known("encoders")


def test_a_plugin_that_fails_is_named(trusting, made, plugin, tmp_path):
    plugin.write_text("raise RuntimeError('no licence')\n")
    write(replace(made, plugins=(str(plugin),)), tmp_path / "b")
    with pytest.raises(BundleError, match=r"plugin '.*mine\.py': RuntimeError in line 1 .*no licence"):
        read(tmp_path / "b")
    with pytest.raises(BundleError, match="no module 'none_such' is installed"):
        write(replace(made, plugins=("none_such",)), tmp_path / "c")
        read(tmp_path / "c")
