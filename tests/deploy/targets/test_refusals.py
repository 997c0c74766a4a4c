"""What targets refuse, and what is said where something is not installed or a file is damaged."""

import re
from dataclasses import replace

import numpy as np
import pytest

from dse.base.records import Layer, Parameters
from dse.deploy.bundle import BundleError, Input
from dse.deploy.run import interpreter
from dse.deploy.targets import TargetError, Verdict
from dse.deploy.verify import target_named
from dse.engine.neurons import lif, parameters_of
from tests.deploy import bundles
from tests.deploy.targets import test_loihi, test_xylo


def made(network=None, **features):
    """Return a bundle of a network, or of one that Loihi and C hold."""
    if network is None:
        features = {"decays": test_loihi.DECAYS, **features}
        network = bundles.network(np.random.default_rng(0), **features)
    return bundles.bundle(network, input=Input("spikes", network.n_channels, 0, 0, 10, 5.0))


def xylo(**features):
    return made(test_xylo.network(np.random.default_rng(0), **features))


def of(bundle, arithmetic):
    return replace(bundle, fitted=replace(bundle.fitted, arithmetic=arithmetic))


def last(numbers=None, **changes):
    """Return a bundle whose last layer is another."""
    fitted = made().fitted
    layer = fitted.layers[-1]
    given = {**layer.parameters, **{name: np.array(x) for name, x in (numbers or {}).items()}}
    layer = Layer(**{**vars(layer), "parameters": given, **changes})
    return made(replace(fitted, layers=(*fitted.layers[:-1], layer)))


LIF = last(neuron="lif", parameters=parameters_of(lif.Lif().at(5.0)))
LATE = last(delay=np.full((3, 7), 2, np.int8))
NO_NETWORK = replace(made(), fitted=Parameters({}, 4))
REFUSED = (
    ("c99", of(made(), "float32"), "integer arithmetic, got float32"),
    ("c99", LIF, "CUBA-LIF neurons, resonators and xylo_lif, got neuron lif"),
    ("c99", NO_NETWORK, "family snn is not written in C"),
    ("ice40", made(resonates=True), "layer 1 has neurons 'resonator', and Verilog is written for cuba_lif"),
    ("ice40", of(made(), "float32"), "integer arithmetic, got float32"),
    ("ice40", last({"decay_current": 0, "decay_voltage": 0, "threshold": 2**25}), "Verilog has 32: choose"),
    ("ice40", made(sizes=(300, 90, 3)), "60 blocks of memory, 30 at most; fits with 12288 weights"),
    ("ice40", made(sizes=(3, 3000, 3)), "fewer neurons: 45 are for states"),
    ("ice40", NO_NETWORK, "Verilog holds networks of neurons, and family snn is none"),
    ("loihi", last({"decay_current": 0}), "layer 2 has a current decay of 0, and the least of Loihi is"),
    ("loihi", last({"decay_voltage": 4096}), "layer 2 has a voltage decay of 1, and the most of Loihi is"),
    ("loihi", last({"threshold": 2**17}), "layer 2 has the threshold 131072, and the most is 131071"),
    ("loihi", made(resonates=True), "loihi1_silicon cannot run resonators: its neurons cannot be programmed"),
    ("loihi", NO_NETWORK, "family snn is none"),
    ("loihi", of(made(), "ideal"), "Loihi holds integers, and the network has ideal arithmetic"),
    ("loihi", lambda: made(sizes=(5000, 2000, 3)), "does not fit loihi1_silicon"),
    ("nir", made(resonates=True), "NIR has no node whose two states rotate, as those of resonators do"),
    ("nir", LATE, "no reader of NIR delays spikes in a network, and layer 2 receives some later"),
    ("nir", NO_NETWORK, "NIR holds networks of neurons, and family snn is none"),
    ("torch", NO_NETWORK, "torch modules hold networks of neurons, and family snn is none"),
    ("xylo", xylo(sizes=(17, 9, 3)), "does not fit xylo_imu: 17 inputs, 16 at most"),
    ("xylo", xylo(sizes=(4, 9, 20)), "does not fit xylo_imu: 20 outputs, 16 at most"),
    ("xylo", xylo(sizes=(4, 129, 3)), "does not fit xylo_imu: 129 neurons in the first layer, 128 at most"),
    ("xylo", xylo(sizes=(4, 100, 300, 100, 3)), "does not fit xylo_imu: 500 hidden neurons, 496 at most"),
    ("xylo", made(), "layer 1 has neurons 'cuba_lif', but Xylo's decay by bit shifts and reset by"),
    ("xylo", of(xylo(), "float32"), "float32 arithmetic"),
    ("xylo", NO_NETWORK, "family snn is none"),
)  # fmt: skip


