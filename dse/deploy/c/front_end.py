"""The C that makes spikes: send-on-delta of samples, pools and bins of events."""

from __future__ import annotations

from collections.abc import Collection

from dse.deploy.c.arrays import Member, Table, index, members_of
from dse.deploy.c.text import filled, real, wrapped
from dse.deploy.form import Frame, ReceptorsForm, SendOnDeltaForm
from dse.encoders.receptors import KINDS
from dse.neurons.izhikevich import FLOOR_MV, PEAK_MV, A, B, C
from dse.preprocessing import END_OF_TIME_US, Pooling

_ROUNDED = """\
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF /* every product is rounded, as by the engine */
#elif defined(__GNUC__)
#pragma GCC optimize ("fp-contract=off")
#endif
"""
_WIDE = """\
/* Levels and tables of 64 bits: where double has 32, as on AVR, this does not compile. */
typedef char dse_needs_a_double_of_64_bits[sizeof(double) >= 8 ? 1 : -1];
"""


def needs_double(plan: Frame, kinds: Collection[str] = ()) -> bool:
    """Return whether a source computes in double, whatever samples are.

    Args:
        plan: says what the encoder computes in.
        kinds: types of the classifier's tables.
    """
    encoder = plan.encoder
    always = isinstance(encoder, ReceptorsForm) or (encoder is not None and not encoder.takes_whole)
    return always or "double" in kinds


def floats(plan: Frame, kinds: Collection[str] = ()) -> str:
    """Return what a source asks of compilers where it computes in floating point (arguments as above)."""
    if plan.encoder is None and not {"float", "double"} & set(kinds):
        return ""
    wide = _WIDE
    if not needs_double(plan, kinds):
        wide = "" if plan.encoder is None else f"#ifdef DSE_REAL_SAMPLES\n{_WIDE}#endif\n"
    return f"{_ROUNDED}{wide}\n"


def level_type(plan: Frame) -> str:
    """Return the type of the levels that an encoder keeps."""
    if not isinstance(plan.encoder, SendOnDeltaForm):
        return ""
    unit = 1 << plan.encoder.shift
    return (
        "\n#ifdef DSE_REAL_SAMPLES\ntypedef double level_t;\n#define LEVEL_UNIT 1.0\n"
        f"#else\ntypedef int32_t level_t;\n#define LEVEL_UNIT {unit}\n#endif\n"
    )


def front_end_members(plan: Frame) -> list[Member]:
    """Return the variables of what makes the input spikes."""
    encoder, pools = plan.encoder, plan.pooling
    of_encoder: dict[str, object] = {}
    if isinstance(encoder, SendOnDeltaForm):  # level_t: of whole samples
        of_encoder = {"level": "level_t" if encoder.takes_whole else "double"}
    if isinstance(encoder, ReceptorsForm):
        of_encoder = {"n_kinds": len(encoder.kinds), "n_totals": encoder.n_totals}
    return members_of(
        "front_end_members.txt",
        plan,
        encoder,
        is_delta=isinstance(encoder, SendOnDeltaForm),
        is_receptors=isinstance(encoder, ReceptorsForm),
        is_endless=pools is not None and _is_endless(pools),
        **of_encoder,
    )


def begin(plan: Frame) -> str:
    """Return the statements with which a recording begins."""
    if plan.encoder is not None:
        return "    net.begun = 0;\n"
    return "" if plan.pooling is None else "    net.started = 0;\n"


def front_end(plan: Frame) -> str:
    """Return the functions that take what is pushed; '' where that is spikes."""
    if isinstance(plan.encoder, ReceptorsForm):
        return _receptors(plan.encoder)
    if plan.encoder is not None:
        return _send_on_delta(plan.encoder)
    return "" if plan.pooling is None else _pooling(plan.pooling)


def _send_on_delta(encoder: SendOnDeltaForm) -> str:
    return filled("numbers.c") + filled(
        "send_on_delta.c",
        encoder,
        **{f"is_{rule}": encoder.rule == rule for rule in ("value", "step", "level")},
        exact=", ".join(map(real, encoder.thresholds)),
        whole=", ".join(map(str, encoder.whole or ())),
        channel="k * DSE_SENSORS + c" if encoder.merged else "(2u * k + (d > 0 ? 1u : 0u)) * DSE_SENSORS + c",
    )


def _receptors(plan: ReceptorsForm) -> str:
    """Return the C of the encoder `receptors`: every operation in the order of dse.encoders.receptors."""
    encoder, kinds = plan.encoder, plan.kinds
    solver_steps = encoder.solver_steps(plan.step_ms)
    h = plan.step_ms / solver_steps
    numbers = {
        "step_s": plan.step_ms / 1000,
        "gain": encoder.gain,
        "gain_fa": encoder.gain_fa,
        **{"A": A, "B": B, "C": C, "h": h, "half": 0.5 * h, "peak": PEAK_MV, "floor": FLOOR_MV},
    }
    return filled("numbers.c") + filled(
        "receptors.c",
        plan,
        **{name: real(x) for name, x in numbers.items()},
        gain_sa=real(encoder.gain_sa) if encoder.sa else "",
        low=wrapped(real(x) for x in encoder.low),
        span=wrapped(real(max(b - a, 0.0)) for a, b in zip(encoder.low, encoder.high, strict=True)),
        names=", ".join(KINDS if encoder.sa else KINDS[1:]),
        n_kinds=len(kinds),
        kinds=", ".join(f"{{{', '.join(map(real, kind))}}}" for kind in kinds.tolist()),
        half_steps=encoder.method == "half_steps",
        falling=0 if encoder.sa else 1,
        solver_steps=solver_steps,
        copies=encoder.spikes_per_step,
    )


def _pooling(pools: Pooling) -> str:
    x, y, columns, rows = pools.crop
    tables, several, sizes = [], [], []
    for axis, place, cut, begins, lengths, n in (
        ("x", "column", slice(x, x + columns), pools.first_x, pools.n_x, pools.width),
        ("y", "row", slice(y, y + rows), pools.first_y, pools.n_y, pools.height),
    ):
        tables.append(Table(index(n), f"first_{axis}", begins[cut]))
        first, *others = dict.fromkeys(lengths[cut].tolist())
        sizes.append(f"n_{axis}[{place}]" if others else f"{first}u")
        several += [Table("uint8_t", f"n_{axis}", lengths[cut])] if others else []
    return filled(
        "pooling.c",
        pools,
        tables="".join(table.text for table in [*tables, *several]),
        columns=columns,
        rows=rows,
        stop_us="" if _is_endless(pools) else pools.end_us,
        too_late="" if _is_endless(pools) else " || t_us >= net.stop_us",
        crop_x=x,
        crop_y=y,
        other_polarity=f" || polarity != {pools.only}u" if pools.only >= 0 else "",
        plane="polarity != 0" if pools.poles == 2 else "0",
        n_x=sizes[0],
        n_y=sizes[1],
        channel=f"(uint16_t)((plane * {pools.height}u + j) * {pools.width}u + i)",
        needed=pools.needed if pools.needed > 1 else 0,
    )


def binned(plan: Frame) -> dict[str, int]:
    """Return the width of a bin and the pools whose events are counted in it; 0: there is none."""
    pools = plan.pooling
    if pools is None:
        return {"bin_us": 0, "n_events": 0}
    return {"bin_us": pools.bin_us, "n_events": plan.n_channels if pools.counts_needed else 0}


def _is_endless(pools: Pooling) -> bool:
    """Return whether no event is too late for the temporal crop."""
    return pools.end_us >= END_OF_TIME_US
