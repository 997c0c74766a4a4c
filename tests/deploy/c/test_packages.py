"""The folder of the C as a package of CMake, ESP-IDF, Zephyr, PlatformIO, Arduino, and as a CMSIS pack."""

import json
import re
import shutil
import sys
import xml.etree.ElementTree
from dataclasses import replace
from importlib.util import find_spec

import pytest
import yaml

from dse.deploy.c import host
from dse.deploy.targets.c99 import C99, C99Weights
from tests.deploy.c import nets
from tests.deploy.c.test_safety import RECEPTORS, encoded
from tests.deploy.c.test_sketch import of
from tests.deploy.targets.test_c99 import run

CMAKE = (
    (sys.executable, "-c", "import sys, cmake; sys.exit(cmake.cmake())")
    if find_spec("cmake")
    else tuple(filter(None, [shutil.which("cmake")]))
)
needs_cmake = pytest.mark.skipif(not CMAKE, reason="cmake is not installed")
SELFTEST = (
    '#include "texture.h"\n#include <stdio.h>\nint main(void)\n{\n    static texture_t net;\n'
    '    puts(texture_selftest(&net) ? "PASS" : "FAIL");\n    return 0;\n}\n'
)


@pytest.fixture
def texture(tmp_path):
    """A folder that begins its names with texture_; its products must not be fused."""
    C99().write(replace(encoded(**RECEPTORS), prefix="texture_"), tmp_path / "texture")
    return tmp_path / "texture"


def configured(folder, text, *options):
    """Configure a project whose CMakeLists.txt has this text; return its folder."""
    folder.mkdir(exist_ok=True)
    (folder / "main.c").write_text(SELFTEST)
    (folder / "CMakeLists.txt").write_text(f"cmake_minimum_required(VERSION 3.10)\n{text}")
    cmake(folder, *options)
    return folder


def cmake(folder, *options):
    compiler = f"-DCMAKE_C_COMPILER={';'.join(host.compiler())}"
    commands = "-DCMAKE_EXPORT_COMPILE_COMMANDS=ON"
    run(*CMAKE, "-S", str(folder), "-B", str(folder / "build"), compiler, commands, *options)


def built(folder, program):
    """Build a configured project, and return what a program of it prints."""
    run(*CMAKE, "--build", str(folder / "build"))
    lines = json.loads((folder / "build" / "compile_commands.json").read_text())
    of_library = [x["command"] for x in lines if x["file"].endswith("texture.c")]
    assert all("-ffp-contract=off" in command for command in of_library)
    return run(str(folder / "build" / program))


@needs_cmake
@nets.needs_compiler
def test_what_cmake_installs_is_found(texture, tmp_path):
    cmake(texture, f"-DCMAKE_INSTALL_PREFIX={tmp_path / 'installed'}")
    assert built(texture, "selftest") == "PASS\n"
    run(*CMAKE, "--install", str(texture / "build"))
    shutil.rmtree(texture)
    user = "find_package(texture REQUIRED)\nadd_executable(user main.c)\n"
    linked = f"project(user C)\n{user}target_link_libraries(user texture::texture)\n"
    folder = configured(tmp_path / "user", linked, f"-DCMAKE_PREFIX_PATH={tmp_path / 'installed'}")
    assert built(folder, "user") == "PASS\n"


@needs_cmake
@nets.needs_compiler
def test_it_is_a_component_of_esp_idf(texture, tmp_path):
    # As of ESP-IDF's build system: the macro is called once to learn of a component, then to make its target.
    early = tmp_path / "early.cmake"
    early.write_text(
        "macro(idf_component_register)\n    message(STATUS ${ARGV})\n    return()\nendmacro()\n"
        f"set(ESP_PLATFORM 1)\nset(CMAKE_C_COMPILER_ID GNU)\ninclude({texture}/CMakeLists.txt)\n"
    )
    assert "SRCSsrc/texture.csrc/texture_selftest.cINCLUDE_DIRSsrc" in run(*CMAKE, "-P", str(early))
    project = f"""\
project(firmware C)
set(ESP_PLATFORM 1)
set(COMPONENT_LIB __idf_texture)
function(idf_component_register)
    cmake_parse_arguments(_ "" "" "SRCS;INCLUDE_DIRS" ${{ARGV}})
    add_library(${{COMPONENT_LIB}} STATIC ${{__SRCS}})
    target_include_directories(${{COMPONENT_LIB}} PUBLIC ${{__INCLUDE_DIRS}})
endfunction()
add_subdirectory({texture} texture)
add_executable(firmware main.c)
target_link_libraries(firmware ${{COMPONENT_LIB}})
"""
    assert built(configured(tmp_path / "firmware", project), "firmware") == "PASS\n"


