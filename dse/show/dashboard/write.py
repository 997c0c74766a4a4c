"""Fill a page's template: one self-contained file that runs no scripts but those in it."""

from __future__ import annotations

import base64
import contextlib
import gzip
import hashlib
import html
import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dse.base.records import Array
from dse.config.locate import shipped_folder
from dse.show.dashboard.views import view_sources
from dse.show.figures.labels import Drawing
from dse.store import atomic

PLOTLY = "plotly-strict.min.js.gz"
"""plotly.js without `eval`: plotly.js-strict-dist-min of npm, in the version of the package plotly."""
_SLOT = re.compile(r"\{\{(\w+)\}\}")
_SHARED = ("dom", "data", "figure")
_MODULES = {"page": (*_SHARED, "details", "budgets", "samples", "touch", "answer", "views"), "trial": _SHARED}
"""The scripts that the views and the main script of each page call."""

_MODULES_RUN = "'wasm-unsafe-eval'"
"""What lets a page run the modules of its designs, and no other text as a script."""


def write_filled(template: str, page: Mapping[str, Any], path: Path | str) -> Path:
    """Write a template of `dashboards/`, `filled`, as one file, whole or not at all; return its path."""
    target = Path(path)
    with atomic(target) as temporary:
        temporary.write_text(filled(template, page).html, encoding="utf-8", newline="\n")
    return target


@dataclass(frozen=True)
class Filled:
    """A page's HTML, and the content security policy that it states."""

    html: str
    policy: str


def filled(template: str, page: Mapping[str, Any], *, live: bool = False) -> Filled:
    """Fill a template. Values are inserted in one pass, so none of them is read as a slot.

    Args:
        template: name of its .html and .js.
        page: data for its script, as plain values that JSON can hold; `name` is the title.
        live: whether the page asks its server for changes (`dashboards/live.js`).
    """
    folder = shipped_folder("dashboards")
    plotly = gzip.decompress((folder / PLOTLY).read_bytes()).decode()
    views = view_sources(page["definition"]["views"]) if template == "page" else []
    scripts = [
        *(_text(folder, f"{name}.js") for name in _MODULES[template]),
        *(view.script for view in views),
        *(_text(folder, f"{name}.js") for name in (template, *(["live"] if live else []))),
    ]
    # Only these scripts may run, and they may only connect to the page's server, whatever a name in the
    # study contains. The strict bundle of plotly.js evaluates no text.
    hashes = " ".join(
        f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
        for text in (plotly, *scripts)
    )
    policy = (
        f"default-src 'none'; script-src {hashes}{' ' + _MODULES_RUN * (live or 'touches' in page)}; "
        "style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'; form-action 'none'"
        + ("; connect-src 'self'" if live else "")
    )
    slots = {
        "plotly": plotly,
        "scripts": "\n".join(f"<script>{text}</script>" for text in scripts),
        "views": "".join(view.section for view in views),
        "title": html.escape(str(page["name"])),
        "policy": policy,
        "style": _text(folder, "style.css") + "".join(view.style for view in views),
        "kind": "application/json" if live else "application/gzip",
        "data": as_json(page) if live else packed(page),
    }
    return Filled(_SLOT.sub(lambda slot: slots[slot[1]], _text(folder, f"{template}.html")), policy)


def _text(folder: Path, name: str) -> str:
    return (folder / name).read_text(encoding="utf-8")


def packed(document: Mapping[str, Any]) -> str:
    """Return a document as base64 of gzipped JSON: text that holds no mark-up, a sixth of the length."""
    text = json.dumps(document, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return base64.b64encode(gzipped(text.encode())).decode("ascii")


def packed_array(values: Array, kind: str) -> str:
    """Return an array as base64 of its bytes, in a little-endian type such as '<u2'."""
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode("ascii")


def gzipped(content: bytes) -> bytes:
    """Return gzipped bytes, the same for the same."""
    return gzip.compress(content, compresslevel=6, mtime=0)


@contextlib.contextmanager
def without_template() -> Iterator[None]:
    """Let figures be made without plotly's template, which a page drops: every figure would copy it."""
    from plotly.io import templates

    before, templates.default = templates.default, None
    try:
        yield
    finally:
        templates.default = before


def plain_figure(figure: Drawing) -> dict[str, Any]:
    """Return a figure as JSON holds it, without its template: a page has its own style."""
    figure.layout.template = None
    plain: dict[str, Any] = json.loads(figure.to_json(validate=False))
    return plain


def as_json(page: Mapping[str, Any]) -> str:
    """Return JSON that no HTML parser can leave: `<`, `>` and `&` are written as escapes."""
    text = json.dumps(page, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
