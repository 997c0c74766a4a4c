/* $title
 * Written by dse: do not edit. Static data: $ram_bytes bytes; tables: $table_bytes bytes.
 *
 * States are integers in 1/4096 of a weight unit. Of CUBA-LIF neurons, at every step:
 *     u = leak(u) + 128 * weights of the spikes;  v = leak(v) + u;  spike where v > threshold, then v = 0
 * What is stored between steps has leaked already, so that a spike adds its row of weights at once, and a
 * neuron at rest (all states 0) is passed over. Weights, decays and threshold bound the states within a
 * window: no sum here can overflow. Division truncates toward zero, as C99 says.
 */
#include "dse.h"

#ifdef DSE_TRACE
#define SPIKE(layer, neuron) dse_trace((uint8_t)(layer), (uint16_t)(neuron), net.step)
#else
#define SPIKE(layer, neuron) ((void)0)
#endif

/* Functions that are not inlined, so that the loops of all networks compile alike. */
#if defined(__GNUC__)
#define APART __attribute__((noinline))
#else
#define APART
#endif

#define STEPS ${network_steps}u /* network steps of a window */

@include floats.c
$tables
@include level.c
/* All memory that there is. */
static struct {
@each declared
$text
@end
} net;

$leaks${rows}void dse_push_spike(uint16_t channel)
{
    const uint32_t bit = (uint32_t)1 << (channel & 31u);
    if (${bound}net.step >= STEPS || (net.spikes[$slot][channel >> 5] & bit) != 0) {
        return;
    }
    net.spikes[$slot][channel >> 5] |= bit;
    net.pushed = 1;
    SPIKE(0, channel);
@each at_once
    reach_1(${copy}channel);
    net.awake_1 = 1;
@end
}

@if is_delayed
/* Spikes of `lag` input steps ago reach layer 1 as a delayed copy of the inputs. */
static APART void deliver(uint32_t lag, uint32_t first)
{
    const uint32_t slot = net.slot >= lag ? net.slot - lag : net.slot + ${n_slots}u - lag;
    uint32_t i;
    for (i = 0; i < ${channel_words}u; i++) {
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

@end
$layers/* The decision at this step, from the output spikes of the steps before. */
static APART void decide(void)
{
@if rule.joint
    uint32_t i, best, at = 0;
    if (net.step != ${rule.last}u) {
        return;
    }
@each heads
    best = ${first}u;
    for (i = ${second}u; i < ${end}u; i++) {
        if (net.counts[i] > net.counts[best]) {
            best = i;
        }
    }
    at = at * ${n}u + (best$less);
@end
    net.answer = (int16_t)(joint[at] + 1);
    net.confident = 1;
@else
    uint32_t i, best;
@if rule.least_total
    if (net.answer != 0 || (!(net.step == ${rule.last}u) && (!net.changed || !(net.total >= ${rule.least_total}u)))) {
        return;
    }
    net.changed = 0;
@else
    if (!(net.step == ${rule.last}u)) {
        return;
    }
@end
    best = ${first}u;
    for (i = ${second}u; i < ${end}u; i++) {
        if (net.counts[i] > net.counts[best]) {
            best = i;
        }
    }
@if rule.least_total
    net.confident = net.total >= ${rule.least_total}u$sure;
    if (!net.confident && !(net.step == ${rule.last}u)) {
        return;
    }
@else
    net.confident = 1;
@end
    net.answer = (int16_t)(best$less + 1u);
@end
    net.answered = net.step + 1u;
}

void dse_step(void)
{
    uint32_t i$part;
@if bin_us
    if (net.started) {
        net.end_us += $bin_us;
    }
@end
    if (net.step >= STEPS) {
        return;
    }
@if part
    for (part = 0; part < ${steps_per_sample}u; part++) {
@end
@if is_delayed
${in}for (i = 0; i < ${n_later}u; i++) {
${in}    if (lags[i] <= net.sample$of_part) {
${in}        deliver(lags[i], copies[i]);
${in}    }
${in}}
@end
${in}decide();
@each steps
${in}step_$k();
@end
${in}net.step++;
@if part
    }
@end
@if is_delayed
    net.sample++;
@end
@if several_slots
    net.slot = (uint16_t)(net.slot + 1u < ${n_slots}u ? net.slot + 1u : 0u);
    for (i = 0; i < ${channel_words}u; i++) {
        net.spikes[net.slot][i] = 0;
    }
@if n_events
    for (i = 0; i < ${n_events}u; i++) {
        net.events[i] = 0;
    }
@end
@else
    if (net.pushed) {
        for (i = 0; i < ${channel_words}u; i++) {
            net.spikes[0][i] = 0;
        }
@if n_events
        for (i = 0; i < ${n_events}u; i++) {
            net.events[i] = 0;
        }
@end
        net.pushed = 0;
    }
@end
}

$front_end
@each clearing
APART void $clear($kind *x, uint32_t n)
{
    for (; n > 0; n--) {
        *x++ = 0;
    }
}

@end
/* All states 0. */
static APART void rest(void)
{
@if several_slots
    uint32_t i;
@end
@each arrays
@if slots
    for (i = 0; i < ${slots}u; i++) {
        $clear($place, ${n}u);
    }
@else
    $clear($place, ${n}u);
@end
@end
@each numbers
    net.$name = 0;
@end
    net.step = 0;
    net.total = 0;
    net.answer = 0;
    net.confident = 0;
    net.changed = 0;
}

void dse_reset(void)
{
    rest();
}

void dse_init(void)
{
@if encoder
    net.begun = 0;
@end
@if pooling
    net.started = 0;
@end
    rest();
}

int16_t dse_decision(void)
{
    return (int16_t)(net.answer - 1);
}

uint8_t dse_confident(void)
{
    return net.confident;
}

uint32_t dse_steps(void)
{
    return net.answer == 0 ? net.step : net.answered;
}

uint32_t dse_count(uint16_t output)
{
    return output < ${n_outputs}u ? net.counts[output] : 0u;
}

const char *dse_class_name(int16_t label)
{
    static const char names[] = $names;
    const char *name = names;
    int16_t i;
    if (label < 0 || label >= ${n_classes}) {
        return label == DSE_NO_CLASS ? "none" : "undecided";
    }
    for (i = 0; i < label; i++) {
        while (*name++ != '\0') {
        }
    }
    return name;
}
