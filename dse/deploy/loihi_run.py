"""Run a network from a netx HDF5 file by Loihi's equations: a script that needs numpy and h5py, and not dse.

    python run.py [--brian2] net.hdf5 SPIKES FIRED

SPIKES (.npz): `spikes`, (n_spikes, 3) recording, step, input; `n_recordings`, `n_steps`.
FIRED (.npz, written): `fired_<k>`, (n_spikes, 3) recording, step, neuron of /layer/<k>, sorted; `n_run`, the
recordings that were run, from the first on; `run_by`, what ran them.

With --brian2 the equations are those of brian2-loihi. Without, they are these integers, at every step, with
D(x, d) = sign(x) ((|x| (4096 - d)) >> 12) and a the sum of the weights that spikes arrive at:

    u = wrap(D(u, iDecay) + 64 a)          24 bits, two's complement
    v = clip(D(v, vDecay) + u)             +-(2**23 - 1)
    fires where v > 64 vThMant;  v = 0 there

Spikes reach the next layer, and neurons of a layer `dense_rec`, one step later; with `delay`, so many steps
after that.
"""

from __future__ import annotations

import importlib.metadata
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import h5py
import numpy as np

STATE_BITS = 24
_CELLS = 2**24  # input cells that are held at a time
_MOST_SYNAPSES = 2**22  # in a run of brian2-loihi


@dataclass(frozen=True)
class Layer:
    """A group of the file: weight and delay (out, in), weight_rec (out, out) or None, decays (out,)."""

    weight: Any
    delay: Any
    weight_rec: Any
    current_decay: Any
    voltage_decay: Any
    threshold: int


def read(path: str) -> list[Layer]:
    """Return the layers of a file.

    Raises:
        ValueError: it has one that is neither dense nor dense_rec, or neurons that are not CUBA.
    """
    layers = []
    with h5py.File(path, "r") as file:
        for k in range(len(file["layer"])):
            group, neuron = file[f"layer/{k}"], file[f"layer/{k}/neuron"]
            kind, cuba = group["type"][0].decode(), neuron["type"][()].decode()
            if kind not in ("dense", "dense_rec") or cuba != "CUBA":
                raise ValueError(f"/layer/{k} must be dense or dense_rec of CUBA neurons, got {kind}, {cuba}")
            weight = group["weight"][()].astype(np.int64)
            n = len(weight)
            layers.append(
                Layer(
                    weight,
                    group["delay"][()].astype(np.int64) if "delay" in group else np.zeros_like(weight),
                    group["weight_rec"][()].astype(np.int64) if kind == "dense_rec" else None,
                    np.broadcast_to(neuron["iDecay"][()], n).astype(np.int64),
                    np.broadcast_to(neuron["vDecay"][()], n).astype(np.int64),
                    int(neuron["vThMant"][()]),
                )
            )
    return layers


def decayed(x: Any, decay: Any) -> Any:
    """Return integers after one step of decay, rounded toward 0."""
    return np.sign(x) * ((np.abs(x) * (4096 - decay)) >> 12)


def states(layer: Layer, spikes: Any) -> Iterator[tuple[Any, Any, Any]]:
    """Yield u, v after a reset, and which neurons fire, (recording, neuron) each, for every step.

    Args:
        layer: as read.
        spikes: (step, recording, input) bool, as they arrive without `delay`.
    """
    n_steps, n = spikes.shape[:2]
    z = np.zeros((n_steps, n, len(layer.weight)), np.int64)
    for steps in np.unique(layer.delay[layer.weight != 0]).tolist():
        weight = np.where(layer.delay == steps, layer.weight, 0).T.astype(np.float64)
        z[steps:] += np.rint(spikes[: max(0, n_steps - steps)] @ weight).astype(np.int64)
    u = np.zeros((n, len(layer.weight)), np.int64)
    v, fired = np.zeros_like(u), np.zeros(u.shape, bool)
    half = 2 ** (STATE_BITS - 1)
    for arriving in z:
        if layer.weight_rec is not None:
            arriving = arriving + fired @ layer.weight_rec.T
        u = (decayed(u, layer.current_decay) + 64 * arriving + half) % (2 * half) - half
        v = np.clip(decayed(v, layer.voltage_decay) + u, 1 - half, half - 1)
        fired = v > 64 * layer.threshold
        v = np.where(fired, 0, v)
        yield u, v, fired


def dense(spikes: Any, first: int, n: int, n_steps: int, n_inputs: int) -> Any:
    """Return listed spikes of n recordings, (n_spikes, 3), as (step, recording, input) bool."""
    own = spikes[(spikes[:, 0] >= first) & (spikes[:, 0] < first + n)]
    out = np.zeros((n_steps, n, n_inputs), bool)
    out[own[:, 1], own[:, 0] - first, own[:, 2]] = True
    return out


def later(spikes: Any) -> Any:
    """Return spikes (step, ...) one step later."""
    return np.concatenate([np.zeros_like(spikes[:1]), spikes[:-1]])


