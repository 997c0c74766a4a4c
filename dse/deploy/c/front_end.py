"""The C that makes spikes: send-on-delta of samples, pools and bins of events."""

from __future__ import annotations

from collections.abc import Collection

from dse.deploy.c.plan import Frame, ReceptorsPlan, SendOnDeltaPlan, is_endless
from dse.deploy.c.text import filled, real, wrapped
from dse.encoders.receptors import KINDS
from dse.neurons.izhikevich import FLOOR_MV, PEAK_MV, A, B, C
from dse.preprocessing import Pooling

_WHOLE = """\
/* The largest whole number up to x >= 0. */
static double whole(double x)
{
    return x < 9007199254740992.0 ? (double)(int64_t)x : x;
}
"""


_NUMBERS = """\
#ifdef DSE_REAL_SAMPLES
/* Whether all samples are finite, told by their exponents: compilers may take every float for finite. */
static uint8_t are_numbers(const dse_sample_t *sample)
{
    union {
        float value;
        uint32_t bits;
    } of;
    uint32_t k;
    for (k = 0; k < DSE_SENSORS; k++) {
        of.value = sample[k];
        if ((of.bits & 0x7F800000u) == 0x7F800000u) {
            return 0;
        }
    }
    return 1;
}
#endif

"""
_REFUSE = """\
#ifdef DSE_REAL_SAMPLES
    if (!are_numbers(sample)) {
        return 0;
    }
#endif
"""
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
    always = isinstance(encoder, ReceptorsPlan) or (encoder is not None and not encoder.takes_whole)
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
    if not isinstance(plan.encoder, SendOnDeltaPlan):
        return ""
    unit = 1 << plan.encoder.shift
    return (
        "\n#ifdef DSE_REAL_SAMPLES\ntypedef double level_t;\n#define LEVEL_UNIT 1.0\n"
        f"#else\ntypedef int32_t level_t;\n#define LEVEL_UNIT {unit}\n#endif\n"
    )


def front_end(plan: Frame) -> str:
    """Return the functions that take what is pushed; '' where that is spikes."""
    if isinstance(plan.encoder, ReceptorsPlan):
        return _NUMBERS + _receptors(plan.encoder)
    if plan.encoder is not None:
        return _NUMBERS + _send_on_delta(plan.encoder)
    return "" if plan.pooling is None else _pooling(plan, plan.pooling)


def _send_on_delta(encoder: SendOnDeltaPlan) -> str:
    channel = "k * DSE_SENSORS + c" if encoder.merged else "(2u * k + (d > 0 ? 1u : 0u)) * DSE_SENSORS + c"
    level = "net.level[k][c]"
    if encoder.rule == "value":
        move = [f"{level} = x;"]
    elif encoder.rule == "step":
        move = [f"{level} += d > 0 ? theta : -theta;"]
    else:
        move = ["const level_t moved = WHOLE_STEPS;", f"{level} += d > 0 ? moved : -moved;"]
    exact = ", ".join(real(x) for x in encoder.thresholds)
    whole = ", ".join(map(str, encoder.whole or ()))
    text = filled(
        "send_on_delta.c",
        rule=encoder.rule,
        n_thresholds=len(encoder.thresholds),
        thresholds="THRESHOLDS",
        refuse=_REFUSE,
        move="".join(f"{' ' * 16}{line}\n" for line in move),
        channel=channel,
    )
    both = "#ifdef DSE_REAL_SAMPLES\n#define THRESHOLDS " + exact + "\n"
    if encoder.rule == "level":
        both += "#define WHOLE_STEPS (theta * whole(size / theta))\n"
    if whole:
        both += f"#else\n#define THRESHOLDS {whole}\n"
        if encoder.rule == "level":
            both += "#define WHOLE_STEPS (size / theta * theta)\n"
    floor = f"#ifdef DSE_REAL_SAMPLES\n{_WHOLE}#endif\n\n" if encoder.rule == "level" else ""
    return floor + both + "#endif\n\n" + text


_HELD = f"""\
static double held(double v)
{{
    v = v > {FLOOR_MV!r} ? v : {FLOOR_MV!r};
    return v < {PEAK_MV!r} ? v : {PEAK_MV!r};
}}

"""


