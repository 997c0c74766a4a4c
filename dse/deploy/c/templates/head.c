#include "dse.h"
@if apart
#include <stddef.h>
@end

#ifdef DSE_TRACE
#define SPIKE(layer, neuron) dse_trace(net, (uint8_t)(layer), (uint16_t)(neuron), net->step)
#else
#define SPIKE(layer, neuron) ((void)0)
#endif

/* Functions that are not inlined, so that the loops of all networks compile alike. */
#if defined(__GNUC__)
#define APART __attribute__((noinline))
#else
#define APART
#endif

#define STEPS ${network_steps}u /* network steps of a window */

@include floats.c
$tables
