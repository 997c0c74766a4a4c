const int32_t lost = (int32_t)v - decayed((int32_t)v, $of_b);
u = decayed(SATURATED(u), $of_a);
v += SATURATED(u - lost);
v = SATURATED(v);
if (v >= $threshold) {
@if several
    const uint32_t n = (uint32_t)(v / $threshold < $most_spikes ? v / $threshold : $most_spikes);
    v -= (int32_t)n * $threshold;
@else
    v -= $threshold;
@end
$spikes}
