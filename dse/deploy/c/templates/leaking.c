$b += $a;
if ($b > $threshold) {
    $b = 0;
$spikes}
@if of_a
$a = $of_a;
@end
@if of_b
$b = $of_b;
@end
