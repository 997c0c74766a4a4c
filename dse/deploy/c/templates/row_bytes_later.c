static void $name(uint32_t source)
{
    const int8_t *w = $table + source * ${n}u;
    const uint8_t *delay = ${table}_delay + source * ${n}u;
    uint32_t i;
    for (i = 0; i < ${n}u; i++) {
        const uint32_t at = net.now_$k + (uint32_t)delay[i];
        net.later_$k[at < ${n_later}u ? at : at - ${n_later}u][i] += w[i] * $unit;
    }
    net.busy_$k = $n_later;
}

