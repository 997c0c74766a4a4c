"""Write sanafe.json and sanafe_steps.json: counts, energy and time of small networks run in SANA-FE 2.2.9.

    pip install sanafe==2.2.9 numpy && python tests/golden/make_sanafe.py

sanafe.json: totals. Inputs share core 0 with the first neurons (they cost nothing there but their messages),
as `dse.measure.hardware.placement` has it.
sanafe_steps.json: counts and time of every step. Inputs have cores of their own, so that no core sends for
inputs and for neurons.
Weights are random; only counts and totals are kept.
"""

import json
from pathlib import Path

import numpy as np
import sanafe

STEPS, RATE = 100, 0.02
NEURON = {"threshold": 1.0, "leak_decay": 29 / 32, "reset_mode": "soft"}
UNITS = {
    "soma_hw_name": "loihi_lif",
    "default_synapse_hw_name": "loihi_dense_synapse",
    "default_dendrite_hw_name": "loihi_dendrites",
}


def network(sizes, cores, scale, *, spread=0.3, seed=None, input_cores=0):
    """Return a loaded chip and its number of input spikes.

    Args:
        sizes: neurons per layer, input first.
        cores: of the layers after the input.
        scale: mean of the hidden weights.
        spread: standard deviation of the hidden weights.
        seed: of weights and input; None: the sizes.
        input_cores: after those of the neurons; 0: inputs share core 0.
    """
    n_in, n_hidden, n_out = sizes
    rng = np.random.default_rng(sizes if seed is None else seed)
    train = rng.random((n_in, STEPS)) < RATE
    chip_cores = sanafe.load_loihi()
    found = sanafe.Network()
    groups = [found.create_neuron_group("input", n_in)]
    groups += [found.create_neuron_group(f"layer{i}", n, NEURON, **UNITS) for i, n in enumerate(sizes[1:])]
    for group in groups:
        for neuron in group.neurons:
            neuron.set_attributes(log_spikes=True, log_potential=group is not groups[0])
    per_core = -(-n_in // max(input_cores, 1))
    for j, neuron in enumerate(groups[0].neurons):
        neuron.set_attributes(
            soma_hw_name=f"loihi_inputs[{j % per_core}]", model_attributes={"spikes": train[j].tolist()}
        )
    groups[0].connect_neurons_dense(
        groups[1], {"weight": rng.normal(scale, spread, n_in * n_hidden).tolist()}
    )
    groups[1].connect_neurons_dense(groups[2], {"weight": rng.normal(0.05, 0.3, n_hidden * n_out).tolist()})
    places = chip_cores.cores() if callable(chip_cores.cores) else chip_cores.cores
    first = 0
    for group, n_cores in zip(groups[1:], cores, strict=True):
        _spread(group, places[first : first + n_cores])
        first += n_cores
    _spread(groups[0], places[first : first + input_cores] if input_cores else places[:1])
    chip = sanafe.SpikingChip(chip_cores)
    chip.load(found)
    return chip, int(train.sum())


def _spread(group, cores):
    for part, core in zip(np.array_split(np.arange(len(group.neurons)), len(cores)), cores, strict=True):
        for j in part:
            group.neurons[int(j)].map_to_core(core)


def run(sizes, cores, scale):
    """Return the counts and the cost of one network."""
    chip, inputs = network(sizes, cores, scale)
    result = chip.sim(STEPS, timing_model="simple", perf_trace=True, processing_threads=1)
    hidden = (result["packets_sent"] - inputs * cores[0]) // cores[1]
    return {
        "sizes": sizes,
        "cores": cores,
        "n_steps": STEPS,
        "spikes": [inputs, hidden, result["neurons_fired"] - inputs - hidden],
        "updates": result["neurons_updated"] - inputs,
        "synaptic_events": result["spikes"],
        "messages": result["packets_sent"],
        "hops": int(np.sum(result["perf_trace"]["hops"])),
        "energy_j": result["energy"],
        "time_s": result["sim_time"],
    }


def run_steps(sizes, cores, scale, **how):
    """Return the counts and the time of every step, and the energy of one network (`how`: of `network`)."""
    chip, inputs = network(sizes, cores, scale, **how)
    result = chip.sim(
        STEPS,
        timing_model="simple",
        perf_trace=True,
        spike_trace=True,
        potential_trace=True,
        processing_threads=1,
    )
    names = ("input", "layer0", "layer1")
    spikes = np.array(
        [[sum(x.group_name == name for x in step) for name in names] for step in result["spike_trace"]]
    )
    # A neuron is updated where something arrived or where its potential was not zero after the step before.
    potential = np.array(result["potential_trace"])
    before = np.vstack([np.zeros_like(potential[:1]), potential[:-1]])
    arrived = np.vstack([np.zeros((1, 2), bool), spikes[:-1, :2] > 0])
    awake = [(part != 0).sum(axis=1) for part in np.split(before, [sizes[1]], axis=1)]
    updates = np.where(arrived, sizes[1:], np.stack(awake, axis=1))
    trace = result["perf_trace"]
    assert spikes[:, 0].sum() == inputs
    assert (updates.sum(axis=1) + spikes[:, 0] == trace["updated"]).all()
    return {
        "sizes": sizes,
        "cores": cores,
        "spikes": spikes.tolist(),
        "updates": updates.tolist(),
        "messages": result["packets_sent"],
        "energy_j": result["energy"],
        "time_s": trace["sim_time"],
    }


if __name__ == "__main__":
    runs = [
        run((24, 50, 7), (1, 1), 0.05),
        run((24, 50, 7), (1, 1), 0.15),
        run((256, 100, 12), (1, 1), 0.02),
        run((900, 660, 11), (6, 1), 0.0),
        run((900, 1240, 40), (10, 1), 0.0),
    ]
    Path(__file__).with_name("sanafe.json").write_text(json.dumps(runs, indent=1))
    steps = [
        run_steps((24, 50, 7), (1, 1), 0.05, input_cores=1),
        run_steps((24, 50, 7), (1, 1), 0.35, input_cores=1),
        run_steps((256, 100, 12), (1, 1), 0.02, input_cores=1),
        run_steps((1600, 450, 11), (7, 1), 0.0, spread=0.04, input_cores=2),
    ]
    Path(__file__).with_name("sanafe_steps.json").write_text(
        "[\n" + ",\n".join(json.dumps(x) for x in steps) + "\n]\n"
    )
