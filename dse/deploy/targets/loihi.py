"""Intel Loihi: integer arrays in the layout of Lava-DL's netx (net.hdf5), and a script that runs the file.

net.hdf5     /layer/<k>/type 'dense' or 'dense_rec', shape, inFeatures, outFeatures, weight (out, in) and
             weight_rec (out, out): the integers of the chip, even numbers from -256 to 254; delay (out, in)
             where synapses have any, steps; neuron/type 'CUBA', iDecay and vDecay (one number, or one per
             neuron), vThMant, refDelay 1, gradedSpike 0. /simulation/Ts, tSample. Attributes of the file:
             how inputs arrive, the decision rule
run.py       runs it, by brian2-loihi or by the same integers (dse.deploy.loihi_run)

The equations are those of `cuba_lif` in integer arithmetic: states are 64 times the weights, so the weight
exponent is 0. netx derives the exponent and the bits of a weight from the numbers that are there. A spike
reaches the next layer, and neurons of its own recurrent layer, one step later, on the chip as here. Delayed
copies of inputs are inputs of their own, which the host feeds later; `delay` is of synapses alone.

The file is run, not the network that it was written from: always by the integers that Lava's bit-accurate
simulator was recorded with, and by brian2-loihi 0.5.2, an emulator of Loihi 1 by others, where an environment
has it. Both must agree for `faithful`. Registers have 24 bits: u wraps, v is clipped, which the network's own
arithmetic does not do. A network whose states left them in validation is refused (`state_bits` of the
profile); for other recordings a run shows whether it matters.

Refused besides what the profile loihi1_silicon refuses: a current decay of 0 (the chip adds 1 to its
register), a voltage decay of 4096 (12 bits), a threshold above 131071 (17 bits).

Source: lava-dl, lava-nc; Davies et al. 2018; Michaelis et al. 2022, brian2-loihi (REFERENCES.md).
"""

from __future__ import annotations

import dataclasses
import json
import shutil
import sys
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from dse.deploy.bundle import Bundle
from dse.deploy.reference import Reference
from dse.deploy.targets import Run, TargetError, Verdict, compare
from dse.deploy.targets.chips import decision_of, inputs_of, misfit, run_script, whole_weights
from dse.deploy.targets.peers import interpreter
from dse.neurons import cuba_lif, population_of
from dse.neurons.fixed_point import DECAY_SCALE
from dse.records import Ints, Network
from dse.registry import register

CHIP = "loihi1_silicon"
MOST_THRESHOLD = 2**17 - 1

_NET, _SCRIPT = "net.hdf5", "run.py"
_RUN = Path(__file__).resolve().parents[1] / "loihi_run.py"


