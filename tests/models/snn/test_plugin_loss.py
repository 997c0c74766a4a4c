"""A loss that a user wrote, in a file beside the search space: an axis with shipped ones, and trained."""

from dse.config import load_space
from dse.testing import check_loss
from tests.models.snn.toy import SHORT, accuracy, fit, rngs, toy
from tests.spaces import write_space

PLUGIN = '''\
from dataclasses import dataclass

from array_api_compat import array_namespace

from dse.base.registry import param, register


@register("losses", "squared_counts")
@dataclass(frozen=True)
class SquaredCounts:
    """Squared distance of the counts from `spikes` for the label, from 0 for the others."""

    spikes: float = param(9.0, low=0, unit="spikes", doc="of the label's output")

    def lengths(self, n_steps):
        return (n_steps,)

    def value(self, counts, outputs):
        xp = array_namespace(counts)
        return xp.sum((counts - self.spikes * outputs.is_label[..., None, :]) ** 2)

    def gradient(self, counts, outputs):
        error = counts - self.spikes * outputs.is_label[..., None, :]
        return (error**2).sum(), 2.0 * error
'''


def test_a_users_loss_is_an_axis_and_trains(trusting, tmp_path):
    (tmp_path / "my_loss.py").write_text(PLUGIN, encoding="utf-8")
    model = "{kind: snn, hidden: 8, loss: {choice: [spike_rate, squared_counts]}, spikes: {choice: [9, 12]}}"
    path = write_space(tmp_path, ("{kind: snn, hidden: {choice: [4, 8, 12]}, true_rate: 0.8}", model))
    path.write_text(f"plugins: [my_loss.py]\n{path.read_text(encoding='utf-8')}", encoding="utf-8")
    space = load_space(path)
    assert [name for name in space.axes if name.startswith("model.")] == ["model.loss", "model.spikes"]
    design = {"encoder.thresholds": (1.0, 2.0), "model.loss": "squared_counts", "model.spikes": 12.0}
    trained = space.resolve(design).model
    check_loss(trained.loss)
    outcome = fit(toy(), trained, SHORT, rngs())
    assert accuracy(outcome, toy()) > 0.6
    assert outcome.history["loss"][-1] < outcome.history["loss"][0]
