"""Time surfaces of events: the equations as they are read, and kernels that cost one surface per event.

The surface of event i holds, for every place (dx, dy) within reach and every plane p,

    S_i(dx, dy, p) = exp(-(t_i - T_i(x_i + dx, y_i + dy, p)) / tau)

where T_i(x, y, p) is the time of the last event there up to and including event i; 0 where there was none.
Events of one time come one after the other, in their order in the list: each sees those before it at age 0
and none after it. Surfaces are flattened in the order dy, dx, plane. The event goes to the prototype of least
Euclidean distance, of equally near ones to the lowest number, and is then an event of the next layer at its
own time and place, in the plane of that number.

Source: Lagorce et al. 2017.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from dse.base.native.compiled import compiled
from dse.base.records import Array

NEVER = np.iinfo(np.int64).min
"""Time of the last event where there was none."""

_UNDERFLOW = 746.0  # exp(-746) is 0 in float64


class Stream(NamedTuple):
    """Events of one recording, in order: t_us (n,) int64 that never falls; x, y, plane (n,) int32 >= 0."""

    t_us: Array
    x: Array
    y: Array
    plane: Array


class Field(NamedTuple):
    """What a layer's surfaces cover: frame of width x height places with n_planes planes each.

    radius: the surface is a square of side 2 radius + 1. Rows and columns of it that lie outside the frame
        for every event are left out: what is always 0 tells nothing.
    tau_us: time constant of the decay.
    """

    width: int
    height: int
    n_planes: int
    radius: int
    tau_us: float

    @property
    def reach(self) -> tuple[int, int]:
        """Places beyond the event's own that a surface has along x and y, on either side."""
        return min(self.radius, self.width - 1), min(self.radius, self.height - 1)

    @property
    def size(self) -> int:
        """Numbers of a surface."""
        reach_x, reach_y = self.reach
        return (2 * reach_x + 1) * (2 * reach_y + 1) * self.n_planes


def surface(events: Stream, i: int, field: Field) -> Array:
    """Return the surface of event i, (size,) float64: the definition, from all events up to it."""
    reach_x, reach_y = field.reach
    values = np.zeros((2 * reach_y + 1, 2 * reach_x + 1, field.n_planes))
    for j in range(i + 1):  # a later event of a place and plane takes the place of an earlier one
        dx, dy = int(events.x[j]) - int(events.x[i]), int(events.y[j]) - int(events.y[i])
        if abs(dx) <= reach_x and abs(dy) <= reach_y:
            age_us = int(events.t_us[i]) - int(events.t_us[j])
            values[dy + reach_y, dx + reach_x, events.plane[j]] = math.exp(-age_us / field.tau_us)
    return values.ravel()


def nearest(surfaces: Array, prototypes: Array) -> Array:
    """Return the number of the nearest prototype of every surface, (n,); the lowest of equally near ones.

    Args:
        surfaces: (n, size).
        prototypes: (prototype, size).
    """
    return np.array([((prototypes - s) ** 2).sum(axis=1).argmin() for s in surfaces], dtype=np.int32)


def learnt_online(surfaces: Array, prototypes: Array) -> Array:
    """Return prototypes after one pass of the online rule over surfaces: the definition.

    The nearest prototype C_k, which was nearest p_k - 1 times before, moves towards the surface S:

        alpha = 0.01 / (1 + p_k / 20000),  beta = C_k . S / (|C_k| |S|),  C_k <- C_k + alpha (S - beta C_k)

    Source: Lagorce et al. 2017, Algorithm 1.

    Args:
        surfaces: (n, size), in the order of their events.
        prototypes: (prototype, size) at the start.
    """
    learnt, chosen = np.array(prototypes, dtype=np.float64), np.ones(len(prototypes))
    for s in surfaces:
        k = nearest(s[None], learnt)[0]
        length = math.sqrt((learnt[k] ** 2).sum() * (s**2).sum())
        beta = (learnt[k] * s).sum() / length if length else 0.0
        learnt[k] += 0.01 / (1 + chosen[k] / 20000) * (s - beta * learnt[k])
        chosen[k] += 1
    return learnt


class Prepared(NamedTuple):
    """Prototypes as the kernels read them: columns (size, prototype), and half their squared lengths."""

    columns: Array
    half_squares: Array


def prepared(prototypes: Array) -> Prepared:
    """Return prototypes, (prototype, size), as the kernels read them."""
    columns = np.array(prototypes.T, dtype=np.float64, order="C")
    return Prepared(columns, np.asarray(0.5 * (columns**2).sum(axis=0)))


