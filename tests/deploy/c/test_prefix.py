"""Names of the C with another prefix: two classifiers in one program."""

import json
import subprocess
import sys
from dataclasses import replace
from importlib.util import find_spec
from itertools import pairwise

import numpy as np
import pytest

from dse.cli import main
from dse.deploy import bundle
from dse.deploy.bundle import BundleError, read
from dse.deploy.c import host
from dse.deploy.evaluate import evaluate
from dse.deploy.targets import emulator
from dse.deploy.targets.c99 import C99
from dse.deploy.verify import export_targets, verify
from dse.testing.targets import small_bundle, small_recordings
from tests.deploy.bundles import document
from tests.deploy.c import nets
from tests.deploy.c.test_sketch import of, touches
from tests.deploy.targets.test_c99 import run

pytestmark = nets.needs_compiler


@pytest.fixture
def folder(tmp_path):
    bundle.write(small_bundle(recurrent=True, delays=(0, 2)), tmp_path / "bundle")
    small_recordings(tmp_path / "touch.npz")
    return tmp_path / "bundle"


def test_the_prefix_is_kept_by_the_bundle_and_verified(folder, capsys):
    touch = str(folder.parent / "touch.npz")
    command = ["export", str(folder), "--target", "c99", "--format", "json"]
    assert main([*command, "--prefix", "texture_", "--verify", touch]) == 0
    assert json.loads(capsys.readouterr().out)["rows"][0]["verdict"] == "faithful"
    sources = {x.name for x in (folder / "targets" / "c99" / "src").iterdir()}
    assert sources == {"texture.h", "texture.c", "texture_selftest.c"} and read(folder).prefix == "texture_"
    assert "texture.c" in (folder / "README.md").read_text()
    written = {x: x.read_bytes() for x in (folder / "targets").rglob("*") if x.is_file()}
    assert not any(b"dse_" in x or b"DSE_" in x for x in written.values())
    assert main(command) == 0  # again, without the option
    assert {x: x.read_bytes() for x in (folder / "targets").rglob("*") if x.is_file()} == written
    assert verify(folder, touch)["c99"].verdict.kind == "faithful"
    assert evaluate(folder, touch).label.size


@pytest.mark.parametrize("prefix", ["names_", "my_names_", "title_"])
def test_a_prefix_may_be_a_word_of_the_templates(folder, prefix, capsys):
    touch = str(folder.parent / "touch.npz")
    command = ["export", str(folder), "--target", "c99", "--json", "--prefix", prefix, "--verify", touch]
    assert main(command) == 0
    assert json.loads(capsys.readouterr().out)["rows"][0]["verdict"] == "faithful"


def test_what_was_edited_is_replaced_where_it_is_asked_for(folder, capsys):
    command = ["export", str(folder), "--target", "c99"]
    assert main(command) == 0
    sources = {x: x.read_bytes() for x in (folder / "targets").rglob("*") if x.is_file()}
    source = folder / "targets" / "c99" / "src" / "dse.c"
    source.write_text(source.read_text() + "/* mine */\n")
    capsys.readouterr()
    assert main(command) == 2
    told = capsys.readouterr().err
    assert "dse.c: is damaged or edited" in told and "--target c99 --force" in told and told.count("\n") == 1
    assert source.read_text().endswith("/* mine */\n")
    assert main(["export", str(folder), "--target", "torch", "--force"]) == 2  # of that target alone
    assert main([*command, "--force"]) == 0
    assert {x: x.read_bytes() for x in (folder / "targets").rglob("*") if x.is_file()} == sources
    source.unlink()
    assert main(command) == 2 and main([*command, "--force"]) == 0 and source.exists()


def test_without_a_prefix_names_are_those_of_dse(folder):
    export_targets(folder, ["c99"])
    assert read(folder).prefix == "dse_"
    document(prefix=None)(folder)  # as older versions wrote it
    assert read(folder).prefix == "dse_"


@pytest.mark.parametrize(
    "prefix",
    ["texture", "Texture_", "1_", "_", "a b_", "../x_", "string_", "touch_", "tëxt_", "app_", "wire_"],
)
def test_what_is_no_prefix_is_refused(prefix, folder, capsys):
    before = (folder / "bundle.json").read_bytes()
    assert main(["export", str(folder), "--target", "c99", "--prefix", prefix]) == 2
    assert "the prefix must" in capsys.readouterr().err and before == (folder / "bundle.json").read_bytes()
    document(prefix=prefix)(folder)
    with pytest.raises(BundleError, match="the prefix must"):
        read(folder)


