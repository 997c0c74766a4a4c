/* Adds a row of n weights, each as many steps later as its delay, in units of $unit. */
APART void $name($type *later, uint32_t now, uint32_t n_later, uint32_t n, const int8_t *w, const uint8_t *delay)
{
    uint32_t i;
    for (i = 0; i < n; i++) {
        const uint32_t at = now + (uint32_t)delay[i];
        later[(((at < n_later) ? at : (at - n_later)) * n) + i] += w[i] * $unit;
    }
}

