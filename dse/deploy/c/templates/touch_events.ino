// $title
// Takes events from your sensor's driver and prints the class once it is decided.
#include <dse.h>

static unsigned long due_us;

// Yours: true, and the event, where the sensor has one.
static bool next_event(int64_t *t_us, uint16_t *x, uint16_t *y, uint8_t *polarity) {
  (void)t_us; (void)x; (void)y; (void)polarity;
  return false;
}

void setup() {
  Serial.begin(115200);
  dse_init();
  due_us = micros();
  dse_start(due_us);
}

void loop() {
  int64_t t_us;
  uint16_t x, y;
  uint8_t polarity;
  while (next_event(&t_us, &x, &y, &polarity)) {
    while (!dse_push(t_us, x, y, polarity)) step();
  }
  while ((long)(micros() - due_us) >= (long)(DSE_STEP_MS * 1000)) step();
}

void step() {
  due_us += (unsigned long)(DSE_STEP_MS * 1000);
  dse_step();
  if (dse_decision() != DSE_UNDECIDED) {
    Serial.println(dse_class_name(dse_decision()));
    dse_reset();
  }
}
