/* At the end of a bin: what each group sums enters its ring, and kernels above their thresholds are counted. */
static APART void slide(dse_t *net)
{
    int16_t *row = &net->ring[net->at];
    const int16_t *now = &row[$n_bins]; /* the last bins lie before it in a row */
    const $back *tap = taps;
    uint32_t i, j, dilation = 1;
    for (i = 0; i < ${n_groups}u; i++) {
        int32_t z = 0;
        for (j = first[i]; j < first[i + 1u]; j++) {
            z += turn[j] * net->levels[member[j]];
        }
@if most_level
        z = (z > $most_level) ? $most_level : ((z < -$most_level) ? -$most_level : z);
@end
        row[0] = (int16_t)z;
        row[$n_bins] = (int16_t)z;
        row = &row[$n_ring];
    }
    for (i = 0; i < ${n_kernels}u; i++) {
        const int16_t *then = now;
        int32_t sum = *then;
        for (j = 0; j < 8u; j++) {
            then = &then[-(int32_t)dilation];
            sum += *then;
        }
@if n_thresholds
        sum = (3 * (*(now - tap[0]) + *(now - tap[1]) + *(now - tap[2]))) - sum;
        for (j = ${n_thresholds}u * i; (j < (${n_thresholds}u * (i + 1u))) && (sum > threshold[j]); j++) {
            net->counts[j]++;
        }
@else
        if (((3 * (*(now - tap[0]) + *(now - tap[1]) + *(now - tap[2]))) - sum) > threshold[i]) {
            net->counts[i]++;
        }
@end
        tap = &tap[3];
        dilation <<= 1;
        if (dilation > ${longest}u) {
            dilation = 1;
            now = &now[$n_ring];
        }
    }
@if n_whole
    for (i = 0; i < ${n_whole}u; i++) { /* now all taps of dilation 2^i lie in the window */
        for (j = ${n_dilations}u + i; (net->window == (8u << i)) && (j < ${n_kernels}u); j += ${two_groups}u) {
            uint32_t k;
            for (k = 0; k < ${per_kernel}u; k++) {
                net->counts[(${per_kernel}u * j) + k] = 0;
            }
        }
    }
@end
    net->at = ((net->at + 1u) < ${n_bins}u) ? (net->at + 1u) : 0u;
}

