"""The whole (phi, theta) grid beside the step-by-step loop: seconds, speed-up, largest difference.

    python benchmarks/decision.py [--samples 2880] [--slice 2]

The loop reads the output spikes step by step for every sample and every setting, as the decision
maker on a robot would; `decide` does one setting at a time in NumPy. Both run on a slice of the
samples with the whole grid; their times are multiplied up to all samples, and the difference is the
largest in accuracy, time and undecided fraction over that slice (0 = exact).
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from dse.decision import decide, surface

N_STEPS, N_CLASSES = 1000, 12


def loop(output: np.ndarray, target: np.ndarray, phi: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Return (phi, theta, 3): accuracy, mean time in steps, undecided fraction."""
    samples = output.tolist()
    result = np.zeros((len(phi), len(theta), 3))
    for p, spikes_to_wait_for in enumerate(phi):
        for q, confidence in enumerate(theta):
            for sample, label in zip(samples, target, strict=True):
                counts, total, decided = [0] * N_CLASSES, 0, False
                t = 0
                for spikes in sample:
                    t += 1
                    for k, spike in enumerate(spikes):
                        counts[k] += spike
                    total = sum(counts)
                    if total > spikes_to_wait_for and max(counts) / total >= confidence:
                        decided = True
                        break
                result[p, q] += (counts.index(max(counts)) == label, t, not decided)
    return result / len(output)


def settle(output: np.ndarray, target: np.ndarray, phi: float, theta: float) -> tuple[float, float, float]:
    """Return accuracy, mean time in steps and undecided fraction of one setting."""
    label, step, decided = decide(output, phi, theta)
    return np.mean(label == target), np.mean(step + 1), np.mean(~decided)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=2880)
    parser.add_argument("--slice", type=int, default=2)
    given = parser.parse_args()
    rng = np.random.default_rng(0)
    target = rng.integers(0, N_CLASSES, given.samples)
    rate = np.where(np.arange(N_CLASSES) == target[:, None], 0.06, 0.02)[:, None]
    output = np.empty((given.samples, N_STEPS, N_CLASSES), dtype=np.uint8)
    for sample, chance in zip(output, rate, strict=True):
        sample[...] = rng.random((N_STEPS, N_CLASSES)) < chance
    phi, theta = np.arange(0, 200, 5), np.round(np.linspace(0.05, 1.0, 20), 2)

    surface(output[:2], target[:2], phi, theta, 1.0)  # compiles
    start = time.perf_counter()
    whole = surface(output, target, phi, theta, 1.0)
    ours = time.perf_counter() - start

    start = time.perf_counter()
    vectorised = np.array([[settle(output[:64], target[:64], p, q) for q in theta] for p in phi])
    numpy_seconds = (time.perf_counter() - start) * given.samples / 64
    part = slice(0, given.slice)
    start = time.perf_counter()
    slow = loop(output[part], target[part], phi, theta)
    loop_seconds = (time.perf_counter() - start) * given.samples / given.slice

    print(
        f"{given.samples} samples x {N_STEPS} steps x {N_CLASSES} classes, "
        f"{len(phi)} phi x {len(theta)} theta; "
        f"accuracies {whole.accuracy.min():.3f} to {whole.accuracy.max():.3f}"
    )
    print(f"{'':<52} {'seconds':>9} {'surface is':>12} {'difference':>11}")
    print(f"{'surface, all samples':<52} {ours:>9.3f}")
    for name, seconds, n, other in (
        ("NumPy, one setting at a time", numpy_seconds, 64, vectorised),
        ("step-by-step loop", loop_seconds, given.slice, slow),
    ):
        found = surface(output[:n], target[:n], phi, theta, 1.0)
        difference = np.abs(
            np.stack([found.accuracy, found.decision_latency_ms, found.undecided], -1) - other
        )
        label = f"{name} ({n} samples, scaled up)"
        print(f"{label:<52} {seconds:>9.1f} {f'{seconds / ours:.0f} x faster':>12} {difference.max():>11g}")


if __name__ == "__main__":
    main()
