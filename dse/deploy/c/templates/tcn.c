/* y += v w */
static APART void weigh(int32_t v, const int8_t *w, int32_t *y, uint32_t n)
{
    uint32_t i;
    for (i = 0; i < n; i++) {
        y[i] += v * w[i];
    }
}

/* At the end of a bin: it enters the ring of the first layer; what a layer passes on enters the next one's. */
static APART void slide(dse_t *net)
{
    const volatile uint32_t *width = widths; /* read, not known: loops take the same time whatever they are */
    const int8_t *w = filters;
    const int32_t *b = offsets;
    int8_t *ring = net->ring;
    int32_t *y = net->sums;
    uint32_t i, j, k, n = width[0], dilation = 1;
    for (i = 0; i < n; i++) {
        /* Shifted towards minus infinity. */
        const int32_t raised = net->levels[i] + ${half};
        const uint32_t level = (uint32_t)raised >> level_shifts[i], rest = ${half}u >> level_shifts[i];
        const int32_t x = (int32_t)level - (int32_t)rest;
        ring[(net->at[0] * n) + i] = (int8_t)((x > $most_passed) ? $most_passed : ((x < -$least_passed) ? -$least_passed : x));
@if is_cleared
        net->levels[i] = 0;
@end
    }
    for (k = 0; k < ${n_layers}u; k++) {
        const uint32_t n_inputs = n, n_rows = (${n_back}u * dilation) + 1u, now = net->at[k];
        uint32_t row = now;
        net->at[k] = ((now + 1u) < n_rows) ? (now + 1u) : 0u;
@if several_bins
        net->waited[k]++;
        if (net->waited[k] < ${stride}u) {
            break;
        }
        net->waited[k] = 0;
@end
        n = width[k + 1u];
        for (i = 0; i < n; i++) {
            y[i] = b[i];
        }
        for (j = 0; j <= ${n_back}u; j++) {
            const int8_t *x = &ring[row * n_inputs];
            for (i = 0; i < n_inputs; i++) {
                if (x[i] != 0) {
                    weigh((int32_t)x[i], w, y, n);
                }
                w = &w[n];
            }
            row = (row >= dilation) ? (row - dilation) : ((row + n_rows) - dilation);
        }
        b = &b[n];
        ring = &ring[n_rows * n_inputs];
        for (i = 0; i < n; i++) {
            const uint32_t shifted = (uint32_t)y[i] >> filter_shifts[k];
            const int32_t passed = (y[i] <= 0) ? 0 : ((shifted > ${most_passed}u) ? $most_passed : (int32_t)shifted);
            if ((k + 1u) < ${n_layers}u) {
                ring[(net->at[k + 1u] * n) + i] = (int8_t)passed;
            } else {
                net->counts[i] += ($count)passed;
            }
        }
        dilation <<= 1;
    }
}
