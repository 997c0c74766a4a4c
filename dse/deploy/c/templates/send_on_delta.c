/* Send-on-delta: a spike wherever a sample has moved by a threshold since the last spike (reference: $rule). */
uint8_t dse_push(const dse_sample_t *sample)
{
    static const level_t thresholds[$n_thresholds] = {$thresholds};
    uint32_t k, c;
$refuse    for (k = 0; k < ${n_thresholds}u; k++) {
        const level_t theta = thresholds[k];
        for (c = 0; c < DSE_SENSORS; c++) {
            const level_t x = (level_t)sample[c] * LEVEL_UNIT;
            level_t d, size;
            if (!net.begun) {
                net.level[k][c] = x;
            }
            d = x - net.level[k][c];
            size = d < 0 ? -d : d;
            if (size >= theta) {
$move                dse_push_spike((uint16_t)($channel));
            }
        }
    }
    net.begun = 1;
    return 1;
}

