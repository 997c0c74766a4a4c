/* Adds a row of words, each of $per_word weights of $bits bits, in units of $unit. */
APART void $name($type *restrict u, const uint32_t *restrict w, uint32_t words)
{
    for (; words > 0; words--) {
        uint32_t word = *w++, k;
        for (k = 0; k < ${per_word}u; k++) {
            u[k] += ((int32_t)((word & ${mask}u) ^ ${sign}u) - $sign) * $unit;
            word >>= $bits;
        }
        u += $per_word;
    }
}

