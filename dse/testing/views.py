"""The contract of a view of a page."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from dse.show.dashboard.views import ViewError, source_of
from dse.testing.expect import expect


def check_view(name: str, view: Any) -> None:
    """Check a view, as far as this can be done without a browser.

    Args:
        name: of the view.
        view: a plugin's component, or the path of a script.

    Raises:
        AssertionError: what it violates.
    """
    try:
        text = source_of(name, view if isinstance(view, Path) else getattr(view, "script", None)).script
    except (ViewError, OSError) as error:
        raise AssertionError(str(error)) from None
    added = re.search(rf"\bViews\.{name}\s*=", text)
    expect(added, f"view '{name}': its script must add itself, Views.{name} = {{ view }}")
    takes = re.search(r"\bview\s*(?:=\s*)?\(\s*root\s*,\s*app\s*\)", text)
    expect(takes, f"view '{name}': its script must have a function view(root, app)")
    expect(re.search(r"\brender\b", text), f"view '{name}': view(root, app) must return render(shown)")
