"""Ceilings of lines per room of the package, of its tests and of the page's JavaScript: they only fall.

`WRITE_SIZES=1 pytest tests/test_size.py` lowers every ceiling in sizes.json to today's count, and adds new
rooms; without the file it begins anew. Lines are as ruff formats them.
"""

import json
import os
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SIZES = Path(__file__).with_name("sizes.json")


def sizes():
    """Return the lines of every room: folders of dse and tests, what is loose there, the page's scripts."""
    lines = Counter()
    for top in ("dse", "tests"):
        for path in (ROOT / top).rglob("*.py"):
            room = path.relative_to(ROOT).parts[:-1][:2]
            lines["/".join(room)] += path.read_text(encoding="utf-8").count("\n")
    for path in (ROOT / "dashboards").rglob("*.js"):
        lines["dashboards"] += path.read_text(encoding="utf-8").count("\n")
    return dict(sorted(lines.items()))


def test_no_room_grows():
    found = sizes()
    assert found["dse"] > 0 and found["tests"] > 0 and found["dashboards"] > 0
    ceilings = json.loads(SIZES.read_text()) if SIZES.is_file() else {}
    if os.environ.get("WRITE_SIZES"):
        ceilings = {room: min(n, ceilings.get(room, n)) for room, n in found.items()}
        SIZES.write_text(json.dumps(ceilings, indent=1) + "\n")
    grown = {room: (n, ceilings.get(room)) for room, n in found.items() if n > ceilings.get(room, 0)}
    assert not grown, f"lines of a room, and its ceiling in {SIZES.name}: {grown}"
    gone = set(ceilings) - set(found)
    assert not gone, f"rooms of {SIZES.name} that are no more: {gone}"
