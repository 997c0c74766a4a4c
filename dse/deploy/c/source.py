"""The C of a spiking network: one source."""

from __future__ import annotations

from collections.abc import Iterable

from dse.deploy.c.files import Code
from dse.deploy.c.front_end import floats, front_end, level_type, needs_double
from dse.deploy.c.memory import is_delayed, members, ram_bytes, states, struct_bytes, table_bytes, tables
from dse.deploy.c.neurons import layer_text, leaks, rows
from dse.deploy.c.plan import Plan
from dse.deploy.c.text import NAMES, TITLE, filled, indented


def code(plan: Plan) -> Code:
    """Return a spiking network as C."""
    sizes = "-".join(str(n) for n in (plan.n_channels, *(layer.n_neurons for layer in plan.layers)))
    return Code(
        frame=plan,
        source=source(plan),
        n_outputs=plan.layers[-1].n_neurons,
        steps_per_sample=plan.steps_per_sample,
        ram_bytes=ram_bytes(plan),
        of_reals_bytes=struct_bytes(members(plan), of_reals=True),
        table_bytes=table_bytes(plan),
        needs_double=needs_double(plan),
        what=f"A {sizes} network of spiking neurons: integers only",
    )


def source(plan: Plan) -> str:
    """Return dse.c."""
    return filled(
        "dse.c",
        title=TITLE,
        ram_bytes=ram_bytes(plan),
        table_bytes=table_bytes(plan),
        network_steps=plan.network_steps,
        floats=floats(plan),
        tables="\n".join(table.text for table in tables(plan)) + level_type(plan),
        members="".join(member.text for member in members(plan)),
        leaks=leaks(plan),
        rows="".join(rows(plan)),
        input=_input(plan),
        layers="".join(layer_text(plan, k) for k in range(len(plan.layers), 0, -1)),
        decision=_decision(plan),
        step=_step(plan),
        front_end=front_end(plan),
        clearing=_clearing(plan),
        clear=_clear(plan),
        init=_init(plan),
        n_outputs=plan.layers[-1].n_neurons,
        names=NAMES,
        n_classes=len(plan.classes),
    )


def _input(plan: Plan) -> str:
    slot = "net.slot" if plan.n_slots > 1 else "0"
    at_once = "".join(
        f"    reach_1({f'{copy * plan.n_channels}u + ' if copy else ''}channel);\n    net.awake_1 = 1;\n"
        for copy, delay in enumerate(plan.delays)
        if delay == 0
    )
    deliver = _DELIVER.replace("WORDS", f"{plan.channel_words}u").replace("SLOTS", f"{plan.n_slots}u")
    bound = "" if plan.n_channels == _ALL_CHANNELS else f"channel >= {plan.n_channels}u || "
    return f"""\
void dse_push_spike(uint16_t channel)
{{
    const uint32_t bit = (uint32_t)1 << (channel & 31u);
    if ({bound}net.step >= STEPS || (net.spikes[{slot}][channel >> 5] & bit) != 0) {{
        return;
    }}
    net.spikes[{slot}][channel >> 5] |= bit;
    net.pushed = 1;
    SPIKE(0, channel);
{at_once}}}

{deliver if is_delayed(plan) else ""}"""


_ALL_CHANNELS = 2**16
_DELIVER = """\
/* Spikes of `lag` input steps ago reach layer 1 as a delayed copy of the inputs. */
static APART void deliver(uint32_t lag, uint32_t first)
{
    const uint32_t slot = net.slot >= lag ? net.slot - lag : net.slot + SLOTS - lag;
    uint32_t i;
    for (i = 0; i < WORDS; i++) {
        uint32_t word = net.spikes[slot][i];
        while (word != 0) {
            const uint32_t bit = word & (0u - word); /* the lowest that is set */
            uint32_t place = (uint32_t)((bit & 0xAAAAAAAAu) != 0);
            place |= (uint32_t)((bit & 0xCCCCCCCCu) != 0) << 1;
            place |= (uint32_t)((bit & 0xF0F0F0F0u) != 0) << 2;
            place |= (uint32_t)((bit & 0xFF00FF00u) != 0) << 3;
            place |= (uint32_t)((bit & 0xFFFF0000u) != 0) << 4;
            reach_1(first + 32u * i + place);
            net.awake_1 = 1;
            word ^= bit;
        }
    }
}

"""


