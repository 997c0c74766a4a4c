"""Sealed files: every change of every byte is an error, and other programs read them as before."""

from __future__ import annotations

import contextlib
import itertools
import json
import random
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml

from dse import store
from dse.study.results import Study, plain_space
from tests.faults.damage import unsealed

DOCUMENT = {"name": "Stoff", "numbers": [1, 2.5, None]}
ARRAYS = {"x": np.arange(50), "name": np.array("wool")}
TABLE = pd.DataFrame({"trial": [0, 1, 2], "accuracy": [0.25, 0.5, 1.0], "name": ["a", "b", None]})


def _write_table(path: Path) -> None:
    store.write_table(path, TABLE)


def _read_table(path: Path) -> pd.DataFrame:
    with contextlib.suppress(FileNotFoundError):
        path.rename(path.with_name("trials.parquet"))
    return Study(path.parent).trials


def _read_yaml(path: Path) -> Any:
    return plain_space(path)


FORMS: dict[str, tuple[Callable[[Path], None], Callable[[Path], Any]]] = {
    "x.json": (lambda path: store.write_json(path, DOCUMENT), store.read_json),
    "rows.json": (lambda path: store.write_json(path, [DOCUMENT, DOCUMENT]), store.read_json),
    "x.yaml": (lambda path: store.write_sealed_text(path, yaml.dump(DOCUMENT)), _read_yaml),
    "x.npz": (lambda path: store.save_arrays(path, ARRAYS), store.load_arrays),
    "x.parquet": (_write_table, _read_table),
}


@pytest.mark.parametrize("name", FORMS)
def test_a_change_of_any_byte_is_an_error_or_changes_nothing_that_is_read(tmp_path: Path, name: str) -> None:
    write, read = FORMS[name]
    path = tmp_path / name
    write(path)
    content = path.read_bytes()
    assert store.is_sealed(content)
    expected = repr(read(path))
    rng = random.Random(name)
    n_read = 0
    for _ in range(150):
        damaged = bytearray(content)
        kind = rng.choice(("flip", "flip", "cut", "zeros", "double"))
        place = rng.randrange(len(content))
        if kind == "flip":
            damaged[place] ^= 1 << rng.randrange(8)
        elif kind == "cut":
            del damaged[place:]
        elif kind == "zeros":
            damaged[place : place + 64] = bytes(len(damaged[place : place + 64]))
        else:
            damaged[place:place] = damaged[place : place + 40]
        path.write_bytes(damaged)
        try:
            assert repr(read(path)) == expected, (kind, place)
            n_read += 1  # the word `dse-sha256` itself was hit, outside of a study
        except store.Damaged as error:
            assert str(error).startswith(f"{tmp_path}/")
    assert n_read < 40


def test_other_programs_read_sealed_files(tmp_path: Path) -> None:
    for name, (write, _) in FORMS.items():
        write(tmp_path / name)
    document = json.loads((tmp_path / "x.json").read_text())
    assert document.pop("seal").startswith("dse-sha256:")
    assert document == DOCUMENT
    assert json.loads((tmp_path / "rows.json").read_text())["rows"] == [DOCUMENT, DOCUMENT]
    assert yaml.safe_load((tmp_path / "x.yaml").read_text()) == DOCUMENT
    with np.load(tmp_path / "x.npz") as archive:
        assert {key: archive[key].tolist() for key in archive.files} == {"x": [*range(50)], "name": "wool"}
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "x.parquet"), TABLE)


@pytest.mark.parametrize("name", FORMS)
def test_a_removed_seal_is_an_error_in_a_study_that_has_always_had_seals(tmp_path: Path, name: str) -> None:
    write, read = FORMS[name]
    write(tmp_path / name)
    (tmp_path / name).write_bytes(unsealed((tmp_path / name).read_bytes()))

    def write_sessions(*sessions: Any) -> None:
        store.write_json(tmp_path / store.ENVIRONMENT, sessions)

    write_sessions({"sealed": True}, {"sealed": True})
    with pytest.raises(store.Damaged, match="its checksum is missing"):
        read(tmp_path / name)
    write_sessions({"started": "2025"}, {"sealed": True})  # begun by an earlier version
    read(tmp_path / name)


@pytest.mark.parametrize("name", FORMS)
def test_a_file_of_another_study_is_an_error(tmp_path: Path, name: str) -> None:
    write, read = FORMS[name]
    name = "trials.parquet" if name == "x.parquet" else name
    for folder, identity in (("one", "1" * 16), ("two", "2" * 16), ("before", "")):
        (tmp_path / folder / "deep").mkdir(parents=True)
        session = {"sealed": True, **({"identity": identity} if identity else {})}
        store.write_json(tmp_path / folder / store.ENVIRONMENT, [session])
        write(tmp_path / folder / "deep" / name)
    expected = repr(read(tmp_path / "one" / "deep" / name))
    for target, source in itertools.permutations(("one", "two", "before"), 2):
        path = tmp_path / target / "deep" / f"{source}_{name}"
        shutil.copy(tmp_path / source / "deep" / name, path)
        with pytest.raises(store.Damaged, match="is a file of another study"):
            store.verify(path)
    moved = tmp_path / "one" / "deep"
    moved.rename(tmp_path / "elsewhere")  # out of any study
    assert repr(read(tmp_path / "elsewhere" / name)) == expected
    shutil.copytree(tmp_path / "two", tmp_path / "copy")
    assert repr(read(tmp_path / "copy" / "deep" / name)) == expected


def test_files_of_earlier_versions_are_read_as_they_are(tmp_path: Path) -> None:
    (tmp_path / "x.json").write_text(json.dumps([DOCUMENT]))
    assert store.read_json(tmp_path / "x.json") == [DOCUMENT]
    (tmp_path / "x.yaml").write_text("# of 2025\na: 1\n")
    assert store.read_sealed_text(tmp_path / "x.yaml") == "# of 2025\na: 1\n"
    np.savez_compressed(tmp_path / "x.npz", **ARRAYS)  # type: ignore[arg-type]
    assert store.load_arrays(tmp_path / "x.npz", ["x"])["x"].tolist() == [*range(50)]
