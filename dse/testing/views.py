"""The contract of a view of a page."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from dse.testing.expect import expect

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


def check_view(name: str, view: Any) -> None:
    """Check a view, as far as this can be done without a browser.

    Args:
        name: of the view.
        view: a plugin's component, or the path of a script.

    Raises:
        AssertionError: what it violates.
    """
    expect(_NAME.fullmatch(name), f"view '{name}': a name must be letters, digits and '_', a letter first")
    script = view if isinstance(view, Path) else getattr(view, "script", None)
    expect(
        isinstance(script, Path | str),
        f"view '{name}' must have a `script`: its text or its path",
    )
    if isinstance(script, Path):
        expect(script.is_file(), f"view '{name}': there is no file {script}")
        text = script.read_text(encoding="utf-8")
    else:
        text = str(script)
    expect("</script" not in text.lower(), f"view '{name}': its script must not contain '</script'")
    added = re.search(rf"\bViews\.{name}\s*=", text)
    expect(added, f"view '{name}': its script must add itself, Views.{name} = {{ view }}")
    takes = re.search(r"\bview\s*(?:=\s*)?\(\s*root\s*,\s*app\s*\)", text)
    expect(takes, f"view '{name}': its script must have a function view(root, app)")
    expect(re.search(r"\brender\b", text), f"view '{name}': view(root, app) must return render(shown)")