class Memory:
    """The last event of every place and plane, and workspace: what a layer keeps from event to event.

    What takes in events raises ValueError where a place or plane lies outside the field, or time falls.
    """

    def __init__(self, field: Field) -> None:
        self.field = field
        reach_x, reach_y = field.reach
        shape = field.height + 2 * reach_y, field.width + 2 * reach_x, field.n_planes
        self.last_us = np.full(shape, NEVER, dtype=np.int64)  # the margin is never written
        self.latest_us = np.full(shape[:2], NEVER, dtype=np.int64)  # of all planes
        self._index = np.empty(field.size, dtype=np.int64)
        self._value = np.empty(field.size)

    def forget(self) -> None:
        """Begin a recording: there was no event."""
        self.last_us.fill(NEVER)
        self.latest_us.fill(NEVER)

    def surfaces(self, events: Stream, chosen: Array) -> Array:
        """Take in events; return the surfaces of some, (chosen, size) float64.

        Args:
            events: that follow those taken in before.
            chosen: numbers of the events whose surfaces are returned, rising.
        """
        surfaces = np.zeros((len(chosen), self.field.size))
        _surfaces(*self._checked(events), np.asarray(chosen, dtype=np.int64), *self._state(), surfaces)
        return surfaces

    def assign(self, events: Stream, prototypes: Prepared) -> Array:
        """Take in events; return the number of each one's nearest prototype, (n,) int32.

        Args:
            events: that follow those taken in before.
            prototypes: of the layer.
        """
        label = np.empty(len(events.t_us), dtype=np.int32)
        _assign(*self._checked(events), *self._state(), *self._fitting(prototypes), label)
        return label

    def learn(self, events: Stream, prototypes: Prepared, chosen: Array) -> None:
        """Take in events; move prototypes by the online rule (`learnt_online`), in place.

        Args:
            events: that follow those taken in before.
            prototypes: of the layer.
            chosen: (prototype,) float64 p_k of each, 1 at the start.
        """
        _learn(*self._checked(events), *self._state(), *self._fitting(prototypes), chosen)

    def _fitting(self, prototypes: Prepared) -> tuple[Array, Array, Array]:
        """Return prototypes and workspace for their scores."""
        size, n = prototypes.columns.shape
        if size != self.field.size:
            raise ValueError(f"prototypes must have {self.field.size} numbers each, got {size}")
        return *prototypes, np.empty(n)

    def _checked(self, events: Stream) -> Stream:
        """Return events in the types that the kernels are compiled for; those do not look out for borders."""
        t_us = np.ascontiguousarray(events.t_us, dtype=np.int64)
        if (t_us[1:] < t_us[:-1]).any():
            raise ValueError("the times of events must never fall within a recording")
        limits = self.field.width, self.field.height, self.field.n_planes
        places = []
        for name, limit in zip(Stream._fields[1:], limits, strict=True):
            numbers = np.ascontiguousarray(getattr(events, name), dtype=np.int32)
            low, high = (int(numbers.min()), int(numbers.max())) if len(numbers) else (0, 0)
            if low < 0 or high >= limit:
                raise ValueError(f"{name} of events must be in [0, {limit - 1}], got {low} to {high}")
            places.append(numbers)
        return Stream(t_us, *places)

    def _state(self) -> tuple[Array, Array, int, int, float, Array, Array]:
        return self.last_us, self.latest_us, *self.field.reach, self.field.tau_us, self._index, self._value


def neighbours(events: Stream, radius: int, span_us: int) -> Array:
    """Return how many earlier events are near each event, (n,) int64.

    Near is: at a distance of at most `radius` (Euclidean; the place itself included), in any plane, and not
    more than `span_us` before. Each event costs the places within the radius.

    Args:
        events: a whole recording.
        radius: in places.
        span_us: of time, in microseconds.
    """
    count = np.zeros((_extent(events.y) + 2 * radius, _extent(events.x) + 2 * radius), dtype=np.int32)
    n_near = np.empty(len(events.t_us), dtype=np.int64)
    _neighbours(events.t_us, events.x, events.y, radius, span_us, count, n_near)
    return n_near


def _extent(places: Array) -> int:
    return int(places.max()) + 1 if len(places) else 0


