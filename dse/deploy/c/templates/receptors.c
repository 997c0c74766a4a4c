static const double lowest[$n_sensors] = {
$low};
static const double span[$n_sensors] = {
$span};
/* a, b, c and d of every kind of receptor: $names. */
static const double kinds[$n_kinds][4] = {$kinds};

$held/* Receptors: neurons of Izhikevich, driven by the value of a sensor and by its changes. */
uint8_t dse_push(const dse_sample_t *sample)
{
    uint32_t q, k, s, j;
$refuse$advance    for (k = 0; k < DSE_SENSORS; k++) {
        const double x = $value;
        const double level = span[k] > 0 ? (x - lowest[k]) / span[k] : 0;
        const double change = net.begun ? (level - net.last[k]) / $step_s : 0;
        net.last[k] = level;
        for (q = 0; q < ${n_kinds}u; q++) {
            const double a = kinds[q][0], b = kinds[q][1], c = kinds[q][2], d = kinds[q][3];
            const double moved = q % 2u == ${falling}u ? -change : change;
            const double drive = $gain * ($drive);
            double v = net.begun ? net.v[q][k] : c, u = net.begun ? net.u[q][k] : b * c;
            uint32_t n = 0;
            for (s = 0; s < ${solver_steps}u; s++) {
                const double slope = ($A * v + $B) * v + $C - u + drive;
$method                u = u + $h * (a * (b * seen - u));
                if (next >= $peak) {
                    n++;
                    v = c;
                    u = u + d;
                } else {
                    v = next > $floor ? next : $floor;
                }
            }
            net.v[q][k] = v;
            net.u[q][k] = u;
            for (j = 0; j < n && j < ${copies}u; j++) {
                dse_push_spike((uint16_t)((j * ${n_kinds}u + q) * DSE_SENSORS + k));
            }
        }
    }
    net.begun = 1;
    return 1;
}

