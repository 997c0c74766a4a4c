import numpy as np
import pytest

from dse.testing.small import SmallStudy
from dse_papers.figures.surface import SurfaceFigure, gather_surface


@pytest.fixture
def surface():
    latency = np.array([[10.0, 30.0], [5.0, 20.0]])
    return {
        "phi": np.array([0.0, 8.0]),
        "theta": np.array([0.2, 0.9]),
        "accuracy": np.array([[0.5, 0.9], [0.4, 0.9]]),
        "decision_latency_ms": latency,
    }


def test_best_is_the_fastest_of_the_most_accurate(surface):
    assert gather_surface(surface).best == (8.0, 0.9)


def test_by_default_it_is_of_the_most_accurate_trial_that_has_one():
    class Bayes(SmallStudy):
        """The most accurate trial decides once, at the end, and has no surface."""

        def arrays(self, trial, name):
            is_best = trial == self.best_trial()
            return [] if is_best and name == "surface.npz" else super().arrays(trial, name)

    study = Bayes()
    next_best = study.trials.sort_values("accuracy", ascending=False, kind="stable")["trial"].iloc[1]
    drawn, expected = SurfaceFigure().gather(study), SurfaceFigure(trial=int(next_best)).gather(study)
    assert drawn.values.tolist() == expected.values.tolist()
    with pytest.raises(ValueError, match=f"trial {study.best_trial()} recorded no surface"):
        SurfaceFigure(trial=study.best_trial()).gather(study)


def test_drawing_puts_theta_across_and_phi_up(surface):
    heat, mark = SurfaceFigure().draw(gather_surface(surface, "decision_latency_ms")).data
    assert list(heat.x) == [0.2, 0.9]
    assert heat.z[1][0] == 5.0
    assert heat.colorbar.title.text == "decision latency (ms)"
    assert (mark.x[0], mark.y[0]) == (0.9, 8.0)


def test_unknown_quantity(surface):
    with pytest.raises(ValueError, match=r"quantity must be one of accuracy, .* got 'speed'"):
        gather_surface(surface, "speed")
