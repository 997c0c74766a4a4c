"""A figure of a study, drawn into a file: what `dse figure` does."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dse.base import registry
from dse.cli.answer import Answer
from dse.cli.signature import Texts
from dse.config import ConfigError, Fault
from dse.config.yaml_lines import Document, override

if TYPE_CHECKING:
    from dse.show.figures import Figure
    from dse.show.figures.labels import Drawing

SUFFIXES = (".pdf", ".svg", ".png", ".html", ".json")
_SIZE = re.compile(r"([0-9]+)x([0-9]+)(mm)?")
_SIZES_PX = (50, 10_000)


def figure(
    results: str, name: str, *, out: Path, size: str | None = None, set: Texts = (), plugin: Texts = ()
) -> Answer:
    """Draw a figure of a study into a file (PDF, SVG, PNG, HTML or JSON); `dse describe figures` lists them.

    Args:
        name: a figure, e.g. front.
        out (FILE): file to write: .pdf, .svg or .png for print (needs Chromium, and
            `pip install 'dse-spiking[figures]'`), .html (a page that works offline and saves SVG) or .json
            (plotly's own format).
        size (WIDTHxHEIGHT): size of a .pdf, .svg or .png: 85x60mm fits a column of most journals, 700x450 is
            in pixels of 1/96 inch (default: the figure's own, else 700x450); text has 8 pt.
        set (KEY=VALUE): replace the value of a key, e.g. x=model.hidden; `dse describe figures NAME` lists
            the keys; repeatable.
        plugin (NAME): load components from this module or .py file first; repeatable.
    """
    from dse.cli.spaces import overrides_of
    from dse.study.results import open as open_study

    if out.suffix not in SUFFIXES:
        raise _fault(f"--out must end in {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}, got '{out}'")
    px, study = size_px(size), open_study(results)
    try:
        for plugin_name in plugin:
            registry.load_plugin(plugin_name)
    except registry.PluginError as error:
        raise _fault(str(error)) from None
    drawing = _figure(name, overrides_of(set))
    try:
        drawn = drawing.draw(drawing.gather(study))
    except ValueError as error:
        raise _fault(f"figure {name}: {error}") from None
    except Exception as error:
        source = registry.plugin_of(type(drawing))
        if source is None:
            raise
        raise _fault(f"figure {name}: {registry.failure(error, source)}") from error
    _write(drawn, out, px, name)
    return Answer([{"figure": name, "file": str(out)}])


def size_px(text: str | None) -> tuple[int, int] | None:
    """Return width and height in pixels of `--size`."""
    from dse.show.figures.image import PX_PER_MM

    if text is None:
        return None
    if (found := _SIZE.fullmatch(text)) is None:
        raise _fault(f"--size must be WIDTHxHEIGHT, such as 85x60mm or 700x450, got '{text}'")
    per_unit = PX_PER_MM if found[3] else 1.0
    width, height = round(int(found[1]) * per_unit), round(int(found[2]) * per_unit)
    if not all(_SIZES_PX[0] <= side <= _SIZES_PX[1] for side in (width, height)):
        raise _fault(f"--size must have sides of {_SIZES_PX[0]} to {_SIZES_PX[1]} pixels, got '{text}'")
    return width, height


def _write(drawn: Drawing, out: Path, size_px: tuple[int, int] | None, name: str) -> None:
    from dse.base.native.extras import MissingExtra
    from dse.show.figures.image import on_white, static_image
    from dse.store import published, write_text

    if out.suffix == ".json":
        write_text(out, drawn.to_json())
    elif out.suffix == ".html":
        saves_svg = {"toImageButtonOptions": {"format": "svg", "filename": name}}
        write_text(out, on_white(drawn).to_html(config=saves_svg, include_plotlyjs=True))
    else:
        try:
            content = static_image(drawn, out.suffix[1:], size_px)
        except MissingExtra as error:
            raise _fault(str(error)) from None
        with published(out) as temporary:
            temporary.write_bytes(content)


def _figure(name: str, settings: Mapping[str, str]) -> Figure[Any]:
    """Return the named figure with the keys of `--set`."""
    from dse.show import figures

    document = override(Document({}, {}), settings)
    faults = list(document.faults)

    def report(_: object, text: str) -> None:
        faults.append(Fault("dse figure", 0, text))

    assert isinstance(document.data, dict)  # as `override` leaves a mapping
    figure = figures.named(name, document.data, report)
    if figure is None or faults:
        raise ConfigError(faults)
    return figure


def _fault(text: str) -> ConfigError:
    return ConfigError([Fault("dse figure", 0, text)])
