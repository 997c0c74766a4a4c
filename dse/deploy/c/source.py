"""The C of a plan: one header, one source, a program that reads a recording, and how to build them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from dse.deploy.c.front_end import front_end, level_type
from dse.deploy.c.memory import is_delayed, members, ram_bytes, states, table_bytes, tables
from dse.deploy.c.neurons import layer_text, leaks, rows
from dse.deploy.c.plan import Plan
from dse.deploy.c.text import filled, indented, real, string


def write(plan: Plan, folder: Path, title: str, version: str) -> None:
    """Write the files of a plan into an empty folder.

    Args:
        plan: what the C does.
        folder: it is empty or missing.
        title: a line about the classifier.
        version: of dse.
    """
    title = title.replace("*/", "* /")
    for place in ("src", "examples/touch"):
        (folder / place).mkdir(parents=True)
    project = "dse_touch"
    for name, text in (
        ("src/dse.h", header(plan, title)),
        ("src/dse.c", source(plan, title)),
        ("main.c", program(plan, title)),
        ("CMakeLists.txt", filled("CMakeLists.txt", project=project)),
        ("library.properties", filled("library.properties", project=project, version=version)),
        ("examples/touch/touch.ino", filled(f"touch_{plan.front_end}.ino", title=title)),
        ("README.md", readme(plan, title)),
    ):
        (folder / name).write_text(text, encoding="utf-8")


def header(plan: Plan, title: str) -> str:
    """Return dse.h."""
    declaration, comment, defines, kept = {
        "samples": (
            _PUSH_SAMPLES,
            "a sample of every sensor",
            _samples_defines(plan),
            "; levels of the encoder stay",
        ),
        "events": (_PUSH_EVENTS, "every event of the step", "#define DSE_EVENTS\n", "; bins go on"),
        "spikes": ("", "dse_push_spike(channel) of every spike of the step", "", ""),
    }[plan.front_end]
    text = filled(
        "dse.h",
        title=title,
        n_channels=plan.n_channels,
        n_classes=len(plan.classes),
        n_outputs=plan.layers[-1].n_neurons,
        n_steps=plan.n_steps,
        steps_per_sample=plan.steps_per_sample,
        step_ms=real(plan.step_ms),
        push_comment=comment,
        push_declaration=declaration,
        defines=defines,
        reset_comment=kept,
    )
    return text.replace("dse_push(...);               dse_push_spike", "dse_push_spike")


def source(plan: Plan, title: str) -> str:
    """Return dse.c."""
    names = "\n        ".join(string(name) for name in plan.classes)
    return filled(
        "dse.c",
        title=title,
        ram_bytes=ram_bytes(plan),
        table_bytes=table_bytes(plan),
        network_steps=plan.network_steps,
        tables="\n".join(table.text for table in tables(plan)) + level_type(plan),
        members="".join(member.text for member in members(plan)),
        leaks=leaks(plan),
        rows="".join(rows(plan)),
        input=_input(plan),
        layers="".join(layer_text(plan, k) for k in range(len(plan.layers), 0, -1)),
        decision=_decision(plan),
        step=_step(plan),
        front_end=front_end(plan),
        clear=_clear(plan),
        init=_init(plan),
        n_outputs=plan.layers[-1].n_neurons,
        names=names,
        n_classes=len(plan.classes),
    )


def program(plan: Plan, title: str) -> str:
    """Return main.c, which reads recordings from stdin."""
    at = plan.window
    onset = plan.onset_threshold
    constants = [
        f"#define WINDOW_AT_{at.upper()}",
        f"#define ONSET {real(float(np.float32(onset)) if plan.front_end == 'samples' else float(onset))}",
    ]
    if plan.pooling is not None:
        x, y, columns, rows = plan.pooling.crop
        constants += [
            f"#define BIN_US {plan.pooling.bin_us}",
            f"#define START_US {plan.pooling.start_us}",
            f"#define END_US {min(plan.pooling.end_us, 2**62)}",
            f"#define CROP_X {x}",
            f"#define CROP_Y {y}",
            f"#define CROP_COLUMNS {columns}",
            f"#define CROP_ROWS {rows}",
        ]
        if plan.t0_us is not None:
            constants += [
                "#ifndef RECORDED /* trials begin at 0; recordings with their first event */",
                f"#define T0_US {plan.t0_us}",
                f"#define N_BINS {plan.n_bins}",
                "#endif",
            ]
    return filled(f"main_{plan.front_end}.c", title=title, constants="\n".join(constants))


def readme(plan: Plan, title: str) -> str:
    """Return README.md of the folder."""
    sizes = "-".join(str(n) for n in (plan.n_channels, *(layer.n_neurons for layer in plan.layers)))
    rows = {
        "samples": "a row per sample: one number per sensor, separated by commas",
        "events": "a row per event: time in us, x, y, polarity (1 ON, 0 OFF)",
        "spikes": "a row per step: 1 or 0 of every channel",
    }[plan.front_end]
    why = f"\nSpikes are pushed because {plan.no_front_end}.\n" if plan.no_front_end else ""
    if plan.encoder is not None:
        why = (
            "\nSamples are whole numbers; `-DDSE_REAL_SAMPLES` makes them `float`, and the encoder then "
            "computes in `double`.\n"
            if plan.encoder.whole is not None
            else "\nThe encoder's thresholds are no multiples of 1/32: it computes in `double`, the network "
            "in integers.\n"
        )
    window = {
        "start": "begins with the recording",
        "middle": "lies in the middle of the recording",
        "contact_onset": "begins at the contact",
    }[plan.window]
    return filled(
        "README.md",
        title=title,
        sizes=sizes,
        rows=rows,
        why=why,
        window=window,
        n_steps=plan.n_steps,
        step_ms=real(plan.step_ms),
        ram_bytes=ram_bytes(plan),
        table_bytes=table_bytes(plan),
    )


_PUSH_SAMPLES = """\
/* One sample of every sensor: the spikes that it gives belong to this step. */
void dse_push(const dse_sample_t *sample);
"""
_PUSH_EVENTS = """\
/* Bins are counted from a time; without a call, from the first event. */
void dse_start(int64_t t_us);

