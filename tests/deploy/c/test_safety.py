"""The C where it could be misled: a short double, no number, no dse_init, counts beside an answer, memory."""

import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from dse.data.recordings import RecordingError
from dse.deploy.bundle import Bundle
from dse.deploy.c import host, replay
from dse.deploy.c.plan import plan_of
from dse.deploy.reference import of_recordings
from dse.deploy.stream import Stream
from dse.deploy.targets import TargetError
from dse.deploy.targets.c99 import C99
from dse.models.counts.elm import ELM
from dse.models.counts.knn import KNN
from dse.models.counts.mlp import MLP
from dse.models.counts.naive_bayes import NaiveBayes
from tests.deploy.c import nets
from tests.deploy.c.test_counting import fitted
from tests.deploy.c.test_sketch import of, touches
from tests.deploy.targets.test_c99 import NETS, SAMPLES, answers_of_main, network
from tests.spaces import sections

pytestmark = nets.needs_compiler


def encoded(**encoder):
    """Return a bundle of four sensors with an encoder."""
    made = of("samples", {"at": "start"})
    design = sections({**SAMPLES, "encoder": {"kind": "send_on_delta", **encoder}})
    if encoder.get("kind") == "receptors":
        ranges = {"low": (290.0,) * 4, "high": (340.0,) * 4}
        design = replace(design, encoder=replace(design.encoder, **ranges))
    fitted = network(design.encoder.n_channels(4))
    return replace(made, fitted=fitted, sections=replace(design, window=made.sections.window))


REAL = {"thresholds": [0.7, 3.9]}
LEVEL = {"thresholds": [0.7, 3.9], "reference": "level"}
RECEPTORS = {"kind": "receptors", "spikes_per_step": 2, "smoothing_ms": 20}


# Where double has 32 bits, as on AVR.


@pytest.mark.parametrize(
    ("made", "always", "with_reals"),
    [
        (encoded(**REAL), True, True),
        (encoded(kind="receptors"), True, True),
        (encoded(thresholds=[1, 4]), False, True),
        (NaiveBayes(), True, True),
        (ELM(window_ms=20, windows=3, hidden=9), True, True),
        (ELM(window_ms=20, windows=3, hidden=9, precision="float32"), False, False),
        (MLP(window_ms=20, hidden=(5,), epochs=2), False, False),
        (KNN(), False, False),
        (nets.case(0)[0], False, False),
    ],
    ids="send_on_delta receptors whole bayes elm elm32 mlp knn net".split(),
)
def test_a_short_double_is_refused_where_c_needs_a_long_one(made, always, with_reals, tmp_path):
    C99().write(made if isinstance(made, Bundle) else fitted(made)[0], tmp_path)

    def compiles(*options):
        try:
            host.compiled([tmp_path / "src" / "dse.c"], tmp_path / "dse.o", "-c", *options)
        except TargetError as error:
            assert "dse_needs_a_double_of_64_bits" in str(error)
            return False
        return True

    assert compiles() and compiles("-DDSE_REAL_SAMPLES")
    assert compiles("-Ddouble=float") is not always
    assert compiles("-Ddouble=float", "-DDSE_REAL_SAMPLES") is not with_reals
    properties = dict(x.split("=", 1) for x in (tmp_path / "library.properties").read_text().splitlines())
    architectures = properties["architectures"].split(",")
    assert ("*" in architectures) is not always and "avr" not in architectures


@pytest.mark.parametrize("encoder", [LEVEL, RECEPTORS])
def test_products_are_rounded_whatever_the_compiler_may_fuse(encoder, tmp_path):
    C99().write(encoded(**encoder), tmp_path)
    assembly = tmp_path / "dse.s"
    try:
        fused = ("-std=gnu11", "-O2", "-ffp-contract=fast", "-march=haswell", "-S", "-DDSE_REAL_SAMPLES")
        host.compiled([tmp_path / "src" / "dse.c"], assembly, *fused)
    except TargetError:
        pytest.skip("the compiler has no fused products")
    assert "mulsd" in assembly.read_text() and "fmadd" not in assembly.read_text()
    assert "-ffp-contract=off" in (tmp_path / "CMakeLists.txt").read_text()


# A sample with a value that is no number.


@pytest.mark.parametrize("encoder", [REAL, LEVEL, {"thresholds": [0.7], "reference": "value"}, RECEPTORS])
@pytest.mark.parametrize("options", [(), ("-O3", "-ffast-math")])
def test_samples_that_are_no_numbers_are_left_out(encoder, options, tmp_path):
    made = encoded(**encoder)
    C99().write(made, tmp_path)
    values = np.concatenate(touches("samples")).astype(np.float32)[:60]
    whole = replay.of_samples(values, 0, 60)
    lines = whole[2:-1].reshape(60, 6)  # SAMPLE, four values, STEP
    bad = []
    for k, (sensor, value) in enumerate([(1, np.nan), (0, np.inf), (3, -np.inf), (2, np.nan)]):
        row = values[10 * k].copy()
        row[sensor] = value
        bad += [np.array([replay.SAMPLE, *row.view(np.int32)]), lines[15 * k : 15 * k + 15].ravel()]
    commands = np.concatenate([whole[:2], *bad, whole[-1:]])  # one before the first sample
    clean, dirty = (host.played(tmp_path, [x], "-DDSE_REAL_SAMPLES", *options) for x in (whole, commands))
    assert (clean.spikes[:, 1] == 0).sum() > 10
    assert np.array_equal(clean.spikes, dirty.spikes) and clean.label == dirty.label


