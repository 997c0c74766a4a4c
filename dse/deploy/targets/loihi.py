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

import json
import shutil
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from dse.base.records import Ints
from dse.base.registry import register
from dse.deploy.bundle import Bundle
from dse.deploy.form import Net, Unsupported, net_of, network_in
from dse.deploy.reference import Reference
from dse.deploy.run import interpreter, of_script, require
from dse.deploy.targets import BackEnd, Engine, Run
from dse.deploy.targets.chips import decision_of, inputs_of, misfit
from dse.engine.neurons import cuba_lif
from dse.engine.neurons.fixed_point import DECAY_SCALE

CHIP = "loihi1_silicon"
MOST_THRESHOLD = 2**17 - 1

_NET, _SCRIPT = "net.hdf5", "run.py"
_RUN = Path(__file__).resolve().parents[1] / "loihi_run.py"


@register("targets", "loihi")
@dataclass(frozen=True)
class Loihi(BackEnd[Net]):
    """The network as a netx file, run by Loihi's equations."""

    label: ClassVar[str] = "Intel Loihi, netx HDF5 for Lava-DL"
    extra: ClassVar[str] = "h5"
    use: ClassVar[str] = (
        "`netx.hdf5.Network(net_config='targets/loihi/net.hdf5')` of Lava-DL; `python targets/loihi/run.py` "
        "runs it without Lava"
    )

    def form(self, bundle: Bundle) -> Net:
        """Return the network, within the limits of the chip."""
        net = net_of(network_in(bundle, "Loihi holds"))
        if why := misfit(bundle, CHIP):
            raise Unsupported(why)
        for k, layer in enumerate(net.layers, 1):
            population, why = layer.population, ""
            if not isinstance(population, cuba_lif.Population):
                why = f"neurons '{layer.neuron}', and only CUBA-LIF neurons are written for Loihi"
            elif np.any(population.decay_current == 0):
                why = f"a current decay of 0, and the least of Loihi is 1/{DECAY_SCALE}"
            elif np.any(population.decay_voltage == DECAY_SCALE):
                why = f"a voltage decay of 1, and the most of Loihi is 4095/{DECAY_SCALE}"
            elif population.threshold > MOST_THRESHOLD:
                why = f"the threshold {population.threshold}, and the most is {MOST_THRESHOLD}"
            if why:
                raise Unsupported(f"layer {k} has {why}")
        if net.arithmetic != "integer":
            raise Unsupported(f"Loihi holds integers, and the network has {net.arithmetic} arithmetic")
        return net

    def emit(self, form: Net, bundle: Bundle, folder: Path) -> None:
        """Write net.hdf5 and run.py."""
        require("h5py", "h5")
        _write_net(folder / _NET, bundle, form)
        shutil.copyfile(_RUN, folder / _SCRIPT)

    def engines(self, form: Net, bundle: Bundle, folder: Path, reference: Reference) -> Iterator[Engine]:
        """Run net.hdf5 by both sets of equations.

        Figure `brian2_loihi_recordings` counts the recordings that brian2-loihi ran: 0 where no environment
        has it or the integers differ already, the first ones only where all would take too much memory.
        """
        if find_spec("h5py") is None:
            yield Engine(("h5py is not installed",))
            return
        fired, written = of_script(sys.executable, _RUN, [folder / _NET], form, reference)
        run, figure = Run.of_fired(bundle, reference, fired), "brian2_loihi_recordings"
        ours = Engine((str(written["run_by"]),), run, {figure: 0})
        yield ours
        python = interpreter("brian2_loihi")
        if python is not None and ours.verdict(reference).kind == "faithful":
            emulated, written = of_script(python, _RUN, ["--brian2", folder / _NET], form, reference)
            n_run = int(written["n_run"])
            others = [spikes[spikes[:, 0] >= n_run] for spikes in fired]
            both = [np.concatenate(pair) for pair in zip(emulated, others, strict=True)]
            of_all = f" on {n_run} of {reference.n_recordings} recordings"
            by = f"{written['run_by']}{of_all if n_run < reference.n_recordings else ''}"
            yield Engine((by,), Run.of_fired(bundle, reference, both), {figure: n_run})


def _write_net(path: Path, bundle: Bundle, net: Net) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        for k, layer in enumerate(net.layers):
            population = layer.population
            assert isinstance(population, cuba_lif.Population)
            group = file.create_group(f"layer/{k}")
            kind = b"dense" if layer.recurrent is None else b"dense_rec"
            group.create_dataset("type", (1,), "S10", [kind])
            group["shape"] = np.array([layer.n_neurons], np.int64)
            group["inFeatures"], group["outFeatures"] = len(layer.weights), layer.n_neurons
            _put(group, "weight", 2 * layer.forward_steps.T)
            if layer.recurrent is not None:
                _put(group, "weight_rec", 2 * layer.ring_steps.T)
            if layer.delays is not None:
                _put(group, "delay", layer.delays.T)
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
            file["simulation/Ts"] = bundle.input.step_ms / net.steps_per_sample
            file["simulation/tSample"] = bundle.input.n_steps * net.steps_per_sample
        file.attrs["inputs"] = json.dumps(inputs_of(net))
        file.attrs["decision"] = json.dumps(decision_of(bundle))


def _put(group: Any, name: str, values: Any) -> None:
    """Write a matrix as lava-dl does, in float32; zeros of pruned weights take no room."""
    group.create_dataset(name, data=np.asarray(values, np.float32), compression="gzip")


def _one_or_all(decay: Ints) -> Any:
    """Return the decay of all neurons as a number where they agree."""
    values = np.asarray(decay, np.int64)
    return values.flat[0] if (values == values.flat[0]).all() else values
