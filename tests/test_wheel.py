"""The wheel carries what a user needs without the clone; cli/test_first_hour.py runs it there."""

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The wheel, built by the installed back end: nothing is fetched."""
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)],
        cwd=ROOT,
        check=True,
        capture_output=True,
    )
    (path,) = folder.glob("dse_spiking-*.whl")
    return path


def test_data_is_inside(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    assert "dse/py.typed" in names
    for source in ROOT.glob("dashboards/**/*.*"):
        assert f"dse/_{source.relative_to(ROOT)}" in names
    assert {
        f"dse/_dashboards/{name}" for name in ("page.html", "page.js", "study.yaml", "views/front.js")
    } <= names
    for space in ROOT.glob("search_spaces/**/*.yaml"):
        assert f"dse/_{space.relative_to(ROOT)}" in names
    for profile in ROOT.glob("dse/measure/hardware/profiles/*.yaml"):
        assert f"dse/measure/hardware/profiles/{profile.name}" in names
    assert "dse/_search_spaces/fabric_texture.yaml" in names
    assert "dse/_search_spaces/scenes/quickstart.yaml" in names
    assert "dse/measure/hardware/profiles/loihi1_silicon.yaml" in names
    assert {"dse/_datasets/icub.py", "dse/_datasets/braille.npy"} <= names
    assert {f"dse/_results/example/{name}" for name in ("study.sqlite", "points.parquet")} <= names
    assert {"dse/scene/sensors.yaml", "dse/scene/textures.yaml"} <= names


def test_the_source_distribution_builds_the_same_wheel(wheel, tmp_path):
    hatch = [sys.executable, "-m", "hatchling", "build", "-d", str(tmp_path), "-t"]
    subprocess.run([*hatch, "sdist"], cwd=ROOT, check=True, capture_output=True)
    [archive] = tmp_path.glob("dse_spiking-*.tar.gz")
    shutil.unpack_archive(archive, tmp_path, filter="data")
    unpacked = tmp_path / archive.name.removesuffix(".tar.gz")
    subprocess.run([*hatch, "wheel"], cwd=unpacked, check=True, capture_output=True)
    assert content(tmp_path / wheel.name) == content(wheel)


def content(wheel):
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def test_nothing_else_is_inside(wheel):
    tops = {name.split("/")[0] for name in zipfile.ZipFile(wheel).namelist()}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"dse"}
