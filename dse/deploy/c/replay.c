/* Runs commands from stdin and writes what came of them to stdout: numbers of 32 bits, in the machine's order.
 *
 * in:   INIT | RESET | STEP | SPIKE channel | SAMPLE one per sensor | START t_low t_high |
 *       EVENT t_low t_high x y polarity | ANSWER;  spikes before RESET are not written
 * out:  spike: layer, step, neuron;  answer: -1, label, steps, confident, outputs, count of every output
 *
 * With DSE_TIMES it runs them as often as its argument says, and writes the nanoseconds of every step since RESET
 * where spikes would be: from the end of the step before to its own end, and so with what is pushed in it.
 */
#ifdef DSE_TIMES
#define _POSIX_C_SOURCE 199309L
#include <string.h>
#include <time.h>
#endif
#include "dse.h"

static dse_t net; /* before what the emulator counts as its own */

#ifdef DSE_WEIGHTS
#include "weights.h"
#endif
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

#ifdef DSE_TIMES
static int32_t *numbers, *taken; /* all of stdin, read before anything is timed; times of steps */
static size_t n_numbers, n_read, n_taken;
static int64_t before;

static int take(void *to, size_t n)
{
    if (n_read + n > n_numbers) {
        return 0;
    }
    memcpy(to, numbers + n_read, n * sizeof *numbers);
    n_read += n;
    return 1;
}

static int64_t now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}
#else
static int take(void *to, size_t n)
{
    return fread(to, 4, n, stdin) == n;
}
#endif

static int32_t get(void)
{
    int32_t x;
    if (!take(&x, 1)) {
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

void dse_trace(const dse_t *of, uint8_t layer, uint16_t neuron, uint32_t step)
{
    (void)of;
    if (in_window) {
        put(layer);
        put((int32_t)step);
        put(neuron);
    }
}

static int run(void)
{
    int32_t command;
#ifdef DSE_WEIGHTS
    if (!dse_load(&net, weights, N_WEIGHT_BYTES)) {
        return 5;
    }
#endif
    while (take(&command, 1)) {
        switch (command) {
        case INIT:
            dse_init(&net);
            in_window = 0;
            break;
        case RESET:
            dse_reset(&net);
            in_window = 1;
#ifdef DSE_TIMES
            n_taken = 0;
            before = now_ns();
#endif
            break;
        case STEP:
            dse_step(&net);
#ifdef DSE_TIMES
            taken[n_taken] = (int32_t)(now_ns() - before);
            before += taken[n_taken++];
#endif
            break;
        case SPIKE:
            dse_push_spike(&net, (uint16_t)get());
            break;
#ifdef DSE_SENSORS
        case SAMPLE: {
            dse_sample_t sample[DSE_SENSORS];
            if (!take(sample, DSE_SENSORS)) {
                return 3;
            }
            dse_push(&net, sample);
            break;
        }
#endif
#ifdef DSE_EVENTS
        case START:
            dse_start(&net, get_time());
            break;
        case EVENT: {
            const int64_t t_us = get_time();
            const uint16_t x = (uint16_t)get(), y = (uint16_t)get();
            if (!dse_push(&net, t_us, x, y, (uint8_t)get())) {
                return 4;
            }
            break;
        }
#endif
        case ANSWER: {
            const uint32_t n = DSE_OUTPUTS;
            uint32_t i;
#ifdef DSE_TIMES
            for (i = 0; i < n_taken; i++) {
                put(taken[i]);
            }
            n_taken = 0;
#endif
            put(-1);
            put(dse_decision(&net));
            put((int32_t)dse_steps(&net));
            put(dse_confident(&net));
            put((int32_t)n);
            for (i = 0; i < n; i++) {
                put((int32_t)dse_count(&net, (uint16_t)i));
            }
            break;
        }
        default:
            return 3;
        }
    }
    return 0;
}

#ifdef DSE_TIMES
int main(int argc, char **argv)
{
    size_t capacity = 0, n;
    long repetitions = argc > 1 ? strtol(argv[1], NULL, 10) : 1;
    int failed = 0;
    do {
        if (n_numbers == capacity) {
            capacity = 2 * capacity + 65536;
            numbers = realloc(numbers, capacity * sizeof *numbers);
            if (numbers == NULL) {
                return 3;
            }
        }
        n = fread(numbers + n_numbers, sizeof *numbers, capacity - n_numbers, stdin);
        n_numbers += n;
    } while (n > 0);
    taken = malloc((n_numbers + 1) * sizeof *taken);
    if (taken == NULL) {
        return 3;
    }
    while (!failed && repetitions-- > 0) {
        n_read = 0;
        failed = run();
    }
    return failed;
}
#else
int main(void)
{
    return run();
}
#endif
