/* Adds weights from `begin` to `end` of lists, each to its column, in units of $unit. */
APART void $name($type *restrict u, const $column_type *restrict column, const int8_t *restrict w,
                 uint32_t begin, uint32_t end)
{
    for (; begin < end; begin++) {
        u[column[begin]] += w[begin] * $unit;
    }
}

