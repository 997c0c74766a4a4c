"""The shape of the package: lines, rooms, arrows, circles, long and complex functions, what commands enter.

`python -m benchmarks.structure [CHECKOUT ...]` prints a column per checkout, today's beside an earlier one.
Commands read results/example of this checkout: their CPU seconds, and the files of dse that they import.
"""

from __future__ import annotations

import ast
import functools
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
FACE = ("__init__", "__main__")
LONG, COMPLEX = 60, 20
COMMANDS = {
    "skyline --where": (
        "skyline",
        "example",
        "--where",
        "task == 'texture'",
        "--where",
        "n_weights <= 20000",
    ),
    "check": ("check", str(ROOT / "search_spaces" / "example.yaml")),
    "pick --export": ("pick", "example", "--budget", "task == 'texture'", "--export", "bundle"),
}
_ENTERED = """
import atexit, sys
atexit.register(lambda: print(sum(name.split(".")[0] == "dse" for name in sys.modules), file=sys.stderr))
from dse.cli import main
sys.exit(main(sys.argv[1:]))
"""


def modules(package: Path) -> dict[str, ast.Module]:
    """Return dotted module name -> syntax tree of every file of a package."""
    trees = {}
    for path in sorted(package.rglob("*.py")):
        name = ".".join(path.relative_to(package.parent).with_suffix("").parts).removesuffix(".__init__")
        trees[name] = ast.parse(path.read_text(encoding="utf-8"))
    return trees


@functools.cache
def nodes(tree: ast.Module) -> list[ast.AST]:
    """Return all nodes of a syntax tree: a walk takes longer than all that is asked of them."""
    return list(ast.walk(tree))


def imports(tree: ast.Module, names: set[str]) -> Iterator[str]:
    """Yield the modules of the package that a module imports, inside functions and for type checkers too."""
    for node in nodes(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                if inner in names or node.module in names:
                    yield inner if inner in names else node.module
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in names)


def named_by_strings(name: str, tree: ast.Module, names: set[str]) -> Iterator[tuple[int, str]]:
    """Yield (line, module) for every text that is the name of a module or class: "dse.a.b" or "dse.a.b:C".

    A package's own name, as for its data files, is left out.
    """
    for node in nodes(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            module = node.value.partition(":")[0]
            if module in names and module != "dse" and not f"{name}.".startswith(f"{module}."):
                yield node.lineno, module


def circles(arrows: dict[str, set[str]]) -> list[list[str]]:
    """Return the strongly connected components of two or more nodes (Tarjan, SIAM J. Comput. 1, 1972)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    result: list[list[str]] = []

    def visit(node: str) -> None:
        index[node] = low[node] = len(index)
        stack.append(node)
        for after in sorted(arrows.get(node, ())):
            if after not in index:
                visit(after)
            if after in stack:
                low[node] = min(low[node], low[after])
        if low[node] == index[node]:
            cut = stack.index(node)
            component = stack[cut:]
            del stack[cut:]
            if len(component) > 1:
                result.append(sorted(component))

    for node in sorted(arrows):
        if node not in index:
            visit(node)
    return result


def rooms_of(name: str) -> str:
    """Return the part of `dse` that a module is in."""
    parts = name.split(".")
    return parts[1] if len(parts) > 1 else parts[0]


def shape(root: Path) -> dict[str, object]:
    """Return the figures of a checkout by their names."""
    trees = modules(root / "dse")
    names = set(trees)
    arrows = {
        name: {other for other in imports(tree, names) if other != name} for name, tree in trees.items()
    }
    between = defaultdict(set)
    for name, others in arrows.items():
        for other in others:
            if rooms_of(name) != rooms_of(other) and "." in name and "." in other:
                between[rooms_of(name)].add(rooms_of(other))
    nodes = [node for tree in trees.values() for node in ast.walk(tree)]
    lengths = [
        (node.end_lineno or 0) - node.lineno + 1
        for node in nodes
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    ]
    return {
        **{
            f"lines of {top}": lines(root / top, end)
            for top, end in (("dse", "py"), ("tests", "py"), ("dashboards", "js"))
        },
        "files": len(trees),
        "rooms": sum(path.is_dir() and (path / "__init__.py").is_file() for path in (root / "dse").iterdir()),
        "loose files": sum(path.stem not in FACE for path in (root / "dse").glob("*.py")),
        "arrows between rooms": sum(map(len, between.values())),
        "circles of rooms": len(circles(between)),
        "circles of files": sum("dse" not in circle for circle in circles(arrows)),
        f"functions over {LONG} lines": sum(n > LONG for n in lengths),
        f"functions of complexity above {COMPLEX}": complex_functions(root),
        "Any": sum(isinstance(node, ast.Name) and node.id == "Any" for node in nodes),
        **commands(root),
    }


def lines(folder: Path, ending: str) -> int:
    """Return the lines of the files of a folder."""
    return sum(path.read_text(encoding="utf-8").count("\n") for path in folder.rglob(f"*.{ending}"))


def complex_functions(root: Path) -> int:
    """Return how many functions ruff finds too complex (McCabe)."""
    ruff = [
        sys.executable,
        "-m",
        "ruff",
        "check",
        "--isolated",
        "--select",
        "C901",
        "--output-format",
        "json",
    ]
    limit = ["--config", f"lint.mccabe.max-complexity={COMPLEX}", str(root / "dse")]
    return len(json.loads(subprocess.run([*ruff, *limit], capture_output=True, check=False).stdout))


def commands(root: Path) -> dict[str, object]:
    """Return the columns of a design point, and the CPU seconds and files of each command."""
    found: dict[str, object] = {}
    with tempfile.TemporaryDirectory() as folder:
        shutil.copytree(ROOT / "results" / "example", Path(folder, "example"))
        plugins = root / "plugins" / "dse-papers"
        environment = {**os.environ, "PYTHONPATH": f"{root}:{plugins}"}
        for name, arguments in COMMANDS.items():
            run = [sys.executable, "-c", _ENTERED, *arguments]
            before = _children_s()
            ended = subprocess.run(
                run, cwd=folder, env=environment, capture_output=True, text=True, check=False
            )
            cpu_s = _children_s() - before
            entered = ended.stderr.split()[-1] if ended.returncode == 0 else "failed"
            found |= {f"{name}: CPU s": f"{cpu_s:.2f}", f"{name}: files": entered}
            if name.startswith("skyline"):
                found["columns of its view"] = ended.stdout.partition("\n")[0].count(",") + 1
    return found


def _children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main(roots: list[Path]) -> None:
    """Print the figures of checkouts, side by side."""
    columns = [shape(root) for root in roots]
    print(f"| | {' | '.join(root.name for root in roots)} |")
    print("|---" * (len(roots) + 1) + "|")
    for name in columns[0]:
        print(f"| {name} | {' | '.join(str(column[name]) for column in columns)} |")


if __name__ == "__main__":
    main([Path(path).resolve() for path in sys.argv[1:]] or [ROOT])