def _receptors(plan: ReceptorsPlan) -> str:
    """Return the C of the encoder `receptors`: every operation in the order of dse.encoders.receptors."""
    encoder, kinds, n_totals = plan.encoder, plan.kinds, plan.smoothed + 1
    solver_steps = encoder.solver_steps(plan.step_ms)
    h = plan.step_ms / solver_steps
    half = real(0.5 * h)
    slope = f"({real(A)} * middle + {real(B)}) * middle + {real(C)} - u + drive"
    method = [f"const double seen = v, next = v + {real(h)} * slope;"]
    if encoder.method == "half_steps":
        method = [
            f"const double middle = held(v + {half} * slope);",
            f"const double next = middle + {half} * ({slope}), seen = held(next);",
        ]
    value, advance = "(double)sample[k]", ""
    if n_totals > 2:
        value = "(net.sums[next_total][k] - net.sums[oldest][k]) / (double)(net.n_totals - 1u)"
        advance = _AVERAGE.replace("N_TOTALS", f"{n_totals}u")
    fast = f"{real(encoder.gain_fa)} * (moved > 0 ? moved : 0)"
    return filled(
        "receptors.c",
        n_sensors=plan.n_sensors,
        low=wrapped(real(x) for x in encoder.low),
        span=wrapped(real(max(b - a, 0.0)) for a, b in zip(encoder.low, encoder.high, strict=True)),
        names=", ".join(KINDS if encoder.sa else KINDS[1:]),
        n_kinds=len(kinds),
        kinds=", ".join(f"{{{', '.join(map(real, kind))}}}" for kind in kinds.tolist()),
        held=_HELD if encoder.method == "half_steps" else "",
        refuse=_REFUSE,
        advance=advance,
        value=value,
        step_s=real(plan.step_ms / 1000),
        falling=0 if encoder.sa else 1,
        gain=real(encoder.gain),
        drive=f"q == 0 ? {real(encoder.gain_sa)} * level : {fast}" if encoder.sa else fast,
        solver_steps=solver_steps,
        A=real(A),
        B=real(B),
        C=real(C),
        method="".join(f"{' ' * 16}{line}\n" for line in method),
        h=real(h),
        peak=real(PEAK_MV),
        floor=real(FLOOR_MV),
        copies=encoder.spikes_per_step,
    )


_AVERAGE = """\
    uint32_t next_total, oldest = 0;
    if (!net.begun) {
        for (k = 0; k < DSE_SENSORS; k++) {
            net.sums[0][k] = 0;
        }
        net.newest = 0;
        net.n_totals = 1;
    }
    next_total = net.newest + 1u < N_TOTALS ? net.newest + 1u : 0u;
    for (k = 0; k < DSE_SENSORS; k++) {
        net.sums[next_total][k] = net.sums[net.newest][k] + (double)sample[k];
    }
    net.newest = next_total;
    if (net.n_totals < N_TOTALS) {
        net.n_totals++;
    }
    if (net.n_totals == N_TOTALS) {
        oldest = next_total + 1u < N_TOTALS ? next_total + 1u : 0u;
    }
"""


def _pooling(plan: Frame, pools: Pooling) -> str:
    x, y, columns, rows = pools.crop
    n_x, n_y = pools.n_x[x : x + columns], pools.n_y[y : y + rows]
    more = []
    sizes = []
    for axis, n, length in (("x", n_x, columns), ("y", n_y, rows)):
        first = "column" if axis == "x" else "row"
        if (n == n[0]).all():
            sizes.append(f"{int(n[0])}u")
        else:
            more.append(f"static const uint8_t n_{axis}[{length}] = {{\n{wrapped(map(str, n.tolist()))}}};\n")
            sizes.append(f"n_{axis}[{first}]")
    channel = f"(uint16_t)((plane * {pools.height}u + j) * {pools.width}u + i)"
    if pools.needed > 1:
        count = (
            f"const uint16_t channel = {channel};\n"
            f"            if (net.events[channel] < {pools.needed}u "
            f"&& ++net.events[channel] == {pools.needed}u) {{\n"
            "                dse_push_spike(channel);\n            }\n            net.pushed = 1;"
        )
    else:
        count = f"dse_push_spike({channel});"
    endless = is_endless(pools)
    text = filled(
        "pooling.c",
        x_bits=8 if pools.width <= 256 else 16,
        y_bits=8 if pools.height <= 256 else 16,
        columns=columns,
        rows=rows,
        first_x=wrapped(map(str, pools.first_x[x : x + columns].tolist())),
        first_y=wrapped(map(str, pools.first_y[y : y + rows].tolist())),
        more="".join(more),
        start_us=pools.start_us,
        bin_us=pools.bin_us,
        stop="" if endless else f"    net.stop_us = t_us + {pools.end_us};\n",
        too_late="" if endless else " || t_us >= net.stop_us",
        crop_x=x,
        crop_y=y,
        other_polarity=f" || polarity != {pools.only}u" if pools.only >= 0 else "",
        plane="polarity != 0" if pools.poles == 2 else "0",
        n_x=sizes[0],
        n_y=sizes[1],
        count=count,
    )
    return text
