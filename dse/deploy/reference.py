"""New recordings as a bundle sees them, and what its own engine does on them: the reference of targets."""

from __future__ import annotations

import dataclasses
import glob
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from dse.base import registry
from dse.base.records import (
    Answers,
    Array,
    Bools,
    Dataset,
    Floats,
    Head,
    Ints,
    Network,
    Rasters,
    Response,
    Spikes,
)
from dse.config.contracts import Recordings, Source
from dse.data import dataset
from dse.data.dataset.assemble import New
from dse.data.recordings import RecordingError, arrays
from dse.data.recordings.event_files import EventFiles
from dse.data.recordings.events import EventFile
from dse.data.recordings.scene import COLUMNS, SceneTrials
from dse.deploy.classifier import BundleError, Classifier
from dse.deploy.form import Net
from dse.engine.events import Rows, gather
from dse.measure import decision
from dse.measure.heads import head_answers, head_slices, joint_label
from dse.measure.run import read_out
from dse.models.snn.respond import spikes_of_layers


@dataclass(frozen=True)
class Run:
    """What a classifier did on n recordings.

    label, time_ms, decided: (n,) decisions as `dse evaluate` gives them; label -1: a combination of the
        heads' answers that no training recording had.
    fired: per layer after the input, (n_spikes, 3) int32: recording, network step in which the neuron fires,
        neuron; sorted. The next layer, or who decides, receives the spike one step later, and never that of
        the last step. Empty where the classifier is no single network.
    """

    label: Ints
    time_ms: Floats
    decided: Bools
    fired: Sequence[Ints]

    @classmethod
    def of_fired(cls, bundle: Classifier, reference: Reference, fired: Sequence[Ints]) -> Self:
        """Return the run of a target that only spikes: its bundle's rule decides from the last layer."""
        n, n_steps, spikes = reference.n_recordings, reference.n_steps, np.asarray(fired[-1], np.int64)
        assert isinstance(bundle.fitted, Network)
        output = np.zeros((n, n_steps, bundle.fitted.sizes[-1]), np.uint8)
        recording, step, neuron = spikes[spikes[:, 1] < n_steps - 1].T
        np.add.at(output, (recording, step + 1, neuron), 1)
        none = np.zeros((n, n_steps, 0), np.int32)
        response = Response(output, none, none, reference.step_ms, peak_state=0)
        return cls(*decided(bundle, reference.dataset, response), fired)


@dataclass(frozen=True)
class Reference(Run):
    """What the engine of a bundle did.

    inputs: the recordings as read, which an encoder or preprocessing is fed; None where they are the input
        spikes already. Encoders run from a recording's first sample on, and bins of recorded events
        begin at its first event (those of a scene at 0), both before the window.
    first_step: (n,) input step of each recording at which its window begins.
    dataset: the same after encoder and preprocessing: spikes, windows.
    spikes_in: input spikes of the windows, (n_spikes, 3) int32: recording, input step of the window, channel;
        sorted. Input copies by delays are not in it.
    n_steps: network steps of a window.
    step_ms: duration of a network step.
    """

    inputs: Recordings | None
    first_step: Ints
    dataset: Dataset
    spikes_in: Ints
    n_steps: int
    step_ms: float

    @property
    def n_recordings(self) -> int:
        return len(self.label)

    def arriving(self, network: Network | Net) -> Rows:
        """Return the spikes that reach the first layer of a network, with their delayed copies."""
        data, delays, per_sample = self.dataset, network.delays, network.steps_per_sample
        return gather(data.spikes, data.test, data.start[data.test], data.n_steps, delays, per_sample)


def of_recordings(bundle: Classifier, data_file: str | Path) -> Reference:
    """Return what a bundle does on recordings.

    Args:
        bundle: as read.
        data_file: recordings of the kind that it was trained on, labelled or not.

    Raises:
        BundleError: its classifier refuses the recordings.
        RecordingError: the recordings do not fit.
    """
    return of_new(bundle, prepared(bundle, data_file), data_file)


