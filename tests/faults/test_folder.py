"""Seeded damage to the files of a study and of the cache: none is believed, none is final."""

import contextlib
import os
import random
import resource
import shutil
from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from pandas.testing import assert_frame_equal

from dse import store
from dse.config import ConfigError, load_space
from dse.data import dataset
from dse.data.dataset import cache
from dse.study import explore, results
from dse.study.doctor import examine, repair
from dse.study.ledger import Ledger, read_entries
from dse.study.mended import opened
from dse.study.results import Study
from tests.faults.damage import damage


def _read(study):
    """Return everything that the readers of a study make of it, or the class of their error."""
    parts = {}
    readers = {
        "trials": lambda: study.trials.drop(columns="train_s"),
        "points": study.points,
        "objectives": lambda: study.objectives,
        "warnings": lambda: study.warnings,
        "chip": lambda: study.chip("loihi1_silicon").text,
        **{f"runs {trial}": lambda trial=trial: study.runs(trial) for trial in range(6)},
        **{f"read-outs {t}": lambda trial=t: study.arrays(trial, "read_out.npz") for t in range(6)},
    }
    for name, read in readers.items():
        try:
            parts[name] = read()
        except (store.StoreError, ConfigError) as error:
            parts[name] = error
    return parts


def _table(part):
    assert isinstance(part, pd.DataFrame), part
    return part.drop(columns="train_s", errors="ignore")


def _same(one, other):
    if isinstance(one, pd.DataFrame) and isinstance(other, pd.DataFrame):
        return bool(one.equals(other))
    return repr(one) == repr(other)


