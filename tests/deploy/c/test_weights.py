"""C that loads its weights: the same spikes, an update without new code, and refusals."""

import re
from dataclasses import replace

import numpy as np
import pytest

from dse.deploy.c import host, replay
from dse.deploy.reference import of_recordings
from dse.deploy.targets import TargetError, compare
from dse.deploy.targets.c99 import C99, C99Weights
from dse.models.counts.kernels import Kernels
from dse.models.counts.mlp import MLP
from dse.models.counts.naive_bayes import NaiveBayes
from dse.models.counts.tcn import TCN
from tests.deploy.c import nets
from tests.deploy.c.test_counting import fitted
from tests.deploy.c.test_sketch import of, touches
from tests.deploy.targets.test_c99 import answers_of_main, csv, run

pytestmark = nets.needs_compiler

TARGET = C99Weights()


@pytest.mark.parametrize("number", [0, 3, 5, 7, 9])
def test_spikes_and_decisions_are_those_of_the_engine(number, tmp_path):
    made, fired = nets.case(number)
    nets.faithful(TARGET, made, nets.reference(made, fired), tmp_path)
    assert not re.search(r"const \w+ weights_1\[", (tmp_path / "src" / "dse.c").read_text())


@pytest.mark.parametrize(
    "model",
    [
        NaiveBayes(window_ms=5, channels="each"),
        MLP(window_ms=20, hidden=(5,), epochs=2),
        Kernels(window_ms=20, kernels=84, places=2),
        TCN(window_ms=10, hidden=(8, 8), epochs=1, read_outs=1),
    ],
)
def test_answers_of_counts_are_those_of_the_engine(model, tmp_path):
    nets.faithful(TARGET, *fitted(model), tmp_path)


def test_samples_are_encoded_and_the_program_reads_the_file(tmp_path, monkeypatch):
    made, recording = of("samples", {"at": "start"}), touches("samples")[0][:12]
    np.savez(tmp_path / "touch.npz", signal=recording.astype(np.float32)[None])
    reference = of_recordings(made, tmp_path / "touch.npz")
    nets.faithful(TARGET, made, reference, tmp_path / "c")
    monkeypatch.chdir(tmp_path / "c")
    [[answer, *_]] = answers_of_main(tmp_path / "c", csv([recording]))
    assert answer == made.classes[reference.label[0]]
    monkeypatch.chdir(tmp_path)
    with pytest.raises(AssertionError, match=r"weights\.bin here is not of this program"):
        run(str(tmp_path / "touch"), input=csv([recording]))


def retrained(made, seed=1):
    """Return a bundle with other weights of the same shapes, many of them 0."""
    rng = np.random.default_rng(seed)
    layers = []
    for layer in made.fitted.layers:
        weight = layer.weight * rng.choice([0.0, 0.7, 1.0, -1.0], layer.weight.shape)
        layers.append(replace(layer, weight=weight.astype(np.float32)))
    return replace(made, fitted=replace(made.fitted, layers=tuple(layers)))


def test_other_weights_are_an_update_of_the_same_code(tmp_path):
    made, fired = nets.case(6)
    other = retrained(made)
    for name, each in (("first", made), ("second", other)):
        TARGET.write(each, tmp_path / name)
    firsts, seconds = (
        {x.name: x.read_bytes() for x in (tmp_path / name / "src").iterdir()} for name in ("first", "second")
    )
    assert firsts.keys() == seconds.keys()
    (tmp_path / "first" / "weights.bin").write_bytes((tmp_path / "second" / "weights.bin").read_bytes())
    reference = nets.reference(other, fired)
    played = host.played(tmp_path / "first", replay.of_spikes(reference))
    plan = TARGET.form(other)
    assert compare(reference, replay.run_of(played, plan, reference)).kind == "faithful"
    assert compare(nets.reference(made, fired), replay.run_of(played, plan, reference)).kind != "faithful"


@pytest.mark.parametrize("place", [0, 5, 9, 20, -3])
def test_a_damaged_file_is_refused(place, tmp_path):
    made, fired = nets.case(6)
    TARGET.write(made, tmp_path)
    content = bytearray((tmp_path / "weights.bin").read_bytes())
    content[place] ^= 4
    (tmp_path / "weights.bin").write_bytes(content)
    with pytest.raises(TargetError, match="exit code 5"):
        host.played(tmp_path, replay.of_spikes(nets.reference(made, fired)))


def test_weights_of_other_code_are_refused(tmp_path):
    made, fired = nets.case(6)
    for name, each in (
        ("a", made),
        ("b", replace(made, phi=9.0, theta=0.9)),
        ("n", replace(made, classes=tuple("xyz"))),
        ("c", nets.case(7)[0]),
    ):
        TARGET.write(each, tmp_path / name)
    for name in "bnc":
        (tmp_path / "a" / "weights.bin").write_bytes((tmp_path / name / "weights.bin").read_bytes())
        with pytest.raises(TargetError, match="exit code 5"):
            host.played(tmp_path / "a", replay.of_spikes(nets.reference(made, fired)))


def test_without_weights_there_is_no_answer(tmp_path):
    made, _ = nets.case(6)
    TARGET.write(made, tmp_path)
    (tmp_path / "main.c").write_text(
        '#include "dse.h"\n#include <stdio.h>\nstatic dse_t net;\nint main(void)\n{\n    unsigned t;\n'
        "    dse_init(&net);\n    for (t = 0; t < 2 * DSE_WINDOW; t++) {\n        dse_push_spike(&net, 0);\n"
        '        dse_step(&net);\n    }\n    printf("%d\\n", dse_decision(&net));\n    return 0;\n}\n'
    )
    src = tmp_path / "src"
    host.compiled([tmp_path / "main.c", src / "dse.c"], tmp_path / "a", f"-I{src}", "-O2")
    assert run(str(tmp_path / "a")) == "-1\n"


def test_the_plain_export_has_no_file_of_weights(tmp_path):
    C99().write(nets.case(6)[0], tmp_path)
    assert not (tmp_path / "weights.bin").exists()
