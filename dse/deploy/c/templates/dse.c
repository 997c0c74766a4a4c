/* $title
 * Written by dse: do not edit. Memory of a classifier: $ram_bytes bytes; tables: $table_bytes bytes.
 *
 * States are integers in 1/4096 of a weight unit. Of CUBA-LIF neurons, at every step:
 *     u = leak(u) + 128 * weights of the spikes;  v = leak(v) + u;  spike where v > threshold, then v = 0
 * What is stored between steps has leaked already, so that a spike adds its row of weights at once, and a
 * neuron at rest (all states 0) is passed over. Weights, decays and threshold bound the states within a
 * window: no sum here can overflow. Division truncates toward zero, as C99 says.
 */
@include head.c
$leaks${rows}void dse_push_spike(dse_t *net, uint16_t channel)
{
    const uint32_t bit = (uint32_t)1 << (channel & 31u);
@if apart
    if (net->weights == NULL) {
        return;
    }
@end
    if (${bound}(net->step >= STEPS) || ((net->spikes[$slot][channel >> 5] & bit) != 0u)) {
        return;
    }
    net->spikes[$slot][channel >> 5] |= bit;
    net->pushed = 1;
    SPIKE(0, channel);
@each at_once
    reach_1(net, ${copy}channel);
    net->awake_1 = 1;
@end
}

@if is_delayed
/* Spikes of `lag` input steps ago reach layer 1 as a delayed copy of the inputs. */
static APART void deliver(dse_t *net, uint32_t lag, uint32_t first)
{
    const uint32_t slot = (net->slot >= lag) ? (net->slot - lag) : (net->slot + ${n_slots}u - lag);
    uint32_t i;
    for (i = 0; i < ${channel_words}u; i++) {
        uint32_t word = net->spikes[slot][i];
        while (word != 0u) {
            const uint32_t bit = word & (0u - word); /* the lowest that is set */
            uint32_t place = ((bit & 0xAAAAAAAAu) != 0u) ? 1u : 0u;
            place |= ((bit & 0xCCCCCCCCu) != 0u) ? 2u : 0u;
            place |= ((bit & 0xF0F0F0F0u) != 0u) ? 4u : 0u;
            place |= ((bit & 0xFF00FF00u) != 0u) ? 8u : 0u;
            place |= ((bit & 0xFFFF0000u) != 0u) ? 16u : 0u;
            reach_1(net, first + (32u * i) + place);
            net->awake_1 = 1;
            word ^= bit;
        }
    }
}

@end
$layers/* The decision at this step, from the output spikes of the steps before. */
static APART void decide(dse_t *net)
{
    uint32_t i, best;
@if rule.joint
    uint32_t at = 0;
    if (net->step != ${rule.last}u) {
        return;
    }
@each heads
    best = ${first}u;
    for (i = ${second}u; i < ${end}u; i++) {
        if (net->counts[i] > net->counts[best]) {
            best = i;
        }
    }
    at = (at * ${n}u) + (best$less);
@end
    net->answer = (int16_t)(joint[at] + 1);
    net->confident = 1;
@else
@if rule.least_total
    if ((net->answer != 0) ||
        ((net->step != ${rule.last}u) && ((net->changed == 0u) || (net->total < ${rule.least_total}u)))) {
        return;
    }
    net->changed = 0;
@else
    if (net->step != ${rule.last}u) {
        return;
    }
@end
    best = ${first}u;
    for (i = ${second}u; i < ${end}u; i++) {
        if (net->counts[i] > net->counts[best]) {
            best = i;
        }
    }
@if rule.least_total
    net->confident = ((net->total >= ${rule.least_total}u)$sure) ? 1u : 0u;
    if ((net->confident == 0u) && (net->step != ${rule.last}u)) {
        return;
    }
@else
    net->confident = 1;
@end
    best = best$less + 1u;
    net->answer = (int16_t)best;
@end
    net->answered = net->step + 1u;
}

void dse_step(dse_t *net)
{
    uint32_t i$part;
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
@if part
    for (part = 0; part < ${steps_per_sample}u; part++) {
@end
@if is_delayed
${in}for (i = 0; i < ${n_later}u; i++) {
${in}    if ((lags[i] <= net->sample)$of_part) {
${in}        deliver(net, lags[i], copies[i]);
${in}    }
${in}}
@end
${in}decide(net);
@each steps
${in}step_$k(net);
@end
${in}net->step++;
@if part
    }
@end
@if is_delayed
    net->sample++;
@end
@if several_slots
    net->slot = (uint16_t)(((net->slot + 1u) < ${n_slots}u) ? (net->slot + 1u) : 0u);
    for (i = 0; i < ${channel_words}u; i++) {
        net->spikes[net->slot][i] = 0;
    }
@if n_events
    for (i = 0; i < ${n_events}u; i++) {
        net->events[i] = 0;
    }
@end
@else
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
@end
}

uint8_t dse_confident(const dse_t *net)
{
    return net->confident;
}

uint32_t dse_count(const dse_t *net, uint16_t output)
{
    return (output < ${n_outputs}u) ? net->counts[output] : 0u;
}

@include rest.c
