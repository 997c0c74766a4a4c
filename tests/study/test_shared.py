"""Several coordinators on one study: no design is trained by two, all learn, and nothing is lost."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import pwd
import shutil
import sqlite3
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import optuna
import pandas as pd
import pytest
import sqlalchemy
from pandas.testing import assert_frame_equal

from dse.cli.command_line import main
from dse.config import SearchSpace, load_space
from dse.search.space import design_at
from dse.seeds import design_key
from dse.store import StoreError
from dse.study import explore, shared, workers
from dse.study.claim import claim
from dse.study.journal import read_journal
from dse.study.shared import SharedStudy
from tests import tiny_study
from tests.in_process import InProcess
from tests.waiting import PATIENCE_S, until

CHILDREN = multiprocessing.get_context("forkserver")
N_DESIGNS = 6
BINARIES = [shutil.which("initdb"), *sorted(map(str, Path("/usr/lib/postgresql").glob("*/bin/initdb")))]
OFF = "-c fsync=off -c listen_addresses= -c unix_socket_directories={0}"


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    tiny_study.register()
    monkeypatch.setattr(workers, "Loky", InProcess)
    yield
    tiny_study.unregister()


@pytest.fixture(scope="module")
def server() -> Iterator[str]:
    """The address of a PostgreSQL server of its own, which keeps its data in a temporary folder."""
    initdb = next((one for one in BINARIES if one), None)
    if initdb is None:
        pytest.skip("no PostgreSQL server is installed (Debian: apt install postgresql)")
    pg_ctl = Path(initdb).resolve().with_name("pg_ctl")
    as_user: dict[str, Any] = {}
    folder = Path(tempfile.mkdtemp(prefix="dse-"))  # short, as paths of sockets are
    if os.geteuid() == 0:  # which PostgreSQL refuses
        user = pwd.getpwnam("nobody")
        as_user = {"user": user.pw_uid, "group": user.pw_gid, "extra_groups": []}
        os.chown(folder, user.pw_uid, user.pw_gid)

    def run(*command: object) -> None:
        done = subprocess.run(
            [*map(str, command)], cwd=folder, capture_output=True, text=True, check=False, **as_user
        )
        assert done.returncode == 0, done.stderr

    data = ("-D", folder / "data")
    run(initdb, *data, "-U", "dse", "-A", "trust", "--no-sync")
    run(pg_ctl, *data, "-o", OFF.format(folder), "-l", folder / "log", "-w", "-t", int(PATIENCE_S), "start")
    yield f"postgresql://dse@/postgres?host={folder}"
    run(pg_ctl, *data, "-m", "immediate", "stop")
    shutil.rmtree(folder)


@pytest.fixture(params=["sqlite", "postgresql"])
def storage(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path / 'shared.db'}"
    url = request.getfixturevalue("server")
    database = f"of_{tmp_path.name.lower()}".replace("-", "_")
    engine = sqlalchemy.create_engine(url.replace("postgresql:", "postgresql+psycopg:"))
    with engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
        connection.exec_driver_sql(f'CREATE DATABASE "{database}"')
    engine.dispose()
    return str(url.replace("/postgres?", f"/{database}?"))


@pytest.fixture
def one_storage(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """A PostgreSQL server where there is one, else SQLite."""
    is_installed = any(BINARIES)
    return str(request.getfixturevalue("server") if is_installed else f"sqlite:///{tmp_path / 'shared.db'}")


def space_of(folder: Path, storage: str | None, **changes: Any) -> SearchSpace:
    search = {"sampler": "grid", "batch": 2, **changes.pop("search", {})}
    execution = {"jobs": 1, **({} if storage is None else {"storage": storage})}
    return tiny_study.make_space(folder, search=search, execution=execution, **changes)


def begun(space: SearchSpace, results: Path) -> SharedStudy:
    """Return what a coordinator with a folder of its own begins with."""
    folder = results / space.study
    folder.mkdir(parents=True, exist_ok=True)
    claim(space, folder)
    return SharedStudy(space, folder)


def designs(results: Path) -> list[str]:
    """Return the designs that a coordinator has trained."""
    return [
        design_key(entry.design)
        for entry in read_journal(results / "tiny/journal.log")
        if not entry.excluded and entry.is_reported
    ]


def table(folder: Path) -> pd.DataFrame:
    frame = pd.read_parquet(folder / "trials.parquet").drop(columns=["trial", "train_s"])
    axes = [name for name in frame if name.startswith("model.")]
    return frame.sort_values(axes).reset_index(drop=True)


def coordinator(folder: Path, results: str, heartbeat_s: float, grace_s: float) -> None:
    """Run a coordinator in a process of its own."""
    tiny_study.register()
    workers.Loky = InProcess  # type: ignore[assignment, misc]
    shared.HEARTBEAT_S, shared.GRACE_S = heartbeat_s, grace_s  # type: ignore[assignment]
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    space = load_space(folder / "tiny.yaml")
    explore.run(space, folder / results, progress=False)
    sys.exit(0)


def test_two_coordinators_make_the_table_of_one(tmp_path: Path, storage: str) -> None:
    explore.run(space_of(tmp_path, None), tmp_path / "alone", progress=False)
    space = space_of(tmp_path, storage)
    here, there = tmp_path / "here", tmp_path / "there"

    def other(_: object) -> None:
        if not there.exists():  # in the middle of the first one's first batch
            explore.run(space, there, progress=False)

    explore.run(space, here, progress=False, on_trial=other)
    assert (len(designs(here)), len(designs(there))) == (2, 4)
    assert len({*designs(here), *designs(there)}) == N_DESIGNS, "a design was trained by two"
    merged = tmp_path / "all" / "tiny"
    assert main(["merge", str(here / "tiny"), str(there / "tiny"), "--into", str(merged)]) == 0
    assert_frame_equal(table(merged), table(tmp_path / "alone/tiny"), check_exact=True)
    before = read_journal(here / "tiny/journal.log")
    explore.run(space, here, progress=False)
    assert read_journal(here / "tiny/journal.log") == before, "a study that is done trains no more"


def test_a_killed_coordinator_leaves_its_designs_to_others(
    tmp_path: Path, one_storage: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    gate = tmp_path / "gate"
    slow = {**tiny_study.plain()["model"], "gate": str(gate), "hidden": {"choice": [[8], [4], [16]]}}
    space = space_of(tmp_path, one_storage, model=slow, search={"batch": 4})
    process = CHILDREN.Process(target=coordinator, args=(tmp_path, "here", 1, 2))
    process.start()
    artefacts = tmp_path / "here/tiny/artefacts"
    until(lambda: process.exitcode is not None or len([*artefacts.glob("*/repeat_0")]) == 2, "two runs")
    process.kill()  # two designs are trained and nobody knows, two are in training
    process.join()
    gate.touch()
    monkeypatch.setattr(shared, "HEARTBEAT_S", 1)
    monkeypatch.setattr(shared, "GRACE_S", 1)

    def free() -> int:
        with begun(space, tmp_path / "there") as one:
            return len(one.free())

    until(lambda: free() == 4, "its claims to be freed")
    monkeypatch.setattr(shared, "GRACE_S", 1000)
    explore.run(space, tmp_path / "there", progress=False)
    assert len(designs(tmp_path / "there")) == N_DESIGNS
    explore.run(space, tmp_path / "here", progress=False)
    entries = read_journal(tmp_path / "here/tiny/journal.log")
    assert ["another coordinator" in entry.excluded for entry in entries] == [False, False, True, True]
    assert len(designs(tmp_path / "here")) == 2, "what was trained is not lost"


def test_samplers_learn_from_all(tmp_path: Path) -> None:
    storage = f"sqlite:///{tmp_path / 'shared.db'}"
    search = {"sampler": "tpe", "batch": 2, "n_trials": 3}
    space = space_of(tmp_path, storage, search=search, limits=["n_weights <= 100"])
    explore.run(space, tmp_path / "here", progress=False)
    with begun(space, tmp_path / "here") as ours:
        assert ours.elsewhere() == []
    with begun(space, tmp_path / "there") as one:
        known = one.elsewhere()
        assert [design_key(x.design) for x in known] == designs(tmp_path / "here")
        assert len(known) == 3
        assert all(x.values is not None and len(x.values) == 3 for x in known)
        assert all("n_weights <= 100" in x.violations for x in known)
        assert one.elsewhere() == []
    database = optuna.storages.RDBStorage(storage)
    study = optuna.load_study(study_name="tiny", storage=database)
    assert study.metric_names == ["accuracy", "n_weights", "energy_uj"]
    assert all(trial.params["model.true_rate"] in (0.2, 0.8) for trial in study.trials)
    database.remove_session()
    database.engine.dispose()


def test_claims_of_a_race(tmp_path: Path, storage: str, monkeypatch: pytest.MonkeyPatch) -> None:
    space = space_of(tmp_path, storage, search={"n_trials": 3})
    first, *rest = [design_at(space, place) for place in range(4)]
    with begun(space, tmp_path / "here") as one, begun(space, tmp_path / "there") as two:
        assert one.claim([first]) == [first]
        with monkeypatch.context() as late:  # the other one looked before that
            late.setattr(two, "_claims", iter([{}, two._claims()]).__next__)
            assert two.claim([first]) == []
        assert two.claim([first, *rest]) == rest[:2], "no more than n_trials"
        assert one.n_left() == 0
        assert one.n_in_training_elsewhere() == 2
        one.report(first, None, {})
    with begun(space, tmp_path / "here") as one, begun(space, tmp_path / "there") as two:
        assert one.n_in_training_elsewhere() == 0, "a coordinator that ends gives back what it has"
        assert one.free() == rest, "one that failed in training is not free"
        two.report(rest[0], [0.5, 10.0, 1.0], {"n_weights <= 60": 0.0})
        assert [x.values for x in one.elsewhere()] == [[0.5, 10.0, 1.0]]


def test_what_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    database = f"sqlite:///{tmp_path / 'shared.db'}"
    space = space_of(tmp_path, database)

    def refused(*settings: str) -> str:
        sets = [text for one in settings for text in ("--set", one)]
        path, results = str(space.source), str(tmp_path / "there")
        assert main(["run", path, "--results", results, "--quiet", *sets]) == 2
        told = capsys.readouterr().err.strip()
        assert "\n" not in told
        return told

    with begun(space, tmp_path / "here"):
        pass
    another = f"seed is 8, but 7 in study 'tiny' in {database}; use another study name or database"
    assert another in refused("seed=8")
    apart = optuna.storages.RDBStorage(database)
    optuna.create_study(storage=apart, study_name="theirs", directions=["maximize"] * 3).ask()
    apart.remove_session()
    apart.engine.dispose()
    assert "study 'theirs' in sqlite" in refused("study=theirs")
    assert "unable to open database file" in refused("execution.storage=sqlite:////nowhere/shared.db")
    nobody = "execution.storage=postgresql://dse@127.0.0.1:1/dse"
    assert "execution.storage postgresql://dse@127.0.0.1:1/dse: " in refused(nobody)
    assert "must begin with postgresql:// or sqlite:///, got 'mysql://x/y'" in refused(
        "execution.storage=mysql://x/y"
    )
    assert "must not hold a password" in refused("execution.storage=postgresql://dse:secret@host/dse")
    assert "execution.storage is not for search.racing" in refused(
        "search.racing={rungs: [1]}", "model.kind=curve"
    )
    with begun(space, tmp_path / "here"):
        pass


def test_a_database_that_is_full_or_comes_late(tmp_path: Path) -> None:
    database = tmp_path / "shared.db"
    space = space_of(tmp_path, f"sqlite:///{database}")

    def execute(text: str) -> None:
        with contextlib.closing(sqlite3.connect(database)) as connection, connection:
            connection.execute(text)

    def fill(_: object) -> None:
        full = "SELECT RAISE(FAIL, 'database or disk is full')"
        execute(f"CREATE TRIGGER IF NOT EXISTS full BEFORE UPDATE ON trials BEGIN {full}; END")

    with pytest.raises(StoreError, match=r"shared\.db: database or disk is full; finished runs are kept"):
        explore.run(space, tmp_path / "here", progress=False, on_trial=fill)
    assert len(designs(tmp_path / "here")) == 2, "the journal has what the database has not"
    execute("DROP TRIGGER full")
    explore.run(space, tmp_path / "here", progress=False)
    assert len(designs(tmp_path / "here")) == N_DESIGNS
    with begun(space, tmp_path / "there") as one:
        assert len([x for x in one.elsewhere() if x.values]) == N_DESIGNS
