"""A chip of cores on a mesh, step by step, neuron by neuron and message by message.

In a step every core walks through its neurons: each takes its access, and its update and its spike where they
happen; a spike is then sent to one destination core after the other. Inputs are sent from ports at tile 0. A
core receives beside that, one message after the other. A barrier ends the step.

Without a network, a message is there at once and a step takes as long as the core that sends or receives
longest: what `dse.measure.hardware.kinds.mesh` has in closed form. With it, messages are routed along x, then
y, and wait in queues: every link and every core's input takes one message at a time, in order of arrival, and
holds so many; what finds no room stays where it is and holds up what is behind it, up to the neurons that
send.

Source: SANA-FE's events and figures (REFERENCES.md); the network is a plain one of queues, not SANA-FE's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dse.base.native.compiled import compiled
from dse.base.records import Array, Floats, Ints, Workload
from dse.measure.hardware.placement import neurons_per_core
from dse.measure.hardware.profile import Profile

BUFFER = 16
"""Messages that a link or a core's input holds; SANA-FE's, for Loihi."""
HOP_NS = 4.1, 6.5
"""A message from a tile to the next along x, and along y: Loihi's, which the closed form has no use for."""

_COUNTS = ("access", "update", "spike", "synaptic_event", "message", "hop_x", "hop_y")


@dataclass(frozen=True)
class Layout:
    """Where units, inputs first and then neurons, are on a chip and whom they send to.

    n_inputs, n_cores: the first units; cores that hold neurons.
    core: (unit,) int64, ports of inputs numbered after the cores.
    tile: (core or port,) int64.
    row: (unit + 1,) int64; unit i sends to destination[row[i]:row[i + 1]], cores (int64) that have as many
        of its `targets` (int64), one or more.
    """

    n_inputs: int
    n_cores: int
    core: Ints
    tile: Ints
    row: Ints
    destination: Ints
    targets: Ints


@dataclass(frozen=True)
class Run:
    """What a simulated chip did.

    counts: how often each cause of energy came about.
    energy_pj: of all steps, dynamic.
    step_ns: (step,) time of each, the barrier included.
    """

    counts: Mapping[str, int]
    energy_pj: float
    step_ns: Floats


