/* Layer $k of $n_layers: $n_neurons neurons ($kinds). |$a| <= ${bounds.first}, |$b| <= ${bounds.second} within a window. */
static APART void step_$k(dse_t *net)
{
    uint32_t i;
    $type left = 0;
@if several
    uint32_t j;
@end
@if back
    uint32_t n_fired = 0;
@end
@if held
    if ((net->awake_$k == 0u) && (net->busy_$k == 0u)) {
@else
    if (net->awake_$k == 0u) {
@end
        return;
    }
    for (i = 0; i < ${n_neurons}u; i++) {
@if held
        $type $a = net->${a}_$k[i] + $held, $b = net->${b}_$k[i];
@else
        $type $a = net->${a}_$k[i], $b = net->${b}_$k[i];
@end
@if held
        $held = 0;
@end
        if (($a | $b) == 0) {
@if held
            net->${a}_$k[i] = 0; /* what arrived may have cancelled it */
@end
            continue; /* at rest */
        }
$update        net->${a}_$k[i] = $a;
        net->${b}_$k[i] = $b;
        left |= $a | $b;
    }
    net->awake_$k = (left != 0) ? 1u : 0u;
@if held
    net->now_$k = (uint8_t)(((net->now_$k + 1u) < ${n_later}u) ? (net->now_$k + 1u) : 0u);
    net->busy_$k -= (net->busy_$k != 0u) ? 1u : 0u;
@end
@if back
    for (i = 0; i < n_fired; i++) {
@if several
        for (j = 0; j < net->times[i]; j++) {
            return_$k(net, net->fired[i]);
        }
@else
        return_$k(net, net->fired[i]);
@end
        net->awake_$k = 1;
    }
@end
}