def of_new(bundle: Classifier, new: New, where: str | Path) -> Reference:
    """Return what a bundle does on recordings that are prepared for it (`dataset.build_for`).

    Args:
        bundle: as exported.
        new: prepared with its sections.
        where: what an error calls them.

    Raises:
        BundleError: its classifier refuses the recordings.
    """
    data, network = dataclasses.replace(new.dataset, heads=bundle.heads), bundle.fitted
    decisions = decided(bundle, data, answered(bundle, data, where))
    is_spikes = isinstance(new.recordings, Rasters) and bundle.sections.encoder is None
    per_sample = network.steps_per_sample if isinstance(network, Network) else 1
    return Reference(
        inputs=None if is_spikes else new.recordings,
        first_step=(new.first + data.start)[data.test],
        dataset=data,
        spikes_in=spikes_of_windows(data),
        fired=tuple(spikes_of_layers(network, data, data.test)) if isinstance(network, Network) else (),
        label=decisions[0],
        time_ms=decisions[1],
        decided=decisions[2],
        n_steps=data.n_steps * per_sample,
        step_ms=data.spikes.step_ms / per_sample,
    )


def of_spikes(bundle: Classifier, fired: Array, step_ms: float) -> Reference:
    """Return what a bundle does on windows of input spikes, (recording, step, channel) of 0 and 1."""
    no_recordings: Any = None
    data = windows_of(Spikes.of_dense(fired, step_ms), bundle.classes)
    return of_new(bundle, New(data, [], no_recordings, np.zeros(len(fired), np.int64)), "spikes")


def windows_of(spikes: Spikes, classes: tuple[str, ...], heads: tuple[Head, ...] = ()) -> Dataset:
    """Return spikes whose samples are windows as the test set of a data set without labels or positions."""
    n, n_steps = spikes.n_samples, spikes.n_steps
    start, none, places = np.zeros(n, np.int32), np.zeros(0, np.int64), np.zeros((spikes.n_channels, 3))
    return Dataset(
        spikes=spikes, target=np.full(n, -1), classes=classes, start=start, start_low=start,
        start_high=start, n_steps=n_steps, train=none, validation=none, test=np.arange(n),
        positions=places.astype(np.int32), heads=heads,
    )  # fmt: skip


def prepared(bundle: Classifier, data_file: str | Path, *, repair: bool = False) -> New:
    """Return recordings as the classifier of a bundle receives them.

    Raises:
        BundleError: they have another number of channels.
        RecordingError: they do not fit.
    """
    path = Path(data_file).absolute()
    source = source_at(path, bundle.sections.data)
    kind = registry.name_of("recordings", source)
    if repair:
        if not isinstance(source, EventFiles):
            text = f"only event files can be repaired, got data of kind '{kind}'"
            raise RecordingError(f"{path.name}: {text}")
        source = dataclasses.replace(source, repair=True)
    kinds = {**bundle.sections.kinds, "data": kind}
    sections = dataclasses.replace(bundle.sections, data=source, kinds=kinds)
    new = dataset.build_for(sections, path.parent, bundle.classes)
    if new.dataset.spikes.n_channels != bundle.fitted.n_channels:
        raise BundleError(
            f"{data_file}: must have {bundle.fitted.n_channels} input channels after preprocessing, "
            f"got {new.dataset.spikes.n_channels}"
        )
    return new._replace(dataset=dataclasses.replace(new.dataset, heads=bundle.heads))


def answered(bundle: Classifier, data: Dataset, data_file: str | Path) -> Response | Answers:
    """Return what the classifier answers to prepared recordings.

    Raises:
        BundleError: it refuses them, e.g. because they are of another length.
    """
    try:
        response = bundle.sections.model.respond(bundle.fitted, data, data.test)
    except ValueError as error:
        raise BundleError(f"{data_file}: {error}") from None
    except (KeyError, IndexError, TypeError, OverflowError) as error:
        kind = bundle.sections.kinds["model"]
        reason = " ".join(str(error).split())
        text = f"family {kind} cannot use the arrays of the bundle ({type(error).__name__}: {reason})"
        raise BundleError(f"{data_file}: {text}") from error
    if isinstance(response, Answers):
        n, label = len(bundle.classes), response.label
        if label.size and not (0 <= label.min() and label.max() < n):
            raise BundleError(f"{data_file}: the bundle must answer classes 0 to {n - 1}, got others")
    return response


