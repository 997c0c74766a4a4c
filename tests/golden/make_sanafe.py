"""Write sanafe.json: counts, energy and time of small networks run in SANA-FE 2.2.9.

    pip install sanafe==2.2.9 numpy && python tests/golden/make_sanafe.py

Inputs share core 0 with the first neurons (they cost nothing there but their messages), as
`dse.hardware.placement` has it. Weights are random; only counts and totals are kept.
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


def run(sizes: tuple[int, int, int], cores: tuple[int, int], scale: float) -> dict[str, object]:
    """Return the counts and the cost of one network."""
    n_in, n_hidden, n_out = sizes
    rng = np.random.default_rng(sizes)
    train = rng.random((n_in, STEPS)) < RATE
    chip_cores = sanafe.load_loihi()
    network = sanafe.Network()
    groups = [network.create_neuron_group("input", n_in)]
    groups += [network.create_neuron_group(f"layer{i}", n, NEURON, **UNITS) for i, n in enumerate(sizes[1:])]
    for j, neuron in enumerate(groups[0].neurons):
        neuron.set_attributes(
            soma_hw_name=f"loihi_inputs[{j}]", model_attributes={"spikes": train[j].tolist()}
        )
    groups[0].connect_neurons_dense(groups[1], {"weight": rng.normal(scale, 0.3, n_in * n_hidden).tolist()})
    groups[1].connect_neurons_dense(groups[2], {"weight": rng.normal(0.05, 0.3, n_hidden * n_out).tolist()})
    places = chip_cores.cores() if callable(chip_cores.cores) else chip_cores.cores
    groups[0].map_to_core(places[0])
    first = 0
    for group, n_cores in zip(groups[1:], cores, strict=True):
        parts = np.array_split(np.arange(len(group.neurons)), n_cores)
        for part, core in zip(parts, places[first : first + n_cores], strict=True):
            for j in part:
                group.neurons[int(j)].map_to_core(core)
        first += n_cores
    chip = sanafe.SpikingChip(chip_cores)
    chip.load(network)
    result = chip.sim(STEPS, timing_model="simple", perf_trace=True, processing_threads=1)
    inputs = int(train.sum())
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


if __name__ == "__main__":
    runs = [
        run((24, 50, 7), (1, 1), 0.05),
        run((24, 50, 7), (1, 1), 0.15),
        run((256, 100, 12), (1, 1), 0.02),
        run((900, 660, 11), (6, 1), 0.0),
        run((900, 1240, 40), (10, 1), 0.0),
    ]
    Path(__file__).with_name("sanafe.json").write_text(json.dumps(runs, indent=1))
