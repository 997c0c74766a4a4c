"""Fuzzing of everything that is read back: bundles, records, books, recordings of every format.

    python -m tests.faults.fuzz [--minutes M] [--seed S] [KIND ...]       make fuzz MINUTES=30

Each kind runs for M minutes of CPU time in a process of its own that may take 1 GiB more than it begins with.
Hypothesis draws the inputs, a new seed for every round, from S on. Refused in one sentence or read soundly:
anything else, a crash, and an input that takes 20 s, is a fault, which is printed with what Hypothesis drew.

Exit code 0: no fault; 1: faults.
"""

import argparse
import copy
import functools
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from pathlib import Path

import numpy as np
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays_of

from dse import store
from dse.base.registry import known
from dse.config import ConfigError
from dse.config.faults import Fault
from dse.data.recordings import RecordingError
from dse.data.recordings.event_files import EventFiles
from dse.data.recordings.raster import RasterFile
from dse.deploy import bundle
from dse.deploy.bundle import BundleError
from dse.deploy.reference import of_recordings
from dse.study import doctor, explore, tables, workers
from dse.study.ledger import read_entries
from dse.study.mended import opened
from dse.study.results import Study
from dse.testing.targets import small_bundle, small_recordings
from tests import tiny_study
from tests.data.recordings import rectangles
from tests.data.recordings.formats import test_contract
from tests.data.recordings.formats.reading import MARKS, RECORDED, a_reader_that_hangs_fails
from tests.in_process import InProcess

MORE_BYTES = 1 << 30
ROUND = 60  # inputs of one seed
ODD = (None, True, -1, 0, 1, 2**31, -(2**63), 2**64, 1e300, float("nan"), float("inf"), "", "x", "\0", [], {})
TOKENS = ("", "nan", "inf", "-1", "1e400", "9" * 30, "x", '"', ",", "\n", "\0", "é", "0x10", "NULL")
REFUSALS = (store.StoreError, ConfigError, RecordingError, BundleError)


def spoilt(data, content):
    """Return a file that was cut, and of which some places hold something else."""
    damaged = bytearray(content[: data.draw(st.integers(0, len(content)) | st.just(len(content)))])
    place = st.integers(0, len(damaged)) | st.integers(0, min(700, len(damaged)))
    for at, what, removes in data.draw(
        st.lists(st.tuples(place, st.binary(min_size=1, max_size=9), st.booleans()), max_size=6)
    ):
        damaged[at : at + len(what) * removes] = what
    return bytes(damaged)


def spoilt_text(data, text):
    """Return a table of which some cells hold something else."""
    cells = text.replace("\n", ",\n,").split(",")
    for at in data.draw(st.lists(st.integers(0, len(cells) - 1), min_size=1, max_size=4)):
        cells[at] = data.draw(st.sampled_from(TOKENS) | st.text(max_size=5))
    return ",".join(cells).replace(",\n,", "\n")


def spoilt_plain(data, document):
    """Return plain data of which some values are others, missing, or of other types."""
    document = copy.deepcopy(document)
    for _ in range(data.draw(st.integers(1, 3))):
        part = document
        while True:
            keys = list(part) if isinstance(part, dict) else list(range(len(part)))
            if not keys:
                break
            key = data.draw(st.sampled_from(keys))
            if isinstance(part[key], dict | list) and part[key] and data.draw(st.integers(0, 3)):
                part = part[key]
                continue
            if data.draw(st.integers(0, 4)):
                part[key] = data.draw(
                    st.sampled_from(ODD) | st.integers() | st.floats() | st.text(max_size=9)
                )
            else:
                del part[key]
            break
    return document


