"""A spiking network as the memories and numbers of a circuit, whose blocks of Verilog stay as they are."""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dse.base.records import Array, Ints
from dse.deploy.form import LayerForm, SendOnDeltaForm, Spiking, Unsupported
from dse.engine.neurons import cuba_lif
from dse.engine.neurons.fixed_point import DECAY_SCALE, common_exponent, needed_bits
from dse.measure.hardware.kinds.gate_array import LIST_CYCLES, WORD_CHANNELS, Memories, Stored

BLOCKS = ("arrivals.v", "core.v", "decision.v", "encoder.v", "inputs.v", "neurons.v", "top.v", "uart.v")
_MOST_CLASSES, _MOST_STATE_BITS, _MOST_CHANNELS = 254, 32, 65532
NO_CLASS = 254
"""Answer of several heads whose combination is no class."""
SAMPLE_BITS = 16
_MOST_THRESHOLDS, _CYCLES_PER_THRESHOLD = 32, 6
_NONE = SendOnDeltaForm(1, (1.0,), (1,), 0, "step", merged=False)
"""Where there is no encoder."""
_BLOCKS = Path(__file__).parent / "blocks"


@dataclass(frozen=True)
class Circuit:
    """A network as its memories.

    stored: as rows of all weights, or as lists of those that are not 0.
    weights: (n_weights,) what a spike adds, in 8-bit steps without common factors of 2: rows of the input
        copies, then of the neurons; a row of a neuron has the weights to its own layer, then to the next.
    delays: (n_weights,) steps that each acts later.
    targets: (n_weights,) neuron that each is added to.
    lengths: (row,) weights of each.
    keeps: (2 * neurons,) 4096 less the decays of current and potential.
    weight_bits, delay_bits, sum_bits, state_bits: of a weight, a delay, a sum of weights, a state.
    slot_bits: 2 to this power steps of sums are held.
    encoder: makes the input spikes of samples; None: spikes alone are taken.
    """

    form: Spiking
    stored: Stored
    weights: Ints
    delays: Ints
    targets: Ints
    lengths: Ints
    keeps: Ints
    shift: int
    weight_bits: int
    delay_bits: int
    sum_bits: int
    state_bits: int
    slot_bits: int
    encoder: SendOnDeltaForm | None = None

    @property
    def sample_bits(self) -> int:
        """2 to this power input steps are held."""
        return max(1, bits(self.form.n_slots - 1))

    @property
    def word_bits(self) -> int:
        """2 to this power words of 16 channels are held of an input step."""
        return max(1, bits(-(-self.form.n_channels // WORD_CHANNELS) - 1))

    @property
    def level_bits(self) -> int:
        """Bits of a level of the encoder; 0: there is none."""
        return 0 if self.encoder is None else SAMPLE_BITS + self.encoder.shift

    @property
    def share_bits(self) -> int:
        """Bits of the products that confidence compares."""
        confidence, total = self.form.rule.confidence, self.form.network_steps * self.form.rule.n
        return bits(total * max(1, confidence.numerator, confidence.denominator))

    @property
    def memories(self) -> Memories:
        """Words and bits of a word of every memory; what is the same in every word takes none."""
        form, n, encoder = self.form, sum(self.form.sizes[1:]), self.encoder
        per_sensor = 0 if encoder is None else encoder.n_levels + bool(encoder.first)
        varying = int(np.bitwise_or.reduce(self.keeps ^ self.keeps[0]))
        return {
            **self.stored.memories,
            "sums": (n << self.slot_bits, self.sum_bits),
            "states": (2 * n, self.state_bits),
            "keeps": (2 * n, varying.bit_count()),
            "inputs": (1 << (self.sample_bits + self.word_bits), 16),
            "counts": (1 << max(1, bits(form.sizes[-1] - 1)), bits(form.network_steps)),
            **({"joint": (len(form.rule.joint), 8)} if form.rule.joint else {}),
            **({"levels": (per_sensor * encoder.n_sensors, self.level_bits)} if encoder else {}),
        }

    @property
    def most_cycles(self) -> int:
        """Clock cycles that an input step takes at most, in which everything spikes."""
        form, n = self.form, sum(self.form.sizes[1:])
        n_words = -(-form.n_channels // 16)
        inputs, neurons = np.split(self.lengths + LIST_CYCLES * self.stored.is_sparse, [form.sizes[0]])
        sending = neurons[np.repeat(_lengths(form), form.sizes[1:]) > 0]
        of_step = 5 * n + int((sending + 4).sum()) + 8
        of_copies = int((inputs + 5).sum()) + len(form.delays) * 4 * n_words
        of_samples = 0
        if self.encoder is not None:
            of_samples = self.encoder.n_sensors * (_CYCLES_PER_THRESHOLD * self.encoder.n_thresholds + 4)
        return form.steps_per_sample * (of_step + n_words) + of_copies + of_samples


def bits(number: int) -> int:
    """Return the bits of a whole number that is not negative."""
    return int(number).bit_length()


def of_form(form: Spiking) -> Circuit:
    """Return the circuit of a network."""
    _check(form)
    rows, delays, targets, lengths = _rows(form)
    factor = common_exponent(rows)
    reaching = [
        sign * np.concatenate([layer.forward_steps, layer.ring_steps])
        for layer in form.layers
        for sign in (1, -1)
    ]
    sums = max(int(np.maximum(x, 0).sum(axis=0).max()) for x in reaching)
    of_first = form.layers[0].delays
    of_others = [x.delays for x in form.layers[1:] if x.delays is not None]
    # Neurons send into the next slot and later ones, inputs into this one too.
    longest = max(1, 0 if of_first is None else int(of_first.max()), *(1 + int(x.max()) for x in of_others))
    bounds = [b for x in form.layers if (b := x.bounds) is not None]
    weights = rows >> factor
    weight_bits, is_used = needed_bits(weights), weights != 0
    is_used[0] |= not is_used.any()  # a memory has a word
    delays = np.where(is_used, delays, 0)
    delay_bits = bits(int(delays.max(initial=0)))
    stored = Stored.smallest(
        n_all=len(weights),
        n_used=int(is_used.sum()),
        n_bits=weight_bits + delay_bits,
        n_neurons=sum(form.sizes[1:]),
        n_rows=len(lengths),
        n_first=form.sizes[1],
    )
    if stored.is_sparse:
        row = np.repeat(np.arange(len(lengths)), lengths)[is_used]
        weights, delays, targets = weights[is_used], delays[is_used], targets[is_used]
        lengths = np.bincount(row, minlength=len(lengths))
    return Circuit(
        form=form,
        stored=stored,
        weights=weights,
        delays=delays,
        targets=targets,
        lengths=lengths,
        keeps=np.stack([_keeps(form, "decay_current"), _keeps(form, "decay_voltage")], axis=1).ravel(),
        shift=form.layers[0].unit.bit_length() - 1 + factor,
        weight_bits=weight_bits,
        delay_bits=delay_bits,
        sum_bits=1 + bits(max(1, sums >> factor)),
        state_bits=1 + max(bits(max(x.first, x.second)) for x in bounds),
        slot_bits=bits(longest),
        encoder=_encoder(form),
    )


def _encoder(form: Spiking) -> SendOnDeltaForm | None:
    """Return the encoder of a network, if it is send-on-delta in integers that a sample of 16 bits moves."""
    encoder = form.encoder
    if not isinstance(encoder, SendOnDeltaForm) or encoder.whole is None or encoder.rule == "level":
        return None
    half = 1 << (SAMPLE_BITS + encoder.shift - 1)  # no level lies farther from 0, and no threshold
    begins = [abs(x) * 2**encoder.shift for x in encoder.first]
    are_few = encoder.n_thresholds <= _MOST_THRESHOLDS
    return encoder if are_few and max(encoder.whole) < half and max(begins, default=0) < half else None


def _check(form: Spiking) -> None:
    """Refuse what Verilog is not written for."""
    if form.arithmetic != "integer":
        raise Unsupported(f"Verilog needs a network in integer arithmetic, got {form.arithmetic} arithmetic")
    for layer in form.layers:
        if not isinstance(layer.population, cuba_lif.Population):
            text = f"layer {layer.k} has neurons '{layer.neuron}', and Verilog is written for cuba_lif"
            raise Unsupported(f"{text}: train with model.neuron: cuba_lif")
        assert layer.bounds is not None
        if (n_bits := bits(max(layer.bounds.first, layer.bounds.second)) + 1) > _MOST_STATE_BITS:
            text = f"states of layer {layer.k} may take {n_bits} bits within the window"
            raise Unsupported(f"{text}, and Verilog has {_MOST_STATE_BITS}: choose larger decays")
    if form.n_channels > _MOST_CHANNELS:
        raise Unsupported(f"Verilog numbers {_MOST_CHANNELS} channels, got {form.n_channels}")
    if (n := max(form.rule.joint) + 1 if form.rule.joint else form.sizes[-1]) > _MOST_CLASSES:
        raise Unsupported(f"Verilog answers with one of {_MOST_CLASSES} classes, got {n}")


def _keeps(form: Spiking, decay: str) -> Ints:
    of_layers = [np.broadcast_to(getattr(x.population, decay), x.n_neurons) for x in form.layers]
    return DECAY_SCALE - np.concatenate(of_layers).astype(np.int64)


def _rows(form: Spiking) -> tuple[Ints, Ints, Ints, Ints]:
    """Return all weights, delays and targets, and the length of each row, as in `Circuit`."""
    first = form.layers[0]
    blocks = [_block(first.forward_steps, _delays(first), 0)]
    ends = np.cumsum(form.sizes[1:]).tolist()
    for layer, after, end in zip(form.layers, (*form.layers[1:], None), ends, strict=True):
        nothing = np.zeros((layer.n_neurons, 0), np.int64)
        own = nothing if layer.recurrent is None else layer.ring_steps
        next_, later = (nothing, nothing) if after is None else (after.forward_steps, _delays(after))
        weights, delays = np.hstack([own, next_]), np.hstack([np.zeros_like(own), later])
        blocks.append(_block(weights, delays, end - own.shape[1]))
    weights, delays, targets = (np.concatenate([x.ravel() for x in of]) for of in zip(*blocks, strict=True))
    return weights, delays, targets, np.concatenate([np.full(len(x), x.shape[1]) for x, *_ in blocks])


def _block(weights: Ints, delays: Ints, begin: int) -> tuple[Ints, Ints, Ints]:
    """Return rows of weights to the neurons from one on: weights, delays, targets, (row, neuron) each."""
    return weights, delays, np.broadcast_to(begin + np.arange(weights.shape[1]), weights.shape)


def _lengths(form: Spiking) -> list[int]:
    """Return the weights that a spike of each layer meets."""
    own = [layer.n_neurons * (layer.recurrent is not None) for layer in form.layers]
    return [a + b for a, b in zip(own, (*form.sizes[2:], 0), strict=True)]


def _delays(layer: LayerForm) -> Ints:
    return np.zeros(layer.weights.shape, np.int64) if layer.delays is None else layer.delays.astype(np.int64)


def write(circuit: Circuit, folder: Path) -> None:
    """Write the Verilog of a circuit into a folder: its blocks, parameters.vh, and memories as .hex."""
    for name in BLOCKS:
        shutil.copyfile(_BLOCKS / name, folder / name)
    words = circuit.weights & ((1 << circuit.weight_bits) - 1) | circuit.delays << circuit.weight_bits
    if circuit.stored.is_sparse:
        words |= circuit.targets << circuit.weight_bits + circuit.delay_bits
        _write_hex(folder / "lists.hex", np.cumsum([0, *circuit.lengths]))
    _write_hex(folder / "weights.hex", words)
    _write_hex(folder / "keeps.hex", circuit.keeps)
    if circuit.encoder is not None and circuit.encoder.first:
        begins = np.asarray(circuit.encoder.first) * 2**circuit.encoder.shift
        _write_hex(folder / "begins.hex", begins.astype(np.int64) & ((1 << circuit.level_bits) - 1))
    if joint := circuit.form.rule.joint:
        _write_hex(folder / "joint.hex", np.where(np.asarray(joint) < 0, NO_CLASS, joint))
    text = "// The numbers of this network.\n" + "".join(f"localparam {x};\n" for x in _parameters(circuit))
    (folder / "parameters.vh").write_text(text, encoding="utf-8")


def _write_hex(path: Path, words: Array) -> None:
    path.write_text("".join(f"{word:x}\n" for word in words.tolist()), encoding="utf-8")


def _parameters(circuit: Circuit) -> Iterable[str]:
    """Yield name and value of every parameter."""
    form, rule, encoder = circuit.form, circuit.form.rule, circuit.encoder or _NONE
    sizes, confidence, per_sample = form.sizes[1:], rule.confidence, form.steps_per_sample
    n, neuron_bits, total = sum(sizes), bits(sum(sizes)), form.network_steps * rule.n
    ends = np.cumsum(sizes).tolist()
    begins = [0, *ends]
    loops = [layer.recurrent is not None for layer in form.layers]
    firsts = [a if loop else min(b, n - 1) for a, b, loop in zip(begins, ends, loops, strict=False)]
    part_bits, output_bits = max(1, bits(per_sample - 1)), max(1, bits(sizes[-1] - 1))
    numbers = {
        "N_NEURONS": n,
        "N_LAYERS": len(sizes),
        "N_CHANNELS": form.n_channels,
        "N_COPIES": len(form.delays),
        "N_WEIGHTS": len(circuit.weights),
        "IS_SPARSE": int(circuit.stored.is_sparse),
        "N_LISTS": len(circuit.lengths),
        "NEURON_BITS": neuron_bits,
        "LAYER_BITS": max(1, bits(len(sizes) - 1)),
        "COPY_BITS": max(1, bits(len(form.delays) - 1)),
        "PART_BITS": part_bits,
        "PARTS": per_sample,
        "WORD_BITS": circuit.word_bits,
        "SAMPLE_BITS": circuit.sample_bits,
        "STEP_BITS": max(bits(form.network_steps), circuit.slot_bits),
        "SLOT_BITS": circuit.slot_bits,
        "WEIGHT_BITS": circuit.weight_bits,
        "DELAY_BITS": circuit.delay_bits,
        "SUM_BITS": circuit.sum_bits,
        "STATE_BITS": circuit.state_bits,
        "SHIFT": circuit.shift,
        "ADDRESS_BITS": circuit.stored.address_bits,
        "NEURON_LISTS": form.sizes[0] * (1 if circuit.stored.is_sparse else sizes[0]),
        "LAST_NETWORK_STEP": form.network_steps - 1,
        "OUTPUT_BITS": output_bits,
        "FIRST_OUTPUT": rule.first,
        "END_OUTPUT": rule.first + rule.n,
        "IS_EARLY": int(rule.least_total is not None),
        "TOTAL_BITS": bits(total),
        "LEAST_TOTAL": rule.least_total or 0,
        "SHARE_BITS": circuit.share_bits,
        "NUMERATOR": confidence.numerator,
        "DENOMINATOR": confidence.denominator,
        "LAST_STEP": rule.last,
        "N_HEADS": len(rule.parts),
        "HEAD_BITS": max(1, bits(len(rule.parts) - 1)),
        "N_JOINT": max(1, len(rule.joint)),
        "HAS_ENCODER": int(circuit.encoder is not None),
        "N_SENSORS": encoder.n_sensors,
        "SENSOR_BITS": max(1, bits(encoder.n_sensors - 1)),
        "N_THRESHOLDS": encoder.n_thresholds,
        "N_LEVELS": encoder.n_levels,
        "PLACE_BITS": bits((encoder.n_levels + bool(encoder.first)) * encoder.n_sensors),
        "SAMPLE_SHIFT": encoder.shift,
        "FOLLOWS": int(encoder.rule == "value"),
        "IS_SHARED": int(encoder.rule == "digits"),
        "HAS_BEGINS": int(bool(encoder.first)),
        "IS_MERGED": int(encoder.merged),
    }
    yield from (f"{name} = {number}" for name, number in numbers.items())
    yield f"[{neuron_bits - 1}:0] FIRST_LENGTH = {sizes[0]}"
    vectors = {
        "LAST": (neuron_bits, [end - 1 for end in ends]),
        "FIRST": (neuron_bits, firsts),
        "LENGTH": (neuron_bits, _lengths(form)),
        "THRESHOLD": (circuit.state_bits, [layer.threshold for layer in form.layers]),
        "LAGS": (circuit.sample_bits, [delay // per_sample for delay in form.delays]),
        "LAG_PARTS": (part_bits, [delay % per_sample for delay in form.delays]),
        "HEAD_FIRST": (output_bits, [first for first, _ in rule.parts]),
        "HEAD_LAST": (output_bits, [first + n - 1 for first, n in rule.parts]),
        "STRIDES": (16, [math.prod(n for _, n in rule.parts[k + 1 :]) for k in range(len(rule.parts))]),
        "THRESHOLDS": (SAMPLE_BITS + encoder.shift + 1, list(encoder.whole or ())),
    }
    for name, (width, values) in vectors.items():
        listed = ", ".join(f"{width}'d{value}" for value in reversed(values))
        yield f"[{width * len(values) - 1}:0] {name} = {{{listed}}}"
