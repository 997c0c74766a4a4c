"""What a bundle's own engine does on recordings: decisions, and every spike."""

import numpy as np
import pytest

from dse.base.records import Response, Signals
from dse.config import load_space
from dse.deploy import bundle
from dse.deploy.evaluate import evaluate
from dse.deploy.export import export
from dse.deploy.reference import answered, of_recordings, prepared
from dse.engine.neurons import cuba_lif, population_of
from dse.engine.neurons.fixed_point import quantise
from dse.study import explore
from tests import tiny_study
from tests.deploy.bundles import explored
from tests.spaces import write_space


@pytest.fixture(scope="module")
def of_signals(tmp_path_factory):
    """The bundle of a recurrent network with delays and two steps per sample, on sampled signals."""
    folder = tmp_path_factory.mktemp("signals")
    keys = "hidden: [6, 5], recurrent: true, steps_per_sample: 2, input_delays: [0, 3]"
    path = write_space(
        folder,
        ("thresholds: {choice: [[1, 2], [1, 2, 4]]}", "thresholds: [1, 2]"),
        ("hidden: {choice: [4, 8, 12]}", keys),
        ("epochs: 1", "epochs: 3"),
    )
    study = explore.run(load_space(path), folder / "results", progress=False)
    points = study.points()
    export(study, dict(points[points["phi"].notna()].iloc[0].to_dict()), folder / "bundle")
    return folder / "bundle"


def test_decisions_are_those_of_evaluate(of_signals):
    touch = of_signals.parent / "touch.npz"
    reference, evaluation = of_recordings(bundle.read(of_signals), touch), evaluate(of_signals, touch)
    for name in ("label", "time_ms", "decided"):
        assert np.array_equal(getattr(reference, name), getattr(evaluation, name))
    assert reference.n_recordings == len(evaluation.target)


def test_spikes_follow_from_the_definition_of_the_neurons(of_signals):
    classifier = bundle.read(of_signals)
    reference = of_recordings(classifier, of_signals.parent / "touch.npz")
    network = classifier.fitted
    n, steps, per_sample = reference.n_recordings, reference.n_steps, network.steps_per_sample
    recording, step, channel = reference.spikes_in.T
    arriving = np.zeros((n, steps, network.n_channels * len(network.delays)))
    for k, delay in enumerate(network.delays):
        later = step * per_sample + delay
        seen = later < steps
        arriving[recording[seen], later[seen], channel[seen] + k * network.n_channels] = 1
    for layer, listed in zip(network.layers, reference.fired, strict=True):
        population = population_of(layer.neuron, layer.parameters)
        assert isinstance(population, cuba_lif.Population)
        fired = _fired(arriving @ quantise(layer.weight).T, layer.recurrent, population)
        assert np.array_equal(np.argwhere(fired), listed) and len(listed)
        arriving = cuba_lif.shift(fired)


def _fired(z, recurrent, population):
    """Return the spikes of a layer, (sample, step, neuron), found one step after the other."""
    if recurrent is not None:
        for t in range(1, z.shape[1]):
            z[:, t] += cuba_lif.run(z[:, :t], population, "integer")[2][:, -1] @ quantise(recurrent).T
    return cuba_lif.run(z, population, "integer")[2]


def test_the_last_layer_is_what_the_decision_reads(of_signals):
    classifier, touch = bundle.read(of_signals), of_signals.parent / "touch.npz"
    reference, new = of_recordings(classifier, touch), prepared(classifier, touch)
    response = answered(classifier, new.dataset, touch)
    assert isinstance(response, Response)
    recording, step, neuron = reference.fired[-1].T
    seen = step < reference.n_steps - 1
    output = np.zeros_like(response.output)
    output[recording[seen], step[seen] + 1, neuron[seen]] = 1
    assert np.array_equal(output, response.output)
    assert reference.step_ms == response.step_ms


def test_encoded_recordings_give_the_input_spikes(of_signals):
    classifier = bundle.read(of_signals)
    reference = of_recordings(classifier, of_signals.parent / "touch.npz")
    assert isinstance(reference.inputs, Signals) and classifier.sections.encoder is not None
    first = reference.first_step
    length = np.full(len(first), reference.dataset.n_steps)
    spikes = classifier.sections.encoder.encode_all(reference.inputs, first, length)
    recording, step, channel = reference.spikes_in.T
    counts = np.bincount(recording * length[0] + step, minlength=length.sum())
    assert np.array_equal(counts, np.diff(spikes.row_offsets))
    assert np.array_equal(channel, spikes.channel)


def test_rasters_are_spikes_already_and_other_families_have_no_layers(tmp_path):
    snn, knn = "kind: snn, hidden: [12], input_delays: [0, 2]", "kind: knn, channels: each, window_ms: 20"
    text = tiny_study.REAL.replace("repeats: 2", "repeats: 1")
    for model, n_layers in ((snn, 2), (knn, 0)):
        named = text.replace(snn, model).replace("study: real", f"study: s{n_layers}")
        study = explored(tmp_path, named)
        export(study, study.trials.iloc[0].to_dict(), tmp_path / "bundle")
        reference = of_recordings(bundle.read(tmp_path / "bundle"), tmp_path / "tiny.npz")
        with np.load(tmp_path / "tiny.npz") as file:
            window = file["spikes"][:, 2:18]
        assert reference.inputs is None
        assert (reference.first_step == 2).all()
        assert np.array_equal(np.argwhere(window), reference.spikes_in)
        assert len(reference.fired) == n_layers