@register("targets", "loihi")
@dataclass(frozen=True)
class Loihi:
    """The network as a netx file, run by Loihi's equations."""

    label: ClassVar[str] = "Intel Loihi, netx HDF5 for Lava-DL"
    extra: ClassVar[str] = "h5"
    use: ClassVar[str] = (
        "`netx.hdf5.Network(net_config='targets/loihi/net.hdf5')` of Lava-DL; `python targets/loihi/run.py` "
        "runs it without Lava"
    )

    def refusal(self, bundle: Bundle) -> str:
        """Return why Loihi cannot hold the classifier; '' if it can."""
        network = bundle.fitted
        if not isinstance(network, Network):
            return f"Loihi holds networks of neurons, and family {bundle.sections.kinds['model']} is none"
        if why := misfit(bundle, CHIP):
            return why
        for k, layer in enumerate(network.layers, 1):
            population = population_of(layer.neuron, layer.parameters)
            if not isinstance(population, cuba_lif.Population):
                return (
                    f"layer {k} has neurons '{layer.neuron}', and only CUBA-LIF neurons are written for Loihi"
                )
            if np.any(population.decay_current == 0):
                return f"layer {k} has a current decay of 0, and the least of Loihi is 1/{DECAY_SCALE}"
            if np.any(population.decay_voltage == DECAY_SCALE):
                return f"layer {k} has a voltage decay of 1, and the most of Loihi is 4095/{DECAY_SCALE}"
            if population.threshold > MOST_THRESHOLD:
                return f"layer {k} has the threshold {population.threshold}, and the most is {MOST_THRESHOLD}"
        if network.arithmetic != "integer":
            return f"Loihi holds integers, and the network has {network.arithmetic} arithmetic"
        return ""

    def write(self, bundle: Bundle, folder: Path) -> None:
        """Write net.hdf5 and run.py (`dse.deploy.targets.Target`)."""
        if find_spec("h5py") is None:
            raise TargetError("h5py is not installed: pip install 'dse[h5]'")
        network = bundle.fitted
        assert isinstance(network, Network)
        _write_net(folder / _NET, bundle, network)
        shutil.copyfile(_RUN, folder / _SCRIPT)

    def verify(self, bundle: Bundle, folder: Path, reference: Reference) -> Verdict:
        """Run net.hdf5 by both sets of equations, and compare.

        Figure `brian2_loihi_recordings` counts the recordings that brian2-loihi ran: 0 where no environment
        has it or the integers differ already, the first ones only where all would take too much memory.
        """
        if find_spec("h5py") is None:
            return Verdict("not verified", "h5py is not installed")
        network = bundle.fitted
        assert isinstance(network, Network)
        fired, written = run_script(sys.executable, _RUN, [folder / _NET], network, reference)
        run_by = [str(written["run_by"])]
        verdict = compare(reference, Run.of_fired(bundle, reference, fired), run_by=run_by)
        python, n_run = interpreter("brian2_loihi"), 0
        if python is not None and verdict.kind == "faithful":
            emulated, written = run_script(python, _RUN, ["--brian2", folder / _NET], network, reference)
            n_run = int(written["n_run"])
            others = [spikes[spikes[:, 0] >= n_run] for spikes in fired]
            both = [np.concatenate(pair) for pair in zip(emulated, others, strict=True)]
            of_all = f" on {n_run} of {reference.n_recordings} recordings"
            run_by.append(f"{written['run_by']}{of_all if n_run < reference.n_recordings else ''}")
            verdict = compare(reference, Run.of_fired(bundle, reference, both), run_by=run_by)
        return dataclasses.replace(verdict, figures={"brian2_loihi_recordings": n_run})


def _write_net(path: Path, bundle: Bundle, network: Network) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        for k, layer in enumerate(network.layers):
            population = population_of(layer.neuron, layer.parameters)
            assert isinstance(population, cuba_lif.Population)
            group = file.create_group(f"layer/{k}")
            n_out, n_in = layer.weight.shape
            kind = b"dense" if layer.recurrent is None else b"dense_rec"
            group.create_dataset("type", (1,), "S10", [kind])
            group["shape"] = np.array([n_out], np.int64)
            group["inFeatures"], group["outFeatures"] = n_in, n_out
            _put(group, "weight", 2 * whole_weights(layer.weight))
            if layer.recurrent is not None:
                _put(group, "weight_rec", 2 * whole_weights(layer.recurrent))
            if layer.delay is not None:
                _put(group, "delay", layer.delay)
            neuron = {
                "type": "CUBA",
                "iDecay": _one_or_all(population.decay_current),
                "vDecay": _one_or_all(population.decay_voltage),
                "vThMant": population.threshold,
                "refDelay": 1,
                "gradedSpike": False,
            }
            for name, value in neuron.items():
                group[f"neuron/{name}"] = value
        if bundle.input is not None:
            file["simulation/Ts"] = bundle.input.step_ms / network.steps_per_sample
            file["simulation/tSample"] = bundle.input.n_steps * network.steps_per_sample
        file.attrs["inputs"] = json.dumps(inputs_of(network))
        file.attrs["decision"] = json.dumps(decision_of(bundle))


def _put(group: Any, name: str, values: Any) -> None:
    """Write a matrix as lava-dl does, in float32; zeros of pruned weights take no room."""
    group.create_dataset(name, data=np.asarray(values, np.float32), compression="gzip")


def _one_or_all(decay: Ints) -> Any:
    """Return the decay of all neurons as a number where they agree."""
    values = np.asarray(decay, np.int64)
    return values.flat[0] if (values == values.flat[0]).all() else values
