/* Layer $k of $n_layers: $n neurons ($kinds). |$a| <= $first, |$b| <= $second within a window. */
static APART void step_$k(void)
{
    uint32_t i;
    $type left = 0;
$declare    if (!net.awake_$k$busy) {
        return;
    }
    for (i = 0; i < ${n}u; i++) {
        $type $a = net.${a}_$k[i]$arriving, $b = net.${b}_$k[i];
$arrived        if (($a | $b) == 0) {
$rested            continue; /* at rest */
        }
$update        net.${a}_$k[i] = $a;
        net.${b}_$k[i] = $b;
        left |= $a | $b;
    }
    net.awake_$k = left != 0;
$after}

