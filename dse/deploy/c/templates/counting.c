/* $title
 * Written by dse: do not edit. Static data: $ram_bytes bytes; tables: $table_bytes bytes.
 *
 * Family $family: the spikes of every counting window are counted, and the answer comes at the end of the last one.
 */
#include "dse.h"

#ifdef DSE_TRACE
#define SPIKE(layer, neuron) dse_trace((uint8_t)(layer), (uint16_t)(neuron), net.step)
#else
#define SPIKE(layer, neuron) ((void)0)
#endif

#ifdef __GNUC__ /* not inlined: a step without an answer saves no registers for it */
#define APART __attribute__((noinline))
#else
#define APART
#endif
#define STEPS ${n_steps}u /* steps of a window */

@include floats.c
$tables
@include level.c
/* All memory that there is. */
static struct {
@each declared
$text
@end
} net;

void dse_push_spike(uint16_t channel)
{
    const uint32_t bit = (uint32_t)1 << (channel & 31u);
    if (${bound}net.step >= STEPS || (net.spikes[0][channel >> 5] & bit) != 0) {
        return;
    }
    net.spikes[0][channel >> 5] |= bit;
    net.pushed = 1;
    SPIKE(0, channel);
@if slides
    if (net.window < ${n_windows}u) {
        net.levels[place[channel]] += sign[channel];
    }
@else
@if reads_levels
    if (net.window < ${n_windows}u) {
        const int32_t rise = sign[channel];
        int32_t *sum = net.counts + 2u * (${n_levels}u * net.window + place[channel]);
        net.levels[place[channel]] += rise;
        sum[0] += rise * (int32_t)(ends[net.window] - net.step);
        sum[1] += rise < 0 ? -rise : rise;
    }
@else
    if (net.window < ${n_windows}u && rows[net.window] >= 0) {
        net.counts[$place]++;
    }
@end
@end
}

$classify
void dse_step(void)
{
    uint32_t i;
@if bin_us
    if (net.started) {
        net.end_us += $bin_us;
    }
@end
    if (net.step >= STEPS) {
        return;
    }
    net.step++;
    if (net.window < ${n_windows}u && net.step == ends[net.window]) {
        net.window++;
@if slides
        slide();
@end
@if reads_levels
        for (i = 0; i < ${n_levels}u && net.window < ${n_windows}u; i++) {
            const int32_t n_steps = (int32_t)(ends[net.window] - ends[net.window - 1u]);
            net.counts[2u * (${n_levels}u * net.window + i)] = net.levels[i] * n_steps;
        }
@end
        if (net.window == ${n_windows}u) {
@if reads_levels
            for (i = 0; i < ${n_features}u; i++) {
                const int32_t sum = net.counts[i], size = sum < 0 ? -sum : sum;
                const int32_t shifted = sum < 0 ? -((size + $rest) >> $shift) : size >> $shift;
                net.counts[i] = shifted > $held ? $held : shifted < -$held ? -$held : shifted;
            }
@end
            net.answer = (int16_t)(labels[classify()] + 1);
            net.answered = net.step;
        }
    }
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
}

$front_end
void dse_reset(void)
{
    uint32_t i;
    for (i = 0; i < ${n_features}u; i++) {
        net.counts[i] = 0;
    }
@if n_levels
    for (i = 0; i < ${n_levels}u; i++) {
        net.levels[i] = 0;
    }
@end
@if slides
    for (i = 0; i < ${n_groups}u * ${n_ring}u; i++) {
        net.ring[i] = 0;
    }
    net.at = 0;
@end
    for (i = 0; i < ${channel_words}u; i++) {
        net.spikes[0][i] = 0;
    }
@if n_events
    for (i = 0; i < ${n_events}u; i++) {
        net.events[i] = 0;
    }
@end
    net.pushed = 0;
    net.step = 0;
    net.window = 0;
    net.answer = 0;
}

void dse_init(void)
{
@if encoder
    net.begun = 0;
@end
@if pooling
    net.started = 0;
@end
    dse_reset();
}

int16_t dse_decision(void)
{
    return (int16_t)(net.answer - 1);
}

uint8_t dse_confident(void)
{
    return 1;
}

uint32_t dse_steps(void)
{
    return net.answer == 0 ? net.step : net.answered;
}

uint32_t dse_count(uint16_t output)
{
    (void)output;
    return 0;
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
