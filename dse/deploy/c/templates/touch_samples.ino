// $title
// Reads a sensor array at its own pace and prints the class once it is decided.
#include <dse.h>

static dse_t net;

// $windows
@include constants.ino

static dse_sample_t samples[DSE_SENSORS];
static unsigned long due_us;

@include window.ino
@if at_contact
@include contact.ino
@end

void setup() {
  Serial.begin(115200);
  dse_init(&net);
  due_us = micros();
}

void loop() {
  if ((long)(micros() - due_us) < 0) return;
  due_us += (unsigned long)(DSE_STEP_MS * 1000);
  for (unsigned i = 0; i < DSE_SENSORS; i++) samples[i] = analogRead(A0 + i);  // your sensor
  if (!dse_push(&net, samples)) return;  // a value is no number: the sample is left out
  end_step($touches);
}
