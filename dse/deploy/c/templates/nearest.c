/* The most frequent class among the $k nearest training samples, in whole numbers: the lowest class on ties, the
 * first of equally distant samples. */
static uint32_t classify(void)
{
    uint32_t sample, i, n = 0, best = 0;
    for (sample = 0; sample < ${n_samples}u; sample++) {
        $wide distance = 0;
        for (i = 0; i < ${n_features}u; i++) {
            const int32_t d = (int32_t)net.counts[i] - (int32_t)stored[sample * ${n_features}u + i];
            distance += ($wide)d * ($wide)d;
        }
        if (n == ${k}u && distance >= net.distance[n - 1u]) {
            continue;
        }
        if (n < ${k}u) {
            n++;
        }
        for (i = n - 1u; i > 0 && distance < net.distance[i - 1u]; i--) {
            net.distance[i] = net.distance[i - 1u];
            net.vote[i] = net.vote[i - 1u];
        }
        net.distance[i] = distance;
        net.vote[i] = place[sample];
    }
    for (i = 0; i < ${n_places}u; i++) {
        net.votes[i] = 0;
    }
    for (i = 0; i < n; i++) {
        net.votes[net.vote[i]]++;
    }
    for (i = 1; i < ${n_places}u; i++) {
        if (net.votes[i] > net.votes[best]) {
            best = i;
        }
    }
    return best;
}
