/* $title
 * Written by dse: do not edit. Memory of a classifier: $ram_bytes bytes; tables: $table_bytes bytes.
 *
 * Family $family: the spikes of every counting window are counted, and the answer comes at the end of the last one.
 */
@include head.c
void dse_push_spike(dse_t *net, uint16_t channel)
{
    const uint32_t bit = (uint32_t)1 << (channel & 31u);
@if apart
    if (net->weights == NULL) {
        return;
    }
@end
    if (${bound}(net->step >= STEPS) || ((net->spikes[0][channel >> 5] & bit) != 0u)) {
        return;
    }
    net->spikes[0][channel >> 5] |= bit;
    net->pushed = 1;
    SPIKE(0, channel);
@if slides
    if (net->window < ${n_windows}u) {
        net->levels[place[channel]] += sign[channel];
    }
@else
@if reads_levels
    if (net->window < ${n_windows}u) {
        const int32_t rise = sign[channel];
        int32_t *sum = &net->counts[2u * ((${n_levels}u * net->window) + place[channel])];
        net->levels[place[channel]] += rise;
        sum[0] += rise * (int32_t)(ends[net->window] - net->step);
        sum[1] += (rise < 0) ? -rise : rise;
    }
@else
    if ((net->window < ${n_windows}u) && (rows[net->window] >= 0)) {
        net->counts[$counted_at]++;
    }
@end
@end
}

$classify
void dse_step(dse_t *net)
{
    uint32_t i;
@if bin_us
    if (net->started != 0u) {
        net->end_us += $bin_us;
    }
@end
@if apart
    if ((net->weights == NULL) || (net->step >= STEPS)) {
@else
    if (net->step >= STEPS) {
@end
        return;
    }
    net->step++;
    if ((net->window < ${n_windows}u) && (net->step == ends[net->window])) {
        net->window++;
@if slides
        slide(net);
@end
@if reads_levels
        for (i = 0; (i < ${n_levels}u) && (net->window < ${n_windows}u); i++) {
            const int32_t n_steps = (int32_t)(ends[net->window] - ends[net->window - 1u]);
            net->counts[2u * ((${n_levels}u * net->window) + i)] = net->levels[i] * n_steps;
        }
@end
        if (net->window == ${n_windows}u) {
@if reads_levels
            for (i = 0; i < ${n_features}u; i++) {
                const int32_t sum = net->counts[i], size = (sum < 0) ? -sum : sum;
                const uint32_t steps = ((uint32_t)size + ((sum < 0) ? ${rest}u : 0u)) >> $shift;
                const int32_t shifted = (sum < 0) ? -(int32_t)steps : (int32_t)steps;
                net->counts[i] = (shifted > $held) ? $held : ((shifted < -$held) ? -$held : shifted);
            }
@end
            net->answer = (int16_t)(labels[classify(net)] + 1);
            net->answered = net->step;
        }
    }
    if (net->pushed != 0u) {
        for (i = 0; i < ${channel_words}u; i++) {
            net->spikes[0][i] = 0;
        }
@if n_events
        for (i = 0; i < ${n_events}u; i++) {
            net->events[i] = 0;
        }
@end
        net->pushed = 0;
    }
}

uint8_t dse_confident(const dse_t *net)
{
    (void)net;
    return 1;
}

uint32_t dse_count(const dse_t *net, uint16_t output)
{
    (void)net;
    (void)output;
    return 0;
}

@include rest.c
