@include numbers.c
@if is_level
#ifdef DSE_REAL_SAMPLES
/* The largest whole number up to x >= 0. */
static double whole(double x)
{
    return x < 9007199254740992.0 ? (double)(int64_t)x : x;
}
#endif

@end
#ifdef DSE_REAL_SAMPLES
#define THRESHOLDS $exact
@if first
static const level_t first[$n_sensors] = {
$exact_first};
@end
@if is_level
#define WHOLE_STEPS (theta * whole(size / theta))
@end
@if whole
#else
#define THRESHOLDS $whole
@if first
static const level_t first[$n_sensors] = {
$whole_first};
@end
@if is_level
#define WHOLE_STEPS (size / theta * theta)
@end
@end
#endif

/* Send-on-delta: a spike wherever a sample has moved by a threshold since the last spike (reference: $rule). */
uint8_t dse_push(const dse_sample_t *sample)
{
    static const level_t thresholds[$n_thresholds] = {THRESHOLDS};
    uint32_t k, c;
#ifdef DSE_REAL_SAMPLES
    if (!are_numbers(sample)) {
        return 0;
    }
#endif
    for (k = 0; k < ${n_thresholds}u; k++) {
        const level_t theta = thresholds[k];
        for (c = 0; c < DSE_SENSORS; c++) {
            const level_t x = (level_t)sample[c] * LEVEL_UNIT;
            level_t d, size;
            if (!net.begun$and_once) {
                net.level[$at][c] = $first_level;
            }
            d = x - net.level[$at][c];
            size = d < 0 ? -d : d;
            if (size >= theta) {
@if is_value
                net.level[$at][c] = x;
@end
@if adds
                net.level[$at][c] += d > 0 ? theta : -theta;
@end
@if is_level
                const level_t moved = WHOLE_STEPS;
                net.level[$at][c] += d > 0 ? moved : -moved;
@end
                dse_push_spike((uint16_t)($channel));
            }
        }
    }
    net.begun = 1;
    return 1;
}

