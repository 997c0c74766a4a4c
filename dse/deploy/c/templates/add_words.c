/* Adds a row of words, each of $per_word weights of $bits bits, in units of $unit. */
APART void $name($type *u, const uint32_t *w, uint32_t words)
{
    for (; words > 0u; words--) {
        uint32_t word = *w++, k;
        for (k = 0; k < ${per_word}u; k++) {
            const uint32_t field = (word & ${mask}u) ^ ${sign}u;
            u[k] += ((int32_t)field - $sign) * $unit;
            word >>= $bits;
        }
        u += $per_word;
    }
}

