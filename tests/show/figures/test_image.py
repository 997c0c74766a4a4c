import importlib.util
import threading
from unittest.mock import Mock

import plotly.graph_objects as go
import pytest

from dse.base.native.extras import MissingExtra
from dse.show.figures import image
from dse.show.figures.image import FORMATS, on_white, static_image

START = {"pdf": b"%PDF-", "svg": b"<svg", "png": b"\x89PNG\r\n\x1a\n"}


def figure():
    return go.Figure(go.Scatter(x=[1, 2, 3], y=[1, 4, 9]), {"xaxis": {"title": {"text": "time (ms)"}}})


@pytest.fixture
def browser(chromium_path, monkeypatch):
    pytest.importorskip("kaleido", reason="no kaleido: pip install 'dse-spiking[figures]'")
    monkeypatch.setenv("DSE_CHROMIUM", str(chromium_path))


@pytest.mark.parametrize("form", FORMATS)
def test_a_file_of_its_kind(form, browser):
    size = None if form == "svg" else (320, 200)  # or its own
    content = static_image(figure().update_layout(height=333), form, size)
    assert content.startswith(START[form])
    if form == "svg":
        assert b'width="700" height="333"' in content and b"time (ms)" in content
    if form == "png":
        assert [int.from_bytes(content[k : k + 4]) for k in (16, 20)] == [960, 600]


def test_the_style_of_print_leaves_what_the_figure_says():
    own = figure().update_layout(font_size=7)
    styled = on_white(own)
    assert styled.layout.font.size == 7 and styled.layout.template.layout.plot_bgcolor == "white"
    assert own.layout.template.layout.plot_bgcolor != "white", "the figure itself stays"


def test_what_is_missing_is_named(monkeypatch):
    def without(name):
        return None if name == "kaleido" else importlib.util.find_spec(name)

    monkeypatch.setattr(image, "find_spec", without)
    with pytest.raises(MissingExtra, match=r"needs kaleido: pip install 'dse-spiking\[figures\]'"):
        static_image(figure(), "png")


@pytest.mark.parametrize("raised", ["", "BrowserClosedError", "ChannelClosedError"])  # by when it ends
def test_a_browser_that_does_not_start(monkeypatch, tmp_path, raised):
    errors = pytest.importorskip(
        "choreographer.errors", reason="no kaleido: pip install 'dse-spiking[figures]'"
    )
    broken = tmp_path / "chromium"
    monkeypatch.setenv("DSE_CHROMIUM", str(broken))
    with pytest.raises(MissingExtra, match="Chromium: install one, or name it in DSE_CHROMIUM"):
        static_image(figure(), "png")
    broken.symlink_to("/usr/bin/false")
    if raised:
        monkeypatch.setattr("kaleido.calc_fig_sync", Mock(side_effect=getattr(errors, raised)))
    with pytest.raises(MissingExtra, match=f"needs a Chrome or Chromium that starts: {broken} did not"):
        static_image(figure(), "svg")


def test_a_browser_that_never_answers_is_given_up_after_another(monkeypatch):
    asked, gone = [], threading.Event()

    def draw():
        asked.append(1)
        if len(asked) in (1, 3, 4):
            gone.wait()
        return b"drawn"

    monkeypatch.setattr(image, "_PATIENCE_S", 0.2)
    assert image._answered(draw) == b"drawn" and len(asked) == 2
    with pytest.raises(MissingExtra, match=r"within 0\.2 s, and two have not"):
        image._answered(draw)
    gone.set()
    with pytest.raises(ZeroDivisionError):
        image._answered(lambda: 1 // 0)
