/* Runs commands from stdin and writes spikes and answers to stdout: numbers of 32 bits, in the machine's order.
 *
 * in:   INIT | RESET | STEP | SPIKE channel | SAMPLE one per sensor | START t_low t_high |
 *       EVENT t_low t_high x y polarity | ANSWER;  spikes before RESET are not written
 * out:  spike: layer, step, neuron;  answer: -1, label, steps, confident, outputs, count of every output
 */
#include "dse.h"
#include <stdio.h>
#include <stdlib.h>

enum { INIT, RESET, STEP, SPIKE, SAMPLE, START, EVENT, ANSWER };

static int in_window;

static void put(int32_t x)
{
    if (fwrite(&x, sizeof x, 1, stdout) != 1) {
        exit(3);
    }
}

static int32_t get(void)
{
    int32_t x;
    if (fread(&x, sizeof x, 1, stdin) != 1) {
        exit(3);
    }
    return x;
}

#ifdef DSE_EVENTS
static int64_t get_time(void)
{
    const uint32_t low = (uint32_t)get();
    return (int64_t)(((uint64_t)(uint32_t)get() << 32) | low);
}
#endif

void dse_trace(uint8_t layer, uint16_t neuron, uint32_t step)
{
    if (in_window) {
        put(layer);
        put((int32_t)step);
        put(neuron);
    }
}

int main(void)
{
    int32_t command;
    while (fread(&command, sizeof command, 1, stdin) == 1) {
        switch (command) {
        case INIT:
            dse_init();
            in_window = 0;
            break;
        case RESET:
            dse_reset();
            in_window = 1;
            break;
        case STEP:
            dse_step();
            break;
        case SPIKE:
            dse_push_spike((uint16_t)get());
            break;
#ifdef DSE_SENSORS
        case SAMPLE: {
            dse_sample_t sample[DSE_SENSORS];
            if (fread(sample, sizeof sample[0], DSE_SENSORS, stdin) != DSE_SENSORS) {
                return 3;
            }
            dse_push(sample);
            break;
        }
#endif
#ifdef DSE_EVENTS
        case START:
            dse_start(get_time());
            break;
        case EVENT: {
            const int64_t t_us = get_time();
            const uint16_t x = (uint16_t)get(), y = (uint16_t)get();
            if (!dse_push(t_us, x, y, (uint8_t)get())) {
                return 4;
            }
            break;
        }
#endif
        case ANSWER: {
            const uint32_t n = DSE_OUTPUTS;
            uint32_t i;
            put(-1);
            put(dse_decision());
            put((int32_t)dse_steps());
            put(dse_confident());
            put((int32_t)n);
            for (i = 0; i < n; i++) {
                put((int32_t)dse_count((uint16_t)i));
            }
            break;
        }
        default:
            return 3;
        }
    }
    return 0;
}
