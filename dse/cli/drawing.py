"""A figure of a study, drawn into a file: what `dse figure` does."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dse import registry
from dse.config import ConfigError, Fault
from dse.config.yaml_lines import Document, override

if TYPE_CHECKING:
    import plotly.graph_objects

    from dse.figures import Figure

SUFFIXES = (".pdf", ".svg", ".png", ".html", ".json")
_SIZE = re.compile(r"([0-9]+)x([0-9]+)(mm)?")
_SIZES_PX = (50, 10_000)


def draw(
    results: str,
    name: str,
    out: Path,
    size: tuple[int, int] | None,
    settings: Mapping[str, str],
    plugins: Sequence[str],
) -> None:
    """Draw a figure into a file.

    Args:
        results: folder of the study.
        name: of the figure.
        out: the file; its ending says in which form.
        size: width and height in pixels, of a file for print.
        settings: keys of the figure, as written.
        plugins: modules to load first.

    Raises:
        ConfigError: the figure, one of its keys or the file's ending is unknown, it has nothing to show, or
            what draws images is not installed.
        StoreError: the study is missing or damaged.
    """
    from dse.study.results import open as open_study

    if out.suffix not in SUFFIXES:
        raise _fault(f"--out must end in {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}, got '{out}'")
    study = open_study(results)
    try:
        for plugin_name in plugins:
            registry.load_plugin(plugin_name)
    except registry.PluginError as error:
        raise _fault(str(error)) from None
    figure = _figure(name, settings)
    try:
        drawn: plotly.graph_objects.Figure = figure.draw(figure.gather(study))
    except ValueError as error:
        raise _fault(f"figure {name}: {error}") from None
    except Exception as error:
        plugin = registry.plugin_of(type(figure))
        if plugin is None:
            raise
        raise _fault(f"figure {name}: {registry.failure(error, plugin)}") from error
    _write(drawn, out, size, name)


def size_px(text: str | None) -> tuple[int, int] | None:
    """Return width and height in pixels of `--size`.

    Raises:
        ConfigError: it is no size.
    """
    from dse.figures.image import PX_PER_MM

    if text is None:
        return None
    if (found := _SIZE.fullmatch(text)) is None:
        raise _fault(f"--size must be WIDTHxHEIGHT, such as 85x60mm or 700x450, got '{text}'")
    per_unit = PX_PER_MM if found[3] else 1.0
    width, height = round(int(found[1]) * per_unit), round(int(found[2]) * per_unit)
    if not all(_SIZES_PX[0] <= side <= _SIZES_PX[1] for side in (width, height)):
        raise _fault(f"--size must have sides of {_SIZES_PX[0]} to {_SIZES_PX[1]} pixels, got '{text}'")
    return width, height


def _write(drawn: plotly.graph_objects.Figure, out: Path, size_px: tuple[int, int] | None, name: str) -> None:
    from dse.figures.image import on_white, static_image
    from dse.native.extras import MissingExtra
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
    from dse import figures

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
