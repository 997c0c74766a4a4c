/* A board: a converter (MCP3008), electrodes (MPR121) and multiplexers (CD74HC4067) give the numbers of a row,
 * which it reads from stdin once per tick of the timer, or of the clock. */
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
void setup(void);
void loop(void);
static unsigned long now;
static unsigned seed;
static int row[64], mux, selected = -1, spi_step, spi_channel, i2c_chip, i2c_step, i2c_register;
static int is_running[4];
static bool is_read, is_over, is_masked;
static void (*tick)(void);
static void read_row(void)
{
    for (int i = 0; i < WIDTH; i++) { is_over |= scanf("%d", row + i) != 1; }
    is_read = !is_over;
}
unsigned long micros(void) { return now; }
void delay(unsigned long ms) { if (ms != 1) { abort(); } }
void delayMicroseconds(unsigned us) { (void)us; }
void noInterrupts(void) { is_masked = true; }
void interrupts(void) { is_masked = false; }
void wait_for_interrupt(void) { if (!is_masked) { abort(); } }
void set_tick(void (*called)(void)) { tick = called; }
void set_period(uint32_t us) { if (us != STEP_US) { abort(); } }
void pinMode(int pin, int mode) { (void)pin; (void)mode; }
void digitalWrite(int pin, int level)
{
    if (pin >= 7) { selected = level ? -1 : pin - 7; spi_step = 0; }
    else if (level) { mux |= 1 << (pin - 2); }
    else { mux &= ~(1 << (pin - 2)); }
}
int analogRead(int pin) { return row[(pin - 14) * PER_PIN + mux]; }
uint8_t spi_transfer(uint8_t byte)
{
    if (selected < 0) { abort(); }
    if (spi_step++ == 0) {
        if (byte != 1) { abort(); }
        return 255;
    }
    if (spi_step == 2) {
        spi_channel = 8 * selected + (byte >> 4 & 7);
        return (uint8_t)(0xF8 | row[spi_channel] >> 8);
    }
    return (uint8_t)row[spi_channel];
}
void i2c_begin(uint8_t address) { i2c_chip = address - 0x5A; i2c_step = 0; }
void i2c_write(uint8_t byte)
{
    if (i2c_step++ == 0) { i2c_register = byte; }
    else if (i2c_register == 0x5E) { is_running[i2c_chip] = byte == 0x8F; }
}
void i2c_end(void) {}
uint8_t i2c_read(void)
{
    const int at = i2c_register++ - 4, value = is_running[i2c_chip] ? row[12 * i2c_chip + at / 2] : 0;
    return (uint8_t)(at % 2 ? value >> 8 : value);
}
bool spike_of(uint16_t channel) { return row[channel] != 0; }
bool event_of(int64_t *t_us, uint16_t *x, uint16_t *y, uint8_t *polarity)
{
    if (!is_read) { read_row(); }
    if (is_over || (unsigned long)row[0] > now) { return false; }
    *t_us = row[0]; *x = (uint16_t)row[1]; *y = (uint16_t)row[2]; *polarity = (uint8_t)row[3];
    is_read = false;
    return true;
}
void print_line(const char *text) { puts(text); }
/* Rows that come while the loop is elsewhere, as after a long step: at most MOST of them. */
static int n_waiting(void)
{
    seed = seed * 1103515245u + 12345u;
    return (int)(seed >> 16) % (MOST + 1);
}
int main(void)
{
    setup();
    while (!is_over) {
        int n = tick ? n_waiting() : 1;
        for (; n > 0 && ARE_STEPS; n--) {
            read_row();
            if (is_over) { break; }
            if (tick) { tick(); }
        }
        if (is_over && !tick && ARE_STEPS) { break; }
        for (n = 0; n < (ARE_STEPS ? MOST + 2 : 1); n++) { loop(); }
        now += STEP_US;
    }
    return 0;
}
