/* Adds a row of weights, four at a time and the rest, in units of $unit. */
APART void $name($type *restrict u, const int8_t *restrict w, uint32_t fours, uint32_t rest)
{
    for (; fours > 0; fours--) {
        u[0] += w[0] * $unit;
        u[1] += w[1] * $unit;
        u[2] += w[2] * $unit;
        u[3] += w[3] * $unit;
        u += 4;
        w += 4;
    }
    for (; rest > 0; rest--) {
        *u++ += *w++ * $unit;
    }
}

