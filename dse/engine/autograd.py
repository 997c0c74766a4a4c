"""The torch engine: networks trained by automatic differentiation through the definition of their neurons.

It trains what has no kernel, on any device, and is the independent witness of the kernels: it shares the
equations with them and nothing of their code. Spikes stay sparse: the first layer gathers weight rows.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from types import ModuleType
from typing import Any, TypeVar

import array_api_compat.torch
import numpy as np
import torch
from torch import Tensor

from dse.base.records import Arithmetic, Array, Floats, Ints
from dse.engine.adam import adam
from dse.engine.batch import DIFFERENTIATED_ROWS
from dse.engine.events import Rows, pooled
from dse.engine.goal import SPIKE_RATE, Goal, n_correct
from dse.engine.layers import Weights, check_inputs
from dse.engine.losses import Loss
from dse.engine.member import (
    Masters,
    Member,
    Report,
    State,
    Turn,
    as_part,
    of_part,
)
from dse.engine.neurons import Population
from dse.engine.neurons.fixed_point import HIGHEST_WEIGHT, LOWEST_WEIGHT, WEIGHT_SCALE
from dse.engine.neurons.surrogate import OFFSET, Exponential
from dse.engine.parameters import lengths, normed, whitened
from dse.engine.shared import copies_of

_CPU = torch.device("cpu")
P = TypeVar("P", bound=Population[Any])


class Fire(torch.autograd.Function):
    """Step function forward, surrogate backward."""

    @staticmethod
    def forward(ctx: Any, distance: Tensor, surrogate: Exponential) -> Tensor:
        """Return 1 where the distance from the threshold is positive, else 0."""
        ctx.save_for_backward(distance)
        ctx.surrogate = surrogate
        return (distance > 0).to(distance.dtype)

    @staticmethod
    def backward(ctx: Any, *grad: Tensor) -> Any:
        """Return the gradient times the surrogate of ds/dv."""
        (distance,) = ctx.saved_tensors
        width, height = (
            torch.as_tensor(x, dtype=distance.dtype, device=distance.device)
            for x in (ctx.surrogate.width, ctx.surrogate.height)
        )
        share = ((distance - OFFSET).abs() / -width).exp()
        return grad[0] * height * torch.where(share > ctx.surrogate.cut, share, 0.0), None


@dataclass(frozen=True)
class TorchCalculus:
    """torch with automatic differentiation (dse.engine.neurons.calculus.Calculus).

    Integer states are whole numbers in float64, exact up to 2**53; truncation is straight-through.
    """

    arithmetic: Arithmetic
    surrogate: Exponential
    device: torch.device = _CPU

    @property
    def xp(self) -> ModuleType:
        namespace: ModuleType = array_api_compat.torch
        return namespace

    @property
    def dtype(self) -> torch.dtype:
        """Type of the states."""
        return torch.float32 if self.arithmetic == "float32" else torch.float64

    def zeros(self, shape: tuple[int, ...]) -> Any:
        """Return zeros of the states' type."""
        return torch.zeros(shape, dtype=self.dtype, device=self.device)

    def fire(self, potential: Any, threshold: Any) -> Any:
        """Return 1 where the potential lies strictly above the threshold, else 0."""
        return Fire.apply(potential - threshold, self.surrogate)  # type: ignore[no-untyped-call]

    def constant(self, x: Any) -> Any:
        """Return the same numbers without their history."""
        return x.detach()

    def truncated(self, x: Any, unit: Any = 1) -> Any:
        """Return x / unit, truncated toward zero; the gradient passes straight through."""
        quotient = x / unit
        return quotient + (torch.trunc(quotient) - quotient).detach()


def on_torch(population: P, calculus: TorchCalculus) -> P:
    """Return a population whose arrays are tensors."""

    def tensor(x: Array) -> Tensor:
        kind = calculus.dtype if x.dtype.kind == "f" else None
        return torch.as_tensor(x, dtype=kind, device=calculus.device)

    changes = {
        field.name: tensor(np.asarray(value))
        for field in dataclasses.fields(population)  # type: ignore[arg-type]
        if isinstance(value := getattr(population, field.name), np.ndarray | np.generic)
    }
    return dataclasses.replace(population, **changes)  # type: ignore[type-var]