def _files(folder):
    """Return the files of a study, those of runs as often as all others together."""
    files = sorted(path for path in folder.rglob("*") if path.is_file() and path.name != ".lock")
    rare = [path for path in files if path.parent.name != "runs"]
    return files + rare * (len(files) // len(rare))


def test_no_reader_believes_a_damaged_file(whole, another, tmp_path, n_faults, tried):
    study = results.open(whole / "results" / "tiny")
    assert examine(study.folder) == []
    expected, rng, counts = _read(study), random.Random(20), Counter[str]()
    assert not any(isinstance(part, Exception) for part in expected.values())
    for number in range(n_faults):
        copy = Path(shutil.copytree(study.folder, tmp_path / "tiny"))
        path = rng.choice(_files(copy))
        before = path.read_bytes()
        what = damage(path, rng, another / path.relative_to(copy))
        is_changed = not path.exists() or path.read_bytes() != before
        read = _read(Study(copy))
        for name, part in read.items():
            if name == "warnings" and what == f"remove {store.BOOK}":
                continue  # a study may have none
            is_refused = isinstance(part, Exception)
            assert is_refused or _same(part, expected[name]), (number, what, name)
            counts["refused" if is_refused else "equal"] += 1
            if is_refused:
                assert "\n" not in str(part), (number, what, name)
        counts["found by doctor"] += bool(examine(copy)) and is_changed
        shutil.rmtree(copy)
        tried["a file of a study, read"] += 1
    assert counts["refused"] and counts["found by doctor"] > n_faults // 2, counts


def test_no_file_of_another_study_is_believed(whole, another, tmp_path):
    """Each file alone, then both tables, then all but the runs."""
    expected = _read(results.open(whole / "results" / "tiny"))
    space, folder = load_space(whole / "tiny.yaml"), tmp_path / "results" / "tiny"
    shutil.copytree(whole / "results" / "tiny", folder)
    names = sorted({path.relative_to(folder) for path in _files(folder)})
    of_study = [name for name in names if name.parts[0] != "runs"]
    alone = [[name] for name in (*of_study, Path("runs/00003-0.npz"))]
    for changed in (*alone, [Path("points.parquet"), Path("trials.parquet")], of_study):
        copied = [name for name in changed if (folder / name).read_bytes() != (another / name).read_bytes()]
        for name in copied:
            shutil.copy(another / name, folder / name)
        faults = {damage.file: damage.fault for damage in examine(folder)}
        assert faults or not copied, changed
        if Path(store.BOOK) not in changed:
            assert faults.keys() == {name.as_posix() for name in copied}
            of_files = {fault for name, fault in faults.items() if name != store.COPY}
            assert all("is not what was written" in fault for fault in of_files), faults
        explore.run(space, tmp_path / "results", progress=False)
        assert examine(folder) == [], changed
        read = _read(Study(folder))
        for table in ("trials", "points"):
            assert_frame_equal(
                _table(read[table]), _table(expected[table]), check_exact=True, obj=str(changed)
            )


def test_a_damaged_study_goes_on_to_the_same_tables(whole, another, tmp_path, n_faults, tried):
    expected = _read(results.open(whole / "results" / "tiny"))
    space, rng = load_space(whole / "tiny.yaml"), random.Random(21)
    for number in range(max(2, n_faults // 10)):
        copy = tmp_path / "results" / "tiny"
        shutil.copytree(whole / "results" / "tiny", copy)
        paths = [rng.choice(_files(copy)) for _ in range(rng.choice((1, 1, 3)))]
        what = [damage(x, rng, another / x.relative_to(copy)) for x in paths if x.exists()]
        if number % 2:
            left = [x for x in repair(copy)[0] if not x.file.startswith("runs")]  # which are trained again
            assert not left or "search_space.yaml" in [x.file for x in left], (what, left)
        study = explore.run(space, tmp_path / "results", progress=False)
        read = _read(study)
        for name in ("trials", "points"):
            one, other = _table(read[name]), _table(expected[name])
            assert_frame_equal(one, other, check_exact=True, obj=f"{number} {what} {name}")
        assert [x.file for x in examine(copy)] == [], what
        tried["files of a study, run on"] += len(what)
        shutil.rmtree(copy)


def test_no_damage_to_a_book_loses_a_trial(whole, tmp_path, n_faults, tried):
    source, rng = whole / "results" / "tiny", random.Random(22)
    folder = tmp_path / "tiny"
    shutil.copytree(source / "runs", folder / "runs")
    path, content = folder / store.BOOK, (source / store.BOOK).read_bytes()
    designs = [(entry.trial, entry.batch, entry.design) for entry in read_entries(source)]
    assert len(designs) == 6
    for number in range(n_faults):
        path.write_bytes(content)
        what = [damage(path, rng) for _ in range(rng.choice((1, 1, 2))) if path.exists()]
        (folder / store.COPY).unlink(missing_ok=True)
        with opened(folder, load_space(whole / "tiny.yaml").search.batch) as (book, _):
            found = [(entry.trial, entry.batch, entry.design) for entry in Ledger(book).entries]
        assert found == designs, (number, what)
        tried["the book"] += 1


def test_a_damaged_cache_entry_is_never_used(whole, tmp_path, n_faults, tried):
    root = whole / "cache"
    [key] = [x.name for x in root.iterdir() if (x / "train.npy").is_file()]
    expected = dataset.find(root, key)
    whole_spikes = np.array(expected.spikes.channel)
    rng, n_refused = random.Random(23), 0
    for number in range(n_faults):
        copy = Path(shutil.copytree(root, tmp_path / str(number)))
        files = sorted(x for x in copy.rglob("*") if x.is_file() and x.name != ".lock")
        what = damage(rng.choice(files), rng)
        data = dataset.find(copy, key)
        if data is None:
            n_refused += 1
            assert cache.find(copy, key) is None or any(copy.iterdir())
        else:
            assert np.array_equal(data.spikes.channel, whole_spikes), (number, what)
            assert np.array_equal(data.target, expected.target), (number, what)
            assert data.classes == expected.classes
        shutil.rmtree(copy)
        tried["a cache entry"] += 1
    assert n_refused > n_faults // 2


def test_a_process_without_file_descriptors_deletes_nothing(whole, tmp_path, tried):
    root = Path(shutil.copytree(whole / "cache", tmp_path / "cache"))
    (root / ".writing-of-another").mkdir()
    (root / ".writing-of-another" / ".lock").touch()
    files = sorted(root.rglob("*"))
    [key] = [x.name for x in root.iterdir() if (x / "train.npy").is_file()]
    used = [os.open(os.devnull, os.O_RDONLY)]
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    for spare in range(6):  # descriptors that are left
        resource.setrlimit(resource.RLIMIT_NOFILE, (used[0] + spare, hard))
        try:
            with contextlib.suppress(OSError, store.StoreError):
                dataset.find(root, key)
            with contextlib.suppress(OSError, store.StoreError):
                cache.tidy(root)
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
        missing = {x for x in files if not x.exists()}
        assert missing <= {x for x in files if ".writing-of-another" in str(x)}, spare
        tried["no file descriptors"] += 1
    os.close(used[0])
    assert dataset.find(root, key) is not None


def test_a_folder_stays_locked_when_its_lock_file_is_removed(tmp_path):
    with store.exclusive(tmp_path):
        (tmp_path / ".lock").unlink()
        with pytest.raises(store.StoreError, match="another process is running"), store.exclusive(tmp_path):
            pass


def test_a_copy_of_a_study_is_a_study(whole, tmp_path):
    source = results.open(whole / "results" / "tiny")
    copy = results.open(Path(shutil.copytree(source.folder, tmp_path / "another name")))
    assert examine(copy.folder) == []
    assert_frame_equal(copy.trials, source.trials, check_exact=True)
    assert_frame_equal(copy.points(), source.points(), check_exact=True)
