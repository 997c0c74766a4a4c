"""What targets that are chips have in common: the limits of their hardware profiles, and runs by a script."""

from __future__ import annotations

import math
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from dse.deploy.bundle import Bundle
from dse.deploy.reference import Reference
from dse.deploy.targets import TargetError
from dse.engine.events import gather
from dse.hardware import profile
from dse.hardware.cost import NotApplicable
from dse.models.snn.quantise import BITS
from dse.neurons import neuron_of
from dse.neurons.fixed_point import quantise
from dse.records import Array, Ints, Network, Workload

WEIGHT_STEPS = 32
"""8-bit steps in a weight of 1."""


def whole_weights(weight: Array) -> Ints:
    """Return weights as they run, in 8-bit steps: -128 to 127."""
    return np.rint(quantise(weight) * WEIGHT_STEPS).astype(np.int64)


def misfit(bundle: Bundle, chip: str) -> str:
    """Return why a chip cannot hold the network of a bundle, by its hardware profile; '' if it can."""
    network = bundle.fitted
    assert isinstance(network, Network)
    sizes = network.sizes
    neurons = [(neuron_of(layer.neuron), layer) for layer in network.layers]
    load = Workload(
        sizes=sizes,
        recurrent=tuple(layer.recurrent is not None for layer in network.layers),
        n_steps=np.ones(1),
        spikes=np.zeros((1, len(sizes))),
        updates=None,
        # Without the step of the recordings no clock is too slow.
        step_ms=1e3 if bundle.input is None else bundle.input.step_ms / network.steps_per_sample,
        weight_bits=int(bundle.evidence.get("precision", {}).get("weight_bits", BITS)),
        stored=network.stored,
        delay_bits=network.delay_bits,
        resonators=tuple(neuron.resonators(layer.parameters) for neuron, layer in neurons),
        peak_state=_peak_state(bundle),
    )
    chosen = profile.load(chip)
    try:
        placement = chosen.plan(load, chosen.ends).placement
    except NotApplicable as error:
        return str(error)
    if placement is None or not placement.misfits:
        return ""
    return f"the network does not fit {chip}: {placement.misfits[0]}"


def _peak_state(bundle: Bundle) -> int:
    """Return the largest state of the design's validation; 0 where its record has none."""
    peak = bundle.record.get("peak_state")
    return int(peak) if isinstance(peak, int | float) and 0 <= peak < math.inf else 0


def inputs_of(network: Network) -> dict[str, object]:
    """Return in words and numbers what arrives at each input of the first layer."""
    return {
        "n_channels": network.n_channels,
        "delays": list(network.delays),
        "steps_per_sample": network.steps_per_sample,
        "rule": "input d * n_channels + c spikes where channel c spiked, delays[d] network steps later; "
        "input steps arrive on the first of steps_per_sample network steps",
    }


def decision_of(bundle: Bundle) -> dict[str, object]:
    """Return the decision rule and the names of the classes."""
    return {
        "phi": bundle.phi,
        "theta": bundle.theta,
        "read_out_ms": bundle.read_out_ms,
        "head": bundle.head,
        "heads": [{"name": x.name, "classes": list(x.classes)} for x in bundle.heads],
        "classes": list(bundle.classes),
    }


def run_script(
    python: str | Path, script: Path, arguments: Sequence[str | Path], network: Network, reference: Reference
) -> tuple[list[Ints], Mapping[str, Array]]:
    """Run a script on the input spikes of a reference; return what each layer fired, and all that it wrote.

    Args:
        python: interpreter; nothing but the standard path and its own packages are visible to it.
        script: takes ARGUMENTS SPIKES FIRED: two .npz files (docstrings of the scripts).
        arguments: what comes before the two files.
        network: of the bundle.
        reference: the recordings.

    Raises:
        TargetError: it fails.
    """
    data = reference.dataset
    rows = gather(
        data.spikes,
        data.test,
        data.start[data.test],
        data.n_steps,
        network.delays,
        network.steps_per_sample,
    )
    with tempfile.TemporaryDirectory() as folder:
        spikes, fired = Path(folder) / "spikes.npz", Path(folder) / "fired.npz"
        n, t = reference.n_recordings, reference.n_steps
        np.savez(spikes, spikes=rows.listed(), n_recordings=n, n_steps=t)
        command = [str(x) for x in (python, "-I", script, *arguments, spikes, fired)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            last = (done.stderr.strip() or f"it ends with code {done.returncode}").splitlines()[-1]
            raise TargetError(f"{script.name} cannot run {arguments[-1]}: {last}")
        with np.load(fired) as file:
            written = dict(file)
    return [written[f"fired_{k}"] for k in range(len(network.layers))], written
