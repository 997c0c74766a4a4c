"""The C that makes spikes: send-on-delta of samples, pools and bins of events."""

from __future__ import annotations

from dse.deploy.c.arrays import Table, index
from dse.deploy.c.text import filled, real, wrapped
from dse.deploy.form import Frame, ReceptorsForm, SendOnDeltaForm
from dse.encoders.receptors import KINDS
from dse.neurons.izhikevich import FLOOR_MV, PEAK_MV, A, B, C
from dse.preprocessing import END_OF_TIME_US, Pooling


def front_end(plan: Frame) -> str:
    """Return the functions that take what is pushed; '' where that is spikes."""
    if isinstance(plan.encoder, ReceptorsForm):
        return _receptors(plan.encoder)
    if plan.encoder is not None:
        return _send_on_delta(plan.encoder)
    return "" if plan.pooling is None else _pooling(plan.pooling)


def _send_on_delta(encoder: SendOnDeltaForm) -> str:
    return filled(
        "send_on_delta.c",
        encoder,
        **{f"is_{rule}": encoder.rule == rule for rule in ("value", "level")},
        adds=encoder.rule in ("step", "digits"),
        at="0" if encoder.rule == "digits" else "k",
        is_first="(net->begun == 0u) && (k == 0u)" if encoder.rule == "digits" else "net->begun == 0u",
        exact=", ".join(map(real, encoder.thresholds)),
        whole=", ".join(map(str, encoder.whole or ())),
        exact_first=wrapped(map(real, encoder.first)),
        whole_first=wrapped(str(int(x * 2**encoder.shift)) for x in encoder.first) if encoder.whole else "",
        by_unit=f" * {1 << encoder.shift}" if encoder.shift else "",
        first_level="begin[c]" if encoder.first else "x",
        channel="(k * DSE_SENSORS) + c"
        if encoder.merged
        else "(((2u * k) + ((d > ZERO) ? 1u : 0u)) * DSE_SENSORS) + c",
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
    return filled(
        "receptors.c",
        plan,
        **{name: real(x) for name, x in numbers.items()},
        gain_sa=real(encoder.gain_sa) if encoder.sa else "",
        low=wrapped(real(x) for x in encoder.low),
        span=wrapped(real(max(b - a, 0.0)) for a, b in zip(encoder.low, encoder.high, strict=True)),
        names=", ".join(KINDS if encoder.sa else KINDS[1:]),
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
        stop_us="" if is_endless(pools) else pools.end_us,
        too_late="" if is_endless(pools) else " || (t_us >= net->stop_us)",
        crop_x=x,
        crop_y=y,
        other_polarity=f" || (polarity != {pools.only}u)" if pools.only >= 0 else "",
        plane="(polarity != 0u) ? 1u : 0u" if pools.poles == 2 else "0",
        n_x=sizes[0],
        n_y=sizes[1],
        channel=f"(uint16_t)((((plane * {pools.height}u) + j) * {pools.width}u) + i)",
        needed=pools.needed if pools.needed > 1 else 0,
    )


def is_endless(pools: Pooling) -> bool:
    """Return whether no event is too late for the temporal crop."""
    return pools.end_us >= END_OF_TIME_US
