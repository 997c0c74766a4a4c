/* $title
 * Written by dse: do not edit. Static memory only, no other header than <stdint.h>.
 *
 *     dse_init();                      a recording begins
 *     for every step of $step_ms ms:
@if is_spikes
 *         dse_push_spike(channel) of every spike of the step
@end
@if is_samples
 *         dse_push(...);               a sample of every sensor
@end
@if is_events
 *         dse_push(...);               every event of the step
@end
 *         dse_step();
 *         if (dse_decision() != DSE_UNDECIDED) ...
 *     dse_reset();                     the next window begins: before its first dse_push
 */
#ifndef DSE_H
#define DSE_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

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

/* Forget everything: the next input is the first of a recording. */
void dse_init(void);

/* Begin a window: the network is at rest and undecided${reset_comment}. */
void dse_reset(void);

@if is_samples
/* One sample of every sensor: the spikes that it gives belong to this step. Returns 0, and does nothing, if a
 * value is no finite number. */
uint8_t dse_push(const dse_sample_t *sample);
@end
@if is_events
/* Bins are counted from a time; without a call, from the first event. */
void dse_start(int64_t t_us);

/* An event, in the order of time; polarity: 1 ON, 0 OFF. Returns 0, and does nothing, if it belongs to a
 * later step: dse_step() first. */
uint8_t dse_push(int64_t t_us, uint16_t x, uint16_t y, uint8_t polarity);
@end

/* Input spike of a channel in this step, from 0; a second one in the same step counts once. */
void dse_push_spike(uint16_t channel);

/* End the step. After the last step of the window the network stands still until dse_reset(). */
void dse_step(void);

/* The answer: a class from 0, DSE_UNDECIDED as long as there is none, or DSE_NO_CLASS. */
int16_t dse_decision(void);

/* 0 where the window ended without the confidence that the rule asks for, else 1. */
uint8_t dse_confident(void);

/* Network steps from dse_reset() to the answer, or so far. */
uint32_t dse_steps(void);

/* Output spikes so far; once there is an answer, those that it was made from. */
uint32_t dse_count(uint16_t output);

/* Name of a class. */
const char *dse_class_name(int16_t label);

#ifdef DSE_TRACE
/* Yours: called at every spike, with its network step since dse_reset(); layer 0 is the input. */
void dse_trace(uint8_t layer, uint16_t neuron, uint32_t step);
#endif

#ifdef __cplusplus
}
#endif

#endif
