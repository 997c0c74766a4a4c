"""Targets of a user, unregistered: the network as arrays, run by the definition of its neurons."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from dse import store
from dse.base.records import Network, Response
from dse.deploy.bundle import Bundle, BundleError
from dse.deploy.reference import Reference, decided
from dse.deploy.targets import Run, TargetError, Verdict, compare
from dse.engine.neurons import cuba_lif, population_of
from dse.engine.neurons.fixed_point import quantise


@dataclass(frozen=True)
class Arrays:
    """The network's arrays in one file."""

    label: ClassVar[str] = "arrays of numpy"
    extra: ClassVar[str] = ""
    use: ClassVar[str] = "numpy.load('targets/arrays/network.npz')"

    def refusal(self, bundle: Bundle) -> str:
        return "" if isinstance(bundle.fitted, Network) else "arrays hold a network, and this is none"

    def write(self, bundle: Bundle, folder: Path) -> None:
        store.save_arrays(folder / "network.npz", store.record_arrays(bundle.fitted))

    def verify(self, bundle: Bundle, folder: Path, reference: Reference) -> Verdict:
        arrays = store.load_arrays(folder / "network.npz")
        network = store.record_of(Network, arrays)
        fired = _fired(network, reference)
        output = cuba_lif.shift(fired[-1]).astype(np.uint8)
        none = np.zeros((*output.shape[:2], 0), np.int32)
        rule = dataclasses.replace(bundle, fitted=network)
        answers = decided(rule, reference.dataset, Response(output, none, none, reference.step_ms, 0))
        size = sum(array.nbytes for array in arrays.values())
        run = Run(*answers, fired=[np.argwhere(x) for x in fired])
        return compare(reference, run, {"flash_bytes": size}, run_by=["numpy"])


@dataclass(frozen=True)
class Locked(Arrays):
    """Arrays that nothing on this machine can run."""

    label: ClassVar[str] = "arrays behind a lock"

    def verify(self, bundle: Bundle, folder: Path, reference: Reference) -> Verdict:
        raise TargetError("no key is installed; pip install 'dse-spiking[key]'")


@dataclass(frozen=True)
class Unread(Arrays):
    """Arrays that whatever is installed runs, here nothing."""

    label: ClassVar[str] = "arrays that nobody reads"

    def verify(self, bundle: Bundle, folder: Path, reference: Reference) -> Verdict:
        return Verdict("not verified", "no reader is installed")


@dataclass(frozen=True)
class Stubborn(Arrays):
    """Arrays that are not written."""

    label: ClassVar[str] = "arrays on a full disk"

    def write(self, bundle: Bundle, folder: Path) -> None:
        (folder / "half.npz").write_text("half")
        raise BundleError("the disk is full")


def _fired(network, reference):
    """Return the spikes of every layer, (recording, step, neuron) bool, found a step after the other."""
    n, steps, per_sample = reference.n_recordings, reference.n_steps, network.steps_per_sample
    recording, step, channel = reference.spikes_in.T
    arriving = np.zeros((n, steps, network.sizes[0]))
    for k, delay in enumerate(network.delays):
        later = step * per_sample + delay
        seen = later < steps
        arriving[recording[seen], later[seen], channel[seen] + k * network.n_channels] = 1
    layers = []
    for layer in network.layers:
        population = population_of(layer.neuron, layer.parameters)
        z = arriving @ quantise(layer.weight).T
        if layer.recurrent is not None:
            for t in range(1, steps):
                before = cuba_lif.run(z[:, :t], population, "integer")[2][:, -1]
                z[:, t] += before @ quantise(layer.recurrent).T
        layers.append(cuba_lif.run(z, population, "integer")[2])
        arriving = cuba_lif.shift(layers[-1])
    return layers
