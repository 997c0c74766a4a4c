// $title
// Takes events from your sensor's driver and prints the class once it is decided.
#include <dse.h>

static dse_t net;

// $windows
@include constants.ino

static unsigned long due_us;
static int64_t t0_us;
static unsigned long n_events;  // of this step, in the crop

// Yours: true, and the event, where the sensor has one.
static bool next_event(int64_t *t_us, uint16_t *x, uint16_t *y, uint8_t *polarity) {
  (void)t_us; (void)x; (void)y; (void)polarity;
  return false;
}

@include window.ino

static void end_bin() {
  due_us += (unsigned long)(DSE_STEP_MS * 1000);
  end_step(n_events >= ONSET);
  n_events = 0;
}

static bool is_in_crop(int64_t t_us, uint16_t x, uint16_t y) {
  const uint32_t column = (uint32_t)x - CROP_X, row = (uint32_t)y - CROP_Y;
  return t_us - t0_us >= START_US && t_us - t0_us < END_US && column < CROP_COLUMNS && row < CROP_ROWS;
}

void setup() {
  Serial.begin(115200);
  dse_init(&net);
  t0_us = due_us = micros();
  dse_start(&net, t0_us);
  due_us += START_US;
}

void loop() {
  int64_t t_us;
  uint16_t x, y;
  uint8_t polarity;
  while (next_event(&t_us, &x, &y, &polarity)) {
    while (!dse_push(&net, t_us, x, y, polarity)) end_bin();
    n_events += is_in_crop(t_us, x, y);
  }
  while ((long)(micros() - due_us) >= (long)(DSE_STEP_MS * 1000)) end_bin();
}
