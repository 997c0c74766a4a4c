static double term(uint32_t first, uint32_t feature)
{
    const double d = net.counts[feature] - mean[first + feature], square = d * d;
    return square / variance[first + feature];
}

/* Sum of (count - mean)^2 / variance over n features of a class: in pairs, in numpy's order. */
static double spread(uint32_t first, uint32_t feature, uint32_t n)
{
    uint32_t i = 0, k;
    double sum = 0;
    if (n > 128u) {
        k = n / 2u;
        k -= k % 8u;
        sum = spread(first, feature, k);
        return sum + spread(first, feature + k, n - k);
    }
    if (n >= 8u) {
        double part[8];
        for (k = 0; k < 8u; k++) {
            part[k] = term(first, feature + k);
        }
        for (i = 8; i < n - n % 8u; i += 8u) {
            for (k = 0; k < 8u; k++) {
                part[k] += term(first, feature + i + k);
            }
        }
        sum = ((part[0] + part[1]) + (part[2] + part[3])) + ((part[4] + part[5]) + (part[6] + part[7]));
    }
    for (; i < n; i++) {
        sum += term(first, feature + i);
    }
    return sum;
}

/* The most likely class; the lowest on ties. */
static APART uint32_t classify(void)
{
    uint32_t c, best = 0;
    double highest = 0;
    for (c = 0; c < ${n_places}u; c++) {
        const double half = 0.5 * spread(c * ${n_features}u, 0, ${n_features}u);
        const double likely = constant[c] - half, score = prior[c] + likely;
        if (c == 0 || score > highest) {
            highest = score;
            best = c;
        }
    }
    return best;
}
