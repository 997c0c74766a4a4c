"""Small recordings with a shortcut of one kind, and clean ones, as what the probes of an audit read."""

import dataclasses

import numpy as np

from dse.base.records import Dataset, Spikes
from dse.study.audit import Material

N_CLASSES, N_CHANNELS, N_STEPS, ROOM = 3, 12, 64, 8
REPEATS = 1  # of each condition in training, and in validation
FORCES, SPEEDS = 4, 5


def spikes_of(raster):
    """Return spikes of (sample, step, channel) bools."""
    n, n_steps, n_channels = raster.shape
    offsets = np.append(0, raster.reshape(n * n_steps, n_channels).sum(axis=1).cumsum())
    channel = np.nonzero(raster)[2].astype(np.int32)
    return Spikes(offsets.astype(np.int64), channel, n_steps, n_channels, 5.0)


def labels():
    """Return every combination of class, force and speed, `REPEATS` times in each part."""
    grid = np.indices((2, N_CLASSES, FORCES, SPEEDS, REPEATS)).reshape(5, -1)
    return dict(zip(("part", "label", "force", "speed", "trial"), grid, strict=True))


def material_of(rate, rng, **changes):
    """Return samples that spike at a rate per step, (sample, step, channel) or what broadcasts to it."""
    columns = labels()
    label, part = columns["label"], columns["part"]
    n = len(label)
    shape = n, N_STEPS + 2 * ROOM, N_CHANNELS
    spikes = spikes_of(rng.random(shape) < np.broadcast_to(rate, shape))
    start = np.full(n, ROOM, np.int32)
    data = Dataset(
        spikes=spikes,
        target=label.astype(np.int64),
        classes=tuple("abc"),
        start=start,
        start_low=0 * start,
        start_high=2 * start,
        n_steps=N_STEPS,
        train=np.flatnonzero(part == 0),
        validation=np.flatnonzero(part == 1),
        test=np.zeros(0, np.int64),
        positions=np.zeros((N_CHANNELS, 3), np.int32),
    )
    material = Material(
        task="material",
        dataset=data,
        train=data.train,
        validation=data.validation,
        columns={"label": label, "part": part, "force": columns["force"], "speed": columns["speed"]},
        lengths=np.full(n, N_STEPS + 2 * ROOM),
        target_columns=("label",),
        split_columns=("part",),
    )
    return dataclasses.replace(material, **changes)


def with_columns(material, columns):
    """Return a material with further label columns."""
    return dataclasses.replace(material, columns={**material.columns, **columns})


def patterns(rng, n):
    """Return n spatial patterns of one total rate, (n, 1, channel)."""
    rate = rng.choice([0.05, 0.5], (n, 1, N_CHANNELS))
    return rate * (0.25 * N_CHANNELS / rate.sum(axis=2, keepdims=True))


def clean(seed):
    """Return classes that differ in which channels spike, at any time, in any condition."""
    rng = np.random.default_rng(seed)
    return material_of(patterns(rng, N_CLASSES)[labels()["label"]], rng)


