// Analogue taxels: one at each pin from A0 on, or sixteen behind a CD74HC4067 at each (PER_PIN 16).
#ifndef PER_PIN
#define PER_PIN 1
#endif

static const uint8_t select_pins[] = {2, 3, 4, 5};  // S0 to S3 of all multiplexers

static void begin_sensor() {
  for (unsigned bit = 0; bit < 4 && PER_PIN > 1; bit++) pinMode(select_pins[bit], OUTPUT);
}

static void read_sensor(dse_sample_t *row) {
  for (unsigned k = 0; k < PER_PIN; k++) {
    if (PER_PIN > 1) {
      for (unsigned bit = 0; bit < 4; bit++) digitalWrite(select_pins[bit], k >> bit & 1 ? HIGH : LOW);
      delayMicroseconds(2);
    }
    for (unsigned i = k; i < DSE_SENSORS; i += PER_PIN) row[i] = analogRead(A0 + i / PER_PIN);
  }
}
