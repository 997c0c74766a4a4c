@include numbers.c
@if is_level
#ifdef DSE_REAL_SAMPLES
/* The largest whole number up to x >= 0. */
static double whole(double x)
{
    return (x < 9007199254740992.0) ? (double)(int64_t)x : x;
}
#endif

@end
#ifdef DSE_REAL_SAMPLES
#define LEVEL_OF(sample) ((double)(sample))
#define ZERO 0.0
#define THRESHOLDS $exact
@if first
static const dse_level_t begin[$n_sensors] = {
$exact_first};
@end
@if is_level
#define WHOLE_STEPS (theta * whole(size / theta))
@end
@if whole
#else
#define LEVEL_OF(sample) ((sample)$by_unit)
#define ZERO 0
#define THRESHOLDS $whole
@if first
static const dse_level_t begin[$n_sensors] = {
$whole_first};
@end
@if is_level
#define WHOLE_STEPS ((size / theta) * theta)
@end
@end
#endif

/* Send-on-delta: a spike wherever a sample has moved by a threshold since the last spike (reference: $rule). */
uint8_t dse_push(dse_t *net, const dse_sample_t *sample)
{
    static const dse_level_t thresholds[$n_thresholds] = {THRESHOLDS};
    uint32_t k, c, channel;
#ifdef DSE_REAL_SAMPLES
    if (are_numbers(sample) == 0u) {
        return 0;
    }
#endif
    for (k = 0; k < ${n_thresholds}u; k++) {
        const dse_level_t theta = thresholds[k];
        for (c = 0; c < DSE_SENSORS; c++) {
            const dse_level_t x = LEVEL_OF(sample[c]);
            dse_level_t d, size;
            if ($is_first) {
                net->level[$at][c] = $first_level;
            }
            d = x - net->level[$at][c];
            size = (d < ZERO) ? -d : d;
            if (size >= theta) {
@if is_value
                net->level[$at][c] = x;
@end
@if adds
                net->level[$at][c] += (d > ZERO) ? theta : -theta;
@end
@if is_level
                const dse_level_t moved = WHOLE_STEPS;
                net->level[$at][c] += (d > ZERO) ? moved : -moved;
@end
                channel = $channel;
                dse_push_spike(net, (uint16_t)channel);
            }
        }
    }
    net->begun = 1;
    return 1;
}

