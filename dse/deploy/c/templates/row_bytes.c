static void $name(uint32_t source)
{
    const int8_t *w = $table + source * ${n}u;
    uint32_t i;
    for (i = 0; i < ${n}u; i++) {
        net.$state[i] += w[i] * $unit;
    }
}

