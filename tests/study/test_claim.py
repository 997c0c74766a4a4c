"""A study's folder belongs to the search space, and to the plugins, that it was started with."""

import re

import pytest

from dse import store
from dse.base import registry
from dse.config import ConfigError, load_space
from dse.config.yaml_lines import dump
from dse.store import Book, read_text
from dse.study.claim import claim
from dse.study.results import Study
from tests.spaces import write_space

PLUGIN = '''
from dataclasses import dataclass
from dse.base.registry import register

@register("encoders", "encoder_of_a_claim")
@dataclass(frozen=True)
class OfAClaim:
    """An encoder of a user."""
    n_channels = positions = encode_all = str
'''


def test_a_plugin_that_changed_or_is_gone_is_one_line(trusting, tmp_path):
    file, folder = tmp_path / "mine.py", tmp_path / "results" / "tiny"
    file.write_text(PLUGIN)
    path = write_space(tmp_path, ("seed: 3\n", "seed: 3\nplugins: [mine.py]\n"))
    folder.mkdir(parents=True)
    book = Book(folder, writes=True)
    claim(load_space(path), book)
    file.write_text(PLUGIN + "# changed before a run has finished\n")
    claim(load_space(path), book)
    (folder / "runs" / "00000-0.npz").mkdir(parents=True)
    claim(load_space(path), book)
    [copy] = (folder / "plugins").iterdir()
    assert (copy.name, read_text(copy)) == ("0_mine.py", file.read_text())

    file.write_text(PLUGIN)
    with pytest.raises(ConfigError) as changed:
        claim(load_space(path), book)
    assert str(changed.value).startswith(
        f"{file}: differs from {copy}, which {folder} was started with; change"
    )
    assert len(changed.value.faults) == 1

    file.unlink()
    with pytest.raises(
        ConfigError, match=r"^\S+:3: plugin 'mine.py': cannot read \S+: No such file or directory$"
    ):
        load_space(path)
    registry.left_out()
    Study(folder).load_plugins()
    [why] = registry.left_out()
    assert re.match(r"plugin '\S+': cannot read \S+: No such file or directory$", why)


def test_a_study_that_began_before_a_key_was_known_goes_on(tmp_path):
    folder, path = tmp_path / "results" / "tiny", write_space(tmp_path)
    folder.mkdir(parents=True)
    book, space = Book(folder, writes=True), load_space(path)
    claim(space, book)
    (folder / "runs" / "00000-0.npz").mkdir(parents=True)
    written = space.to_plain()
    assert written["window"].pop("pad") is False and written["training"].pop("keep") == "last"
    store.write_text(folder / "search_space.yaml", dump(written))
    claim(space, book)
    assert "pad" in read_text(folder / "search_space.yaml")
    store.write_text(folder / "search_space.yaml", dump({**written, "window": {"n_steps": 7}}))
    with pytest.raises(ConfigError, match=r"window\.n_steps is .* was started with 7") as other:
        claim(space, book)
    assert len(other.value.faults) == 1
