// $title
// Takes spikes from your encoder and prints the class once it is decided.
#include <dse.h>

static unsigned long due_us;

// Yours: whether a channel spikes in this step.
static bool spikes(uint16_t channel) {
  (void)channel;
  return false;
}

void setup() {
  Serial.begin(115200);
  dse_init();
  due_us = micros();
}

void loop() {
  if ((long)(micros() - due_us) < 0) return;
  due_us += (unsigned long)(DSE_STEP_MS * 1000);
  for (uint16_t channel = 0; channel < DSE_CHANNELS; channel++) {
    if (spikes(channel)) dse_push_spike(channel);
  }
  dse_step();
  if (dse_decision() != DSE_UNDECIDED) {
    Serial.println(dse_class_name(dse_decision()));
    dse_reset();
  }
}
