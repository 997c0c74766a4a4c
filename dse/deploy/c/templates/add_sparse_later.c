/* Adds weights of lists, each as many steps later as its delay, in units of $unit. */
APART void $name($type *restrict later, uint32_t now, uint32_t n_later, uint32_t n,
                 const $column_type *restrict column, const int8_t *restrict w,
                 const uint8_t *restrict delay, uint32_t begin, uint32_t end)
{
    uint32_t i;
    for (i = begin; i < end; i++) {
        const uint32_t at = now + (uint32_t)delay[i];
        later[(at < n_later ? at : at - n_later) * n + column[i]] += w[i] * $unit;
    }
}

