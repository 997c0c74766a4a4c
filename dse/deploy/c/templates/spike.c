@if several
for (j = 0; j < n; j++) {
@end
${in}SPIKE($k, i);
@if last
${in}if (net->answer == 0) {
${in}    net->counts[i]++;
@if inside
${in}    if ($inside) {
${in}        net->total++;
${in}        net->changed = 1;
${in}    }
@else
${in}    net->total++;
${in}    net->changed = 1;
@end
${in}}
@else
${in}reach_$next(net, i);
${in}net->awake_$next = 1;
@end
@if several
}
@end
@if back
@if several
net->times[n_fired] = (uint8_t)n;
@end
net->fired[n_fired] = ($fired)i;
n_fired++;
@end
