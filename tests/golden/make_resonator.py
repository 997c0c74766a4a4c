"""Write resonator.json: factors, states, spikes and gradients of resonators in plain Python integers.

    python tests/golden/make_resonator.py

Neurons are driven by drawn 8-bit weights on drawn spikes. The gradient of sum_t g[t] y[t] by the input at t
is the sum over lags k of g[t + k] Im((c + i s)^k) / 4096^k: the answer of y to a unit input, k steps later.
"""

import json
import math
import random
from fractions import Fraction
from pathlib import Path

STEPS = 120
THRESHOLD = 80  # in 1/64
KINDS = ((2.2, 1.5), (3.0, 5.0), (4.0, 2.0), (7.3, 1.5), (16.0, 3.2), (40.0, 5.0), (900.0, 40.0))


def factors(period, quality):
    tau = min(max(quality * period / math.pi, 1.0), 4096.0)
    r, w = math.exp(-1 / tau), 2 * math.pi / period
    return round(4096 * r * math.cos(w)), max(1, round(4096 * r * math.sin(w)))


def toward_zero(x):
    return -(-x >> 12) if x < 0 else x >> 12


def run(c, s, z, reset):
    """z: input in 1/4096. The states are those before a reset."""
    x = y = 0
    seen = {"x": [], "y": [], "spikes": []}
    for drive in z:
        x, y = toward_zero(c * x - s * y) + drive, toward_zero(s * x + c * y)
        fired = int(y > THRESHOLD * 64)
        for name, value in (("x", x), ("y", y), ("spikes", fired)):
            seen[name].append(value)
        if fired and reset:
            y = 0
    return seen


def gradient(c, s, g):
    answers, real, imaginary = [], 1, 0
    for k in range(STEPS):
        answers.append(Fraction(imaginary, 4096**k))
        real, imaginary = c * real - s * imaginary, s * real + c * imaginary
    return [float(sum(g[t + k] * answers[k] for k in range(STEPS - t))) for t in range(STEPS)]


def main():
    rng = random.Random(17)
    cases = []
    for period, quality in KINDS:
        c, s = factors(period, quality)
        weights = [2 * rng.randint(-128, 127) for _ in range(6)]  # in 1/64
        z = [64 * sum(w for w in weights if rng.random() < 0.25) for _ in range(STEPS)]
        g = [rng.randint(-3, 3) for _ in range(STEPS)]
        cases.append(
            {"period": period, "quality": quality, "c": c, "s": s, "z": z, "g": g, "by_z": gradient(c, s, g)}
            | {name: run(c, s, z, name == "reset") for name in ("free", "reset")}
        )
    text = json.dumps({"threshold": THRESHOLD, "cases": cases})
    Path(__file__).with_name("resonator.json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