ZEPHYR = """\
cmake_minimum_required(VERSION 3.10)
project(kernel C)
set(ZEPHYR_BASE ${CMAKE_CURRENT_LIST_DIR})
macro(zephyr_library_named name)
    set(ZEPHYR_CURRENT_LIBRARY ${name})
    add_library(${name} STATIC "")
    set_property(GLOBAL APPEND PROPERTY LIBRARIES ${name})
endmacro()
function(zephyr_library_sources source)
    target_sources(${ZEPHYR_CURRENT_LIBRARY} PRIVATE ${source} ${ARGN})
endfunction()
function(zephyr_include_directories)
    foreach(each ${ARGV})
        include_directories(${CMAKE_CURRENT_SOURCE_DIR}/${each})
        target_include_directories(app PRIVATE ${CMAKE_CURRENT_SOURCE_DIR}/${each})
    endforeach()
endfunction()
file(STRINGS ${CMAKE_SOURCE_DIR}/prj.conf lines)
foreach(line ${lines})
    string(REPLACE "=" ";" pair ${line})
    list(GET pair 0 name)
    list(GET pair 1 value)
    if(NOT WITHOUT)
        set(${name} ${value})
    endif()
endforeach()
add_executable(app "")
foreach(module ${EXTRA_ZEPHYR_MODULES})
    add_subdirectory(${module} module)
endforeach()
get_property(libraries GLOBAL PROPERTY LIBRARIES)
target_link_libraries(app ${libraries})
"""


@needs_cmake
@nets.needs_compiler
def test_it_is_a_module_of_zephyr_with_a_sample(texture, tmp_path):
    (tmp_path / "zephyr").mkdir()
    (tmp_path / "zephyr" / "ZephyrConfig.cmake").write_text(ZEPHYR)
    sample = texture / "zephyr" / "sample"
    cmake(sample, f"-DZephyr_DIR={tmp_path / 'zephyr'}")
    assert built(sample, "app") == "PASS\n"
    shutil.rmtree(sample / "build")
    cmake(sample, f"-DZephyr_DIR={tmp_path / 'zephyr'}", "-DWITHOUT=1")  # not configured: it is left out
    lines = json.loads((sample / "build" / "compile_commands.json").read_text())
    assert [x["file"] for x in lines if x["file"].endswith("texture.c")] == []
    [symbol] = re.findall(r"^config (\w+)$", (texture / "zephyr" / "Kconfig").read_text(), re.MULTILINE)
    assert f"CONFIG_{symbol}=y\n" in (sample / "prj.conf").read_text() and symbol == "TEXTURE"


KINDS = {
    "samples": lambda: (C99(), of("samples", {})),
    "spikes": lambda: (C99(), of("spikes", {})),
    "events": lambda: (C99(), of("events", {})),
    "receptors": lambda: (C99(), encoded(**RECEPTORS)),
    "prefixed": lambda: (C99(), replace(of("samples", {}), prefix="speed_")),
    "weights": lambda: (C99Weights(), of("spikes", {})),
}


@pytest.mark.parametrize("kind", KINDS)
def test_what_describes_a_package_names_its_files(kind, tmp_path):
    target, made = KINDS[kind]()
    target.write(made, tmp_path)
    name = made.prefix[:-1]
    module = yaml.safe_load((tmp_path / "zephyr" / "module.yml").read_text())
    assert module["name"] == name and (tmp_path / module["build"]["kconfig"]).is_file()
    assert (tmp_path / module["build"]["cmake"] / "CMakeLists.txt").is_file()
    for sample in module.get("samples", ()):
        assert {x.name for x in (tmp_path / sample).iterdir()} == {"CMakeLists.txt", "prj.conf"}
    pack = xml.etree.ElementTree.parse(tmp_path / f"dse.{name}.pdsc").getroot()
    assert [pack.findtext(x) for x in ("vendor", "name")] == ["dse", name]
    named = {x.attrib["name"] for x in pack.iter("file")}
    sources = {f"src/{x.name}" for x in (tmp_path / "src").iterdir()}
    assert named == {"src/", *sources} and all((tmp_path / x).exists() for x in named)
    if kind == "weights":  # which are no part of the code
        assert not list(tmp_path.glob("library.*")) and "samples" not in module
        return
    library = json.loads((tmp_path / "library.json").read_text())
    properties = dict(x.split("=", 1) for x in (tmp_path / "library.properties").read_text().splitlines())
    assert all(library[key] == properties[key] for key in ("name", "version"))
    assert library["headers"] == [properties["includes"]] == [f"{name}.h"]
    assert all((tmp_path / x).exists() for x in library["export"]["include"])
    [example] = library["examples"]
    sketch = tmp_path / example["base"]
    assert {x.name for x in sketch.iterdir()} == set(example["files"])
    # AVR, whose double has 32 bits, is in neither list where 64 are needed.
    assert (library["platforms"] == ["*"]) is (properties["architectures"] == "*") is (kind != "receptors")
