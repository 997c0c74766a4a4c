"""Write xylo.json: states and spikes of SynSense's simulator xylosim 0.1.3 (module v2) on drawn nets.

    python tests/golden/make_xylo.py      # needs xylosim

One hidden layer with recurrent weights, whose neurons spike several times in some steps, outputs, and drawn
spikes. Currents saturate only in the case whose weights are all positive, where their order does not matter;
potentials do in others too. `state_i` and `state_v` are what the simulator records: the current after its
decay, the potential after the reset.
"""

import json
import random
from pathlib import Path

from xylosim.v2 import XyloLayer, XyloSynapse

STEPS = 60
N_IN, N_HIDDEN, N_OUT = 5, 6, 3


def drawn_case(rng, shift, out_shift, low, high, rate):
    def matrix(n, m, part=1):
        return [[rng.randint(low // part, high // part) for _ in range(m)] for _ in range(n)]

    return {
        "weight_shift": shift,
        "output_weight_shift": out_shift,
        "weights_in": matrix(N_IN, N_HIDDEN),
        "weights_rec": matrix(N_HIDDEN, N_HIDDEN, 8),
        "weights_out": matrix(N_HIDDEN, N_OUT, 2),
        "current_shift": [rng.choice((1, 2, 3, 15 if low >= 0 else 4)) for _ in range(N_HIDDEN)],
        "voltage_shift": [rng.choice((0, 1, 2, 5, 15)) for _ in range(N_HIDDEN)],
        "threshold": rng.choice((300, 700, 1024)),
        "output_current_shift": [rng.choice((1, 3)) for _ in range(N_OUT)],
        "output_voltage_shift": [rng.choice((0, 5)) for _ in range(N_OUT)],
        "output_threshold": rng.choice((7, 512)),
        "input": [[int(rng.random() < rate) for _ in range(N_IN)] for _ in range(STEPS)],
    }


def simulated(case):
    def synapses(matrix):
        return [[XyloSynapse(j, 0, w) for j, w in enumerate(row) if w] for row in matrix]

    # The layer holds pointers to the synapses and does not own them.
    matrices = [synapses(case[name]) for name in ("weights_in", "weights_rec", "weights_out")]
    layer = XyloLayer(
        synapses_in=matrices[0],
        synapses_rec=matrices[1],
        synapses_out=matrices[2],
        aliases=[[] for _ in range(N_HIDDEN)],
        threshold=[case["threshold"]] * N_HIDDEN,
        threshold_out=[case["output_threshold"]] * N_OUT,
        has_bias=False,
        bias=[0] * N_HIDDEN,
        bias_out=[0] * N_OUT,
        weight_shift_inp=case["weight_shift"],
        weight_shift_rec=case["weight_shift"],
        weight_shift_out=case["output_weight_shift"],
        dash_mem=case["voltage_shift"],
        dash_mem_out=case["output_voltage_shift"],
        dash_syns=[[k] for k in case["current_shift"]],
        dash_syns_out=[[k] for k in case["output_current_shift"]],
        name="golden",
    )
    outputs = layer.evolve(case["input"])
    hidden = {"i": layer.rec_i_syn, "v": layer.rec_v_mem}
    out = {"i": layer.rec_i_syn_out, "v": layer.rec_v_mem_out}
    return {
        **{f"state_{name}": [list(row) for row in rows] for name, rows in hidden.items()},
        **{f"output_state_{name}": [list(row) for row in rows] for name, rows in out.items()},
        "spikes": [list(row) for row in layer.rec_recurrent_spikes],
        "output_spikes": [list(row) for row in outputs],
    }


def main():
    rng = random.Random(23)
    kinds = ((3, 4, -20, 28, 0.3), (4, 1, -40, 50, 0.2), (0, 0, -128, 127, 0.3), (7, 2, 0, 127, 0.2))
    cases = []
    for kind in kinds:
        case = drawn_case(rng, *kind)
        cases.append({**case, **simulated(case)})
    file = Path(__file__).with_name("xylo.json")
    file.write_text("[\n" + ",\n".join(json.dumps(case) for case in cases) + "\n]\n")


if __name__ == "__main__":
    main()
