enum { MSBFIRST, SPI_MODE0 };
struct SPISettings { SPISettings(unsigned long hz, int, int) { if (hz > 1350000) spi_transfer(255); } };
struct Spi {
  void begin() {}
  void beginTransaction(SPISettings) {}
  uint8_t transfer(uint8_t byte) { return spi_transfer(byte); }
  void endTransaction() {}
};
static Spi SPI;
