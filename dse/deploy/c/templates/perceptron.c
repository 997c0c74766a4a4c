/* The class of the largest output. Sums are of double; the engine's are of float, in another order. */
static uint32_t classify(void)
{
    uint32_t i, j, best = 0;
$layers    for (i = 1; i < ${n_places}u; i++) {
        if (net.$last[i] > net.$last[best]) {
            best = i;
        }
    }
    return best;
}
