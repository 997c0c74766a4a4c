"""`dse figure`: a figure of a study, in a file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dse.cli.answer import Answer
from dse.cli.fields import argument, option
from dse.cli.options import overrides_of
from dse.config import ConfigError, Fault, known_names

_SIZES_PX = (50, 10_000)

if TYPE_CHECKING:
    import plotly.graph_objects

    from dse.figures import Figure

GROUP = "choose"
HELP = "draw a figure of a study into a file (PDF, SVG, PNG, HTML or JSON); `dse describe figures` lists them"
SUFFIXES = (".pdf", ".svg", ".png", ".html", ".json")


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """The arguments."""

    results: str = argument("RESULTS", "folder of a study")
    figure: str = argument("NAME", "a figure, e.g. front")
    out: Path = option(  # noqa: RUF009
        "FILE",
        "file to write: .pdf, .svg or .png for print (needs `pip install 'dse[figures]'` and Chromium), "
        ".html (a page that works offline and saves SVG) or .json (plotly's own format)",
        MISSING,
    )
    size: str | None = option(
        "WIDTHxHEIGHT",
        "size of a .pdf, .svg or .png: 85x60mm fits a column of most journals, 700x450 is in pixels of 1/96 "
        "inch (default: the figure's own, else 700x450); text has 8 pt",
    )
    set: tuple[str, ...] = option(
        "KEY=VALUE",
        "replace the value of a key, e.g. x=model.hidden; `dse describe figures NAME` lists the keys; "
        "repeatable",
        (),
    )
    plugin: tuple[str, ...] = option(
        "NAME", "load components from this module or .py file first; repeatable", ()
    )


def answer(arguments: Arguments) -> Answer:
    """Draw the figure into the file.

    Raises:
        ConfigError: the figure, one of its keys or the file's ending is unknown, it has nothing to show, or
            what draws images is not installed.
        StoreError: the study is missing or damaged.
    """
    from dse.registry import PluginError, failure, load_plugin, plugin_of
    from dse.study.results import open as open_study

    out: Path = arguments.out
    if out.suffix not in SUFFIXES:
        raise _fault(f"--out must end in {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}, got '{out}'")
    size_px = None if arguments.size is None else _size(arguments.size)
    study = open_study(arguments.results)
    try:
        for name in arguments.plugin:
            load_plugin(name)
    except PluginError as error:
        raise _fault(str(error)) from None
    figure = _figure(arguments.figure, overrides_of(arguments.set))
    try:
        drawn: plotly.graph_objects.Figure = figure.draw(figure.gather(study))
    except ValueError as error:
        raise _fault(f"figure {arguments.figure}: {error}") from None
    except Exception as error:
        plugin = plugin_of(type(figure))
        if plugin is None:
            raise
        raise _fault(f"figure {arguments.figure}: {failure(error, plugin)}") from error
    _write(drawn, out, size_px, arguments.figure)
    return Answer([{"figure": arguments.figure, "file": str(out)}])


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


def _size(text: str) -> tuple[int, int]:
    """Return width and height of `--size` in pixels."""
    from dse.figures.image import PX_PER_MM

    width, _, height = text.removesuffix("mm").partition("x")
    if not (width.isascii() and width.isdigit() and height.isascii() and height.isdigit()):
        raise _fault(f"--size must be WIDTHxHEIGHT, such as 85x60mm or 700x450, got '{text}'")
    per_unit = PX_PER_MM if text.endswith("mm") else 1.0
    size_px = round(int(width) * per_unit), round(int(height) * per_unit)
    if not all(_SIZES_PX[0] <= side <= _SIZES_PX[1] for side in size_px):
        raise _fault(f"--size must have sides of {_SIZES_PX[0]} to {_SIZES_PX[1]} pixels, got '{text}'")
    return size_px


def _figure(name: str, settings: Mapping[str, str]) -> Figure[Any]:
    """Return the named figure with the keys of `--set`."""
    from dse import registry
    from dse.config.values import read_object
    from dse.config.yaml_lines import Document, override

    figures: Mapping[str, type[Figure[Any]]] = registry.known("figures")
    if name not in figures:
        where = registry.elsewhere("figures", name)
        raise _fault(f"unknown figure '{name}'{where}; {known_names(name, figures)}")
    document = override(Document({}, {}), settings)
    faults = list(document.faults)

    def report(_: object, text: str) -> None:
        faults.append(Fault("dse figure", 0, text))

    figure = read_object(figures[name], document.data, (name,), report)
    if figure is None or faults:
        raise ConfigError(faults)
    return figure


def _fault(text: str) -> ConfigError:
    return ConfigError([Fault("dse figure", 0, text)])