def spoilt_arrays(data, arrays):
    """Return arrays of which one has another shape, type or number, or is missing."""
    changed = dict(arrays)
    name = data.draw(st.sampled_from(sorted(changed)))
    how = data.draw(st.sampled_from(("number", "shape", "type", "other", "missing")))
    array = np.array(changed[name])
    if how == "missing":
        del changed[name]
    elif how == "number" and array.size and array.dtype.kind in "iufb":
        value = data.draw(st.sampled_from((-1, 0, 1, 2, 255, 1e30, -(2.0**31), 2.0**62, np.nan, np.inf)))
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            array.flat[data.draw(st.integers(0, array.size - 1))] = np.array(value).astype(array.dtype)
        changed[name] = array
    elif how == "shape":
        changed[name] = array.reshape(-1)[: data.draw(st.integers(0, array.size))]
    elif how == "type" and array.dtype.kind in "iufb":
        kinds = (np.int8, np.uint64, np.float16, np.float64, np.complex64, np.bool_, "U3")
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            changed[name] = array.astype(data.draw(st.sampled_from(kinds)))
    else:
        dtypes = st.sampled_from((np.dtype("i8"), np.dtype("f4"), np.dtype("u1"), np.dtype("f8")))
        shape = arrays_of.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=5)
        changed[name] = data.draw(arrays_of.arrays(dtypes, shape))
    return changed


# ---- bundles, records, books


def bundle_of(folder):
    whole, touch = folder / "bundle", small_recordings(folder / "touch.npz")
    bundle.write(small_bundle(recurrent=True, delays=(0, 2)), whole)

    def fuzz(data, place):
        shutil.copytree(whole, place / "b")
        document, arrays = json.loads((place / "b/bundle.json").read_text()), place / "b/weights.npz"
        what = data.draw(st.sampled_from(("document", "arrays", "bytes")))
        if what == "bytes":
            path = place / "b" / data.draw(st.sampled_from(("bundle.json", "weights.npz")))
            path.write_bytes(spoilt(data, path.read_bytes()))
        elif what == "arrays":
            changed = spoilt_arrays(data, store.load_arrays(arrays))
            for name in [name for name in changed if name.endswith("_8bit") and data.draw(st.booleans())]:
                base = np.nan_to_num(np.asarray(changed.get(name.removesuffix("_8bit"), 0), float))
                changed[name] = np.rint(np.clip(base, -4, 127 / 32) * 32).astype(np.int8)
            store.save_arrays(arrays, changed)
            document["files"]["weights.npz"] = store.checksum(arrays)
        else:
            document = spoilt_plain(data, document)
        if what != "bytes":
            (place / "b/bundle.json").write_text(json.dumps(bundle.sealed(document)))
        of_recordings(bundle.read(place / "b"), touch)

    return fuzz


def _study(folder):
    workers.Loky = InProcess
    os.environ["DSE_CACHE"] = str(folder / "cache")
    space = tiny_study.make_space(folder, execution={"jobs": 1})
    return explore.run(space, folder / "results", progress=False).folder


def record_of(folder):
    whole = _study(folder)

    def fuzz(data, place):
        study = Path(shutil.copytree(whole, place / "results/tiny"))
        run = data.draw(st.sampled_from(sorted(study.glob("runs/*-0.npz"))))
        record = store.record_in(run)
        parts = {name: store.load_arrays(run / name) for name in record.pop("files")}
        kind = data.draw(st.sampled_from(["arrays", "record", "record", "document"]))
        if kind == "arrays":
            name = data.draw(st.sampled_from(sorted(parts)))
            parts[name] = spoilt_arrays(data, parts[name])
        elif kind == "record":
            record = spoilt_plain(data, record)
        with store.Book(study, writes=True) as book:
            if kind == "document":
                name = data.draw(st.sampled_from([store.ENVIRONMENT, store.WARNINGS]))
                book.keep(name, spoilt_plain(data, book.document(name, [])))
            elif isinstance(record, dict):
                store.save_run(run, record, parts, replaces=True)
                store.note_files(book, [run])
        opened, refusal = Study(study), None
        for read in (
            lambda: opened.trials, opened.points, lambda: opened.warnings, lambda: opened.runs(0),
            lambda: opened.arrays(0, "read_out.npz"), lambda: doctor.examine(study),
            lambda: tables.write_again(study), opened.points,
        ):  # fmt: skip
            try:
                read()
            except REFUSALS as error:
                refusal = error
        if refusal is not None:
            raise refusal

    return fuzz