def layout(
    profile: Profile, load: Workload, connected: Sequence[Array], *, ports_last: bool = False
) -> Layout:
    """Place a network on a chip as the closed form does.

    Args:
        profile: of kind mesh.
        load: the architecture.
        connected: (source, neuron) bool into each layer; sources of a recurrent layer are followed by itself.
        ports_last: ports are at the tiles that follow, as cores are, instead of at tile 0.
    """
    limits, sizes = profile.at("value"), load.sizes
    placement = profile.plan(load, profile.ends).placement
    assert placement is not None
    n_ports = -(-sizes[0] // int(limits["neurons_per_core"]))
    first_core = np.cumsum([0, *placement.cores])
    n_cores = int(first_core[-1])
    of_layer = [n_cores + np.repeat(np.arange(n_ports), neurons_per_core(sizes[0], n_ports))]
    for first, n, size in zip(first_core, placement.cores, sizes[1:], strict=False):
        of_layer.append(first + np.repeat(np.arange(n), neurons_per_core(size, n)))
    tile = np.arange(n_cores + n_ports) // int(limits["cores_per_tile"])
    if not ports_last:
        tile[n_cores:] = 0
    reached = []
    for layer, size in enumerate(sizes):
        per_core = np.zeros((size, n_cores), np.int64)
        if layer + 1 < len(sizes):
            _add_targets(per_core, connected[layer][:size], of_layer[layer + 1])
        if layer > 0 and load.recurrent[layer - 1]:
            _add_targets(per_core, connected[layer - 1][sizes[layer - 1] :], of_layer[layer])
        reached.append(per_core)
    every = np.concatenate(reached)
    row = np.concatenate([[0], np.cumsum((every > 0).sum(axis=1))])
    destination = np.ascontiguousarray(np.nonzero(every)[1])
    return Layout(sizes[0], n_cores, np.concatenate(of_layer), tile, row, destination, every[every > 0])


def _add_targets(per_core: Array, connected: Array, core: Array) -> None:
    """Add how many targets (source, core) each source has in each core."""
    edges = [*np.flatnonzero(np.diff(core, prepend=-1)), len(core)]
    for first, end in pairwise(edges):
        per_core[:, core[first]] += connected[:, first:end].sum(axis=1)


def simulate(
    profile: Profile, chip: Layout, fired: Sequence[Array], updated: Sequence[Array], buffer: int | None
) -> Run:
    """Run a chip.

    Args:
        profile: of kind mesh; its values count.
        chip: the layout.
        fired: spikes of each layer, input first, (step, neuron) bool.
        updated: neurons updated in each layer after the input, (step, neuron) bool.
        buffer: messages that a link or a core's input holds; None: no network.
    """
    n = profile.at("value")
    times = np.array(
        [
            n[f"{name}_ns"]
            for name in (
                "neuron_access", "neuron_update", "spike", "message_out", "message_in", "synaptic_event"
            )
        ]
    )  # fmt: skip
    spikes = np.concatenate(fired, axis=1)
    updates = np.concatenate([np.zeros_like(fired[0]), *updated], axis=1)
    counts, busy_ns = np.zeros(len(_COUNTS), np.int64), np.zeros(len(spikes))
    _run(
        spikes, updates, chip.n_inputs, chip.n_cores, chip.core, chip.tile, chip.row, chip.destination,
        chip.targets, int(n["mesh_height"]), times, np.array(HOP_NS), buffer or 0, counts, busy_ns,
    )  # fmt: skip
    tiles = chip.tile.max() + 1
    barrier_ns = 1e3 * next(n[f"barrier_{least}_us"] for least in (29, 4, 2, 1) if tiles >= least)
    happened = dict(zip(_COUNTS, counts.tolist(), strict=True))
    per_count = [n[f"{'neuron_' if name in ('access', 'update') else ''}{name}_pj"] for name in _COUNTS]
    return Run(happened, float(counts @ np.array(per_count)), barrier_ns + busy_ns)


@compiled()
def _run(
    fired, updated, n_inputs, n_cores, core, tile, row, destination, targets, height, times, hop_ns, buffer,
    counts, busy_ns,
):  # fmt: skip
    """Write counts and the time of each step without its barrier."""
    access, update, spike, message_out, message_in, event = times
    n_units, n_senders, most = len(core), len(tile), len(destination)
    n_tiles = (tile.max() // height + 1) * height  # whole columns: a message may turn at an empty tile
    # Messages of a step, those of a sender one after the other: work before it is sent, and to receive it.
    gap, work, to = np.empty(most), np.empty(most), np.empty(most, np.int64)
    begin, end = np.empty(n_senders, np.int64), np.empty(n_senders, np.int64)
    for t in range(len(fired)):
        send, receive, last = np.zeros(n_senders), np.zeros(n_cores), np.zeros(n_senders)
        begin[:], end[:] = 0, 0
        n_messages = 0
        for unit in range(n_units):
            sender = core[unit]
            if unit >= n_inputs:
                send[sender] += access
                counts[0] += 1
                if updated[t, unit]:
                    send[sender] += update
                    counts[1] += 1
            if not fired[t, unit]:
                continue
            if unit >= n_inputs:
                send[sender] += spike
                counts[2] += 1
            for at in range(row[unit], row[unit + 1]):
                c = destination[at]
                send[sender] += message_out
                if begin[sender] == end[sender]:
                    begin[sender] = n_messages
                gap[n_messages] = send[sender] - last[sender]
                work[n_messages] = message_in + event * targets[at]
                to[n_messages] = c
                receive[c] += work[n_messages]
                last[sender] = send[sender]
                n_messages += 1
                end[sender] = n_messages
                counts[3] += targets[at]
                counts[4] += 1
                counts[5] += abs(tile[sender] // height - tile[c] // height)
                counts[6] += abs(tile[sender] % height - tile[c] % height)
        if buffer == 0:
            busy_ns[t] = max(send.max(), receive.max())
        else:
            rest = send - last
            busy_ns[t] = _queued(
                begin, end, gap, work, to, rest, tile, n_cores, n_tiles, height, hop_ns, buffer
            )


@compiled()
def _queued(begin, end, gap, work, to, rest, tile, n_cores, n_tiles, height, hop_ns, buffer):
    """Return when the last message of a step was received and the last core had sent.

    A place is a sender, a core's input or a link; it serves one message, the first in its queue.
    """
    n_senders = len(begin)
    first_link = n_senders + n_cores
    n_places = first_link + 4 * n_tiles
    queue, head = np.empty((n_places, buffer), np.int64), np.zeros(n_places, np.int64)
    waiting = np.zeros(n_places, np.int64)
    ready = np.full(n_places, np.inf)  # when its message has been served
    held_by, held_since, n_held = np.full(n_places, -1), np.zeros(n_places, np.int64), 0
    ended = 0.0
    for sender in range(n_senders):
        head[sender], waiting[sender] = begin[sender], end[sender] - begin[sender]
        if waiting[sender]:
            ready[sender] = gap[begin[sender]]
        else:
            ended = max(ended, rest[sender])
    while True:
        place = ready.argmin()
        now = ready[place]
        if now == np.inf:
            return ended
        ready[place] = np.inf
        message = head[place] if place < n_senders else queue[place, head[place]]
        if place < n_senders or place >= first_link:
            onward = _onward(place, to[message], tile, n_senders, first_link, height)
            if waiting[onward] == buffer:
                held_by[place], held_since[place] = onward, n_held
                n_held += 1
                continue
            _enter(onward, message, now, queue, head, waiting, ready, work, hop_ns, n_senders, first_link)
        else:
            ended = max(ended, now)
        while place >= 0:  # what leaves makes room for what was held up, and so on
            waiting[place] -= 1
            if place < n_senders:
                head[place] += 1
                if waiting[place]:
                    ready[place] = now + gap[head[place]]
                else:
                    ended = max(ended, now + rest[place])
                break
            head[place] = (head[place] + 1) % buffer
            if waiting[place]:
                ready[place] = now + _service(place, queue[place, head[place]], work, hop_ns, first_link)
            next_in = -1
            for other in range(n_places):
                if held_by[other] == place and (next_in < 0 or held_since[other] < held_since[next_in]):
                    next_in = other
            if next_in >= 0:
                held_by[next_in] = -1
                message = head[next_in] if next_in < n_senders else queue[next_in, head[next_in]]
                _enter(place, message, now, queue, head, waiting, ready, work, hop_ns, n_senders, first_link)
            place = next_in


@compiled()
def _onward(place, destination, tile, n_senders, first_link, height):
    """Return where a message goes from a place: the core's input at its tile, else a link along x, then y."""
    if place < n_senders:
        at = tile[place]
    else:
        link = place - first_link
        at = link // 4 + (height, -height, 1, -1)[link % 4]
    aim = tile[destination]
    if at == aim:
        return n_senders + destination
    if at // height != aim // height:
        return first_link + 4 * at + (0 if at // height < aim // height else 1)
    return first_link + 4 * at + (2 if at < aim else 3)


@compiled()
def _service(place, message, work, hop_ns, first_link):
    """Return how long a place takes for a message."""
    if place < first_link:
        return work[message]
    return hop_ns[(place - first_link) % 4 // 2]


@compiled()
def _enter(place, message, now, queue, head, waiting, ready, work, hop_ns, n_senders, first_link):
    """Put a message at the end of a queue with room."""
    queue[place, (head[place] + waiting[place]) % queue.shape[1]] = message
    waiting[place] += 1
    if waiting[place] == 1:
        ready[place] = now + _service(place, message, work, hop_ns, first_link)