def _decision(plan: Plan) -> str:
    rule = plan.rule
    n_outputs = plan.layers[-1].n_neurons
    if rule.joint:
        lines = ["uint32_t i, best, at = 0;", f"if (net.step != {rule.last}u) {{", "    return;", "}"]
        for first, n in rule.heads:
            lines += _argmax("best", first, n)
            lines.append(f"at = at * {n}u + (best{f' - {first}u' if first else ''});")
        lines += [
            "net.answer = (int16_t)(joint[at] + 1);",
            "net.confident = 1;",
            "net.answered = net.step + 1u;",
        ]
        return _decide(lines)
    end = f"net.step == {rule.last}u"
    answer = f"(int16_t)(best - {rule.first}u + 1u)" if rule.first else "(int16_t)(best + 1u)"
    lines = ["uint32_t i, best;"]
    if rule.least_total is None:
        lines += [f"if (!({end})) {{", "    return;", "}", *_argmax("best", rule.first, rule.n)]
        lines.append("net.confident = 1;")
    else:
        largest = plan.network_steps * n_outputs
        wide = largest * max(rule.confidence.numerator, rule.confidence.denominator) >= 2**32
        cast = "(uint64_t)" if wide else ""
        enough = f"net.total >= {rule.least_total}u"
        sure = (
            f"{cast}net.counts[best] * {rule.confidence.denominator}u >= "
            f"{cast}net.total * {rule.confidence.numerator}u"
        )
        if rule.confidence == 0:
            sure = ""
        lines += [
            f"if (net.answer != 0 || (!({end}) && (!net.changed || !({enough})))) {{",
            "    return;",
            "}",
            "net.changed = 0;",
            *_argmax("best", rule.first, rule.n),
            f"net.confident = {enough}{f' && {sure}' if sure else ''};",
            f"if (!net.confident && !({end})) {{",
            "    return;",
            "}",
        ]
    lines += [f"net.answer = {answer};", "net.answered = net.step + 1u;"]
    return _decide(lines)


def _argmax(name: str, first: int, n: int) -> list[str]:
    """Return the statements that find the most active of some outputs, the lowest on ties."""
    return [
        f"{name} = {first}u;",
        f"for (i = {first + 1}u; i < {first + n}u; i++) {{",
        f"    if (net.counts[i] > net.counts[{name}]) {{",
        f"        {name} = i;",
        "    }",
        "}",
    ]


def _decide(lines: Iterable[str]) -> str:
    body = indented("\n".join(lines) + "\n")
    purpose = "/* The decision at this step, from the output spikes of the steps before. */\n"
    return f"{purpose}static APART void decide(void)\n{{\n{body}}}\n\n"


