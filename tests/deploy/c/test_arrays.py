"""Stored weights: the smallest form, and nothing lost in it; variables and text from templates."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.instructions import made_network, work_of
from dse.deploy.c.arrays import Member, Table, laid_out, members_of, stored, struct_bytes
from dse.deploy.c.plan import plan_of
from dse.deploy.c.text import filled
from tests.deploy.bundles import network
from tests.deploy.c.nets import bundle


def read_back(matrix):
    """Return the weights that C reads, (input, neuron)."""
    tables = {table.name: table.values for table in matrix.tables("w")}
    n_inputs, n = matrix.weights.shape
    out = np.zeros((n_inputs, matrix.row_length), np.int64)
    if matrix.form == "bytes":
        out[:] = tables["w"].reshape(n_inputs, n)
    elif matrix.form == "words":
        words = tables["w"].reshape(n_inputs, matrix.words_per_row)
        for k in range(matrix.per_word):
            field = (words >> (matrix.bits * k)) & (2**matrix.bits - 1)
            out[:, k :: matrix.per_word] = (field ^ 2 ** (matrix.bits - 1)) - 2 ** (matrix.bits - 1)
    else:
        for i in range(n_inputs):
            part = slice(int(tables["w_begin"][i]), int(tables["w_begin"][i + 1]))
            out[i, tables["w_column"][part]] = tables["w"][part]
    assert not out[:, n:].any()
    return out[:, :n] << matrix.exponent


@pytest.mark.parametrize(
    ("low", "high", "kept", "form", "bits"),
    [
        (-128, 128, 1.0, "bytes", 8),
        (-4, 4, 1.0, "words", 3),
        (-2, 2, 1.0, "words", 2),
        (-8, 8, 0.1, "sparse", 4),
    ],
)
def test_weights_survive_their_form(low, high, kept, form, bits):
    rng = np.random.default_rng(1)
    weights = rng.integers(low, high, (40, 33)) * (rng.random((40, 33)) < kept)
    weights[0, 0], weights[0, 1] = low, high - 1
    matrix = stored(weights)
    assert (matrix.form, matrix.bits) == (form, bits)
    assert np.array_equal(read_back(matrix), weights)


def test_a_shared_exponent_saves_bits():
    matrix = stored(np.array([[-128, 64], [0, -64]] * 20))
    assert (matrix.exponent, matrix.bits) == (6, 2)
    assert np.array_equal(read_back(matrix), matrix.weights)


# Of the last two, forward weights need more than 4 bits and recurrent ones do not.
@pytest.mark.parametrize("seed", [14, 87, 126])
def test_prices_know_the_form_of_every_matrix(seed):
    made, engine, bits = made_network(seed)
    forms = {m.form for x in plan_of(made).layers for m in (x.forward, x.back) if m is not None}
    work = work_of(made, engine, bits)
    kinds = {"bytes": "synapse_cycles", "words": "packed_cycles", "sparse": "list_cycles"}
    assert {form for form, kind in kinds.items() if work[kind]} == forms


@pytest.mark.parametrize("shape", [(1, 1), (5, 1), (3, 300)])
def test_nothing_but_zeros(shape):
    matrix = stored(np.zeros(shape, np.int64))
    assert not read_back(matrix).any()
    assert all(isinstance(table, Table) and table.values.size for table in matrix.tables("w"))


def test_a_template_walks_objects(tmp_path):
    each = "@each layers\n@if recurrent\n$k.$state.first;\n@else\n${k}u of $n\n@end\n@end\n"
    (tmp_path / "x").write_text(f"{each}@if not n\nnone\n@end\n")
    layers = [SimpleNamespace(k=k, recurrent=k == 2, state=SimpleNamespace(first=7)) for k in (1, 2)]
    assert filled(tmp_path / "x", SimpleNamespace(layers=layers, n=5), n=9) == "1u of 9\n2.7;\n"
    assert filled(tmp_path / "x", layers=[{"k": 0, "recurrent": 0}], n=0) == "0u of 0\nnone\n"
    (tmp_path / "y").write_text(f"first\n@include {tmp_path}/${{which}}\n")
    assert filled(tmp_path / "y", which="x", layers=[], n=0) == "first\nnone\n"
    with pytest.raises(KeyError, match="layers"):
        filled(tmp_path / "x", n=1)


def test_variables_are_declared_once(tmp_path):
    (tmp_path / "x").write_text("uint8_t pushed; any: yes; no\n0 int32_t u[$n][2];\ndouble last[3]; of all\n")
    members = members_of(tmp_path / "x", n=5)
    assert members == [
        Member("uint8_t", "pushed", (), "any: yes; no"),
        Member("int32_t", "u", (5, 2), "", True),
        Member("double", "last", (3,), "of all"),
    ]
    assert struct_bytes(members) == 72  # 1 + 24 + 40, as doubles lie
    assert [x.text for x in laid_out(members)] == [
        "    uint8_t pushed; /* any: yes; no */",
        "    double last[3]; /* of all */",
        "    int32_t u[5][2];",
    ]


@pytest.mark.parametrize(
    ("options", "parts"),
    [
        ({}, {"cuba_lif": 2, "short_matrix": 2, "short_row": 7 + 3}),
        (
            {"sizes": (4, 300, 5), "delays": (0, 3), "recurrent": True},
            {"cuba_lif": 2, "add_bytes": 1, "recurrent": 1, "short_matrix": 1, "short_row": 5}
            | {"delayed_copies": 1, "many_classes": 1},
        ),
        (
            {"sizes": (4, 9, 9, 3), "resonates": True},
            {"mixed": 2, "cuba_lif": 1, "short_matrix": 3, "short_row": 9 + 9 + 3},
        ),
        ({"sizes": (40, 60, 30, 3), "pruned": 0.9}, {"cuba_lif": 3, "add_sparse": 1}),
    ],
)
def test_a_program_has_the_parts_of_its_network(options, parts):
    """Its flash is predicted from them (`dse.deploy.c.code_size`)."""
    made = bundle(network(np.random.default_rng(3), **options), 40)
    assert +plan_of(made).parts() == {"base": 1, **parts}
    early = replace(made, phi=2.0, theta=0.5)
    assert +plan_of(early).parts() == {"base": 1, "confidence": 1, **parts}


@pytest.mark.parametrize(("kind", "third"), [("float", "0.33333334f"), ("double", "0.3333333333333333")])
def test_a_constant_is_written_as_the_shortest_decimals_that_are_it(kind, third):
    written = Table(kind, "x", np.array([1 / 3, 2.0])).text
    assert written == f"static const {kind} x[2] = {{\n    {third}, 2.0{'f' * (kind == 'float')},\n}};\n"