def run(layers: list[Layer], spikes: Any, n: int, n_steps: int) -> list[Any]:
    """Return (n_spikes, 3) recording, step and neuron of every spike of each layer, by the integers above."""
    parts: list[list[Any]] = [[np.zeros((0, 3), np.int64)] for _ in layers]
    widest = max(x.weight.shape[1] for x in layers)
    size = max(1, _CELLS // max(1, n_steps * widest))
    for first in range(0, n, size):
        arriving = dense(spikes, first, min(size, n - first), n_steps, layers[0].weight.shape[1])
        for layer, part in zip(layers, parts, strict=True):
            fired = np.stack([fires for _, _, fires in states(layer, arriving)])
            step, recording, neuron = np.nonzero(fired)
            part.append(np.stack([recording + first, step, neuron], axis=1))
            arriving = later(fired)
    return [np.concatenate(part) for part in parts]


def run_in_brian2(layers: list[Layer], spikes: Any, n: int, n_steps: int) -> tuple[list[Any], int]:
    """Return the same by brian2-loihi, and how many recordings were run: not all if there are many synapses.

    Recordings are neurons side by side. Its group of neurons has one pair of decays; here its equations
    are run with a pair per neuron.
    """
    import brian2
    import brian2_loihi
    from brian2_loihi.constants import synapse_sign_mode

    brian2.prefs.codegen.target = "numpy"
    brian2.BrianLogger.log_level_error()
    matrices = [m for x in layers for m in (x.weight, x.weight_rec) if m is not None]
    synapses = sum(int(np.count_nonzero(m)) for m in matrices)
    n = min(n, max(1, _MOST_SYNAPSES // max(1, synapses)))
    network = brian2_loihi.LoihiNetwork()
    n_inputs = layers[0].weight.shape[1]
    arriving = spikes[spikes[:, 0] < n]
    source: Any = brian2_loihi.LoihiSpikeGeneratorGroup(
        n * n_inputs, arriving[:, 0] * n_inputs + arriving[:, 2], arriving[:, 1]
    )
    network.add(source)
    monitors = []

    def connect(before: Any, after: Any, weight: Any, delay: Any) -> None:
        n_out, n_in = weight.shape
        for steps in np.unique(delay[weight != 0]).tolist():
            to, of = np.nonzero((weight != 0) & (delay == steps))
            made = brian2_loihi.LoihiSynapses(
                before, after, delay=steps, sign_mode=synapse_sign_mode.MIXED, num_weight_bits=8
            )
            recording = np.arange(n)[:, None]
            made.connect(i=(recording * n_in + of).ravel(), j=(recording * n_out + to).ravel())
            made.w = np.tile(weight[to, of], n)
            network.add(made)

    for layer in layers:
        group = _neurons(layer, n)
        connect(source, group, layer.weight, layer.delay)
        if layer.weight_rec is not None:
            connect(group, group, layer.weight_rec, np.zeros_like(layer.weight_rec))
        monitors.append(brian2.SpikeMonitor(group))
        network.add(group, monitors[-1])
        source = group
    network.run(n_steps)
    fired = []
    for layer, monitor in zip(layers, monitors, strict=True):
        recording, neuron = np.divmod(np.asarray(monitor.i), len(layer.weight))
        step = np.rint(np.asarray(monitor.t / brian2.ms)).astype(np.int64)
        fired.append(np.stack([recording, step, neuron], axis=1))
    return fired, n


def _neurons(layer: Layer, copies: int) -> Any:
    """Return a layer's neurons, so many times, by the equations of brian2-loihi."""
    import brian2
    import brian2_loihi

    text = str(brian2_loihi.LoihiNeuronGroup(1, decay_v=1, decay_I=3).user_equations)
    for name, of_decay in (("share_v", 1 / 4096), ("share_I", 3 / 4096)):
        if text.count(str(of_decay)) != 1:
            raise RuntimeError(f"brian2-loihi's equations must name the decay {of_decay} once, got {text}")
        text = text.replace(str(of_decay), name)
    group = brian2.NeuronGroup(
        copies * len(layer.weight),
        f"{text}\nshare_v : 1 (constant)\nshare_I : 1 (constant)",
        threshold=f"v > {64 * layer.threshold}",
        reset="v = 0",
        refractory=1 * brian2.ms,
        method="forward_euler",
    )
    group.share_v = np.tile(layer.voltage_decay / 4096, copies)
    group.share_I = np.tile(layer.current_decay / 4096, copies)
    return group


def main(*arguments: str) -> None:
    """Read the files, run the recordings, write what fired."""
    *flags, network, spikes_file, fired_file = arguments
    layers = read(network)
    with np.load(spikes_file) as file:
        spikes, n, n_steps = file["spikes"].astype(np.int64), int(file["n_recordings"]), int(file["n_steps"])
    n_run, run_by = n, "run.py"
    if flags == ["--brian2"]:
        fired, n_run = run_in_brian2(layers, spikes, n, n_steps)
        run_by = f"brian2-loihi {importlib.metadata.version('brian2-loihi')}"
    else:
        fired = run(layers, spikes, n, n_steps)
    ordered = [x[np.lexsort(x.T[::-1])].astype(np.int32) for x in fired]
    np.savez(fired_file, n_run=n_run, run_by=run_by, **{f"fired_{k}": x for k, x in enumerate(ordered)})


if __name__ == "__main__":
    main(*sys.argv[1:])
