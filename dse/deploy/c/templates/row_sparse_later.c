static void $name(uint32_t source)
{
    uint32_t i = ${table}_begin[source], end = ${table}_begin[source + 1u];
    for (; i < end; i++) {
        const uint32_t at = net.now_$k + (uint32_t)${table}_delay[i];
        net.later_$k[at < ${n_later}u ? at : at - ${n_later}u][${table}_column[i]] += $table[i] * $unit;
    }
    net.busy_$k = $n_later;
}

