@if full
/* What a unit's counter holds of y in (0, 1]: whole steps. */
static $real counted($real y)
{
    const $real scaled = y * $full;
    return ($real)(int32_t)scaled * $step;
}

@end
/* y: units of a layer, weighted sums of x, the units before; without any, of the features. */
static APART void layer(const dse_t *net, const $real *x, const $real *w, const $real *b, $real *y,
                        const uint32_t *size, uint8_t is_first, uint8_t is_hidden)
{
    const uint32_t n_inputs = size[0], n = size[1];
    const $real *row = w;
    uint32_t i, j;
    for (i = 0; i < n; i++) {
        y[i] = b[i];
    }
    for (j = 0; j < n_inputs; j++) {
        const $real v = (is_first != 0u) ? ($input) : x[j];
        if (v != $zero) {
            for (i = 0; i < n; i++) {
                y[i] += v * row[i];
            }
        }
        row = &row[n];
    }
    for (i = 0; (i < n) && (is_hidden != 0u); i++) {
        y[i] = (y[i] < $zero) ? $zero : ($positive);
    }
}

/* The class of the largest output. Sums are of $real, as the engine's, which adds in another order. */
static APART uint32_t classify(dse_t *net)
{
    const $real *w = weight, *b = bias, *x = net->units;
    $real *y = net->units;
    uint32_t k, best = 0;
    for (k = 0; k < ${n_layers}u; k++) {
        layer(net, x, w, b, y, &sizes[k], (k == 0u) ? 1u : 0u, ((k + 1u) < ${n_layers}u) ? 1u : 0u);
        w = &w[sizes[k] * sizes[k + 1u]];
        b = &b[sizes[k + 1u]];
        x = y;
        y = &y[sizes[k + 1u]];
    }
@if several_outputs
    for (k = 1; k < ${n_outputs}u; k++) {
        if (x[k] > x[best]) {
            best = k;
        }
    }
@else
    best = (x[0] > $zero) ? 1u : 0u; /* of two classes, one output > 0 says the second */
@end
    return best;
}
