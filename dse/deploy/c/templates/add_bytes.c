/* Adds a row of weights, four at a time and up to three more, in units of $unit. */
APART void $name($type *u, const int8_t *w, uint32_t fours, uint32_t rest)
{
    for (; fours > 0u; fours--) {
        const $type a = w[0], b = w[1], c = w[2], d = w[3]; /* first: for the compiler, sums may be weights */
        u[0] += a * $unit;
        u[1] += b * $unit;
        u[2] += c * $unit;
        u[3] += d * $unit;
        u += 4;
        w += 4;
    }
    if (rest > 0u) {
        u[0] += w[0] * $unit;
    }
    if (rest > 1u) {
        u[1] += w[1] * $unit;
    }
    if (rest > 2u) {
        u[2] += w[2] * $unit;
    }
}

