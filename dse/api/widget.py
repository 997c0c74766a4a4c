"""The page of a study in a notebook, as a widget: JupyterLab, VS Code and whatever else shows anywidget.

It is the page that `dse dashboard --html` writes, in a frame of its own; what is chosen there is known here.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import anywidget
import traitlets

from dse.show.dashboard.study import PageRequest, load_definition, write_page
from dse.store import StoreError
from dse.study.question import Question
from dse.study.results import Study

if TYPE_CHECKING:
    import pandas


class Page(anywidget.AnyWidget):
    """The page of a study; `row` is the design point that it shows, which `study.export` takes.

    Attributes:
        chosen: trial, point, task and hardware of what the page shows; empty before it has been drawn.
    """

    # A frame with an address of its own, in which a page may keep its state.
    _esm = """
    export default { render({ model, el }) {
      const address = URL.createObjectURL(new Blob([model.get("html")], { type: "text/html" }));
      const frame = document.createElement("iframe");
      Object.assign(frame, { src: address, title: "the page of a study" });
      Object.assign(frame.style, { width: "100%", height: `${model.get("height_px")}px`, border: "0" });
      const heard = ({ source, data }) => {
        if (source !== frame.contentWindow || !data?.chosen) return;
        model.set("chosen", data.chosen);
        model.save_changes();
      };
      addEventListener("message", heard);
      el.append(frame);
      return () => { removeEventListener("message", heard); URL.revokeObjectURL(address); };
    } };
    """
    html = traitlets.Unicode().tag(sync=True)
    height_px = traitlets.Int().tag(sync=True)
    chosen: traitlets.Dict[str, Any] = traitlets.Dict().tag(sync=True)

    def __init__(self, study: Study, hardware: Sequence[str], height_px: int) -> None:
        """Gather the page, priced on `hardware`; none: on that of the study."""
        request = PageRequest(load_definition(study.folder, "study"), Question(hardware=tuple(hardware)))
        with tempfile.TemporaryDirectory() as folder:
            html = write_page(study, Path(folder) / "page.html", request).read_text(encoding="utf-8")
        super().__init__(html=html, height_px=height_px)
        self._points = study.points(hardware)

    @property
    def row(self) -> pandas.Series[Any]:
        """The design point that the page shows.

        Raises:
            StoreError: it shows none (yet).
        """
        named = {name: x for name, x in self.chosen.items() if name in self._points and x not in (None, "")}
        if "trial" not in named:
            raise StoreError("the page shows no design point yet: display it first")
        rows = self._points
        for name, value in named.items():
            rows = rows[rows[name] == value]
        if rows.empty:
            raise StoreError(f"the page shows a point that the study has no more: {self.chosen}")
        return rows.iloc[0]
