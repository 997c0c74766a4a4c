from dataclasses import replace

import numpy as np
import pytest

from dse.base.records import Block
from dse.data.preprocessing.stages import Stages
from dse.testing.small import SmallStudy
from dse_papers.figures import preprocessing
from dse_papers.figures.preprocessing import InputsFigure, draw_rasters, gather_pooled, gather_stages


def stages():
    """Four events on 4 x 2 pixels, of which the two middle columns are kept; bins of 2 ms."""
    t_us, x, y = np.array([[0, 1000, 5000, 7999], [0, 1, 2, 2], [0, 0, 1, 1]])
    return Stages(
        name="<felt>",
        events=Block(t_us, x, y, np.ones(4, np.uint8)),
        frame=(4, 2),
        crop=(1, 0, 2, 2),
        counts=np.array([1, 0, 1, 1]),
        channels=np.array([0, 1, 1]),
        n_channels=2,
        bin_us=2000,
        begin_us=2000,
        end_us=6000,
    )


def test_every_stage_by_hand(monkeypatch):
    monkeypatch.setattr(preprocessing, "_CELLS", (4, 4))
    raw, cropped, pooled, window = gather_stages(stages())
    # Cells of 2 ms and two addresses: pixels 0 and 1 in the first; 6 = row 1, column 2.
    assert (raw.cell_ms, raw.cell_addresses, raw.n_addresses) == (2, 2, 8)
    assert raw.counts.tolist() == [[2, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 1, 1]]
    assert (cropped.cell_addresses, cropped.n_addresses) == (1, 4)
    assert cropped.counts.tolist() == [[1, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 1, 1]]
    assert pooled.counts.tolist() == [[1, 0, 0, 0], [0, 0, 1, 1]] and pooled.window_ms == (2, 6)
    assert window.counts.tolist() == [[0, 0], [0, 1]] and window.end_ms == 4
    assert [raster.title for raster in (raw, cropped, pooled, window)] == [
        *("as recorded, 4 × 2 pixels", "cropped to 2 × 2 pixels", "pooled to 2 channels", "window of 4 ms")
    ]


def test_a_frame_without_crop():
    raw, pooled, _ = gather_stages(replace(stages(), crop=(0, 0, 4, 2)))
    assert raw.title == "as recorded, 4 × 2 pixels, not cropped" and raw.counts.sum() == 4
    assert pooled.title == "pooled to 2 channels"


def test_no_two_panels_are_equal_where_a_step_leaves_out_nothing():
    raw, pooled = gather_stages(replace(stages(), crop=(0, 0, 4, 2), begin_us=0, end_us=8000))
    assert raw.counts.sum() == 4 and pooled.title == "pooled to 2 channels, window of 8 ms"


def test_cells_hold_whole_bins(monkeypatch):
    monkeypatch.setattr(preprocessing, "_CELLS", (3, 4))
    pooled = gather_pooled(stages())
    assert pooled.cell_ms == 4 and pooled.counts.tolist() == [[1, 0], [0, 2]]


def test_nothing_is_shaded_where_the_window_is_everything():
    whole = replace(stages(), begin_us=0, end_us=8000)
    assert gather_pooled(whole).window_ms is None
    assert not draw_rasters([gather_pooled(whole)]).layout.shapes


def test_what_the_window_leaves_out_is_shaded():
    figure = draw_rasters(gather_stages(stages()))
    assert [(shape.x0, shape.x1, shape.xref) for shape in figure.layout.shapes] == [
        (0, 2, "x3"),
        (6, 8, "x3"),
    ]
    assert figure.data[2].z.max() == 1 and figure.data[2].z.min() == 0


def test_a_silent_recording():
    none = np.zeros(0, np.int64)
    silent = replace(stages(), events=Block(none, none, none, none), counts=none, channels=none)
    raw, *_, window = gather_stages(silent)
    assert not raw.counts.any() and raw.end_ms == 6 and not window.counts.any()
    assert len(draw_rasters(gather_stages(silent)).data) == 4


def test_several_recordings():
    rasters = InputsFigure(samples=(0, 1)).gather(SmallStudy())
    assert [raster.title for raster in rasters] == ["felt", "linen"]
    with pytest.raises(ValueError, match="samples must name at least one recording, got none"):
        InputsFigure(samples=()).gather(SmallStudy())
