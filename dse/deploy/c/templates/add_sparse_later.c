/* Adds weights of lists, each as many steps later as its delay, in units of $unit. */
APART void $name($type *later, uint32_t now, uint32_t n_later, uint32_t n, const $column_type *column,
                 const int8_t *w, const uint8_t *delay, uint32_t begin, uint32_t end)
{
    uint32_t i;
    for (i = begin; i < end; i++) {
        const uint32_t at = now + (uint32_t)delay[i];
        later[(((at < n_later) ? at : (at - n_later)) * n) + column[i]] += w[i] * $unit;
    }
}

