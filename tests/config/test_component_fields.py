"""A field that names a component: the component's own keys stand beside it in the same mapping."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pytest

from dse.base import registry
from dse.base.registry import param
from dse.config import ConfigError, Sections, load_space
from dse.config.values import dotted, plain, read_object
from dse.search.space import corners
from tests.spaces import grid, write_space


@dataclass(frozen=True)
class Leaky:
    tau_ms: float = param(20.0, low=0, low_open=True, unit="ms", doc="time constant")


@dataclass(frozen=True)
class Adaptive:
    tau_ms: float = param(30.0, low=0, low_open=True, unit="ms", doc="time constant")
    beta: float = param(1.6, low=0, doc="strength of the adaptation")

    def __post_init__(self) -> None:
        if self.beta > self.tau_ms:
            raise ValueError(f"beta must be at most tau_ms = {self.tau_ms:g}, got {self.beta:g}")


@dataclass(frozen=True)
class Texts:
    tau_ms: str = param("slow", doc="time constant in words")


@dataclass(frozen=True)
class Net:
    hidden: tuple[int, ...] = param((8,), low=1, doc="neurons")
    neuron: Any = param(  # noqa: RUF009
        "leaky_of_a_test", component="neurons", doc="kind of the neurons"
    )


@dataclass(frozen=True)
class Clash:
    beta: float = 1.0
    neuron: Any = param(  # noqa: RUF009
        "leaky_of_a_test", component="neurons", doc="kind of the neurons"
    )


@pytest.fixture(autouse=True)
def components():
    neurons = {"leaky_of_a_test": Leaky, "adaptive_of_a_test": Adaptive, "texts_of_a_test": Texts}
    named = {"neurons": neurons, "models": {"net": Net}}
    for section, classes in named.items():
        registry.known(section)
        registry._components[section].update(classes)
    yield
    for section, classes in named.items():
        for name in classes:
            registry._components[section].pop(name)


def read(value, cls=Net):
    faults = []
    found = read_object(cls, value, ("model",), lambda path, text: faults.append(f"{dotted(path)}: {text}"))
    return found, faults


def test_its_keys_stand_beside_its_name():
    assert Net() == read({})[0] == Net((8,), Leaky(20.0))
    found, _ = read({"neuron": "adaptive_of_a_test", "beta": 2, "hidden": 4})
    assert found == Net((4,), Adaptive(30.0, 2.0))
    assert plain(found) == {"hidden": (4,), "neuron": "adaptive_of_a_test", "tau_ms": 30.0, "beta": 2.0}
    assert read(plain(found))[0] == found
    assert read({"tau_ms": 5})[0] == Net((8,), Leaky(5.0))


@pytest.mark.parametrize(
    ("keys", "fault"),
    [
        ({"beta": 2}, "model.beta: unknown key 'model.beta'; known: hidden, neuron, tau_ms"),
        ({"neuron": "leaky_of_a_tset"}, "model.neuron: unknown model.neuron 'leaky_of_a_tset'; known: "),
        ({"tau_ms": 0}, "model.tau_ms: model.tau_ms must be > 0, got 0.0"),
        ({"neuron": "adaptive_of_a_test", "beta": 40}, "model.beta: model.beta must be at most tau_ms ="),
    ],
)
def test_mistakes_in_them(keys, fault):
    found, faults = read(keys)
    assert found is None and faults[0].startswith(fault)


def test_a_key_that_both_have_is_refused():
    _, faults = read({"neuron": "adaptive_of_a_test"}, Clash)
    assert faults == ["model.neuron: model.neuron must not name a component with a key of Clash, 'beta'"]


def test_they_may_be_axes(tmp_path):
    old = "{kind: snn, hidden: {choice: [4, 8, 12]}, true_rate: 0.8}"
    net = (
        "{kind: net, neuron: adaptive_of_a_test, tau_ms: {choice: [20, 40]}, beta: {range: [0, 2], step: 1}}"
    )
    space = load_space(write_space(tmp_path, (old, net)))
    assert [name for name in space.axes if name.startswith("model.")] == ["model.tau_ms", "model.beta"]
    design = {"encoder.thresholds": (1.0, 2.0), "model.tau_ms": 40.0, "model.beta": 2.0}
    sections = space.resolve(design)
    assert sections.model == Net((8,), Adaptive(40.0, 2.0))
    assert Sections.from_plain(sections.to_plain(), "a record") == sections
    again = tmp_path / "again.yaml"
    again.write_text(space.to_yaml(), encoding="utf-8")
    assert load_space(again).to_yaml() == space.to_yaml()


OLD = "{kind: snn, hidden: {choice: [4, 8, 12]}, true_rate: 0.8}"
BOTH = "neuron: {choice: [leaky_of_a_test, adaptive_of_a_test]}"


def test_the_component_may_be_an_axis_and_axes_of_its_own_keys_belong_to_it(tmp_path):
    net = f"{{kind: net, {BOTH}, beta: {{choice: [1, 2]}}}}"
    space = load_space(write_space(tmp_path, (OLD, net)))
    condition = ("model.neuron", "adaptive_of_a_test")
    assert {name: space.axes[name].condition for name in ("model.neuron", "model.beta")} == {
        "model.neuron": None,
        "model.beta": condition,
    }
    designs = [
        {name: value for name, value in design.items() if name.startswith("model.")} for design in grid(space)
    ]
    assert designs[:3] == [
        {"model.neuron": "leaky_of_a_test"},
        {"model.neuron": "adaptive_of_a_test", "model.beta": 1.0},
        {"model.neuron": "adaptive_of_a_test", "model.beta": 2.0},
    ]
    nets = [space.resolve(design).model for design in grid(space)[:3]]
    # tau_ms is not written: each component has the default of its own.
    assert nets == [Net((8,), Leaky(20.0)), Net((8,), Adaptive(30.0, 1.0)), Net((8,), Adaptive(30.0, 2.0))]
    for design in corners(space, ("model",), 8):
        space.resolve(design)
    again = tmp_path / "again.yaml"
    again.write_text(space.to_yaml(), encoding="utf-8")
    assert load_space(again).to_yaml() == space.to_yaml()


@pytest.mark.parametrize(
    ("model", "fault"),
    [
        (f"{{kind: net, {BOTH}, tau_ms: 0}}", r"tiny.yaml:\d+: model.tau_ms must be > 0, got 0"),
        (f"{{kind: net, {BOTH}, beta: {{choice: [1, 40]}}}}", r"tiny.yaml:\d+: model.beta must be at most"),
        ("{kind: net, neuron: {choice: [leaky_of_a_tset]}}", r"model.neuron.choice\[0\] 'leaky_of_a_tset'"),
        ("{kind: net, neuron: {choice: [leaky_of_a_test, texts_of_a_test]}}", "model.neuron must not be a"),
        (f"{{choice: [knn, {{kind: net, {BOTH}, beta: {{choice: [1, 2]}}}}]}}", "model.net.beta cannot be"),
    ],
)
def test_mistakes_in_an_axis_of_components(tmp_path, model, fault):
    with pytest.raises(ConfigError, match=fault):
        load_space(write_space(tmp_path, (OLD, model)))
