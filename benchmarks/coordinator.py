"""What a study costs beside training: many trials whose training is a stub, then the same study resumed.

    python -m benchmarks.coordinator [--trials 500 1000 2000 5000] [--batch 64] [--profile FILE]
    python -m benchmarks.coordinator --space FILE [--set KEY=VALUE ...] [--jobs 1 2 8]

One design is trained for its files; in place of every other training a worker copies these, and publishes
them as a finished run does. Everything else is as in `dse run`: ledger, executor, reading back, tables. CPU
seconds are those of the coordinator and its worker; flat per trial is linear. A resume finds every run done;
`one missing` is a resume of a study, tables included, that lacks its last trial, and `to the first job` the
part of it before this trial is trained. Memory is the coordinator's peak.

With `--space`, the spiking networks of a search space are trained, on each number of workers. Training is
what the workers spend in it. The rest of all CPU seconds is the framework's: measuring, writing, reading.
That of a study of one design stands apart, as the start: processes, and kernels that load. Data sets and
kernels are prepared before. `on paper` is when a study ends that has a core for each worker: CPU seconds of
the coordinator, of the start of a worker, and of the cohorts of the worker that ends last, each taken by the
next free worker. It does not depend on what else the machine does, nor on how many cores it has.
"""

from __future__ import annotations

import argparse
import contextlib
import cProfile
import functools
import heapq
import importlib
import resource
import shutil
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import yaml
from rich.console import Console
from rich.table import Table

from dse import store
from dse.config import load_space
from dse.models.snn import train as snn
from dse.study import explore, jobs, tables

NAME = "benchmarks.coordinator"
"""Where workers look the stub up: not in __main__."""
TEMPLATE = "template.npz"
TIMES = "training_s.txt"


def train(job: jobs.TrainingJob) -> Iterator[tuple[int, None]]:
    """Do as `dse.study.jobs.train`, with the files of the one design that was trained."""
    for number, run in enumerate(job.runs):
        record, parts = _template(run.base / TEMPLATE)
        changed = {"trial": run.trial, "repeat": run.repeat, "design": dict(run.design)}
        store.save_run(run.folder, {**record, **changed}, parts)
        yield number, None