@pytest.mark.parametrize("encoder", [REAL, RECEPTORS])
def test_a_stream_leaves_out_what_it_refuses(encoder):
    made, values = encoded(**encoder), np.concatenate(touches("samples")).astype(np.float32)
    clean, dirty = Stream(made), Stream(made)
    for k, row in enumerate(values):
        if k % 7 == 0:
            wrong = row.copy()
            wrong[k % 4] = (np.nan, np.inf)[k % 2]
            with pytest.raises(RecordingError, match="a sample must have finite numbers"):
                dirty.push(wrong)
        assert dirty.push(row) == clean.push(row)


def test_the_program_refuses_what_is_no_number(tmp_path):
    C99().write(encoded(**REAL), tmp_path / "c99")
    rows = [",".join(map(str, row)) for row in np.concatenate(touches("samples"))[:12].tolist()]
    assert answers_of_main(tmp_path / "c99", "\n".join(rows))
    for value in ("nan", "inf", "-inf", "3.5e38"):
        wrong = [*rows[:7], f"{value},1,2,3", *rows[8:]]
        with pytest.raises(AssertionError, match="line 8: a sample must be a finite number"):
            answers_of_main(tmp_path / "c99", "\n".join(wrong))


# Answers and counts.


@pytest.mark.parametrize("made", ["net", "heads", "knn"])
def test_before_any_step_nothing_is_decided(made, tmp_path):
    C99().write(fitted(KNN())[0] if made == "knn" else nets.case(3 * (made == "heads"))[0], tmp_path)
    (tmp_path / "main.c").write_text(
        '#include "dse.h"\n#include <stdio.h>\n'
        "static dse_t net;\n"
        'int main(void)\n{\n    printf("%d %d\\n", dse_decision(&net), (int)dse_steps(&net));\n'
        "    dse_init(&net);\n"
        '    printf("%d\\n", dse_decision(&net));\n    return 0;\n}\n'
    )
    host.compiled([tmp_path / "main.c", tmp_path / "src" / "dse.c"], tmp_path / "a", f"-I{tmp_path / 'src'}")
    done = subprocess.run([tmp_path / "a"], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["-1", "0", "-1"]


def test_counts_are_those_that_the_answer_was_made_from(tmp_path):
    n_undecided = 0
    for number in NETS:
        made, fired = nets.case(number)
        plan, reference = plan_of(made), nets.reference(made, fired)
        if plan.rule.joint or number % 2:
            continue
        C99().write(made, tmp_path / str(number))
        played = host.played(tmp_path / str(number), replay.of_spikes(reference))
        of_answer = played.counts[:, plan.rule.first : plan.rule.first + plan.rule.n]
        assert np.array_equal(of_answer.argmax(axis=1), played.label)
        output = np.asarray(reference.fired[-1])
        for recording, steps in enumerate(played.steps):  # a spike of the last step comes too late
            read = output[(output[:, 0] == recording) & (output[:, 1] < steps - 1), 2]
            assert np.array_equal(
                np.bincount(read, minlength=len(played.counts[0])), played.counts[recording]
            )
        n_undecided += int((~played.confident).sum())
    assert n_undecided >= 3


@pytest.mark.parametrize(
    ("told", "version"),
    [
        (
            "cc (Debian 12.2.0-14+deb12u1) 12.2.0\nCopyright (C) 2022 Free Software Foundation, Inc.",
            "gcc 12.2.0",
        ),
        ("Debian clang version 14.0.6\nTarget: x86_64-pc-linux-gnu", "clang 14.0.6"),
        ("Apple clang version 15.0.0 (clang-1500.3.9.4)\nTarget: arm64-apple-darwin23.4.0", "clang 15.0.0"),
        ("tcc version 0.9.27 (x86_64 Linux)", "tcc 0.9.27"),
    ],
)
def test_compilers_are_named(told, version, tmp_path, monkeypatch):
    (tmp_path / "told").write_text(told)
    (tmp_path / "cc").write_text(f'#!/bin/sh\ncat "{tmp_path / "told"}"\n')
    (tmp_path / "cc").chmod(0o755)
    monkeypatch.setenv("CC", str(tmp_path / "cc"))
    assert host.compiler_version() == version


# Memory.


@pytest.mark.skipif(shutil.which("size") is None, reason="binutils are not installed")
@pytest.mark.parametrize("encoder", [REAL, LEVEL, RECEPTORS, {"thresholds": [1, 4]}])
def test_ram_is_one_number_wherever_it_is_stated(encoder, tmp_path):
    made = encoded(**encoder)
    values = np.concatenate(touches("samples"))[:40].astype(np.float32)
    np.savez(tmp_path / "touch.npz", signal=values[None])
    verdict = nets.faithful(C99(), made, of_recordings(made, tmp_path / "touch.npz"), tmp_path / "c99")
    assert verdict.run_by == (host.compiler_version(),)
    stated, plan = C99().footprint(made)["ram_bytes"], plan_of(made)
    assert verdict.figures["ram_bytes"] == stated == plan.ram_bytes
    readme = (tmp_path / "c99" / "README.md").read_text()
    assert f"| {stated:.0f} |" in readme
    of_reals = host.sizes(tmp_path / "c99", "-DDSE_REAL_SAMPLES")["ram_bytes"]
    if encoder == {"thresholds": [1, 4]}:
        assert of_reals > stated and f"takes {of_reals:.0f} bytes of RAM" in readme
    else:
        assert of_reals == stated
