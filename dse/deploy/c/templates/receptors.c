@include numbers.c
static const double lowest[$n_sensors] = {
$low};
static const double span[$n_sensors] = {
$span};
/* a, b, c and d of every kind of receptor: $names. */
static const double kinds[$n_kinds][4] = {$kinds};

@if half_steps
static double held(double v)
{
    const double above = (v > $floor) ? v : $floor;
    return (above < $peak) ? above : $peak;
}

@end
/* Receptors: neurons of Izhikevich, driven by the value of a sensor and by its changes. */
uint8_t dse_push(dse_t *net, const dse_sample_t *sample)
{
    uint32_t q, k, s, j;
#ifdef DSE_REAL_SAMPLES
    if (are_numbers(sample) == 0u) {
        return 0;
    }
#endif
@if n_totals
    uint32_t next_total, oldest = 0;
    if (net->begun == 0u) {
        for (k = 0; k < DSE_SENSORS; k++) {
            net->sums[0][k] = 0;
        }
        net->newest = 0;
        net->n_totals = 1;
    }
    next_total = ((net->newest + 1u) < ${n_totals}u) ? (net->newest + 1u) : 0u;
    for (k = 0; k < DSE_SENSORS; k++) {
        net->sums[next_total][k] = net->sums[net->newest][k] + (double)sample[k];
    }
    net->newest = next_total;
    if (net->n_totals < ${n_totals}u) {
        net->n_totals++;
    }
    if (net->n_totals == ${n_totals}u) {
        oldest = ((next_total + 1u) < ${n_totals}u) ? (next_total + 1u) : 0u;
    }
@end
    for (k = 0; k < DSE_SENSORS; k++) {
@if n_totals
        const uint32_t n_samples = net->n_totals - 1u;
        const double x = (net->sums[next_total][k] - net->sums[oldest][k]) / (double)n_samples;
@else
        const double x = (double)sample[k];
@end
        const double level = (span[k] > 0.0) ? ((x - lowest[k]) / span[k]) : 0.0;
        const double change = (net->begun != 0u) ? ((level - net->last[k]) / $step_s) : 0.0;
        net->last[k] = level;
        for (q = 0; q < ${n_kinds}u; q++) {
            const double a = kinds[q][0], b = kinds[q][1], c = kinds[q][2], d = kinds[q][3];
            const double moved = ((q % 2u) == ${falling}u) ? -change : change;
@if gain_sa
            const double rising = $gain_fa * ((moved > 0.0) ? moved : 0.0);
            const double drive = $gain * ((q == 0u) ? ($gain_sa * level) : rising);
@else
            const double drive = $gain * ($gain_fa * ((moved > 0.0) ? moved : 0.0));
@end
            double v = (net->begun != 0u) ? net->v[q][k] : c, u = (net->begun != 0u) ? net->u[q][k] : (b * c);
            uint32_t n = 0;
            for (s = 0; s < ${solver_steps}u; s++) {
                const double slope = ($A * v + $B) * v + $C - u + drive;
@if half_steps
                const double middle = held(v + $half * slope);
                const double next = middle + $half * (($A * middle + $B) * middle + $C - u + drive), seen = held(next);
@else
                const double seen = v, next = v + $h * slope;
@end
                u = u + $h * (a * (b * seen - u));
                if (next >= $peak) {
                    n++;
                    v = c;
                    u = u + d;
                } else {
                    v = (next > $floor) ? next : $floor;
                }
            }
            net->v[q][k] = v;
            net->u[q][k] = u;
            for (j = 0; (j < n) && (j < ${copies}u); j++) {
                const uint32_t channel = (((j * ${n_kinds}u) + q) * DSE_SENSORS) + k;
                dse_push_spike(net, (uint16_t)channel);
            }
        }
    }
    net->begun = 1;
    return 1;
}

