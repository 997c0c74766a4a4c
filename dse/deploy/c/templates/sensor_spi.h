// MCP3008: converters of eight channels and 10 bits. Microchip, DS21295, 6.1.
#include <SPI.h>

#define CHIPS ((DSE_SENSORS + 7) / 8)
#define FIRST_SELECT 7  // pin that selects the first one; those of others follow

static void begin_sensor() {
  SPI.begin();
  for (unsigned chip = 0; chip < CHIPS; chip++) {
    pinMode(FIRST_SELECT + chip, OUTPUT);
    digitalWrite(FIRST_SELECT + chip, HIGH);
  }
}

static void read_sensor(dse_sample_t *row) {
  SPI.beginTransaction(SPISettings(1000000, MSBFIRST, SPI_MODE0));
  for (unsigned i = 0; i < DSE_SENSORS; i++) {
    digitalWrite(FIRST_SELECT + i / 8, LOW);
    SPI.transfer(1);
    const int high = SPI.transfer((uint8_t)(0x80 | i % 8 << 4)) & 3;
    row[i] = high << 8 | SPI.transfer(0);
    digitalWrite(FIRST_SELECT + i / 8, HIGH);
  }
  SPI.endTransaction();
}
