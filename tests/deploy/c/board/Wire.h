struct I2c {
  void begin() {}
  void setClock(unsigned long) {}
  void beginTransmission(uint8_t address) { i2c_begin(address); }
  void write(uint8_t byte) { i2c_write(byte); }
  void endTransmission(bool = true) { i2c_end(); }
  void requestFrom(uint8_t address, uint8_t) { i2c_begin(address); }
  int read() { return i2c_read(); }
};
static I2c Wire;
