"""Imports go one way, down this list of layers; never upwards, never sideways within a layer."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parent.parent / "dse"

LAYERS = (
    ("cli",),
    ("dashboard",),
    ("deploy", "report"),
    ("study",),
    ("dataset", "figures", "models"),
    ("measure", "recordings"),
    ("encoders", "engine", "hardware", "scene", "search", "skyline"),
    ("config", "neurons", "preprocessing", "store"),
    ("native", "records", "registry", "seeds"),
)
HEIGHT = {name: -depth for depth, layer in enumerate(LAYERS) for name in layer}
PUBLIC = ("__init__", "__main__")  # the package's own face may import anything

HEAVY = (
    *("h5py", "lz4", "moocore", "numba", "optuna", "pandas"),
    *("plotly", "pyarrow", "sklearn", "torch", "triton", "zstandard"),
)


def part(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imported(path: Path) -> Iterator[tuple[int, str]]:
    """Yield (line, part of dse) for every import in a file, those inside functions included."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name}:{node.lineno}: imports must be absolute"
            above = node.module or ""
            names = [f"dse.{alias.name}" for alias in node.names] if above == "dse" else [above]
        else:
            continue
        for name in names:
            if name.startswith("dse."):
                yield node.lineno, name.split(".")[1]


def test_every_part_has_a_layer():
    parts = {part(path) for path in PACKAGE.rglob("*.py")} - set(PUBLIC)
    assert parts, "found no module to check"
    assert parts <= set(HEIGHT), f"give these a layer: {sorted(parts - set(HEIGHT))}"


def test_imports_go_down():
    wrong = [
        f"{path.relative_to(PACKAGE)}:{line}: {part(path)} may not import {name}"
        for path in sorted(PACKAGE.rglob("*.py"))
        if part(path) not in PUBLIC
        for line, name in imported(path)
        if name != part(path) and HEIGHT[name] >= HEIGHT[part(path)]
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("module", ["dse", "dse.cli"])
def test_importing_costs_nothing(module):
    code = f"import sys, {module}; print(*sorted(set({HEAVY}) & set(sys.modules)))"
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert answer.stdout.split() == []


def test_public_names():
    code = "import dse; print(*dse.__all__); [getattr(dse, name) for name in dse.__all__]"
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert 0 < len(answer.stdout.split()) <= 10


def test_unknown_public_name():
    import dse

    with pytest.raises(AttributeError, match="no attribute 'sweep'; public names: ConfigError, Study"):
        dse.sweep  # noqa: B018