def book_of(folder):
    study = _study(folder)
    whole = (study / store.BOOK).read_bytes()

    def fuzz(data, place):
        target = place / "tiny"
        shutil.copytree(study / "runs", target / "runs")
        for name in (store.BOOK, store.COPY):
            (target / name).write_bytes(spoilt(data, whole))
        read_entries(target)
        try:
            with opened(target):
                pass
        except store.Damaged as error:
            raise AssertionError("a dead end") from error
        with opened(target) as (_, notes):
            assert notes == [], "it was mended already"

    return fuzz


# ---- recordings


def format_of(name, folder):
    native = Path(os.environ.get("DSE_DATA", "")) / "native_event_files"
    samples = [native / file for file, (kind, *_) in RECORDED.items() if kind == name]
    contents = [path.read_bytes()[: 1 << 15] for path in samples if path.is_file()]
    if name in ("npz", "h5"):
        t = np.arange(90) * 7
        arrays = {"t": t, "x": t % 30, "y": t % 20, "p": t % 2}
        path = folder / f"valid.{name}"
        if name == "npz":
            np.savez(path, **arrays)
        else:
            import h5py

            with h5py.File(path, "w") as file:
                for key, array in arrays.items():
                    file[key] = array
        contents.append(path.read_bytes())
    suffix = known("recordings.formats")[name]().suffixes[0]

    def fuzz(data, place):
        marked = st.builds(lambda *x: b"".join(x), st.sampled_from(MARKS), st.binary(max_size=300))
        content = data.draw(st.sampled_from(contents)) if contents and data.draw(st.integers(0, 4)) else b""
        path = place / f"fuzzed{suffix}"
        path.write_bytes(spoilt(data, content) if content else data.draw(marked))
        n_events = test_contract.read(path, name, data.draw(st.booleans()))
        source = EventFiles(str(place), format=name)
        source.check(place)
        if n_events is None:
            raise RecordingError(path.name)

    return fuzz


def arrays_kind(source, arrays, folder):
    def fuzz(data, place):
        path = place / "x.npz"
        np.savez(path, **spoilt_arrays(data, arrays))
        if not data.draw(st.integers(0, 3)):
            path.write_bytes(spoilt(data, path.read_bytes()))
        _read(source, place)

    return fuzz


def table_kind(source, frames, folder):
    def fuzz(data, place):
        for name, frame in frames.items():
            (place / name).write_text(frame.to_csv(index=False))
        path = place / data.draw(st.sampled_from(sorted(frames)))
        if data.draw(st.integers(0, 2)):
            path.write_text(spoilt_text(data, path.read_text()), encoding="utf-8", errors="replace")
        else:
            path.write_bytes(spoilt(data, path.read_bytes()))
        _read(source, place)

    return fuzz


def _read(source, place):
    assert all("\n" not in str(Fault("x.yaml", 0, fault)) for fault in source.check(place))
    source.content(place)
    source.with_columns_found(place)
    recordings = source.read(place)
    assert recordings.n_recordings >= 0


_SPIKES = {"spikes": np.eye(24, dtype=np.uint8).reshape(4, 6, 24), "label": np.arange(4)}
_TABLES = {"x.csv": rectangles.SAMPLES, "labels.csv": rectangles.LABELS}
KINDS = {
    "bundle": bundle_of,
    "record": record_of,
    "book": book_of,
    "raster": functools.partial(arrays_kind, RasterFile("x.npz", 5.0, columns={"a": "label"}), _SPIKES),
    "events": functools.partial(arrays_kind, rectangles.EVENTS, rectangles.TAXELS),
    "time_series": functools.partial(arrays_kind, rectangles.TIME_SERIES, rectangles.SERIES),
    "table": functools.partial(table_kind, rectangles.TABLE, _TABLES),
    "long_table": functools.partial(table_kind, rectangles.LONG_TABLE, {"x.csv": rectangles.LONG}),
    "wide_table": functools.partial(table_kind, rectangles.WIDE_TABLE, {"x.csv": rectangles.WIDE}),
    **{name: functools.partial(format_of, name) for name in known("recordings.formats")},
}


