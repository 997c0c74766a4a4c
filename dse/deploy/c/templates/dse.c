/* $title
 * Written by dse: do not edit. Static data: $ram_bytes bytes; tables: $table_bytes bytes.
 *
 * States are integers in 1/4096 of a weight unit. Of CUBA-LIF neurons, at every step:
 *     u = leak(u) + 128 * weights of the spikes;  v = leak(v) + u;  spike where v > threshold, then v = 0
 * What is stored between steps has leaked already, so that a spike adds its row of weights at once, and a
 * neuron at rest (all states 0) is passed over. Weights, decays and threshold bound the states within a
 * window: no sum here can overflow. Division truncates toward zero, as C99 says.
 */
#include "dse.h"

#ifdef DSE_TRACE
#define SPIKE(layer, neuron) dse_trace((uint8_t)(layer), (uint16_t)(neuron), net.step)
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

$floats$tables
/* All memory that there is. */
static struct {
$members} net;

$leaks$rows$input$layers$decision$step$front_end
${clearing}/* All states 0. */
static APART void rest(void)
{
$clear    net.step = 0;
    net.total = 0;
    net.answer = 0;
    net.confident = 0;
    net.changed = 0;
}

void dse_reset(void)
{
    rest();
}

void dse_init(void)
{
$init    rest();
}

int16_t dse_decision(void)
{
    return (int16_t)(net.answer - 1);
}

uint8_t dse_confident(void)
{
    return net.confident;
}

uint32_t dse_steps(void)
{
    return net.answer == 0 ? net.step : net.answered;
}

uint32_t dse_count(uint16_t output)
{
    return output < ${n_outputs}u ? net.counts[output] : 0u;
}

const char *dse_class_name(int16_t label)
{
    static const char names[] = $names;
    const char *name = names;
    int16_t i;
    if (label < 0 || label >= ${n_classes}) {
        return label == DSE_NO_CLASS ? "none" : "undecided";
    }
    for (i = 0; i < label; i++) {
        while (*name++ != '\0') {
        }
    }
    return name;
}
