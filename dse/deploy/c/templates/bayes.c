@if several_leaves
/* Features that are added at once, and how many sums then join the one before: numpy's order. */
static const uint8_t leaf_length[$n_leaves] = {$leaves};
static const uint8_t leaf_joins[$n_leaves] = {$joins};

@end
static double term(const dse_t *net, uint32_t first, uint32_t feature)
{
    const double d = (double)net->counts[feature] - mean[first + feature], square = d * d;
    return square / variance[first + feature];
}

/* Sum of (count - mean)^2 / variance over up to 128 features of a class. */
static double spread(const dse_t *net, uint32_t first, uint32_t feature, uint32_t n)
{
    uint32_t i = 0;
    double sum = 0.0;
@if by_eights
    if (n >= 8u) {
        uint32_t k;
        double part[8];
        for (k = 0; k < 8u; k++) {
            part[k] = term(net, first, feature + k);
        }
        for (i = 8; i < (n - (n % 8u)); i += 8u) {
            for (k = 0; k < 8u; k++) {
                part[k] += term(net, first, feature + i + k);
            }
        }
        sum = ((part[0] + part[1]) + (part[2] + part[3])) + ((part[4] + part[5]) + (part[6] + part[7]));
    }
@end
    for (; i < n; i++) {
        sum += term(net, first, feature + i);
    }
    return sum;
}

/* The most likely class; the lowest on ties. */
static APART uint32_t classify(const dse_t *net)
{
    uint32_t c, best = 0;
    double highest = 0.0;
    for (c = 0; c < ${n_places}u; c++) {
@if several_leaves
        double sums[$depth];
        uint32_t leaf, k, n = 0, feature = 0;
        for (leaf = 0; leaf < ${n_leaves}u; leaf++) {
            sums[n] = spread(net, c * ${n_features}u, feature, leaf_length[leaf]);
            feature += leaf_length[leaf];
            for (k = 0; k < leaf_joins[leaf]; k++) {
                n--;
                sums[n] += sums[n + 1u];
            }
            n++;
        }
        const double half = 0.5 * sums[0];
@else
        const double half = 0.5 * spread(net, c * ${n_features}u, 0, ${n_features}u);
@end
        const double likely = constant[c] - half, score = prior[c] + likely;
        if ((c == 0u) || (score > highest)) {
            highest = score;
            best = c;
        }
    }
    return best;
}