@functools.cache
def _template(run: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the record and the parts of the one design that was trained."""
    record = store.record_in(run)
    return record, {name: store.load_arrays(run / name) for name in record["files"]}


def timed(job: jobs.TrainingJob) -> Iterator[Any]:
    """Do as `dse.study.jobs.train`, and note when it began, its CPU seconds and those of training."""
    original, seconds, began, began_s = snn.train, 0.0, time.time(), time.process_time()

    def measured(*arguments: Any, **named: Any) -> Iterator[Any]:
        nonlocal seconds
        training = original(*arguments, **named)
        while True:
            began = time.process_time()
            ended = next(training, None)
            seconds += time.process_time() - began
            if ended is None:
                return
            yield ended

    with mock.patch.object(snn, "train", measured):
        yield from jobs.train(job)
    with (job.runs[0].folder.parents[2] / TIMES).open("a") as file:
        file.write(f"{began} {time.process_time() - began_s} {seconds}\n")


@dataclass(frozen=True)
class Measured:
    """What a study took, in seconds: of CPU, of that training, of wall time, and on paper."""

    designs: int
    cpu_s: float
    training_s: float
    wall_s: float
    paper_s: float


def measure(path: Path, changes: dict[str, str], n_workers: int) -> Measured:
    """Return what a study takes on so many workers."""
    space = load_space(path, changes)
    timer = importlib.import_module(NAME).timed
    with tempfile.TemporaryDirectory() as name, mock.patch.object(jobs, "train", timer):
        began_s, own_s, wall_s = _cpu_s(), _cpu_s(resource.RUSAGE_SELF), time.perf_counter()
        study = explore.run(space, name, jobs=n_workers, progress=False)
        cpu_s, own_s = _cpu_s() - began_s, _cpu_s(resource.RUSAGE_SELF) - own_s
        wall_s = time.perf_counter() - wall_s
        lines = (study.folder / TIMES).read_text().splitlines()
        _, cohort_s, training_s = zip(*sorted(map(_floats, lines)), strict=True)
        ends = [0.0] * n_workers
        for seconds in cohort_s:
            heapq.heapreplace(ends, ends[0] + seconds)
        starts_s = (cpu_s - own_s - sum(cohort_s)) / min(n_workers, len(cohort_s))
        return Measured(len(study.trials), cpu_s, sum(training_s), wall_s, own_s + starts_s + max(ends))


def _floats(line: str) -> tuple[float, ...]:
    return tuple(map(float, line.split()))


def overhead(path: Path, changes: dict[str, str], workers: list[int]) -> Table:
    """Return what the framework adds to the training of a search space."""
    one = changes | {"search.n_trials": "1"}
    measure(path, one, 1)  # the cache is filled, and kernels are compiled
    table = Table(
        *("workers", "designs", "CPU s", "training", "start", "framework, % of training", "wall s"),
        *("on paper", "times as fast"),
        box=None,
    )
    first_s = 0.0
    for n_workers in workers:
        first, whole = measure(path, one, n_workers), measure(path, changes, n_workers)
        start_s = first.cpu_s - first.training_s
        share = 100 * (whole.cpu_s - whole.training_s - start_s) / whole.training_s
        first_s = first_s or whole.paper_s
        numbers = (whole.cpu_s, whole.training_s, start_s, share, whole.wall_s, whole.paper_s)
        cells = [f"{x:.2f}" for x in (*numbers, first_s / whole.paper_s)]
        table.add_row(str(n_workers), str(whole.designs), *cells)
    return table


def write_space(folder: Path, n_trials: int, batch: int) -> Path:
    """Write recordings of two classes and a search space of so many designs; return its path."""
    rng = np.random.default_rng(0)
    label = np.repeat([0, 1], 10)
    spikes = (rng.random((20, 8, 4)) < 0.1 + 0.4 * label[:, None, None]).astype(np.uint8)
    np.savez(folder / "tiny.npz", spikes=spikes, label=label)
    space = {
        "study": f"tiny_{n_trials}",
        "seed": 1,
        "data": {"kind": "raster", "file": "tiny.npz", "step_ms": 5.0, "columns": {"fabric": "label"}},
        "task": {"target": "fabric"},
        "split": {"stratified": {"validation": 0.5}},
        "model": {
            "kind": "naive_bayes",
            "var_smoothing": {"choice": np.geomspace(1e-9, 1e-3, 25).tolist()},
        },
        "training": {
            "learning_rate": {"choice": np.linspace(0.01, 0.1, 25).tolist()},
            "epochs": {"choice": list(range(1, 17))},
        },
        "hardware": ["loihi1_silicon"],
        "objectives": ["accuracy:max", "n_weights:min"],
        "search": {"sampler": "grid", "batch": batch, "n_trials": n_trials},
    }
    path = folder / f"tiny_{n_trials}.yaml"
    path.write_text(yaml.safe_dump(space, sort_keys=False))
    return path


def run(path: Path, stub: bool = True) -> tuple[float, float, float | None]:
    """Run or resume a study; return CPU and wall seconds, and CPU seconds to the first job."""
    to_first: list[float] = []

    def plan(self: Any, work: Any) -> None:
        if len(work) and not to_first:
            to_first.append(_cpu_s() - began_s)

    began_s, wall_s = _cpu_s(), time.perf_counter()
    with contextlib.ExitStack() as patched:
        if stub:
            patched.enter_context(mock.patch.object(jobs, "train", importlib.import_module(NAME).train))
        patched.enter_context(mock.patch("dse.study.progress.Progress.plan", plan))
        explore.run(load_space(path), path.parent / "results", progress=False)
    return _cpu_s() - began_s, time.perf_counter() - wall_s, to_first[0] if to_first else None


def _cpu_s(*who: int) -> float:
    used = map(resource.getrusage, who or (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(each.ru_utime + each.ru_stime for each in used)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--trials", type=int, nargs="+", default=[500, 1000, 2000, 5000])
    parser.add_argument("--batch", type=int, default=64)
    parser.add_argument("--profile", type=Path, help="write cProfile's statistics of the studies here")
    parser.add_argument("--space", type=Path, help="a search space of spiking networks to train")
    parser.add_argument("--set", nargs="*", default=[], metavar="KEY=VALUE", help="changes of this space")
    parser.add_argument(
        "--jobs", type=int, nargs="+", default=[1, 2, 8], help="numbers of workers, with --space"
    )
    arguments = parser.parse_args()
    if arguments.space:
        changes = dict(pair.split("=", 1) for pair in arguments.set)
        Console(width=120).print(overhead(arguments.space, changes, arguments.jobs))
        return
    table = Table(
        *("trials", "CPU s", "of it worker", "wall s", "CPU ms per trial"),
        *("resume, CPU s", "one missing", "to the first job", "MiB"),
    )
    profile = cProfile.Profile()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        run(write_space(folder, 1, 1), stub=False)
        shutil.copy(store.run_file(folder / "results" / "tiny_1", 0, 0), folder / TEMPLATE)
        for n_trials in arguments.trials:
            path = write_space(folder, n_trials, arguments.batch)
            if arguments.profile:
                profile.enable()
            before_s = _cpu_s(resource.RUSAGE_CHILDREN)
            cpu_s, wall_s, _ = run(path)
            worker_s = _cpu_s(resource.RUSAGE_CHILDREN) - before_s
            resume_s, _, _ = run(path)
            store.run_file(folder / "results" / path.stem, n_trials - 1, 0).unlink()
            tables.write_again(folder / "results" / path.stem)
            missing_s, _, first_s = run(path)
            profile.disable()
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
            numbers = [cpu_s, worker_s, wall_s, 1000 * cpu_s / n_trials, resume_s]
            numbers += [missing_s, first_s or 0.0, peak]
            table.add_row(str(n_trials), *(f"{x:.1f}" for x in numbers))
    if arguments.profile:
        profile.dump_stats(arguments.profile)
    Console().print(table)


if __name__ == "__main__":
    main()
