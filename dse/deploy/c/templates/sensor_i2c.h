// MPR121: twelve capacitive electrodes each, at the addresses 0x5A to 0x5D. NXP, MPR121 data sheet, 5.
#include <Wire.h>

#define FIRST_ADDRESS 0x5A
#define PER_CHIP 12u

static void set_register(uint8_t address, uint8_t name, uint8_t value) {
  Wire.beginTransmission(address);
  Wire.write(name);
  Wire.write(value);
  Wire.endTransmission();
}

static void begin_sensor() {
  Wire.begin();
  Wire.setClock(400000);
  for (unsigned i = 0; i < DSE_SENSORS; i += PER_CHIP) {
    const uint8_t address = FIRST_ADDRESS + i / PER_CHIP;
    set_register(address, 0x80, 0x63);  // soft reset
    set_register(address, 0x5D, 0x20);  // four samples, a new value every millisecond
    set_register(address, 0x5E, 0x8F);  // run, with all electrodes
  }
}

static void read_sensor(dse_sample_t *row) {
  for (unsigned i = 0; i < DSE_SENSORS; i += PER_CHIP) {
    const uint8_t address = FIRST_ADDRESS + i / PER_CHIP;
    const unsigned n = DSE_SENSORS - i < PER_CHIP ? DSE_SENSORS - i : PER_CHIP;
    Wire.beginTransmission(address);
    Wire.write(0x04);  // filtered data, two bytes each, the low one first
    Wire.endTransmission(false);
    Wire.requestFrom(address, (uint8_t)(2 * n));
    for (unsigned k = 0; k < n; k++) {
      const int low = Wire.read();
      row[i + k] = low | (Wire.read() & 3) << 8;
    }
  }
}