def synchronous(seed):
    """Return classes that differ in which two channels spike together, alike in all counts."""
    rng = np.random.default_rng(seed)
    six = np.array([[0, 0, 1, 1, 2, 2], [0, 1, 0, 2, 1, 2], [0, 1, 2, 2, 1, 0]])
    partners = np.concatenate([six, six + 3], axis=1)[labels()["label"]]
    pairs = rng.random((len(partners), N_STEPS + 2 * ROOM, N_CHANNELS // 2)) < 0.2
    return material_of(np.take_along_axis(pairs, partners[:, None, :], axis=2), rng)


def by_total(seed):
    """Return classes that differ in the number of spikes."""
    rng = np.random.default_rng(seed)
    return material_of(np.array([0.1, 0.2, 0.3])[labels()["label"]][:, None, None], rng)


def by_end(seed):
    """Return classes that end at different times."""
    rng = np.random.default_rng(seed)
    end = np.array([40, 52, 64])[labels()["label"]][:, None, None] + ROOM
    return material_of(0.3 * (np.arange(N_STEPS + 2 * ROOM)[None, :, None] < end), rng)


def by_contact(seed):
    """Return classes that begin at different times."""
    rng = np.random.default_rng(seed)
    begin = np.array([4, 16, 28])[labels()["label"]][:, None, None] + ROOM
    return material_of(0.4 * (np.arange(N_STEPS + 2 * ROOM)[None, :, None] >= begin), rng)


def by_position(seed):
    """Return classes whose spikes come at certain places along the recording."""
    rng = np.random.default_rng(seed)
    n_blocks = (N_STEPS + 2 * ROOM) // 4
    blocks = rng.permuted(np.tile([0.02, 0.4], (N_CLASSES, N_CHANNELS, n_blocks // 2)), axis=2)
    rate = np.repeat(blocks, 4, axis=2).transpose(0, 2, 1)
    return material_of(rate[labels()["label"]], rng)


def by_condition(seed):
    """Return samples that look like those of the same class, force and speed, and like no others."""
    rng = np.random.default_rng(seed)
    columns = labels()
    number = (columns["label"] * FORCES + columns["force"]) * SPEEDS + columns["speed"]
    return material_of(patterns(rng, N_CLASSES * FORCES * SPEEDS)[number], rng)


def by_group(seed):
    """Return samples that look like those of the same class and force, at any speed."""
    rng = np.random.default_rng(seed)
    columns = labels()
    return material_of(patterns(rng, N_CLASSES * FORCES)[columns["label"] * FORCES + columns["force"]], rng)


def by_session(seed):
    """Return samples that look like those of the same session; each session has one class."""
    rng = np.random.default_rng(seed)
    columns = labels()
    session = columns["label"] * FORCES + columns["force"]
    material = material_of(patterns(rng, N_CLASSES * FORCES)[session], rng)
    return dataclasses.replace(
        material, columns={"label": columns["label"], "part": columns["part"], "session": session}
    )


def by_order(seed):
    """Return classes recorded one after the other while all rates drift."""
    rng = np.random.default_rng(seed)
    columns = labels()
    order = np.zeros(len(columns["label"]))
    order[np.lexsort((rng.random(len(order)), columns["label"]))] = np.arange(len(order))
    share = (order / len(order))[:, None, None]
    tilt = np.linspace(-1, 1, N_CHANNELS)
    material = material_of(0.3 * (1 + (2 * share - 1) * tilt), rng)
    return dataclasses.replace(
        material, columns={"label": columns["label"], "part": columns["part"], "trial": order}
    )


def by_rate_of_regions(seed):
    """Return classes that differ in how many spikes quarters of a frame of 24 x 24 have over time.

    The gain of a sample varies by a factor of 10, and a channel hardly ever spikes twice.
    """
    rng = np.random.default_rng(seed)
    label, side = labels()["label"], 24
    y, x = np.divmod(np.arange(side**2), side)
    quarter = 2 * (y >= side // 2) + (x >= side // 2)
    course = rng.permuted(np.tile([1.0, 4.0], (N_CLASSES, 4, 2)), axis=2)  # of four parts of the window
    part = np.minimum(4 * np.arange(N_STEPS + 2 * ROOM) // (N_STEPS + 2 * ROOM), 3)
    rate = course[:, :, part].transpose(0, 2, 1)[label][:, :, quarter]
    gain = 10 ** rng.uniform(-1, 0, len(label))
    spikes = spikes_of(rng.random(rate.shape) < 0.004 * gain[:, None, None] * rate)
    material = clean(seed)
    positions = np.stack([x, y, 0 * x], axis=1).astype(np.int32)
    data = dataclasses.replace(material.dataset, spikes=spikes, positions=positions)
    return dataclasses.replace(material, dataset=data)
