$front_end
@each clearing
APART void $clear($kind *x, uint32_t n)
{
    uint32_t i;
    for (i = 0; i < n; i++) {
        x[i] = 0;
    }
}

@end
/* All states 0. */
static APART void rest(dse_t *net)
{
@if several_slots
    uint32_t i;
@end
@each arrays
@if slots
    for (i = 0; i < ${slots}u; i++) {
        $clear($place, ${n}u);
    }
@else
    $clear($place, ${n}u);
@end
@end
@each numbers
    net->$name = 0;
@end
}

void dse_reset(dse_t *net)
{
    rest(net);
}

void dse_init(dse_t *net)
{
@if encoder
    net->begun = 0;
@end
@if pooling
    net->started = 0;
@end
    rest(net);
}

int16_t dse_decision(const dse_t *net)
{
    return (int16_t)(net->answer - 1);
}

uint32_t dse_steps(const dse_t *net)
{
    return (net->answer == 0) ? net->step : net->answered;
}

const char *dse_class_name(int16_t label)
{
    static const char names[] = $names;
    uint32_t at = 0;
    int16_t i;
    if ((label < 0) || (label >= ${n_classes})) {
        return (label == DSE_NO_CLASS) ? "none" : "undecided";
    }
    for (i = 0; i < label; i++) {
        while (names[at] != '\0') {
            at++;
        }
        at++;
    }
    return &names[at];
}
@if apart
@include load.c
@end
