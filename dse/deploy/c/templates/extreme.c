/* The class of the largest output of an extreme learning machine whose hidden neurons count. Sums are of double;
 * the engine's are of $precision, in another order. */
static uint32_t classify(void)
{
    uint32_t i, j, best = 0;
    for (j = 0; j < ${n_places}u; j++) {
        net.outputs[j] = 0;
    }
    for (i = 0; i < ${n_hidden}u; i++) {
        double z = 0;
        for (j = 0; j < ${n_features}u; j++) {
            if (net.counts[j] != 0) {
                z += (double)net.counts[j] * input_weight[i * ${n_features}u + j];
            }
        }
        z += bias[i];
        z = z < 0 ? 0 : z > 1 ? 1 : z;
        z = (double)(int32_t)(z * $full) / $full;
        for (j = 0; j < ${n_places}u; j++) {
            net.outputs[j] += z * output_weight[i * ${n_places}u + j];
        }
    }
    for (i = 1; i < ${n_places}u; i++) {
        if (net.outputs[i] > net.outputs[best]) {
            best = i;
        }
    }
    return best;
}