def test_a_prefix_is_of_all_c_in_a_bundle(folder):
    if why := emulator.missing():
        pytest.skip(why)
    export_targets(folder, ["c99", "cortex_m4"])
    with pytest.raises(BundleError, match="name cortex_m4 too"):
        export_targets(folder, ["c99"], prefix="speed_")
    with pytest.raises(BundleError, match="which torch has not"):
        export_targets(folder, ["torch"], prefix="speed_")
    touch = folder.parent / "touch.npz"
    verified = export_targets(folder, ["c99", "cortex_m4"], touch, prefix="speed_")
    assert {x.verdict.kind for x in verified.values()} == {"faithful"}
    assert "src/speed.c" in (folder / "targets" / "cortex_m4" / "README.md").read_text()


def test_two_classifiers_answer_in_one_program(tmp_path):
    parts = {"texture": of("samples", {"at": "start"}), "speed": of("samples", {"at": "start", "n_steps": 9})}
    named = ("dse_a", "DSE_B", "dse.c")  # what users name is not renamed
    parts["speed"] = replace(parts["speed"], phi=None, theta=None, classes=named)
    recordings = touches("samples")
    np.savez(tmp_path / "touch.npz", signal=np.concatenate(recordings).astype(np.float32),
             offsets=np.cumsum([0, *map(len, recordings)]))  # fmt: skip
    expected = []
    for name, made in parts.items():
        design = made.sections
        design = replace(design, data=replace(design.data, offsets="offsets"))
        bundle.write(replace(made, sections=design, prefix=f"{name}_"), tmp_path / name)
        C99().write(read(tmp_path / name), tmp_path / "libraries" / name)
        evaluation = evaluate(tmp_path / name, tmp_path / "touch.npz")
        expected.append([evaluation.classes[label] for label in evaluation.label])
    assert expected[0] != expected[1] and len(set(expected[1])) > 1
    program = tmp_path / "main.c"
    program.write_text(_MAIN)
    libraries = tmp_path / "libraries"
    sources = [libraries / name / "src" / f"{name}.c" for name in parts]
    includes = [f"-I{x.parent}" for x in sources]
    host.compiled([program, *sources], tmp_path / "both", *includes)
    rows = [part[:12] for part in recordings]
    text = "\n".join(" ".join(map(str, row)) for part in rows for row in part.tolist())
    done = subprocess.run([tmp_path / "both"], input=text, capture_output=True, text=True, check=True)
    assert [line.split(",") for line in done.stdout.splitlines()] == [
        list(x) for x in zip(*expected, strict=True)
    ]
    if find_spec("cmake") is not None:
        _built_by_cmake(tmp_path, list(parts), text, done.stdout)


def _built_by_cmake(folder, names, text, answers):
    """Build the program in a project of both folders."""
    (folder / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.10)\nproject(both C)\n"
        + "".join(f"add_subdirectory(libraries/{name})\n" for name in names)
        + f"add_executable(both main.c)\ntarget_link_libraries(both {' '.join(names)})\n"
    )
    cmake = (sys.executable, "-c", "import sys, cmake; sys.exit(cmake.cmake())")
    compiler = f"-DCMAKE_C_COMPILER={';'.join(host.compiler())}"
    run(*cmake, "-S", str(folder), "-B", str(folder / "build"), compiler)
    run(*cmake, "--build", str(folder / "build"))
    assert run(str(folder / "build" / "both"), input=text) == answers


def test_names_of_the_program_do_not_meet(tmp_path):
    if (tool := host.compiler()[0]) and not tool.endswith(("gcc", "cc")):
        pytest.skip("nm comes with gcc")
    symbols = []
    for name in ("texture_", "speed_"):
        C99().write(replace(of("samples", {}), prefix=name), tmp_path / name)
        source, _ = host.classifier_in(tmp_path / name)
        host.compiled([source], tmp_path / f"{name}.o", "-c", "-DTEXTURE_TRACE", "-DSPEED_TRACE")
        listed = run("nm", str(tmp_path / f"{name}.o")).splitlines()
        symbols.append({line.split()[-1] for line in listed if line.split()[-2] in "TDBRU"})
        assert all(symbol.startswith(name) for symbol in symbols[-1])
    assert all(pair[0].isdisjoint(pair[1]) for pair in pairwise(symbols))


_MAIN = """\
#include "speed.h"
#include "texture.h"
#include <stdio.h>

static texture_t texture;
static speed_t speed;

int main(void)
{
    int t, n, k, x[4];
    for (;;) {
        texture_init(&texture);
        speed_init(&speed);
        for (t = 0; t < 12; t++) {
            texture_sample_t here[TEXTURE_SENSORS];
            speed_sample_t there[SPEED_SENSORS];
            for (n = k = 0; k < 4; k++) {
                n += scanf("%d", x + k);
                here[k] = x[k];
                there[k] = x[k];
            }
            if (n != 4) {
                return 0;
            }
            texture_push(&texture, here);
            speed_push(&speed, there);
            texture_step(&texture);
            speed_step(&speed);
        }
        printf("%s,", texture_class_name(texture_decision(&texture)));
        printf("%s\\n", speed_class_name(speed_decision(&speed)));
    }
}
"""