def fuzz_kind(name, cpu_s, first_seed):
    """Fuzz a kind in this process; return how many inputs were read and refused, faults, memory (MiB)."""
    counts = Counter[str](read=0, refused=0, faults=0)
    with tempfile.TemporaryDirectory() as root, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        folder = Path(root)
        kind, place = KINDS[name](folder), folder / "fuzzed"

        def one(data):
            shutil.rmtree(place, ignore_errors=True)
            place.mkdir()
            try:
                with a_reader_that_hangs_fails():
                    kind(data, place)
            except REFUSALS as error:
                lines_of_text = str(error).split("\n")  # one, or one for each fault of a file
                of_faults = isinstance(error, ConfigError) or isinstance(error.__cause__, ConfigError)
                assert of_faults or len(lines_of_text) == 1, error
                counts["refused"] += 1
            else:
                counts["read"] += 1

        few = settings(
            max_examples=ROUND, deadline=None, database=None, derandomize=False,
            suppress_health_check=list(HealthCheck), phases=(Phase.generate,), report_multiple_bugs=False,
        )  # fmt: skip
        number, end_s, first_kib = 0, 0.0, 0
        while number < 2 or time.process_time() < end_s:
            if number == 1:  # everything that is needed is imported and compiled
                end_s = time.process_time() + cpu_s
                first_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
                pages = int(Path("/proc/self/statm").read_text().split()[0])
                limit = pages * resource.getpagesize() + MORE_BYTES
                resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
            try:
                seed(first_seed + number)(few(given(st.data())(one)))()
            except Exception:
                counts["faults"] += 1
                traceback.print_exc()
            number += 1
    peak_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {**counts, "peak_mib": peak_kib >> 10, "more_mib": (peak_kib - first_kib) >> 10}


def main(arguments=None):
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=f"of {', '.join(KINDS)}; default: all")
    parser.add_argument("--minutes", type=float, default=3.0, help="of CPU time, per kind")
    parser.add_argument("--seed", type=int, default=0, help="of the first round")
    parser.add_argument("--here", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if unknown := [name for name in options.kinds if name not in KINDS]:
        parser.error(f"unknown kind {unknown[0]}; known: {', '.join(KINDS)}")
    if options.here:
        print(json.dumps(fuzz_kind(options.kinds[0], 60 * options.minutes, options.seed)))
        return 0
    n_faults = 0
    print(f"{'kind':<12} {'inputs':>8} {'refused':>8} {'faults':>7} {'MiB':>6} {'more':>6}", flush=True)
    for name in options.kinds or KINDS:
        command = [
            sys.executable,
            "-m",
            "tests.faults.fuzz",
            "--here",
            "--minutes",
            str(options.minutes),
            "--seed",
            str(options.seed),
            name,
        ]
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
        if done.returncode:
            n_faults += 1
            print(f"{name:<12} ended with exit code {done.returncode}", flush=True)
            continue
        counts = json.loads(done.stdout.splitlines()[-1])
        n_faults += counts["faults"]
        inputs = counts["read"] + counts["refused"]
        memory = f"{counts['peak_mib']:>6} {counts['more_mib']:>6}"
        print(f"{name:<12} {inputs:>8} {counts['refused']:>8} {counts['faults']:>7} {memory}", flush=True)
    return min(n_faults, 1)


if __name__ == "__main__":
    sys.exit(main())
