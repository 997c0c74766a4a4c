"""A folder as versions up to 0.9 wrote it becomes one of today; what is damaged in it is named and kept."""

import hashlib
import json

import numpy as np
import pytest

from dse import store
from dse.study.doctor import examine
from dse.study.earlier import convert
from dse.study.held import plain_space

ZEROS = "0" * 64
SPACE = """study: tiny
seed: 7
search: {batch: 8, stop: {cpu_hours: null,
    wall_hours: 2.0}, from: []}
execution: {backend: loky,
  storage: sqlite:///shared.db, jobs: 1}
"""


def write_sealed(path, document):
    text = json.dumps({"seal": f"dse-sha256:{ZEROS}", **document})
    path.write_text(text.replace(ZEROS, hashlib.sha256(text.encode()).hexdigest(), 1))


@pytest.fixture
def earlier(tmp_path):
    """A folder of two runs and one warning."""
    (tmp_path / store.SPACE).write_text(SPACE)
    for trial in (0, 1):
        run = tmp_path / "artefacts" / f"{trial:05d}" / "repeat_0"
        run.mkdir(parents=True)
        np.savez(run / "history.npz", loss=np.array([0.5, 0.25]))
        files = {"history.npz": store.checksum(run / "history.npz")}
        record = {
            "schema": 1,
            "trial": trial,
            "repeat": 0,
            "design": {"x": trial},
            "leak": "",
            "files": files,
        }
        write_sealed(run / store.RECORD, record)
    write_sealed(tmp_path / "warnings.json", {"rows": ["labels are few"]})
    return tmp_path


def test_an_earlier_folder_is_converted(earlier):
    assert [damage.file for damage in examine(earlier)] == [store.BOOK]
    convert(earlier)
    for trial in (0, 1):
        run = store.run_file(earlier, trial, 0)
        assert store.read_record(run)["design"] == {"x": trial}
        assert store.load_arrays(run / "history.npz")["loss"].tolist() == [0.5, 0.25]
    assert store.document(earlier, store.WARNINGS) == ["labels are few"]
    space = plain_space(earlier / store.SPACE)
    assert space["search"] == {"batch": 8, "stop": None, "from": []}
    assert space["execution"] == {"backend": "loky", "jobs": 1}
    assert not (earlier / "artefacts").exists() and not (earlier / "artefacts.damaged").exists()


@pytest.mark.parametrize("name", ["record.json", "history.npz"])
def test_a_damaged_run_of_an_earlier_folder_is_named_and_kept(earlier, name):
    path = earlier / "artefacts/00001/repeat_0" / name
    content = bytearray(path.read_bytes())
    content[-3] ^= 1
    path.write_bytes(content)
    convert(earlier)
    assert (earlier / "artefacts.damaged/00001/repeat_0" / name).read_bytes() == content
    assert store.runs_in(earlier) == {0: [0]}


def test_a_damaged_document_of_an_earlier_folder_is_kept(earlier):
    path = earlier / "warnings.json"
    path.write_text(path.read_text().replace("few", "two"))
    convert(earlier)
    assert "two" in (earlier / "warnings.json.damaged").read_text()
    assert store.document(earlier, store.WARNINGS) is None
