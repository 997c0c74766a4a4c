// The parts of Arduino that the sketch uses; board.c has them.
#pragma once
#include <stdint.h>
#include <stddef.h>
enum { A0 = 14, LOW = 0, HIGH = 1, OUTPUT = 1 };
extern "C" {
unsigned long micros(void);
void delay(unsigned long ms);
void delayMicroseconds(unsigned us);
void noInterrupts(void);
void interrupts(void);
void wait_for_interrupt(void);
void set_tick(void (*tick)(void));
void set_period(uint32_t us);
void pinMode(int pin, int mode);
void digitalWrite(int pin, int level);
int analogRead(int pin);
uint8_t spi_transfer(uint8_t byte);
void i2c_begin(uint8_t address);
void i2c_write(uint8_t byte);
void i2c_end(void);
uint8_t i2c_read(void);
bool spike_of(uint16_t channel);
bool event_of(int64_t *t_us, uint16_t *x, uint16_t *y, uint8_t *polarity);
void print_line(const char *text);
}
struct Port { void begin(unsigned long) {} void println(const char *text) { print_line(text); } };
static Port Serial;

// What each core has of timers and sleep; set_tick takes what the timer calls.
#if defined(ARDUINO_ARCH_STM32)
enum Format { MICROSEC_FORMAT };
enum Timer { TIMER_TONE };
struct HardwareTimer {
  HardwareTimer(Timer) {}
  void setOverflow(uint32_t us, Format) { set_period(us); }
  void attachInterrupt(void (*tick)(void)) { held = tick; }
  void resume() { set_tick(held); }
  void (*held)(void);
};
#define __WFI wait_for_interrupt
#elif defined(ARDUINO_ARCH_RP2040)
struct repeating_timer_t { int unused; };
static bool (*tick_of_timer)(repeating_timer_t *);
static void call_tick() { if (!tick_of_timer(nullptr)) set_tick(nullptr); }
static inline bool add_repeating_timer_us(int64_t us, bool (*tick)(repeating_timer_t *), void *,
                                          repeating_timer_t *) {
  set_period((uint32_t)-us);
  tick_of_timer = tick;
  set_tick(call_tick);
  return true;
}
#define __wfi wait_for_interrupt
#elif defined(ARDUINO_ARCH_ESP32)
struct esp_timer_create_args_t { void (*callback)(void *); };
typedef int esp_timer_handle_t;
static void (*tick_of_timer)(void *);
static void call_tick() { tick_of_timer(nullptr); }
static inline void esp_timer_create(const esp_timer_create_args_t *how, esp_timer_handle_t *) { tick_of_timer = how->callback; }
static inline void esp_timer_start_periodic(esp_timer_handle_t, uint32_t us) { set_period(us); set_tick(call_tick); }
#endif
