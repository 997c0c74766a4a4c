$tables
void dse_start(dse_t *net, int64_t t_us)
{
    net->begin_us = t_us + ${start_us};
    net->end_us = net->begin_us + $bin_us;
@if stop_us
    net->stop_us = t_us + $stop_us;
@end
    net->started = 1;
}

uint8_t dse_push(dse_t *net, int64_t t_us, uint16_t x, uint16_t y, uint8_t polarity)
{
    uint32_t column, row, i, j, i_end, j_end, plane;
    (void)polarity;
    if (net->started == 0u) {
        dse_start(net, t_us);
    }
    if ((t_us < net->begin_us)$too_late) {
        return 1;
    }
    if (t_us >= net->end_us) {
        return 0;
    }
    column = (uint32_t)x - ${crop_x}u;
    row = (uint32_t)y - ${crop_y}u;
    if ((net->step >= STEPS) || (column >= ${columns}u) || (row >= ${rows}u)$other_polarity) {
        return 1;
    }
    plane = $plane;
    i_end = first_x[column] + $n_x;
    j_end = first_y[row] + $n_y;
    for (j = first_y[row]; j < j_end; j++) {
        for (i = first_x[column]; i < i_end; i++) {
@if needed
            const uint16_t channel = $channel;
            if (net->events[channel] < ${needed}u) {
                net->events[channel]++;
                if (net->events[channel] == ${needed}u) {
                    dse_push_spike(net, channel);
                }
            }
            net->pushed = 1;
@else
            dse_push_spike(net, $channel);
@end
        }
    }
    return 1;
}