def spikes_of_windows(data: Dataset) -> Ints:
    """Return recording, step and channel of every input spike of the windows, (n_spikes, 3) int32."""
    spikes, parts = data.spikes, [np.zeros((0, 3), np.int32)]
    for i, sample in enumerate(data.test.tolist()):
        row = sample * spikes.n_steps + int(data.start[sample])
        borders = np.asarray(spikes.row_offsets[row : row + data.n_steps + 1])
        channel = np.asarray(spikes.channel[borders[0] : borders[-1]])
        step = np.repeat(np.arange(data.n_steps, dtype=np.int32), np.diff(borders))
        parts.append(np.stack([np.full_like(step, i), step, channel], axis=1))
    return np.concatenate(parts)


def source_at(path: Path, data: Source) -> Source:
    """Return section `data` for new recordings at a path; a network of a scene may get those of a sensor."""
    if isinstance(data, SceneTrials):
        if path.suffix in (".yaml", ".yml"):
            return dataclasses.replace(data, scene=str(path))
        if path.suffix == ".npz" and "offsets" in arrays.headers(path):
            # As `dse simulate` writes them: several recordings, the frame beside them.
            frame = arrays.load(path, ("width", "height"))
            return EventFile(
                file=str(path),
                width=int(frame["width"]),
                height=int(frame["height"]),
                x="x",
                y="y",
                polarity="polarity",
                columns={name: name for name in COLUMNS},
            )
        data = EventFiles(folder=str(path.parent))
    if isinstance(data, EventFiles):
        if path.is_dir():
            return dataclasses.replace(data, folder=str(path))
        if not path.exists():
            raise RecordingError(f"{path}: no such file or folder")
        return dataclasses.replace(data, folder=str(path.parent), pattern=glob.escape(path.name))
    return dataclasses.replace(data, file=str(path))  # type: ignore[type-var]


def read_out_number(bundle: Classifier, response: Answers) -> int:
    """Return after which of its input lengths a classifier answers."""
    time_ms = response.time_ms
    return (
        len(time_ms) - 1 if bundle.read_out_ms is None else int(np.abs(time_ms - bundle.read_out_ms).argmin())
    )


def decided(bundle: Classifier, data: Dataset, response: Response | Answers) -> tuple[Ints, Floats, Bools]:
    """Return the label, the time of the answer in ms, and whether theta was reached, by the decision rule.

    A label of -1 is a combination of the heads' answers that no training recording had.
    """
    if isinstance(response, Answers):
        column = read_out_number(bundle, response)
        label = bundle.answered(response.label[:, column])
        return label, np.full(len(label), response.time_ms[column]), np.ones(len(label), bool)
    n, n_steps = response.output.shape[:2]
    parts = dict(zip((x.name for x in bundle.heads), head_slices(data), strict=False))  # without heads: one
    output = response.output[..., parts.get(bundle.head, slice(None))]
    if bundle.phi is not None and bundle.theta is not None:
        label, step, decided = decision.decide(output, bundle.phi, bundle.theta)
        return label, (step + 1) * response.step_ms, decided
    if bundle.read_out_ms is not None:
        n_steps = min(n_steps, max(1, round(bundle.read_out_ms / response.step_ms)))
    if parts and not bundle.head:
        counts = output[:, :n_steps].sum(axis=1, dtype=np.int64)
        label = joint_label(head_answers(data, counts), bundle.heads)
    else:
        label = read_out(output[:, :n_steps])
    return label, np.full(n, n_steps * response.step_ms), np.ones(n, bool)
