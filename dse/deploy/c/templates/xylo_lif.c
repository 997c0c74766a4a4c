const int32_t lost = (int32_t)v - decayed((int32_t)v, $of_b);
u = decayed(SATURATED(u), $of_a);
v += SATURATED(u - lost);
v = SATURATED(v);
if (v >= $threshold) {
@if several
    const $type times = v$per_threshold, fired = (times < $most_spikes) ? times : $most_spikes;
    const uint32_t n = (uint32_t)fired;
    v -= fired$by_threshold;
@else
    v -= $threshold;
@end
$spikes}
