/* Adds weights from `begin` to `end` of lists, each to its column, in units of $unit. */
APART void $name($type *u, const $column_type *column, const int8_t *w, uint32_t begin, uint32_t end)
{
    uint32_t i;
    for (i = begin; i < end; i++) {
        u[column[i]] += w[i] * $unit;
    }
}

