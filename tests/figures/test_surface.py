import numpy as np
import pytest

from dse.figures.surface import draw_surface, gather_surface
from dse.records import Surface


@pytest.fixture
def surface():
    latency = np.array([[10.0, 30.0], [5.0, 20.0]])
    return Surface(
        phi=np.array([0.0, 8.0]),
        theta=np.array([0.2, 0.9]),
        accuracy=np.array([[0.5, 0.9], [0.4, 0.9]]),
        accuracy_strict=np.array([[0.5, 0.8], [0.4, 0.7]]),
        decision_latency_ms=latency,
        undecided=np.zeros((2, 2)),
        ties=np.zeros((2, 2)),
        work=np.zeros((2, 2, 0)),
    )


def test_best_is_the_fastest_of_the_most_accurate(surface):
    assert gather_surface(surface).best == (8.0, 0.9)


def test_drawing_puts_theta_across_and_phi_up(surface):
    heat, mark = draw_surface(gather_surface(surface, "decision_latency_ms")).data
    assert list(heat.x) == [0.2, 0.9]
    assert heat.z[1][0] == 5.0
    assert heat.colorbar.title.text == "decision latency (ms)"
    assert (mark.x[0], mark.y[0]) == (0.9, 8.0)


def test_unknown_quantity(surface):
    with pytest.raises(ValueError, match=r"quantity must be one of accuracy, .* got 'speed'"):
        gather_surface(surface, "speed")
