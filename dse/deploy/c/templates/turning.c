const $product c = first_$k[i], s = second_$k[i], before = x;
if (y > $threshold) {
@if reset
    y = 0;
@end
$spikes}
x = $cast(((c * before) - (s * y)) / $scale);
y = $cast(((s * before) + (c * y)) / $scale);
