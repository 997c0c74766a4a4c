"""Saved views of the page: written, replaced, removed; refused; damaged; on the page of a study."""

from __future__ import annotations

import pytest

from dse.store import Damaged, StoreError
from dse.study import doctor, saved_views


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "search_space.yaml").write_text("study: x\n")
    return tmp_path


def links(folder):
    return {view.name: view.link for view in saved_views.of(folder)}


def test_a_view_is_written_replaced_and_removed(folder):
    assert links(folder) == {}
    saved_views.write(folder, " cheap ", "b.energy_uj=20")
    saved_views.write(folder, "all", "view=3")
    saved_views.write(folder, "cheap", "b.energy_uj=10")
    assert links(folder) == {"all": "view=3", "cheap": "b.energy_uj=10"}
    saved_views.write(folder, "all", "")
    assert [view["name"] for view in saved_views.plain(folder)] == ["cheap"]


def test_what_cannot_be_a_view_is_refused_and_nothing_is_written(folder, monkeypatch):
    for name, link in (("", "x"), (" ", "x"), ("x" * 61, "x"), ("x", "x" * 4001)):
        with pytest.raises(StoreError, match="a name of 1 to 60 characters and a link of at most 4000"):
            saved_views.write(folder, name, link)
    assert not (folder / saved_views.FILE).exists()
    monkeypatch.setattr(saved_views, "MOST", 1)
    saved_views.write(folder, "one", "x")
    with pytest.raises(StoreError, match="at most 1 views"):
        saved_views.write(folder, "two", "x")
    assert links(folder) == {"one": "x"}


def test_a_changed_byte_shows_and_the_doctor_keeps_the_file(folder):
    saved_views.write(folder, "early", "x")
    path = folder / saved_views.FILE
    path.write_bytes(path.read_bytes().replace(b"early", b"later"))
    with pytest.raises(Damaged, match="checksum differs"):
        saved_views.of(folder)
    assert saved_views.plain(folder) == []
    (damage,) = [one for one in doctor.examine(folder) if one.file == saved_views.FILE]
    damage.repair()
    assert not path.exists() and b"later" in (folder / "views.json.damaged").read_bytes()
