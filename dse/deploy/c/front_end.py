"""The C that makes spikes: send-on-delta of samples, pools and bins of events."""

from __future__ import annotations

from dse.deploy.c.plan import Frame, SendOnDeltaPlan, is_endless
from dse.deploy.c.text import filled, real, wrapped
from dse.preprocessing import Pooling

_WHOLE = """\
/* The largest whole number up to x >= 0. */
static double whole(double x)
{
    return x < 9007199254740992.0 ? (double)(int64_t)x : x;
}
"""


def level_type(plan: Frame) -> str:
    """Return the type of the levels that an encoder keeps."""
    if plan.encoder is None:
        return ""
    unit = 1 << plan.encoder.shift
    return (
        "\n#ifdef DSE_REAL_SAMPLES\ntypedef double level_t;\n#define LEVEL_UNIT 1.0\n"
        f"#else\ntypedef int32_t level_t;\n#define LEVEL_UNIT {unit}\n#endif\n"
    )


def front_end(plan: Frame) -> str:
    """Return the functions that take what is pushed; '' where that is spikes."""
    if plan.encoder is not None:
        return _send_on_delta(plan.encoder)
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
