/* y: units of a layer, weighted sums of x, the units before, or 0: of the features. */
static APART void layer(const $real *x, const $real *w, const $real *b, $real *y, const uint32_t *size, int hidden)
{
    const uint32_t n_inputs = size[0], n = size[1];
    uint32_t i, j;
    for (i = 0; i < n; i++) {
        y[i] = b[i];
    }
    for (j = 0; j < n_inputs; j++) {
        const $real v = x == 0 ? $input : x[j];
        if (v != 0) {
            for (i = 0; i < n; i++) {
                y[i] += v * w[i];
            }
        }
        w += n;
    }
    for (i = 0; i < n && hidden; i++) {
        y[i] = y[i] < 0 ? 0 : $positive;
    }
}

/* The class of the largest output. Sums are of $real, as the engine's, which adds in another order. */
static APART uint32_t classify(void)
{
    const $real *w = weight, *b = bias, *x = 0;
    $real *y = net.units;
    uint32_t i, k, best = 0;
    for (k = 0; k < ${n_layers}u; k++) {
        layer(x, w, b, y, sizes + k, k + 1u < ${n_layers}u);
        w += sizes[k] * sizes[k + 1u];
        b += sizes[k + 1u];
        x = y;
        y += sizes[k + 1u];
    }
    for (i = 1; i < ${n_outputs}u; i++) {
        if (x[i] > x[best]) {
            best = i;
        }
    }
    return $answer;
}
