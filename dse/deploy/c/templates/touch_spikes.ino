// $title
// Takes spikes from your encoder and prints the class once it is decided.
#include <dse.h>

static dse_t net;

// $windows
@include constants.ino

static unsigned long due_us;

// Yours: whether a channel spikes in this step.
static bool spikes(uint16_t channel) {
  (void)channel;
  return false;
}

@include window.ino

void setup() {
  Serial.begin(115200);
  dse_init(&net);
  due_us = micros();
}

void loop() {
  if ((long)(micros() - due_us) < 0) return;
  due_us += (unsigned long)(DSE_STEP_MS * 1000);
  unsigned long n_spikes = 0;
  for (unsigned long channel = 0; channel < DSE_CHANNELS; channel++) {
    if (spikes((uint16_t)channel)) {
      dse_push_spike(&net, (uint16_t)channel);
      n_spikes++;
    }
  }
  end_step(n_spikes >= ONSET);
}
