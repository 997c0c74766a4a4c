/* Times steps: runs the commands of stdin, as in replay.c, a number of times, and writes nanoseconds to stdout.
 *
 * out, for every repetition and recording:  int32 time of every step since RESET, -1, label, steps
 * A step is timed from the end of the one before to its own end, and so with what is pushed in it.
 */
#define _POSIX_C_SOURCE 199309L
#include "dse.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { INIT, RESET, STEP, SPIKE, SAMPLE, START, EVENT, ANSWER };

static int32_t *command;
static size_t n_commands;

static int64_t now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

static void put(int32_t x)
{
    if (fwrite(&x, sizeof x, 1, stdout) != 1) {
        exit(3);
    }
}

#ifdef DSE_EVENTS
static int64_t time_at(size_t i)
{
    return (int64_t)(((uint64_t)(uint32_t)command[i + 1] << 32) | (uint32_t)command[i]);
}
#endif

static void run(int32_t *taken)
{
    size_t i = 0, n_steps = 0, k;
    int64_t before = 0, now;
    while (i < n_commands) {
        switch (command[i++]) {
        case INIT:
            dse_init();
            break;
        case RESET:
            dse_reset();
            n_steps = 0;
            before = now_ns();
            break;
        case STEP:
            dse_step();
            now = now_ns();
            taken[n_steps++] = (int32_t)(now - before);
            before = now;
            break;
        case SPIKE:
            dse_push_spike((uint16_t)command[i++]);
            break;
#ifdef DSE_SENSORS
        case SAMPLE: {
            dse_sample_t sample[DSE_SENSORS];
            memcpy(sample, command + i, sizeof sample);
            i += DSE_SENSORS;
            dse_push(sample);
            break;
        }
#endif
#ifdef DSE_EVENTS
        case START:
            dse_start(time_at(i));
            i += 2;
            break;
        case EVENT:
            (void)dse_push(time_at(i), (uint16_t)command[i + 2], (uint16_t)command[i + 3], (uint8_t)command[i + 4]);
            i += 5;
            break;
#endif
        case ANSWER:
            for (k = 0; k < n_steps; k++) {
                put(taken[k]);
            }
            put(-1);
            put(dse_decision());
            put((int32_t)dse_steps());
            n_steps = 0;
            break;
        default:
            exit(3);
        }
    }
}

int main(int argc, char **argv)
{
    size_t capacity = 0, n;
    long repetitions = argc > 1 ? strtol(argv[1], NULL, 10) : 1;
    int32_t *taken;
    do {
        if (n_commands == capacity) {
            capacity = 2 * capacity + 65536;
            command = realloc(command, capacity * sizeof *command);
            if (command == NULL) {
                return 3;
            }
        }
        n = fread(command + n_commands, sizeof *command, capacity - n_commands, stdin);
        n_commands += n;
    } while (n > 0);
    taken = malloc((n_commands + 1) * sizeof *taken);
    if (taken == NULL) {
        return 3;
    }
    while (repetitions-- > 0) {
        run(taken);
    }
    return 0;
}
