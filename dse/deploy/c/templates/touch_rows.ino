// $title
// A timer reads the sensor into a ring, once per step; the loop classifies what waits there, and sleeps.
#include <dse.h>

// $windows
@include constants.ino
#define RING 8u  // rows that may wait while a step of the classifier takes longer: a power of 2
@if is_samples
#define WIDTH DSE_SENSORS
typedef dse_sample_t value_t;

// The sensor: SENSOR_ADC, SENSOR_SPI or SENSOR_I2C, defined here or for the compiler, or a file like theirs.
#if defined(SENSOR_SPI)
#include "sensor_spi.h"
#elif defined(SENSOR_I2C)
#include "sensor_i2c.h"
#else
#include "sensor_adc.h"
#endif
@else
#define WIDTH DSE_CHANNELS
typedef uint8_t value_t;

static void begin_sensor() {}

// Yours: whether a channel spikes in this step.
static bool spikes(uint16_t channel) {
  (void)channel;
  return false;
}

static void read_sensor(value_t *row) {
  for (unsigned long channel = 0; channel < WIDTH; channel++) row[channel] = spikes((uint16_t)channel);
}
@end

static dse_t net;
static value_t ring[RING][WIDTH];
static volatile uint8_t n_read, n_taken;  // rows, modulo 256
static volatile bool is_late;             // a row found no room

// The timer's interrupt.
static void read_row() {
  if ((uint8_t)(n_read - n_taken) == RING) {
    is_late = true;
    return;
  }
  read_sensor(ring[n_read % RING]);
  __atomic_thread_fence(__ATOMIC_SEQ_CST);  // the row is there before it is counted
  n_read = n_read + 1;
}

#include "board.h"

@include window.ino
@if is_samples
@if at_contact
@include contact.ino
@end
@end

void setup() {
  Serial.begin(115200);
  begin_recording();
  begin_sensor();
  begin_timer();
}

void loop() {
  if (is_late) {  // rows are missing: what began before is lost
    Serial.println("late");
    n_taken = n_read;
    is_late = false;
    begin_recording();
  }
  if (n_taken == n_read) {
    rest();
    return;
  }
  __atomic_thread_fence(__ATOMIC_SEQ_CST);
  const value_t *row = ring[n_taken % RING];
@if is_samples
  if (dse_push(&net, row)) end_step($touches);  // else a value is no number: the sample is left out
@else
  unsigned long n_spikes = 0;
  for (unsigned long channel = 0; channel < WIDTH; channel++) {
    if (row[channel]) {
      dse_push_spike(&net, (uint16_t)channel);
      n_spikes++;
    }
  }
  end_step(n_spikes >= ONSET);
@end
  __atomic_thread_fence(__ATOMIC_SEQ_CST);  // the row was read before its place is free
  n_taken = n_taken + 1;
}
