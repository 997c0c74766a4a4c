"""What is installed is what `.ci/*.txt` pin, with licences that a product can be built on."""

import re
import tomllib
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement

from benchmarks.materials import materials

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def canonical(name):
    return re.sub(r"[-_.]+", "-", name).lower()


def pinned(file):
    """Name -> the requirement of a list of .ci."""
    lines = (ROOT / ".ci" / file).read_text().replace("\\\n", " ").splitlines()
    each = [Requirement(line.split("--hash")[0]) for line in lines if "==" in line]
    return {canonical(one.name): one for one in each if one.marker is None or one.marker.evaluate()}


@pytest.fixture(scope="module")
def components():
    return {each["name"]: each for each in materials()["components"]}


def test_what_is_pinned_is_installed(components):
    for name, one in (pinned("study.txt") | pinned("tests.txt")).items():
        assert components[name]["version"] in one.specifier, name
        assert components[name]["purl"] == f"pkg:pypi/{name}@{components[name]['version']}"


@pytest.mark.parametrize(
    ("file", "asked"),
    [
        ("study.txt", PROJECT["dependencies"]),
        ("tests.txt", [*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["test"]]),
    ],
)
def test_the_pins_are_what_the_project_asks_for(file, asked):
    pins = pinned(file)
    for each in map(Requirement, asked):
        [pin] = pins[canonical(each.name)].specifier
        assert pin.version in each.specifier, each


def test_a_study_needs_no_licence_that_binds_what_is_built_with_it(components):
    stated = {name: components[name]["licenses"][0]["license"]["name"] for name in pinned("study.txt")}
    assert {name for name, text in stated.items() if "GPL" in text.upper()} == {"moocore"}  # LGPL: linked
    assert stated["moocore"].startswith("LGPL")


def test_citation_and_project_state_one_version():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert (citation["version"], citation["license"]) == (PROJECT["version"], PROJECT["license"])


def test_actions_are_pinned_by_commit():
    used = [
        x
        for path in ROOT.glob(".github/workflows/*.yml")
        for x in re.findall(r"uses: (\S+)", path.read_text())
    ]
    assert used and all(re.fullmatch(r"[\w./-]+@[0-9a-f]{40}", each) for each in used)
