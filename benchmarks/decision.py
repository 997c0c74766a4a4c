"""The whole (phi, theta) grid beside the step-by-step loop: seconds, speed-up, largest difference.

    python benchmarks/decision.py [--samples 2880] [--slice 2]

The loop reads the output spikes step by step for every sample and every setting, as the decision
maker on a robot would; `decide` does one setting at a time in NumPy. Both run on a slice of the
samples with the whole grid; their times are multiplied up to all samples, and the difference is the
largest in accuracy, time and undecided fraction over that slice (0 = exact).

Then one net read out after 20 input lengths (100 samples x 2000 steps x 20 classes): `early` in one walk,
beside the surface of the output cut to each length; the difference is that of t_p, in ms.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from dse.measure.decision import decide, early, surface, t_p

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


def drawn(n: int, n_steps: int, n_classes: int) -> tuple[np.ndarray, np.ndarray]:
    """Return output spikes, of the right class at 6 %, of the others at 2 % of the steps, and the classes."""
    rng = np.random.default_rng(0)
    target = rng.integers(0, n_classes, n)
    rate = np.where(np.arange(n_classes) == target[:, None], 0.06, 0.02)[:, None]
    output = np.empty((n, n_steps, n_classes), dtype=np.uint8)
    for sample, chance in zip(output, rate, strict=True):
        sample[...] = rng.random((n_steps, n_classes)) < chance
    return output, target


def read_early() -> None:
    """Print what 20 input lengths cost."""
    output, target = drawn(100, 2000, 20)
    lengths, phi, theta = np.arange(100, 2001, 100), np.arange(0, 300, 10), np.linspace(0.05, 1, 20).round(2)
    early(output[:2], target[:2], lengths, phi, theta, 1.0)  # compiles
    start = time.perf_counter()
    found = early(output, target, lengths, phi, theta, 1.0)
    ours = time.perf_counter() - start
    start = time.perf_counter()
    each = [t_p(surface(output[:, :length], target, phi, theta, 1.0))[0] for length in lengths]
    seconds = time.perf_counter() - start
    print(
        f"\n100 samples x 2000 steps x 20 classes, {len(lengths)} lengths, "
        f"{len(phi)} phi x {len(theta)} theta"
    )
    print(f"{'':<52} {'seconds':>9} {'early is':>12} {'difference':>11}")
    print(f"{'early, all lengths at once':<52} {ours:>9.3f}")
    print(
        f"{'surface of every length':<52} {seconds:>9.3f} {f'{seconds / ours:.0f} x faster':>12} "
        f"{np.abs(found['t_p_ms'] - each).max():>11g}"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=2880)
    parser.add_argument("--slice", type=int, default=2)
    given = parser.parse_args()
    output, target = drawn(given.samples, N_STEPS, N_CLASSES)
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
    read_early()


if __name__ == "__main__":
    main()
