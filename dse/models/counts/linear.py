"""A linear classifier of counts in integers: logistic or ridge regression, then weights of 8 bits."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dse.base.records import Array, Floats
from dse.base.registry import fixed, param, register
from dse.models.counts.integers import rounded
from dse.models.counts.levels import LevelReader
from dse.models.counts.rate_windows import Channels, Learnt
from dse.models.counts.readouts import Readouts, scaling, unscaled
from dse.models.counts.ridge import ridge
from dse.models.training import Generators


@dataclass(frozen=True)
class Regressed(Readouts):
    """A classifier whose readouts are logistic or ridge regressions, rounded to integers."""

    readout: Literal["logistic", "ridge"] = param(
        "logistic",
        choices=("logistic", "ridge"),
        doc="what is regressed: classes by their likelihood, or 1 and -1 by squared errors, with the penalty "
        "that answers best to samples left out; ridge pays for many inputs and few samples",
    )
    alpha: float = param(
        0.01,
        low=0,
        low_open=True,
        doc="L2 penalty of logistic: mean loss + alpha / 2 times the sum of squared weights",
    )
    epochs: int = param(1000, low=1, doc="largest number of steps of the solver of logistic")

    def regressed(
        self, arrays: dict[str, Array], counts: Array, target: Array, lengths: Array, most: int
    ) -> Learnt:
        """Train and round a readout per input length; arguments as of `learn`, arrays as of `inputs`."""
        converged = True
        for j, x in enumerate(self._inputs(arrays, counts, lengths)):
            if self.readout == "ridge":
                weight, bias = ridge(x, target)
            else:
                weight, bias, ended = logistic(x, target, self.alpha, self.epochs)
                converged &= ended
            arrays |= rounded([(weight, bias)], x, most).stored(j)
        return Learnt(arrays, {}, {"converged": converged})


@register("models", "linear")
@dataclass(frozen=True)
class Linear(LevelReader, Regressed):
    """Linear classifier of spike counts, or of levels, in integers: a weight of 8 bits per number and class.

    Regression of counts that are scaled to mean 0 and variance 1 in training, in double; scales then go into
    weights and biases, which are rounded (`dse.models.counts.integers`). What is measured is the classifier
    of integers. Where training holds one class, it is answered.

    Cost: W_t = counts x classes (of two classes one), each one multiply-accumulate; biases are not counted.
    Health: converged, whether every input length ended before `epochs`.
    """

    channels: Channels = param(  # noqa: RUF009
        "each", doc="each: spikes are counted per channel; sum: spikes of all channels are counted together"
    )
    read_outs: int = fixed(
        10, low=1, high=50, doc="largest number of input lengths with a prediction, evenly spaced"
    )

    def learn(self, counts: Array, target: Array, lengths: Array, most: int, rngs: Generators) -> Learnt:
        """Train and round a readout per input length; nothing is random."""
        return self.regressed({"classes": np.unique(target)}, counts, target, lengths, most)


def logistic(x: Array, target: Array, alpha: float, epochs: int) -> tuple[Floats, Floats, bool]:
    """Return weights (input, output) and biases (output,) of a logistic regression, and whether it converged.

    Args:
        x: (n, input), scaled inside; the weights are of x as it is.
        target: (n,) with two classes or more; of two there is one output, which says the second where > 0.
        alpha: L2 penalty of weights of scaled inputs.
        epochs: most steps.
    """
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.linear_model import LogisticRegression

    mean, scale = scaling(x)
    model = LogisticRegression(C=1 / (alpha * len(x)), max_iter=epochs)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        model.fit((x - mean) / scale, target)
    ((weight, bias),) = unscaled([(model.coef_.T, model.intercept_)], mean, scale)
    return weight, bias, bool(model.n_iter_.max() < epochs)
