import numpy as np

from benchmarks import hots
from dse_papers.models.time_surfaces import Field, Memory, prepared
from tests.plugins.dse_papers.streams import drawn, stream


def test_frames_per_event_are_exact_surfaces_in_every_layer():
    events = drawn(0, 50, planes=2)
    layers = hots.stack(events, 6, 5, 1, 3)
    for a, b in zip(hots.by_kernel(events, layers), hots.by_frames(events, layers), strict=True):
        np.testing.assert_array_equal(a, b)
    assert hots.slow_difference(events, *layers[0]) == (0, 0)


def test_a_frame_per_bin_is_that_of_its_end():
    field = Field(3, 1, 1, 1, 1000.0)
    found = np.array(list(hots.framed(stream((100, 0, 0, 0), (900, 1, 0, 0), (1300, 1, 0, 0)), field, 1000)))
    e = np.exp([-0.9, -0.1, -1.9, -0.7])
    np.testing.assert_allclose(found, [[0, e[0], e[1]], [e[0], e[1], 0], [e[2], e[3], 0]])


def test_recordings_are_in_order_and_in_the_frame(shared_data, monkeypatch):
    monkeypatch.setenv("DSE_DATA", str(shared_data))
    for events, width, height in (hots.camera(), hots.fingers()):
        assert (np.diff(events.t_us) >= 0).all()
        assert events.x.max() < width and events.y.max() < height
        assert set(np.unique(events.plane)) == {0, 1}
        few = hots.head(events, 20)
        ((field, prototypes),) = hots.stack(few, width, height, 2, 1)
        assert len(Memory(field).assign(few, prepared(prototypes))) == 20
