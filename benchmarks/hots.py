"""Time surfaces: events per second on one core beside whole frames, and what binned or cut-off decay costs.

    DSE_DATA=... python -m benchmarks.hots [--rounds 3] [--frames 100] [--check 200]

Recordings are asynchronous events: an event camera (AEDAT 4, 320 x 240 pixels) and two fingers of taxels.
The kernel takes all events of a recording through every layer. `frame per event` computes the decayed frame
anew for every event and cuts the surface out of it; `frame per ms` does so at the end of every millisecond,
for all its events. Both run on the first `--frames` events (a frame per millisecond on ten times as many), in
NumPy, whose exponentials are vectorised. Times are CPU seconds, the kernel's the least of the rounds.

The error is that of first-layer surfaces of all events against the exact ones: root mean square over their
numbers relative to that of the exact ones, the largest difference, and the share of events that go to another
prototype. `slow definition`: largest difference of the kernel's surfaces, and events that go elsewhere, over
the first `--check` events.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from dse.base.records import Array, Block
from dse.data.recordings.event_files import EventFiles
from dse.data.recordings.events import EventFile
from dse_papers.models.prototypes import clustered, drawn_surfaces
from dse_papers.models.time_surfaces import Field, Memory, Stream, nearest, prepared, surface

TAU_US = 20_000.0
PROTOTYPES = 8
RADIUS_MAX = 10
# Surfaces that the error is taken over, at most.
COMPARED = 20_000


def camera() -> tuple[Stream, int, int]:
    """Return the events of the camera, width and height."""
    files = EventFiles("native_event_files", "tonic_sample.aedat4").read(Path.cwd())
    return _stream(list(files.blocks(0))), files.width, files.height


def fingers() -> tuple[Stream, int, int]:
    """Return the longest recording of the taxels, width and height."""
    file = EventFile(
        "neutouch_objects/neutouch_objects.npz", width=80, taxel="taxel", polarity="polarity"
    ).read(Path.cwd())
    longest = int(np.diff(file.offsets).argmax())
    return _stream(list(file.blocks(longest))), file.width, file.height


def _stream(blocks: list[Block]) -> Stream:
    def joined(name: str, kind: type = np.int32) -> Array:
        return np.concatenate([getattr(b, name) for b in blocks]).astype(kind)

    return Stream(joined("t_us", np.int64), joined("x"), joined("y"), joined("polarity"))


def stack(events: Stream, width: int, height: int, radius: int, layers: int) -> list[tuple[Field, Array]]:
    """Return fields and prototypes of a hierarchy that doubles radius, prototypes and time constant."""
    rng, found, planes = np.random.default_rng(0), [], 2
    for layer in range(layers):
        field = Field(width, height, planes, min(RADIUS_MAX, radius * 2**layer), TAU_US * 2**layer)
        # A few hundred surfaces do: what is timed is not the learning.
        drawn = drawn_surfaces([partial(Stream, *events)], [len(events.t_us)], field, 400, 400, rng)
        found.append((field, clustered(drawn, PROTOTYPES * 2**layer, rng)))
        planes = len(found[-1][1])
        events = events._replace(plane=Memory(field).assign(events, prepared(found[-1][1])))
    return found


def by_kernel(events: Stream, layers: list[tuple[Field, Array]]) -> list[Array]:
    """Return the prototype of every event in every layer."""
    found = []
    for field, prototypes in layers:
        found.append(Memory(field).assign(events, prepared(prototypes)))
        events = events._replace(plane=found[-1])
    return found


def by_frames(events: Stream, layers: list[tuple[Field, Array]], bin_us: int | None = None) -> list[Array]:
    """Return the same from decayed frames: one per event, or one per time bin."""
    found = []
    for field, prototypes in layers:
        surfaces = framed(events, field, bin_us)
        found.append(nearest(np.array(list(surfaces)), prototypes))
        events = events._replace(plane=found[-1])
    return found


def framed(events: Stream, field: Field, bin_us: int | None) -> Iterator[Array]:
    """Yield surfaces cut out of whole decayed frames.

    Args:
        events: of a recording from its start.
        field: of the layer.
        bin_us: a frame is computed at the end of each bin, from all events until then, and serves those of
            the bin; None: for every event.
    """
    reach_x, reach_y = field.reach
    shape = field.height + 2 * reach_y, field.width + 2 * reach_x, field.n_planes
    last = np.full(shape, -np.inf)
    t_us, x, y, plane = events
    number = np.arange(len(t_us)) if bin_us is None else t_us // bin_us
    ends = [*(np.flatnonzero(np.diff(number)) + 1), len(t_us)]
    for first, end in pairwise([0, *ends]):
        last[y[first:end] + reach_y, x[first:end] + reach_x, plane[first:end]] = t_us[first:end]
        now = t_us[first] if bin_us is None else (number[first] + 1) * bin_us
        frame = np.exp((last - now) / field.tau_us)
        for i in range(first, end):
            yield frame[y[i] : y[i] + 2 * reach_y + 1, x[i] : x[i] + 2 * reach_x + 1].ravel()


def head(events: Stream, n: int) -> Stream:
    """Return the first n events."""
    return Stream(*(a[:n] for a in events))


def slow_difference(events: Stream, field: Field, prototypes: Array) -> tuple[float, int]:
    """Return how far the kernel's surfaces are from the definition's, and how many events go elsewhere."""
    n = len(events.t_us)
    expected = np.array([surface(events, i, field) for i in range(n)])
    found = Memory(field).surfaces(events, np.arange(n))
    label = Memory(field).assign(events, prepared(prototypes))
    return float(np.abs(found - expected).max()), int((label != nearest(expected, prototypes)).sum())


def errors(exact: Array, other: Array, prototypes: Array) -> tuple[float, float, float]:
    """Return relative root mean square, largest difference, and share that goes to another prototype."""
    wrong = other - exact
    moved = nearest(exact, prototypes) != nearest(other, prototypes)
    return (
        float(np.sqrt((wrong**2).sum() / (exact**2).sum())),
        float(np.abs(wrong).max()),
        float(moved.mean()),
    )


def speed(name: str, events: Stream, width: int, height: int, given: argparse.Namespace) -> Table:
    """Return events per second per number of layers and radius."""
    table = Table(
        "layers", "radius", "numbers", "kernel /s", "frame per event /s", "kernel is", "frame per ms /s",
        "kernel is", "the same", "slow definition", title=f"{name}: {len(events.t_us)} events",
    )  # fmt: skip
    for layers in (1, 2, 3):
        for radius in (1, 2, 4, 10):
            hierarchy = stack(events, width, height, radius, layers)
            by_kernel(head(events, 10), hierarchy)  # compiles
            rates = []
            for _ in range(given.rounds):
                began = time.process_time()
                label = by_kernel(events, hierarchy)
                rates.append(len(events.t_us) / (time.process_time() - began))
            began, part = time.process_time(), head(events, given.frames)
            same = np.array_equal(by_frames(part, hierarchy), [x[: given.frames] for x in label])
            per_event = given.frames / (time.process_time() - began)
            began, n = time.process_time(), min(10 * given.frames, len(events.t_us))
            by_frames(head(events, n), hierarchy, 1000)
            per_bin = n / (time.process_time() - began)
            far, moved = slow_difference(head(events, given.check), *hierarchy[0])
            table.add_row(
                str(layers), "-".join(str(field.radius) for field, _ in hierarchy),
                "-".join(str(field.size) for field, _ in hierarchy), f"{max(rates):,.0f}",
                f"{per_event:,.0f}", f"{max(rates) / per_event:,.0f} x", f"{per_bin:,.0f}",
                f"{max(rates) / per_bin:,.0f} x", "yes" if same else "NO", f"{far:.1g}, {moved}",
            )  # fmt: skip
    return table


def accuracy(name: str, events: Stream, width: int, height: int) -> Table:
    """Return the error of binned and of cut-off decay."""
    table = Table(
        "decay", "relative rms error", "largest", "other prototype", title=f"{name}: error of surfaces"
    )
    events = head(events, COMPARED)
    ((field, prototypes),) = stack(events, width, height, 2, 1)
    exact = Memory(field).surfaces(events, np.arange(len(events.t_us)))
    binned = {f"frame per {ms} ms": np.array(list(framed(events, field, 1000 * ms))) for ms in (1, 5, 20)}
    cut = {f"0 after {n} tau": np.where(exact < np.exp(-n), 0, exact) for n in (1, 3, 5)}
    for label, other in {"exact": exact, **binned, **cut}.items():
        rms, largest, moved = errors(exact, other, prototypes)
        table.add_row(label, f"{rms:.3g}", f"{largest:.3g}", f"{moved:.3f}")
    return table


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--frames", type=int, default=100)
    parser.add_argument("--check", type=int, default=200)
    given = parser.parse_args()
    console = Console(width=150)
    for name, recording in (("camera, 320 x 240", camera()), ("two fingers, 80 taxels", fingers())):
        console.print(speed(name, *recording, given))
        console.print(accuracy(name, *recording))


if __name__ == "__main__":
    main()