@compiled(_nrt=False)
def _entries(t, x, y, last_us, latest_us, reach_x, reach_y, tau_us, index, value):  # type: ignore[no-untyped-def]
    """List the numbers of a surface that are not 0, in order; return how many."""
    n = 0
    place = 0
    oldest = t - _UNDERFLOW * tau_us
    n_planes = last_us.shape[2]
    for row in range(y, y + 2 * reach_y + 1):
        for column in range(x, x + 2 * reach_x + 1):
            if latest_us[row, column] < oldest:  # most places and, of deep layers, most planes
                place += n_planes
                continue
            for p in range(n_planes):
                seen = last_us[row, column, p]
                if seen != NEVER and seen >= oldest:
                    s = math.exp(-(t - seen) / tau_us)
                    if s > 0.0:
                        index[n] = place
                        value[n] = s
                        n += 1
                place += 1
    return n


@compiled(_nrt=False)
def _surfaces(  # type: ignore[no-untyped-def]
    t_us, x, y, plane, chosen, last_us, latest_us, reach_x, reach_y, tau_us, index, value, surfaces
):
    row = 0
    for i in range(len(t_us)):
        last_us[y[i] + reach_y, x[i] + reach_x, plane[i]] = t_us[i]
        latest_us[y[i] + reach_y, x[i] + reach_x] = t_us[i]
        if row < len(chosen) and chosen[row] == i:
            n = _entries(t_us[i], x[i], y[i], last_us, latest_us, reach_x, reach_y, tau_us, index, value)
            for e in range(n):
                surfaces[row, index[e]] = value[e]
            row += 1


@compiled(_nrt=False)
def _closest(n, index, value, columns, half_squares, score):  # type: ignore[no-untyped-def]
    """Return the nearest prototype: |S - C|^2 is least where |C|^2 / 2 - S . C is; zeros of S add nothing."""
    f = columns.shape[1]
    for k in range(f):
        score[k] = half_squares[k]
    for e in range(n):
        s, place = value[e], index[e]
        for k in range(f):
            score[k] -= s * columns[place, k]
    best = 0
    for k in range(1, f):
        if score[k] < score[best]:
            best = k
    return best


@compiled(_nrt=False)
def _assign(  # type: ignore[no-untyped-def]
    t_us, x, y, plane, last_us, latest_us, reach_x, reach_y, tau_us, index, value, columns, half_squares,
    score, label,
):  # fmt: skip
    for i in range(len(t_us)):
        last_us[y[i] + reach_y, x[i] + reach_x, plane[i]] = t_us[i]
        latest_us[y[i] + reach_y, x[i] + reach_x] = t_us[i]
        n = _entries(t_us[i], x[i], y[i], last_us, latest_us, reach_x, reach_y, tau_us, index, value)
        label[i] = _closest(n, index, value, columns, half_squares, score)


@compiled(_nrt=False)
def _learn(  # type: ignore[no-untyped-def]
    t_us, x, y, plane, last_us, latest_us, reach_x, reach_y, tau_us, index, value, columns, half_squares,
    score, chosen,
):  # fmt: skip
    for i in range(len(t_us)):
        last_us[y[i] + reach_y, x[i] + reach_x, plane[i]] = t_us[i]
        latest_us[y[i] + reach_y, x[i] + reach_x] = t_us[i]
        n = _entries(t_us[i], x[i], y[i], last_us, latest_us, reach_x, reach_y, tau_us, index, value)
        k = _closest(n, index, value, columns, half_squares, score)
        dot = 0.0
        square = 0.0
        for e in range(n):
            dot += value[e] * columns[index[e], k]
            square += value[e] * value[e]
        length = math.sqrt(2.0 * half_squares[k] * square)
        beta = dot / length if length > 0.0 else 0.0
        alpha = 0.01 / (1.0 + chosen[k] / 20000.0)
        chosen[k] += 1.0
        for j in range(columns.shape[0]):
            columns[j, k] -= alpha * beta * columns[j, k]
        for e in range(n):
            columns[index[e], k] += alpha * value[e]
        square = 0.0
        for j in range(columns.shape[0]):
            square += columns[j, k] * columns[j, k]
        half_squares[k] = 0.5 * square


@compiled(_nrt=False)
def _neighbours(t_us, x, y, radius, span_us, count, n_near):  # type: ignore[no-untyped-def]
    oldest = 0
    for i in range(len(t_us)):
        while t_us[i] - t_us[oldest] > span_us:
            count[y[oldest] + radius, x[oldest] + radius] -= 1
            oldest += 1
        near = 0
        for dy in range(-radius, radius + 1):
            for dx in range(-radius, radius + 1):
                if dx * dx + dy * dy <= radius * radius:
                    near += count[y[i] + radius + dy, x[i] + radius + dx]
        n_near[i] = near
        count[y[i] + radius, x[i] + radius] += 1
