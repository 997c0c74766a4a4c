/* $title
 * Written by dse $version of the classifier with the SHA-256 $digest: do not edit.
 * Static memory only, no other header than <stdint.h>.
 *
 *     static dse_t net;                a classifier's memory: one for each that runs
 *     dse_init(&net);                  a recording begins
 *     for every step of $step_ms ms:
@if is_spikes
 *         dse_push_spike(&net, channel) of every spike of the step
@end
@if is_samples
 *         dse_push(&net, ...);         a sample of every sensor
@end
@if is_events
 *         dse_push(&net, ...);         every event of the step
@end
 *         dse_step(&net);
 *         if (dse_decision(&net) != DSE_UNDECIDED) ...
 *     dse_reset(&net);                 the next window begins: before its first dse_push
 */
#ifndef DSE_H
#define DSE_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define DSE_VERSION "$version"       /* of dse, which wrote this */
#define DSE_CLASSIFIER "$digest"
#define DSE_CHANNELS ${n_channels}u          /* channels of the network's input spikes */
#define DSE_OUTPUTS ${n_outputs}u            /* output neurons */
#define DSE_CLASSES ${n_classes}u
#define DSE_WINDOW ${n_steps}u               /* steps of a window: the answer comes at its end at the latest */
#define DSE_STEPS_PER_SAMPLE ${steps_per_sample}u     /* network steps per dse_step() */
#define DSE_STEP_MS $step_ms         /* period of dse_step() */
#define DSE_UNDECIDED (-1)
#define DSE_NO_CLASS (-2)            /* of a joint answer: no class has this combination */
@if is_events
#define DSE_EVENTS
@end
@if is_samples
#define DSE_SENSORS ${n_sensors}u
@if not takes_whole
#ifndef DSE_REAL_SAMPLES /* the thresholds are not on an integer grid */
#define DSE_REAL_SAMPLES
#endif
@end
#ifdef DSE_REAL_SAMPLES
typedef float dse_sample_t; /* the encoder computes in double */
#else
typedef int32_t dse_sample_t; /* magnitude below 2^24 */
#endif
@end
@if has_levels
#ifdef DSE_REAL_SAMPLES
typedef double dse_level_t;
#else
typedef int32_t dse_level_t;
#endif
@end

@if apart
struct dse_weights;

@end
/* All memory of a classifier: $ram_bytes bytes$more, yours, static or not, at first 0 or by dse_init(). Do not look inside. */
typedef struct {
@if apart
    const struct dse_weights *weights; /* where dse_load() found them */
@end
@each declared
$text
@end
} dse_t;

@if apart
/* Take the weights of weights.bin, which lie aligned to 8 bytes and stay there. Returns 0, and there are none, if
 * they are damaged or of other code. A dse_t without weights never answers. dse_init() keeps them. */
uint8_t dse_load(dse_t *net, const void *block, uint32_t n_bytes);

@end
/* Forget everything: the next input is the first of a recording. */
void dse_init(dse_t *net);

/* Begin a window: the network is at rest and undecided${reset_comment}. */
void dse_reset(dse_t *net);

@if is_samples
/* One sample of every sensor: the spikes that it gives belong to this step. Returns 0, and does nothing, if a
 * value is no finite number. */
uint8_t dse_push(dse_t *net, const dse_sample_t *sample);
@end
@if is_events
/* Bins are counted from a time; without a call, from the first event. */
void dse_start(dse_t *net, int64_t t_us);

/* An event, in the order of time; polarity: 1 ON, 0 OFF. Returns 0, and does nothing, if it belongs to a
 * later step: dse_step() first. */
uint8_t dse_push(dse_t *net, int64_t t_us, uint16_t x, uint16_t y, uint8_t polarity);
@end

/* Input spike of a channel in this step, from 0; a second one in the same step counts once. */
void dse_push_spike(dse_t *net, uint16_t channel);

/* End the step. After the last step of the window the network stands still until dse_reset(). */
void dse_step(dse_t *net);

/* The answer: a class from 0, DSE_UNDECIDED as long as there is none, or DSE_NO_CLASS. */
int16_t dse_decision(const dse_t *net);

/* 0 where the window ended without the confidence that the rule asks for, else 1. */
uint8_t dse_confident(const dse_t *net);

/* Network steps from dse_reset() to the answer, or so far. */
uint32_t dse_steps(const dse_t *net);

/* Output spikes so far; once there is an answer, those that it was made from. */
uint32_t dse_count(const dse_t *net, uint16_t output);

/* Name of a class. */
const char *dse_class_name(int16_t label);

@if n_windows
#ifndef DSE_NO_SELFTEST
/* 1: the classifier gives here the answers and output spikes that it gave where it was trained, to three windows
 * of spikes, without an encoder; 0: it does not. It begins and ends as dse_init() does. In dse_selftest.c. */
uint8_t dse_selftest(dse_t *net);
#endif

@end
#ifdef DSE_TRACE
/* Yours: called at every spike, with its network step since dse_reset(); layer 0 is the input. */
void dse_trace(const dse_t *net, uint8_t layer, uint16_t neuron, uint32_t step);
#endif

#ifdef __cplusplus
}
#endif

#endif
