"""Ridge regression on classes: penalty and scale of its outputs by leaving out each sample in turn.

    minimise  |Z w + b - y|^2 + alpha |w|^2,        y = 1 of a class, -1 of the others, per class

Z are inputs of mean 0 and variance 1 in training. With Z = U S V^T and h_i = 1/n + sum_j U_ij^2 s_j^2 /
(s_j^2 + alpha), what is answered to sample i by a regression on all others is y_i - (y_i - f_i) / (1 - h_i)
in closed form. alpha, of ten values, has the least squared error of these answers; and as outputs are used
as log-odds, they are scaled so that these answers are most likely.
Source: [Dempster et al., MiniRocket in REFERENCES.md], whose readout it is, but for the scale.
"""

from __future__ import annotations

import numpy as np

from dse.base.records import Array, Floats
from dse.models.counts.readouts import scaling, unscaled

_ALPHAS = np.logspace(-3, 3, 10)
_SCALES = np.logspace(-1, 2, 31)


def ridge(x: Array, target: Array) -> tuple[Floats, Floats]:
    """Return weights (input, output) and biases (output,) of a ridge classifier, in log-odds.

    Args:
        x: (n, input), n >= 2, scaled inside; the weights are of x as it is.
        target: (n,) with two classes or more; of two there is one output, which says the second where > 0.

    Example:
        >>> weight, bias = ridge(np.array([[0.0], [1.0], [4.0], [5.0]]), np.array([0, 0, 1, 1]))
        >>> (np.array([0.0, 5.0]) * weight[0, 0] + bias[0] > 0).tolist()
        [False, True]
    """
    classes = np.unique(target)
    y = np.where(target[:, None] == (classes if len(classes) > 2 else classes[1:]), 1.0, -1.0)
    mean, scale = scaling(x)
    z = (x - mean) / scale
    wide = z.shape[1] > len(z)
    square, turned = np.linalg.eigh(z @ z.T if wide else z.T @ z)
    square = np.maximum(square, 0)
    # U S; `turned` is U where inputs are more than samples, V where not.
    seen = turned * np.sqrt(square) if wide else z @ turned
    centred = y - y.mean(axis=0)
    tried = []
    for alpha in _ALPHAS:
        part = (seen.T @ centred) / (square + alpha)[:, None]
        leverage = 1 / len(z) + (seen**2 / (square + alpha)).sum(axis=1)
        left_out = y - (centred - seen @ part) / np.maximum(1 - leverage, 1e-9)[:, None]
        tried.append((float(((left_out - y) ** 2).sum()), alpha, left_out))
    _, alpha, left_out = min(tried, key=lambda each: each[0])
    part = ((turned if wide else seen).T @ centred) / (square + alpha)[:, None]
    weight = z.T @ (turned @ part) if wide else turned @ part
    odds = _SCALES[np.argmin([_surprise(left_out * each, y) for each in _SCALES])]
    ((weight, bias),) = unscaled([(weight * odds, y.mean(axis=0) * odds)], mean, scale)
    return weight, bias


def _surprise(outputs: Floats, y: Floats) -> float:
    """Return minus the log-likelihood of the classes, by softmax of the outputs, or of 0 and the one."""
    if outputs.shape[1] == 1:
        return float(np.logaddexp(0, -outputs * y).sum())
    most = outputs.max(axis=1)
    return float((np.log(np.exp(outputs - most[:, None]).sum(axis=1)) + most - outputs[y > 0]).sum())
