static void $name(uint32_t source)
{
    const uint32_t *w = $table + source * ${words}u;
    $type *u = net.$state;
    uint32_t i, k;
    for (i = 0; i < ${words}u; i++) {
        uint32_t word = w[i];
        for (k = 0; k < ${per_word}u; k++) {
            u[k] += ((int32_t)((word & ${mask}u) ^ ${sign}u) - $sign) * $unit;
            word >>= $bits;
        }
        u += $per_word;
    }
}