/* An event, in the order of time; polarity: 1 ON, 0 OFF. Returns 0, and does nothing, if it belongs to a
 * later step: dse_step() first. */
uint8_t dse_push(int64_t t_us, uint16_t x, uint16_t y, uint8_t polarity);
"""


def _samples_defines(plan: Plan) -> str:
    if plan.encoder is None:
        return ""
    reals = (
        "#ifndef DSE_REAL_SAMPLES /* the thresholds are not on an integer grid */\n"
        "#define DSE_REAL_SAMPLES\n#endif\n"
    )
    always = "" if plan.encoder.whole is not None else reals
    return (
        f"#define DSE_SENSORS {plan.encoder.n_sensors}u\n{always}"
        "#ifdef DSE_REAL_SAMPLES\ntypedef float dse_sample_t; /* the encoder computes in double */\n"
        "#else\ntypedef int32_t dse_sample_t; /* magnitude below 2^24 */\n#endif\n"
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
static void deliver(uint32_t lag, uint32_t first)
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
        lines += ["net.label = joint[at];", "net.confident = 1;", "net.answered = net.step + 1u;"]
        return _decide(lines)
    end = f"net.step == {rule.last}u"
    label = f"(int16_t)(best{f' - {rule.first}u' if rule.first else ''})"
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
            f"if (net.label != DSE_UNDECIDED || (!({end}) && (!net.changed || !({enough})))) {{",
            "    return;",
            "}",
            "net.changed = 0;",
            *_argmax("best", rule.first, rule.n),
            f"net.confident = {enough}{f' && {sure}' if sure else ''};",
            f"if (!net.confident && !({end})) {{",
            "    return;",
            "}",
        ]
    lines += [f"net.label = {label};", "net.answered = net.step + 1u;"]
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
    return f"{purpose}static void decide(void)\n{{\n{body}}}\n\n"


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


def _clear(plan: Plan) -> str:
    """Return the statements of dse_reset that set the network to rest."""
    lines = []
    for k, layer in enumerate(plan.layers, 1):
        a, b = states(layer)
        lines += [
            f"for (i = 0; i < {layer.n_places}u; i++) {{",
            f"    net.{a}_{k}[i] = 0;",
            "}",
            f"for (i = 0; i < {layer.n_neurons}u; i++) {{",
            f"    net.{b}_{k}[i] = 0;",
            "}",
            f"net.awake_{k} = 0;",
        ]
    lines += [f"for (i = 0; i < {plan.layers[-1].n_neurons}u; i++) {{", "    net.counts[i] = 0;", "}"]
    if plan.n_slots > 1:
        lines += [
            f"for (i = 0; i < {plan.n_slots * plan.channel_words}u; i++) {{",
            f"    net.spikes[i / {plan.channel_words}u][i % {plan.channel_words}u] = 0;",
            "}",
        ]
    else:
        lines += [f"for (i = 0; i < {plan.channel_words}u; i++) {{", "    net.spikes[0][i] = 0;", "}"]
    if plan.pooling is not None and plan.pooling.counts_needed:
        lines += [f"for (i = 0; i < {plan.n_channels}u; i++) {{", "    net.events[i] = 0;", "}"]
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
