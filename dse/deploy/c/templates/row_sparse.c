static void $name(uint32_t source)
{
    uint32_t i = ${table}_begin[source], end = ${table}_begin[source + 1u];
    for (; i < end; i++) {
        net.$state[${table}_column[i]] += $table[i] * $unit;
    }
}

