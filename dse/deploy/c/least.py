"""What C takes of a spiking network, known before it is trained.

A weight takes a byte, and so does a delay; a trained network takes less only if most of its weights round to
0, or all of them to few bits. States have 32 bits; only trained weights tell whether they need 64. Answers
come at a fixed time, and names of classes are not counted.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from fractions import Fraction
from typing import Any

import numpy as np

from dse.config.resolved import Sections
from dse.config.settings import Preprocessing, pair
from dse.dataset.shape import Shape
from dse.deploy.bounds import Bounds
from dse.deploy.c.code_size import flash_bytes, footprint
from dse.deploy.c.plan import Plan, planned
from dse.deploy.classifier import Input
from dse.deploy.form import Rule, Unsupported, frame_with, spiking_with
from dse.encoders.receptors import Receptors
from dse.encoders.send_on_delta import Deltas
from dse.models.snn.family import SNN
from dse.models.snn.initialise import populations_of
from dse.models.snn.settings import Stack
from dse.neurons import name_of_population, parameters_of
from dse.neurons.fixed_point import WEIGHT_SCALE
from dse.records import Floats, Ints, Layer, Network
from dse.registry import Column

RAM = Column(
    "ram_bytes",
    *("bytes", "min", "Memory of the exported classifier on a target; more only if its states need 64 bits."),
    known="bound",
)
FLASH = Column(
    "flash_bytes",
    *("bytes", "min", "Code and constants on a target, with a byte per weight; of pruned networks unknown."),
    known="exact",
)


def least_memory(
    sections: Sections, shape: Shape, bytes_of_part: Mapping[str, float] | None = None
) -> dict[str, tuple[float, float]]:
    """Return column -> its least and largest number; NaN if C cannot hold the design.

    Args:
        sections: of a design. Of a family that is no single spiking network, nothing is known.
        shape: of its data set.
        bytes_of_part: of code (`dse.deploy.c.code_size`); None: flash is not known.
    """
    columns = (RAM,) if bytes_of_part is None else (RAM, FLASH)
    try:
        plan = least_plan(sections, shape)
    except Unsupported:
        return {column.name: (math.nan, math.nan) for column in columns}
    if plan is None:
        return {}
    memory = {RAM.name: (footprint(plan)[RAM.name], math.inf)}
    if bytes_of_part is not None and not sections.model.pruned:  # type: ignore[attr-defined]
        memory[FLASH.name] = (flash_bytes(plan, bytes_of_part),) * 2
    return memory


def least_plan(sections: Sections, shape: Shape) -> Plan | None:
    """Return the plan of a design before training; None of a family that is no single spiking network."""
    model: Any = sections.model
    if not isinstance(model, SNN):
        return None
    network = _network(model.placed(shape.positions), shape)
    n_steps = shape.n_steps or 1
    uncropped = sections.preprocessing and dataclasses.replace(sections.preprocessing, crop=None)
    sections = dataclasses.replace(sections, preprocessing=uncropped)
    taken = _input(sections, shape, n_steps)
    frame = frame_with(sections, taken, network.n_channels, ("",) * shape.n_outputs)
    rule = Rule(0, shape.n_outputs, None, Fraction(0), n_steps * network.steps_per_sample - 1)
    plan = planned(spiking_with(frame, network, rule))
    layers = tuple(dataclasses.replace(layer, bounds=Bounds(0, 0)) for layer in plan.layers)
    return dataclasses.replace(plan, layers=layers)


def _network(model: Stack, shape: Shape) -> Network:
    """Return a network of a design's size whose weights are stored as bytes."""
    populations = populations_of(model, shape.n_outputs, shape.step_ms, np.random.default_rng(0))
    n_inputs = len(shape.positions) * len(model.input_delays)
    layers = []
    for depth, (n, shared) in enumerate(
        zip((*model.hidden, shape.n_outputs), model.sharing(shape.n_outputs), strict=True)
    ):
        weight = _bytes(n, n_inputs, shared)
        is_recurrent = model.recurrent and depth < len(model.hidden)
        layers.append(
            Layer(
                weight=weight,
                recurrent=_bytes(n, n) if is_recurrent else None,
                parameters=parameters_of(populations[depth]),
                neuron=name_of_population(populations[depth], model.neuron),
                delay=np.zeros(weight.shape, np.int8) if model.has_delays(depth) else None,
            )
        )
        n_inputs = n
    delays = tuple(delay * model.steps_per_sample for delay in model.input_delays)
    return Network(tuple(layers), len(shape.positions), delays, model.steps_per_sample, model.arithmetic)


def _bytes(n: int, n_inputs: int, shared: Ints | None = None) -> Floats:
    """Return (neuron, input) weights of 8 bits; shared: (input, neuron), -1 where there is no weight."""
    weight = np.full((n, n_inputs), 2 / WEIGHT_SCALE, np.float32)
    if shared is not None:
        weight[shared.T < 0] = 0
    weight[tuple(index[:1] for index in np.nonzero(weight))] = 127 * 2 / WEIGHT_SCALE
    return weight


def _input(sections: Sections, shape: Shape, n_steps: int) -> Input:
    """Return recordings that become spikes of a shape."""
    encoder, preprocessing = sections.encoder, sections.preprocessing
    if preprocessing is not None:
        return Input("events", 0, *_frame(preprocessing, shape.positions), n_steps, shape.step_ms)
    known = encoder if isinstance(encoder, Deltas | Receptors) else None
    return Input.of_channels(known, len(shape.positions), n_steps, shape.step_ms)


def _frame(settings: Preprocessing, positions: Ints) -> tuple[int, int]:
    """Return width and height of the least frame with pools at (n_channels, 3) column, row and polarity."""
    kernel, padding = pair(settings.pool), pair(settings.padding)
    stride = kernel if settings.stride is None else pair(settings.stride)
    n_pools = positions.max(axis=0, initial=0).tolist()
    width, height = (
        max(1, n * step + size - 2 * edge)
        for n, step, size, edge in zip(n_pools, stride, kernel, padding, strict=False)
    )
    return width, height
