"""The shape of the package: rooms, arrows, circles, loose files, `Any`, string subscripts, long functions.

python -m benchmarks.structure [CHECKOUT]
"""

from __future__ import annotations

import ast
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

FACE = ("__init__", "__main__")


def modules(package: Path) -> dict[str, ast.Module]:
    """Return dotted module name -> syntax tree of every file of a package."""
    trees = {}
    for path in sorted(package.rglob("*.py")):
        name = ".".join(path.relative_to(package.parent).with_suffix("").parts).removesuffix(".__init__")
        trees[name] = ast.parse(path.read_text(encoding="utf-8"))
    return trees


def imports(tree: ast.Module, names: set[str]) -> Iterator[str]:
    """Yield the modules of the package that a module imports, inside functions and for type checkers too."""
    for node in ast.walk(tree):
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
    for node in ast.walk(tree):
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


def main(root: Path) -> None:
    """Print the figures of a checkout."""
    package = root / "dse"
    trees = modules(package)
    names = set(trees)
    arrows = {
        name: {other for other in imports(tree, names) if other != name} for name, tree in trees.items()
    }
    between = defaultdict(set)
    for name, others in arrows.items():
        for other in others:
            if rooms_of(name) != rooms_of(other) and "." in name and "." in other:
                between[rooms_of(name)].add(rooms_of(other))
    lines: Counter[str] = Counter()
    for path in package.rglob("*.py"):
        lines[path.relative_to(package).parts[0].removesuffix(".py")] += len(path.read_text().splitlines())
    loose = sorted(p.stem for p in package.glob("*.py") if p.stem not in FACE)
    nodes = [node for tree in trees.values() for node in ast.walk(tree)]
    functions = [
        ((node.end_lineno or 0) - node.lineno + 1, f"{name}.{node.name}")
        for name, tree in trees.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    ]
    print(
        f"files {len(trees)}, lines {sum(lines.values())}, rooms {len(set(map(rooms_of, names)) - {'dse'})}"
    )
    print(f"loose files {len(loose)}: {', '.join(loose)}")
    print(f"arrows between rooms {sum(map(len, between.values()))}")
    print(f"arrows between files {sum(map(len, arrows.values()))}")
    inside = [c for c in circles(arrows) if "dse" not in c]
    print(f"circles of rooms {circles(between)}")
    print(f"circles of files {len(inside)}: {inside}")
    print(f"Any {sum(isinstance(n, ast.Name) and n.id == 'Any' for n in nodes)}")
    texts = [
        node.slice.value
        for node in nodes
        if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant)
        if isinstance(node.slice.value, str)
    ]
    print(f"string subscripts {len(texts)}")
    for word in ("found", "told", "said", "asked", "wanted", "kept", "own", "given"):
        uses = sum(isinstance(n, ast.Name) and n.id == word for n in nodes)
        print(f"  name '{word}': {uses}")
    longest = sorted(functions, reverse=True)[:8]
    print("longest functions: " + ", ".join(f"{name.removeprefix('dse.')} {n}" for n, name in longest))
    print(
        "lines: " + ", ".join(f"{room} {n}" for room, n in sorted(lines.items(), key=lambda item: -item[1]))
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1])