def layer_spikes(
    drive: Tensor, population: Population[Any], calculus: TorchCalculus, ring: Tensor | None = None
) -> Tensor:
    """Return a layer's spikes before they are handed on one step later, (step, sample, neuron).

    Args:
        drive: weighted input spikes, (step, sample, neuron).
        population: the layer's neurons, of tensors (`on_torch`).
        calculus: how to calculate.
        ring: recurrent weights (neuron, neuron), row = presynaptic.
    """
    state = population.initial_state(tuple(drive.shape[1:]), calculus)
    spikes: Any = torch.zeros_like(drive[0])
    of_steps = []
    for z in drive.unbind(0):
        step_drive: Any = z if ring is None else z + spikes @ ring
        state, _, spikes = population.step(state, step_drive, calculus)
        of_steps.append(spikes)
    return torch.stack(of_steps)


def later(spikes: Tensor) -> Tensor:
    """Return spikes (step, ...) one step later; the last step's are lost."""
    return torch.cat([torch.zeros_like(spikes[:1]), spikes[:-1]])


def loss_of(output: Tensor, labels: Ints, goal: Goal, soft: Floats | None = None) -> Tensor:
    """Return the loss of output spikes (step, sample, class), summed over the batch."""
    outputs = goal.outputs(labels, output.shape[0], output.shape[2], soft)
    labelled: Any = torch.as_tensor(outputs.is_label, dtype=output.dtype, device=output.device)
    counts: Any = torch.stack([output[:length].sum(0) for length in outputs.lengths], dim=1)
    value: Any = goal.loss.value(counts, dataclasses.replace(outputs, is_label=labelled))
    return torch.as_tensor(value)


def first_drive(rows: Rows, samples: slice, weight: Tensor) -> Tensor:
    """Return the weighted input spikes of some samples, (step, sample, neuron), from rows of the weights."""
    low, high = samples.start * rows.n_steps, samples.stop * rows.n_steps
    offsets = rows.offsets[low : high + 1]
    part = slice(offsets[0], offsets[-1])
    index = torch.as_tensor(rows.index[part], device=weight.device).long()
    starts = torch.as_tensor(offsets - offsets[0], device=weight.device).long()
    times = torch.as_tensor(rows.times[part], device=weight.device).to(weight) if rows.times.size else None
    summed = torch.nn.functional.embedding_bag(
        index, weight, starts, mode="sum", include_last_offset=True, per_sample_weights=times
    )
    return summed.reshape(samples.stop - samples.start, rows.n_steps, -1).transpose(0, 1)


@dataclass(frozen=True)
class Pass:
    """Loss of some samples, their output spike counts (sample, class), and spikes fired per layer."""

    loss: Tensor
    counts: Array
    fired: tuple[float, ...]


def run(
    rows: Rows,
    samples: slice,
    labels: Ints,
    matrices: Sequence[tuple[Tensor, Tensor | None]],
    populations: Sequence[Population[Any]],
    calculi: Sequence[TorchCalculus],
    gains: Sequence[Floats | None],
    goal: Goal,
    shift: bool = True,
    soft: Floats | None = None,
) -> Pass:
    """Run some samples through a stack.

    Args:
        rows: input spikes of the batch.
        samples: of the batch.
        labels: output neurons of all labels of the batch, (sample,) or (sample, head).
        matrices: weights as they run and recurrent weights of each layer, rows presynaptic.
        populations: of each layer, of tensors.
        calculi: of each layer.
        gains: per layer, (sample of the batch, input) factors of its input spikes, or None.
        goal: what training minimises.
        shift: whether layers hand their spikes on one step later.
        soft: of the batch, (sample, class) probabilities in place of the labels; None: the labels.
    """
    y, fired, of_layers = None, [], []
    parts = zip(matrices, populations, calculi, gains, strict=True)
    for (weight, ring), population, calculus, gain in parts:
        if y is None:
            drive = first_drive(rows, samples, weight)
            if gain is not None:
                drive = drive * torch.as_tensor(gain[samples], dtype=drive.dtype, device=drive.device)
        else:
            if gain is not None:
                y = y * torch.as_tensor(gain[samples], dtype=y.dtype, device=y.device)
            drive = y @ weight
        spikes = layer_spikes(drive, population, calculus, ring)
        fired.append(float(spikes.detach().sum()))
        of_layers.append(spikes)
        y = later(spikes) if shift else spikes
    assert y is not None
    counts = np.rint(y.detach().sum(0).cpu().numpy()).astype(np.int64)
    loss = loss_of(y, labels[samples], goal, None if soft is None else soft[samples])
    if goal.hidden_spike_penalty:
        hidden = of_layers[: len(matrices) - 1]
        loss = loss + goal.hidden_spike_penalty * torch.stack([s.sum() for s in hidden]).sum()
    return Pass(loss, counts, tuple(fired))


