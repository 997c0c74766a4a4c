"""What `lint-imports` cannot see: circles within a room, names in strings, where code is run.

A module or class that a string names counts as imported.
"""

import ast
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from benchmarks.structure import circles, imports, modules, named_by_strings, nodes, rooms_of

PACKAGE = Path(__file__).resolve().parent.parent / "dse"
PROJECT = tomllib.loads((PACKAGE.parent / "pyproject.toml").read_text())
LAYERS = PROJECT["tool"]["importlinter"]["contracts"][0]["layers"]
HEIGHT = {name: -depth for depth, layer in enumerate(LAYERS) for name in layer.split(" | ")}
PUBLIC = ("__init__", "__main__")
FINDS_BY_NAME = ("dse", "dse.data", "dse.base.registry")  # what a user names, wherever it lives

HEAVY = (*("h5py", "moocore", "numba", "optuna", "pandas"), *("plotly", "pyarrow", "sklearn", "torch"))


@pytest.fixture(scope="module")
def trees():
    return modules(PACKAGE)


def arrows_within_rooms(trees):
    names = set(trees)
    return {
        name: {
            other
            for other in (*imports(tree, names), *(n for _, n in named_by_strings(name, tree, names)))
            if other != name and rooms_of(other) == rooms_of(name)
        }
        for name, tree in trees.items()
        if name != "dse"
    }


def test_few_modules_stand_outside_the_rooms():
    assert sorted(path.stem for path in PACKAGE.glob("*.py")) == sorted(PUBLIC)


def test_no_circle_within_a_room(trees):
    arrows = arrows_within_rooms(trees)
    assert sum(map(len, arrows.values())) > 100, "found no import to check"
    assert circles(arrows) == []


def test_circles_are_seen_for_type_checkers_and_by_strings():
    texts = {
        "dse.a": "",
        "dse.a.one": "def f():\n    from dse.a import two\n",
        "dse.a.two": "if TYPE_CHECKING:\n    from dse.a.three import C\n",
        "dse.a.three": "import_module('dse.a.one')\n",
        "dse.a.four": "HOME = 'dse.a.one:C'; folder = files('dse.a')\n",
    }
    trees = {name: ast.parse(text) for name, text in texts.items()}
    assert circles(arrows_within_rooms(trees)) == [["dse.a.one", "dse.a.three", "dse.a.two"]]


def test_what_strings_name_is_below(trees):
    wrong = [
        f"{name}:{line}: a string names {other}"
        for name, tree in trees.items()
        if name not in FINDS_BY_NAME
        for line, other in named_by_strings(name, tree, set(trees))
        if rooms_of(other) != rooms_of(name) and HEIGHT[rooms_of(other)] >= HEIGHT[rooms_of(name)]
    ]
    assert not wrong, "\n".join(wrong)


def test_importing_costs_nothing_and_public_names_are_few():
    code = f"import sys, dse.cli; print(*sorted(set({HEAVY}) & set(sys.modules)))"
    code += "; print(*dse.__all__); [getattr(dse, name) for name in dse.__all__]"
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    heavy, public = answer.stdout.splitlines()
    assert heavy == ""
    assert 0 < len([name for name in public.split() if not name.startswith("_")]) <= 12


def test_unknown_public_name():
    import dse

    with pytest.raises(AttributeError, match="no attribute 'sweep'; public names: Classifier, ConfigError"):
        dse.sweep  # noqa: B018


def test_code_is_run_in_one_place(trees):
    """What could run text or find code by a name that comes from outside."""
    risky = {
        "exec",
        "eval",
        "import_module",
        "__import__",
        "run_path",
        "exec_module",
        "spec_from_file_location",
    }
    shipped = {"dse", "dse.config", "dse.data", "dse.base.registry", "dse.cli.commands"}
    shipped |= {"dse.deploy.targets.emulator"}  # these import modules of dse, or of a fixed name
    found = {
        name
        for name, tree in trees.items()
        for node in nodes(tree)
        if isinstance(node, ast.Call)
        and (getattr(node.func, "id", "") in risky or getattr(node.func, "attr", "") in risky - {"eval"})
    }
    assert found == shipped
