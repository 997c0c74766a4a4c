/* Squared, from the counts to those of a training sample. */
static $wide distance_to(const dse_t *net, const $small *other)
{
    const $count *here = net->counts;
    $wide sum = 0;
    while (here < &net->counts[$n_features]) {
        const int32_t d = (int32_t)*here++ - (int32_t)*other++;
        sum += ($wide)d * ($wide)d;
    }
    return sum;
}

/* The most frequent class among the $k nearest training samples, in whole numbers: the lowest class on ties, the
 * first of equally distant samples. */
static APART uint32_t classify(dse_t *net)
{
    uint32_t sample, i, n = 0, best = 0;
    for (sample = 0; sample < ${n_samples}u; sample++) {
        const $wide distance = distance_to(net, &stored[sample * ${n_features}u]);
        if ((n == ${k}u) && (distance >= net->distance[n - 1u])) {
            continue;
        }
        if (n < ${k}u) {
            n++;
        }
        for (i = n - 1u; (i > 0u) && (distance < net->distance[i - 1u]); i--) {
            net->distance[i] = net->distance[i - 1u];
            net->vote[i] = net->vote[i - 1u];
        }
        net->distance[i] = distance;
        net->vote[i] = place[sample];
    }
    for (i = 0; i < ${n_places}u; i++) {
        net->votes[i] = 0;
    }
    for (i = 0; i < n; i++) {
        net->votes[net->vote[i]]++;
    }
    for (i = 1; i < ${n_places}u; i++) {
        if (net->votes[i] > net->votes[best]) {
            best = i;
        }
    }
    return best;
}
