"""Networks and responses survive the disk."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import pytest
from typing_extensions import TypeAliasType

from dse import store
from dse.base.records import (
    Answers,
    Array,
    Floats,
    Layer,
    Network,
    Operations,
    Parameters,
    Response,
    Workload,
)
from tests.layers import cuba_parameters

Scalar = TypeVar("Scalar", bound=np.generic)
NDArray = TypeAliasType("NDArray", np.ndarray[tuple[Any, ...], np.dtype[Scalar]], type_params=(Scalar,))
"""As NumPy 2.5 defines it."""


@dataclass(frozen=True)
class Aliased:
    weight: NDArray[np.floating[Any]]
    delay: NDArray[Any] | None = None


def test_an_array_by_the_alias_of_numpy_2_5_survives_the_disk():
    arrays = store.record_arrays(Aliased(np.ones(3)))
    assert set(arrays) == {"weight"}
    found = store.record_of(Aliased, arrays)
    assert found.weight.tolist() == [1, 1, 1] and found.delay is None


def test_arrays_that_are_no_archive_are_named(tmp_path):
    (tmp_path / "x.npz").write_bytes(b"no zip")
    with pytest.raises(store.StoreError, match=r"x\.npz: cannot be read"):
        store.load_arrays(tmp_path / "x.npz")


def test_a_header_that_is_no_text_of_python_is_damage(tmp_path):
    header = io.BytesIO()
    np.save(header, np.zeros(4))
    with zipfile.ZipFile(tmp_path / "x.npz", "w") as archive:
        archive.writestr("a.npy", header.getvalue().replace(b"'shape'", b"'shap_("))
    with pytest.raises(store.Damaged, match=r"x\.npz: cannot be read"):
        store.load_arrays(tmp_path / "x.npz")


@pytest.mark.parametrize("compressed", [True, False])
def test_arrays_of_every_kind_are_those_that_numpy_reads(tmp_path, compressed):
    arrays = {
        "columns first": np.asfortranarray(np.arange(12.0).reshape(3, 4)),
        "none": np.zeros((0, 3)),
        "one": np.array(3, ">i4"),
        "names": np.array(["felt", "silk"]),
        "no letters": np.array("", "<U1"),
        "a long header": np.zeros(2, [(f"column {k}", "<f8", (2,)) for k in range(30)]),
    }
    store.save_arrays(tmp_path / "x.npz", arrays, compressed=compressed)
    found, by_numpy = store.load_arrays(tmp_path / "x.npz"), np.load(tmp_path / "x.npz")
    assert list(found) == list(arrays)
    for name, x in found.items():
        np.testing.assert_array_equal(x, by_numpy[name], strict=True)
        assert x.flags.writeable and x.flags.f_contiguous == by_numpy[name].flags.f_contiguous
    np.savez(tmp_path / "x.npz", x=np.array([print]))
    with pytest.raises(store.Damaged, match="allow_pickle"):
        store.load_arrays(tmp_path / "x.npz")


def test_a_network_survives_the_disk(tmp_path):
    rng = np.random.default_rng(0)
    layers = tuple(
        Layer(
            weight=rng.normal(size=(n, m)).astype(np.float32),
            recurrent=ring,
            parameters=cuba_parameters(
                rng.integers(0, 4096, n, dtype=np.int32), rng.integers(0, 4096, n, dtype=np.int32), 80
            ),
        )
        for m, n, ring in ((6, 5, np.eye(5, dtype=np.float32)), (5, 3, None))
    )
    network = Network(layers, n_channels=3, delays=(0, 2), steps_per_sample=2, arithmetic="ideal")
    store.save_arrays(tmp_path / "w.npz", store.record_arrays(network))
    restored = store.record_of(Network, store.load_arrays(tmp_path / "w.npz"))
    assert (restored.n_channels, restored.delays, restored.steps_per_sample, restored.arithmetic) == (
        3,
        (0, 2),
        2,
        "ideal",
    )
    for got, put in zip(restored.layers, layers, strict=True):
        assert (got.recurrent is None) == (put.recurrent is None)
        assert got.neuron == put.neuron == "cuba_lif"
        assert np.array_equal(got.weight, put.weight)
        assert set(got.parameters) == {"decay_current", "decay_voltage", "threshold"}
        for name, values in put.parameters.items():
            assert np.array_equal(got.parameters[name], values)
    assert np.array_equal(restored.layers[0].recurrent, np.eye(5))
    with pytest.raises(store.StoreError, match="needs the array '1/weight'"):
        store.record_of(Network, {k: v for k, v in store.record_arrays(network).items() if k != "1/weight"})


def test_a_response_survives_the_disk(tmp_path):
    rng = np.random.default_rng(0)
    response = Response(
        output=rng.integers(0, 2, (3, 7, 5), dtype=np.uint8),
        spikes=rng.integers(0, 9, (3, 7, 2), dtype=np.int32),
        updates=rng.integers(0, 9, (3, 7, 1), dtype=np.int32),
        step_ms=2.5,
        peak_state=2**31,
    )
    arrays = store.response_arrays(response, np.array([4, 9, 2]))
    assert arrays["output"].nbytes == 14  # 105 spikes in bits
    store.save_arrays(tmp_path / "r.npz", arrays)
    restored = store.response_of(store.load_arrays(tmp_path / "r.npz"))
    for name in ("output", "spikes", "updates"):
        assert np.array_equal(getattr(restored, name), getattr(response, name))
        assert getattr(restored, name).dtype == getattr(response, name).dtype
    assert (restored.step_ms, restored.peak_state) == (2.5, 2**31)


def test_what_a_pruned_net_reached_survives_the_disk():
    nothing = np.zeros((1, 2, 3), np.int32)
    response = Response(nothing.astype(np.uint8), nothing, nothing[..., :2], 1.0, 0, (2.5, 1.0, 0.0))
    assert store.response_of(store.response_arrays(response, np.array([0]))).synapses == (2.5, 1.0, 0.0)
    plain = Response(nothing.astype(np.uint8), nothing, nothing[..., :2], 1.0, 0)
    assert store.response_of(store.response_arrays(plain, np.array([0]))).synapses is None


def test_a_family_reads_back_its_own_arrays(tmp_path):
    own = {"n_layers": np.array([3, 4]), "names": np.array(["felt", "silk"]), "0/weight": np.eye(2)}
    store.save_arrays(tmp_path / "w.npz", store.record_arrays(Parameters(own, 7)))
    restored = store.fitted_of(store.load_arrays(tmp_path / "w.npz"))
    assert restored.n_channels == 7 and set(restored.arrays) == set(own)
    assert all(np.array_equal(restored.arrays[name], x) for name, x in own.items())
    layer = Layer(
        np.eye(2, dtype=np.float32), None, cuba_parameters(np.ones(2, np.int32), np.ones(2, np.int32), 80)
    )
    network = Network((layer,), 2, (0,), 1, "integer")
    assert isinstance(store.fitted_of(store.record_arrays(network)), Network)
    with pytest.raises(store.StoreError, match="needs the array 'n_channels'"):
        store.fitted_of({"own/x": np.eye(2)})


def test_answers_are_stored_with_their_samples(tmp_path):
    k = np.arange(2)
    answers = Answers(np.eye(2, dtype=np.int64), k + 1.0, k, k * 1.0, k * 2.0, np.eye(2, dtype=np.int64))
    store.save_arrays(tmp_path / "a.npz", store.response_arrays(answers, np.array([4, 9])))
    restored = store.load_arrays(tmp_path / "a.npz")
    assert restored.pop("index").tolist() == [4, 9]
    assert all(np.array_equal(x, vars(answers)[name]) for name, x in restored.items()) and len(restored) == 6


@dataclass(frozen=True)
class Cell:
    """A record within records."""

    gain: Floats
    name: str
    bias: Floats | None = None


@dataclass(frozen=True)
class Net:
    """A record of every kind of field that can be stored."""

    cells: tuple[Cell, ...]
    first: Cell
    spare: Cell | None
    sizes: tuple[int, ...]
    shares: tuple[float, ...] | None
    names: tuple[str, ...]
    on: bool
    extra: Mapping[str, Array]


@pytest.mark.parametrize("full", [True, False])
def test_any_record_survives_the_disk(tmp_path, full):
    cell = Cell(np.arange(3.0), "a", np.eye(2) if full else None)
    net = Net(
        cells=(cell, Cell(np.zeros(0), "b")) if full else (),
        first=cell,
        spare=cell if full else None,
        sizes=(3, 4) if full else (),
        shares=(0.5, 2.0) if full else None,
        names=("felt", "silk"),
        on=full,
        extra={"x/y": np.arange(2)} if full else {},
    )
    store.save_arrays(tmp_path / "net.npz", store.record_arrays(net, "net/"))
    arrays = store.load_arrays(tmp_path / "net.npz")
    loaded = store.record_of(Net, arrays | {"other": np.arange(2)}, "net/")
    assert repr(loaded) == repr(net)
    assert {name.removeprefix("net/") for name in arrays} == {
        "n_cells", "first/gain", "first/name", "sizes", "names", "on",
        *(["cells/0/gain", "cells/0/name", "cells/0/bias", "cells/1/gain", "cells/1/name"] if full else []),
        *(["first/bias", "spare/gain", "spare/name", "spare/bias", "shares", "extra/x/y"] if full else []),
    }  # fmt: skip
    del arrays["net/first/gain"]
    with pytest.raises(store.StoreError, match="Cell needs the array 'net/first/gain'"):
        store.record_of(Net, arrays, "net/")


def test_a_field_that_cannot_be_stored_is_named():
    @dataclass(frozen=True)
    class Odd:
        health: dict[str, Any]

    with pytest.raises(TypeError, match=r"Odd\.health: .*dict.* cannot be stored as arrays"):
        store.record_arrays(Odd({}))
    with pytest.raises(TypeError, match=r"Odd\.health"):
        store.record_of(Odd, {})


def test_work_survives_the_disk_beside_other_arrays(tmp_path):
    steps = np.arange(3.0)
    loads = [
        Workload(
            sizes=(4, 3), recurrent=(True,), n_steps=steps, spikes=np.ones((3, 2)), updates=None, step_ms=2.5,
            stored=(12,), delay_bits=6, cores=(2,), pipeline_steps=1,
        ),
        Operations(steps, steps, steps, steps, steps, number_bits=16),
    ]  # fmt: skip
    for load in loads:
        store.save_arrays(tmp_path / "x.npz", {"accuracy": steps, **store.work_arrays(load)})
        assert repr(store.work_of(store.load_arrays(tmp_path / "x.npz"))) == repr(load)