@pytest.mark.parametrize(("target", "bundle", "reason"), REFUSED, ids=[f"{x[0]}: {x[2]}" for x in REFUSED])
def test_what_a_target_cannot_hold(target, bundle, reason, tmp_path):
    bundle = bundle() if callable(bundle) else bundle  # a large one only where it is tested
    assert reason in target_named(target).refusal(bundle)
    with pytest.raises(TargetError, match=re.escape(reason)):
        target_named(target).write(bundle, tmp_path)
    assert not list(tmp_path.iterdir())


FIND = "importlib.util.find_spec"
LOIHI, XYLO, RUN = (f"dse.deploy.{x}.find_spec" for x in ("targets.loihi", "targets.xylo", "run"))
ABSENT = (
    ("loihi", LOIHI, "h5py is not installed"),
    ("nir", "dse.deploy.targets.nir.interpreter", "norse is not installed and snntorch is not installed"),
    ("xylo", XYLO, "xylosim is not installed"),
    ("cortex_m4", FIND, TargetError("ziglang, the cross-compiler, is not installed")),
)  # fmt: skip


@pytest.mark.parametrize(("target", "name", "said"), ABSENT, ids=[x[0] for x in ABSENT])
def test_without_what_runs_it_nothing_is_verified(target, name, said, tmp_path, monkeypatch):
    bundle = xylo() if target == "xylo" else made()
    reference = bundles.reference(bundle, bundles.spikes(np.random.default_rng(3), 4), tmp_path)
    (folder := tmp_path / "target").mkdir()
    target_named(target).write(bundle, folder)
    monkeypatch.setattr(name, lambda *names: None)
    if isinstance(said, str):
        assert target_named(target).verify(bundle, folder, reference) == Verdict("not verified", said)
        return
    with pytest.raises(TargetError, match=re.escape(str(said))):
        target_named(target).verify(bundle, folder, reference)


@pytest.mark.parametrize(
    ("target", "package", "extra"), [("loihi", "h5py", "h5"), ("torch", "torch", "torch")]
)
def test_without_what_writes_it_nothing_is_written(target, package, extra, tmp_path, monkeypatch):
    monkeypatch.setattr(RUN, lambda name: None)
    with pytest.raises(TargetError, match=rf"{package} is not installed: .*'dse-spiking\[{extra}\]'"):
        target_named(target).write(made(), tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("target", "file", "message"),
    [
        ("loihi", "net.hdf5", r"loihi_run\.py cannot run .*net\.hdf5: "),
        ("nir", "graph.nir", r"nir_peer\.py cannot run norse .*graph\.nir: "),
        ("torch", "module.pt", r"module\.pt: must be a module of dse/module/1"),
    ],
)
def test_a_damaged_file_is_one_line(target, file, message, tmp_path):
    if target == "nir" and interpreter("norse", "nir") is None:
        pytest.skip("norse is not installed: `make peers` installs it")
    pytest.importorskip({"torch": "torch"}.get(target, "h5py"))
    bundle = made()
    reference = bundles.reference(bundle, bundles.spikes(np.random.default_rng(3), 4), tmp_path)
    (folder := tmp_path / "target").mkdir()
    target_named(target).write(bundle, folder)
    content = (folder / file).read_bytes()
    for damaged in (content[: len(content) // 2], b"", b"text")[-1 if target != "torch" else 0 :]:
        (folder / file).write_bytes(damaged)
        with pytest.raises(BundleError, match=message):
            target_named(target).verify(bundle, folder, reference)
