/* $title: its self-test.
 * Written by dse $version: do not edit. It takes flash where it is called; -DDSE_NO_SELFTEST leaves it out.
 *
 * Three windows of spikes are made here. What they must give is what the engine gave that trained the classifier.
 */
#include "dse.h"

#ifndef DSE_NO_SELFTEST
static const struct {
    uint32_t seed;
    uint32_t halvings; /* of the rates of channels */
    uint32_t steps;    /* network steps until the answer */
    uint32_t spikes;   /* sum of all output spikes with their steps */
    int16_t label;
    uint8_t confident;
} windows[$n_windows] = {
@each tests
    {${seed}u, ${halvings}u, ${steps}u, ${spikes}u, $label, $confident},
@end
};

/* Eight bits, made of a number. */
static uint32_t mixed(uint32_t number)
{
    uint32_t x = number * 2654435761u;
    x = (x ^ (x >> 15)) * 2246822519u;
    return (x ^ (x >> 13)) & 255u;
}

uint8_t dse_selftest(dse_t *net)
{
    uint8_t passed = 1;
    uint32_t k, t, i;
    for (k = 0; k < ${n_windows}u; k++) {
        uint32_t number = windows[k].seed, spikes = 2166136261u;
        dse_init(net);
        for (t = 0; (t < DSE_WINDOW) && (dse_decision(net) == DSE_UNDECIDED); t++) {
            for (i = 0; i < DSE_CHANNELS; i++) {
                if (mixed(number) < (mixed(~(windows[k].seed + i)) >> windows[k].halvings)) {
                    dse_push_spike(net, (uint16_t)i);
                }
                number++;
            }
            dse_step(net);
@if n_outputs
            for (i = 0; i < DSE_OUTPUTS; i++) {
                spikes = (spikes ^ dse_count(net, (uint16_t)i)) * 16777619u;
            }
@end
        }
        if ((dse_decision(net) != windows[k].label) || (dse_steps(net) != windows[k].steps) ||
            (dse_confident(net) != windows[k].confident) || (spikes != windows[k].spikes)) {
            passed = 0;
        }
    }
    dse_init(net);
    return passed;
}
#endif