def gradients(
    rows: Rows,
    layers: Sequence[Weights],
    surrogates: Sequence[Exponential],
    labels: Ints,
    *,
    true_rate: float,
    false_rate: float,
    arithmetic: Arithmetic = "integer",
    gains: Sequence[Floats | None],
    shift: bool = True,
    heads: tuple[int, ...] = (),
    loss: Loss = SPIKE_RATE,
    hidden_spike_penalty: float = 0.0,
    soft: Floats | None = None,
) -> tuple[float, list[Floats], list[Floats]]:
    """Return the loss of a batch, dL/dW of each layer and dL/dR of each recurrent one, by autograd.

    Arguments are those of `dse.engine.network.gradients`, whose witness this is. It calculates in float64
    unless the arithmetic is float32.
    """
    calculi = [TorchCalculus(arithmetic, surrogate) for surrogate in surrogates]

    def parameter(x: Floats, calculus: TorchCalculus) -> Tensor:
        return torch.as_tensor(x, dtype=calculus.dtype).requires_grad_()

    matrices = [
        (parameter(w.feed_forward, c), parameter(w.recurrent, c) if w.recurrent.size else None)
        for w, c in zip(layers, calculi, strict=True)
    ]
    populations = [on_torch(w.population, c) for w, c in zip(layers, calculi, strict=True)]
    samples = slice(0, rows.n_samples)
    goal = Goal(loss, true_rate, false_rate, heads, hidden_spike_penalty)
    done = run(rows, samples, labels, matrices, populations, calculi, gains, goal, shift, soft)
    done.loss.backward()  # type: ignore[no-untyped-call]

    def gradient(x: Tensor) -> Floats:
        return np.zeros(x.shape) if x.grad is None else x.grad.numpy()

    rings = [ring for _, ring in matrices if ring is not None]
    return float(done.loss.detach()), [gradient(w) for w, _ in matrices], [gradient(r) for r in rings]


def quantised(weight: Tensor, weight_bits: int = 8, exponent: int = 0) -> Tensor:
    """Return weights rounded to some bits; the gradient passes straight through inside the clip.

    They become whole multiples of 2**exponent / 32, as in dse.models.snn.quantise.
    """
    grid, end = 2 / WEIGHT_SCALE * 2.0**exponent, 2 ** (weight_bits - 1)
    rounded = torch.round(weight.detach() / grid) * grid
    low, high = -end * grid, (end - 1) * grid
    passes = ((rounded >= low) & (rounded <= high)).to(weight.dtype)
    return torch.as_tensor(rounded.clip(low, high) + (weight - weight.detach()) * passes)


@dataclass
class _Matrix:
    """A matrix as trained: its parameters, Adam's moments, and what a rate of 1 moves each parameter by.

    form: the weights from the parameters (dse.engine.parameters); None: they are the first parameters.
    are_weights: whether parameters are clipped as weights are.
    kept: which of the first parameters are left; None: all.
    """

    parameters: list[Tensor]
    units: list[Tensor]
    first: list[Tensor]
    second: list[Tensor]
    form: Callable[..., Tensor] | None = None
    are_weights: bool = True
    kept: Tensor | None = None

    @classmethod
    def of(
        cls,
        device: torch.device,
        weights: Floats,
        unit: Floats,
        shared: Ints | None = None,
        norm_unit: Floats | None = None,
        basis: Floats | None = None,
    ) -> _Matrix:
        """Return a matrix at its start; arguments as in TrainedLayer."""

        def tensor(x: Array | float) -> Tensor:
            return torch.tensor(x, dtype=torch.float32, device=device)

        start, units = [tensor(weights)], [tensor(unit)]
        form: Callable[..., Tensor] | None = None
        if shared is not None:
            once, number = copies_of(shared).first, torch.as_tensor(shared, device=device).long()
            start = [start[0].flatten()[once]]
            units = [units[0].expand(weights.shape).flatten()[once]]
            form = partial(_tied, number=number)
        elif basis is not None:
            form = partial(whitened, start=start[0], basis=tensor(basis))
            start = [torch.zeros((basis.shape[1], weights.shape[1]), device=device)]
        elif norm_unit is not None:
            start.append(lengths(start[0].double()).float())
            units.append(tensor(norm_unit))
            form = normed
        first, second = ([torch.zeros_like(x) for x in start] for _ in range(2))
        return cls(start, units, first, second, form, basis is None and norm_unit is None)

    @property
    def weights(self) -> Tensor:
        """The weights before rounding, (input, neuron)."""
        return self.parameters[0] if self.form is None else self.form(*self.parameters)

    def masters(self, arithmetic: Arithmetic) -> Floats:
        """Return a copy of them, within the range of 8 bits in integer arithmetic."""
        weights = self.weights.detach()
        if not self.are_weights and arithmetic == "integer":
            weights = weights.clamp(LOWEST_WEIGHT, HIGHEST_WEIGHT)
        return weights.cpu().numpy().copy()

    def prune(self, kept: Array) -> None:
        mask = torch.as_tensor(kept, device=self.parameters[0].device)
        self.kept = mask if self.kept is None else self.kept & mask
        if self.form is normed:
            directions, norms = self.parameters
            self.parameters[1] = norms * lengths(directions * mask) / lengths(directions)
        for values in (self.parameters, self.first, self.second):
            values[0] = values[0] * self.kept

    def state(self) -> dict[str, Array]:
        tensors: dict[str, Tensor | None] = {"kept": self.kept}
        for name, values in (("weights", self.parameters), ("first", self.first), ("second", self.second)):
            tensors |= {f"{k}/{name}" if k else name: x for k, x in enumerate(values)}
        return {name: x.detach().cpu().numpy().copy() for name, x in tensors.items() if x is not None}

    def restore(self, state: State) -> None:
        def tensor(name: str) -> Tensor:
            return torch.tensor(state[name], device=self.parameters[0].device)

        for name, values in (("weights", self.parameters), ("first", self.first), ("second", self.second)):
            values[:] = [tensor(f"{k}/{name}" if k else name) for k in range(len(values))]
        self.kept = tensor("kept") if "kept" in state else None

    def update(self, gradients: Sequence[Tensor], rate: float, step: int, arithmetic: Arithmetic) -> None:
        for k, gradient in enumerate(gradients):
            self.parameters[k], self.first[k], self.second[k] = adam(
                self.parameters[k], gradient, self.first[k], self.second[k], step, rate * self.units[k]
            )
        if arithmetic == "integer" and self.are_weights:
            self.parameters = [x.clamp(LOWEST_WEIGHT, HIGHEST_WEIGHT) for x in self.parameters]