def _step(plan: Plan) -> str:
    k, delayed = plan.steps_per_sample, is_delayed(plan)
    body = ["if (net.step >= STEPS) {", "    return;", "}"]
    if plan.pooling is not None:
        body = ["if (net.started) {", f"    net.end_us += {plan.pooling.bin_us};", "}", *body]
    inner = []
    if delayed:
        part = "" if k == 1 else " && parts[i] == part"
        inner += [
            f"for (i = 0; i < {sum(1 for d in plan.delays if d)}u; i++) {{",
            f"    if (lags[i] <= net.sample{part}) {{",
            "        deliver(lags[i], copies[i]);",
            "    }",
            "}",
        ]
    inner += ["decide();", *(f"step_{n}();" for n in range(len(plan.layers), 0, -1)), "net.step++;"]
    variables = []
    if k > 1:
        variables.append("part")
        inner = [f"for (part = 0; part < {k}u; part++) {{", *(f"    {line}" for line in inner), "}"]
    slot = "net.slot" if plan.n_slots > 1 else "0"
    clear = [f"for (i = 0; i < {plan.channel_words}u; i++) {{", f"    net.spikes[{slot}][i] = 0;", "}"]
    if plan.pooling is not None and plan.pooling.counts_needed:
        clear += [f"for (i = 0; i < {plan.n_channels}u; i++) {{", "    net.events[i] = 0;", "}"]
    counted = ["net.sample++;"] if delayed else []
    if plan.n_slots > 1:
        next_slot = f"net.slot + 1u < {plan.n_slots}u ? net.slot + 1u : 0u"
        after = [*counted, f"net.slot = (uint16_t)({next_slot});", *clear]
    else:
        clear = [*clear, "net.pushed = 0;"]
        after = [*counted, "if (net.pushed) {", *(f"    {line}" for line in clear), "}"]
    variables.append("i")
    lines = [f"uint32_t {', '.join(sorted(variables))};", *body, *inner, *after]
    return "void dse_step(void)\n{\n" + indented("\n".join(lines) + "\n") + "}\n\n"


def _cleared(plan: Plan) -> list[tuple[str, str, str]]:
    """Return what is 0 at rest: the type, its place, and how many numbers."""
    arrays = []
    for k, layer in enumerate(plan.layers, 1):
        a, b = states(layer)
        kind = f"int{layer.state_bits}_t"
        arrays += [
            (kind, f"net.{a}_{k}", f"{layer.n_places}u"),
            (kind, f"net.{b}_{k}", f"{layer.n_neurons}u"),
        ]
        if n := layer.n_later * layer.n_neurons:
            arrays.append((kind, f"net.later_{k}", f"{n}u"))
    counts = "uint16_t" if plan.counts_bytes == 2 else "uint32_t"
    arrays.append((counts, "net.counts", f"{plan.layers[-1].n_neurons}u"))
    arrays.append(("uint32_t", f"net.spikes[{'i' if plan.n_slots > 1 else 0}]", f"{plan.channel_words}u"))
    if plan.pooling is not None and plan.pooling.counts_needed:
        arrays.append(("uint8_t", "net.events", f"{plan.n_channels}u"))
    return arrays


def _clearing(plan: Plan) -> str:
    """Return the functions that clear numbers, one per type."""
    kinds = dict.fromkeys(kind for kind, _, _ in _cleared(plan))
    return "".join(filled("clear.c", type=kind, name=_clear_name(kind)) for kind in kinds)


def _clear_name(kind: str) -> str:
    return f"dse_clear_{kind.removesuffix('_t')}"


def _clear(plan: Plan) -> str:
    """Return the statements that set the network to rest."""
    lines = ["uint32_t i;"] if plan.n_slots > 1 else []
    for kind, place, n in _cleared(plan):
        call = f"{_clear_name(kind)}({place}, {n});"
        many = place.endswith("[i]")
        lines += [f"for (i = 0; i < {plan.n_slots}u; i++) {{", f"    {call}", "}"] if many else [call]
    for k, layer in enumerate(plan.layers, 1):
        lines.append(f"net.awake_{k} = 0;")
        if layer.n_later:
            lines += [f"net.now_{k} = 0;", f"net.busy_{k} = 0;"]
    if is_delayed(plan):
        lines += ["net.sample = 0;", "net.slot = 0;"]
    lines.append("net.pushed = 0;")
    return indented("\n".join(lines) + "\n")


def _init(plan: Plan) -> str:
    lines = []
    if plan.encoder is not None:
        lines.append("net.begun = 0;")
    if plan.pooling is not None:
        lines.append("net.started = 0;")
    return indented("\n".join(lines) + "\n") if lines else ""
