/* y += v w */
static APART void add(int32_t v, const int8_t *w, int32_t *y, uint32_t n)
{
    uint32_t i;
    for (i = 0; i < n; i++) {
        y[i] += v * w[i];
    }
}

/* The class of the largest output. Sizes are read, not known: loops take the same time whatever they are. */
static APART uint32_t classify(dse_t *net)
{
    const volatile uint32_t *size = sizes;
    const int8_t *w = weight;
    const int32_t *b = bias;
    int32_t *y = net->units;
    uint32_t i, j, n = size[1], best = 0;
@if n_shifts
    uint32_t k;
@end
    for (i = 0; i < n; i++) {
        y[i] = b[i];
    }
    for (j = 0; j < size[0]; j++) {
        const $count v = net->counts[j];
        if (v != $zero_count) {
            add((int32_t)v, w, y, n);
        }
        w = &w[n];
    }
@if n_shifts
    for (k = 0; k < ${n_shifts}u; k++) {
        const int32_t *x = y;
        const uint32_t n_inputs = n;
        b = &b[n];
        y = &y[n];
        n = size[k + 2u];
        for (i = 0; i < n; i++) {
            y[i] = b[i];
        }
        for (j = 0; j < n_inputs; j++) {
            const uint32_t shifted = (uint32_t)x[j] >> shifts[k];
            const int32_t v = (x[j] > 0) ? (int32_t)shifted : 0;
            if (v != 0) {
                add((v < $most) ? v : $most, w, y, n);
            }
            w = &w[n];
        }
    }
@end
@if several_outputs
    for (i = 1; i < n; i++) {
        if (y[i] > y[best]) {
            best = i;
        }
    }
@else
    best = (y[0] > 0) ? 1u : 0u; /* of two classes, one output > 0 says the second */
@end
    return best;
}