def _tied(weights: Tensor, number: Tensor) -> Tensor:
    """Return every weight (n,) at all its synapses; -1 is none."""
    return torch.cat([weights, torch.zeros_like(weights[:1])])[number]


class _Network:
    """A member in training."""

    def __init__(self, member: Member, device: torch.device) -> None:
        self._goal = member.goal
        self._clip_norm, self._arithmetic = member.clip_norm, member.arithmetic
        self._calculi = [TorchCalculus(member.arithmetic, x.surrogate, device) for x in member.layers]
        self._populations = [
            on_torch(x.population, calculus) for x, calculus in zip(member.layers, self._calculi, strict=True)
        ]
        self._sizes = [x.feed_forward.shape[1] for x in member.layers]
        self._real = [depth for depth, x in enumerate(member.layers) if not x.is_rounded]
        self._device = device
        self._matrices = [
            _Matrix.of(device, x.feed_forward, x.unit, x.shared, x.norm_unit, x.basis) for x in member.layers
        ]
        self._rings = [
            None
            if x.recurrent is None
            else _Matrix.of(device, x.recurrent, x.unit if x.recurrent_unit is None else x.recurrent_unit)
            for x in member.layers
        ]
        self._steps = 0

    def _as_run(self, matrix: _Matrix) -> Tensor:
        is_rounded = self._weights_in(matrix) == "integer"
        running = quantised(matrix.weights) if is_rounded else matrix.weights
        return running.to(self._calculi[0].dtype)

    def _weights_in(self, matrix: _Matrix) -> Arithmetic:
        """Return the arithmetic of a matrix, which need not be rounded where states are integers."""
        real = {id(self._matrices[d]) for d in self._real}
        is_real = self._arithmetic == "integer" and id(matrix) in real
        return "float32" if is_real else self._arithmetic

    def step(self, rows: Rows, labels: Ints, turn: Turn) -> Report:
        """Train on a batch."""
        self._steps += 1
        trained = [*self._matrices, *(ring for ring in self._rings if ring is not None)]
        for matrix in trained:
            matrix.parameters = [x.detach().requires_grad_() for x in matrix.parameters]
        moved = [x for matrix in trained for x in matrix.parameters]
        totals = [torch.zeros_like(x) for x in moved]
        loss, counts, fired = 0.0, [], np.zeros(len(self._sizes))
        size = max(1, DIFFERENTIATED_ROWS // max(1, rows.n_steps))
        for first in range(0, rows.n_samples, size):
            samples = slice(first, min(first + size, rows.n_samples))
            matrices = [
                (self._as_run(m), None if r is None else self._as_run(r))
                for m, r in zip(self._matrices, self._rings, strict=True)
            ]
            done = run(
                rows,
                samples,
                labels,
                matrices,
                self._populations,
                self._calculi,
                turn.gains,
                self._goal,
                soft=turn.soft,
            )
            loss += float(done.loss.detach())
            counts.append(done.counts)
            fired += done.fired
            parts = torch.autograd.grad(done.loss, moved, allow_unused=True)
            for total, part in zip(totals, parts, strict=True):
                if part is not None:
                    total += part
        left = iter(totals)
        by_matrix = [[next(left) for _ in matrix.parameters] for matrix in trained]
        for matrix, gradients in zip(trained, by_matrix, strict=True):
            matrix.parameters = [x.detach() for x in matrix.parameters]
            if matrix.kept is not None:
                gradients[0] *= matrix.kept
        norm = math.sqrt(sum(float((x.double() ** 2).sum()) for x in totals))
        clip = 1.0
        if self._clip_norm is not None and norm > 0:
            clip = min(1.0, self._clip_norm / norm)
        for matrix, gradients in zip(trained, by_matrix, strict=True):
            kind = self._weights_in(matrix)
            matrix.update([clip * x for x in gradients], turn.learning_rate, self._steps, kind)
        cells = max(1, rows.n_samples * rows.n_steps)
        return Report(
            loss,
            n_correct(np.concatenate(counts), labels, self._goal.heads),
            tuple(float(f) / (cells * n) for f, n in zip(fired, self._sizes, strict=False)),
            norm,
        )

    def prune(self, kept: Masters) -> None:
        """Set weights to 0 for good."""
        for matrix, mask in zip(self._matrices, kept.feed_forward, strict=True):
            matrix.prune(mask)
        for ring, mask_or_none in zip(self._rings, kept.recurrent, strict=True):
            if ring is not None and mask_or_none is not None:
                ring.prune(mask_or_none)

    def masters(self) -> Masters:
        """Return a copy of the master weights."""
        return Masters(
            tuple(m.masters(self._weights_in(m)) for m in self._matrices),
            tuple(None if r is None else r.masters(self._arithmetic) for r in self._rings),
        )

    def state(self) -> dict[str, Array]:
        """Return what training goes on from; see dse.engine.member.Engine."""
        arrays = {"steps": np.array(self._steps)}
        for depth, (matrix, ring) in enumerate(zip(self._matrices, self._rings, strict=True)):
            arrays |= as_part(f"{depth}/feed_forward", matrix.state())
            arrays |= {} if ring is None else as_part(f"{depth}/recurrent", ring.state())
        return arrays

    def restore(self, state: State) -> None:
        """Go on from a state; see dse.engine.member.Engine."""
        self._steps = int(state["steps"])
        for depth, (matrix, ring) in enumerate(zip(self._matrices, self._rings, strict=True)):
            matrix.restore(of_part(state, f"{depth}/feed_forward"))
            if ring is not None:
                ring.restore(of_part(state, f"{depth}/recurrent"))


class AutogradEngine:
    """Networks that are trained one after another on each batch they share; see dse.engine.member.Engine."""

    def __init__(self, members: Sequence[Member], device: torch.device) -> None:
        self._networks = [_Network(member, device) for member in members]
        self._n_inputs = [member.layers[0].feed_forward.shape[0] for member in members]
        self._pools = [member.pool for member in members]

    def step(self, rows: Rows, labels: Ints, turns: Mapping[int, Turn]) -> dict[int, Report]:
        """Train the members named in `turns` on a batch; the others do not move."""
        with _one_thread():
            reports = {}
            for number, turn in turns.items():
                of_pools = pooled(rows, self._pools[number])
                check_inputs(of_pools, self._n_inputs[number])
                reports[number] = self._networks[number].step(of_pools, labels, turn)
            return reports

    def prune(self, member: int, kept: Masters) -> None:
        """Set the weights of a member that are not kept to 0, for good."""
        self._networks[member].prune(kept)

    def masters(self, member: int) -> Masters:
        """Return a copy of a member's master weights."""
        return self._networks[member].masters()

    def state(self, member: int) -> State:
        """Return a copy of what a member's training goes on from."""
        return self._networks[member].state()

    def restore(self, member: int, state: State) -> None:
        """Go on from a member's state."""
        self._networks[member].restore(state)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Let torch calculate in one thread: the order of its sums depends on how many there are."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def start(members: Sequence[Member], device: str = "cpu") -> AutogradEngine:
    """Return an engine on a torch device."""
    return AutogradEngine(members, torch.device(device))
