// What differs between boards: a timer that calls read_row() once per step, and how the processor rests.
#define STEP_US ((uint32_t)(DSE_STEP_MS * 1000 + 0.5))

#if defined(ARDUINO_ARCH_STM32)

static void begin_timer() {
  static HardwareTimer timer(TIMER_TONE);
  timer.setOverflow(STEP_US, MICROSEC_FORMAT);
  timer.attachInterrupt(read_row);
  timer.resume();
}

// An interrupt wakes the processor though it is masked: none is missed between the question and the sleep.
static void rest() {
  noInterrupts();
  if (n_taken == n_read) __WFI();
  interrupts();
}

#elif defined(ARDUINO_ARCH_RP2040) && !defined(ARDUINO_ARCH_MBED)

#include <hardware/sync.h>
#include <pico/time.h>

static bool tick(repeating_timer_t *) {
  read_row();
  return true;
}

static void begin_timer() {
  static repeating_timer_t timer;
  add_repeating_timer_us(-(int64_t)STEP_US, tick, nullptr, &timer);  // negative: from start to start
}

static void rest() {
  noInterrupts();
  if (n_taken == n_read) __wfi();
  interrupts();
}

#elif defined(ARDUINO_ARCH_ESP32)

#include <esp_timer.h>

static void tick(void *) { read_row(); }

static void begin_timer() {
  static esp_timer_handle_t timer;
  esp_timer_create_args_t how = {};
  how.callback = tick;  // in a task above that of the loop: it may wait for a bus
  esp_timer_create(&how, &timer);
  esp_timer_start_periodic(timer, STEP_US);
}

static void rest() { delay(1); }  // the idle task sleeps

#else  // no timer is known here: the loop looks at the clock, and must come back within a step

static uint32_t due_us;

static void begin_timer() { due_us = micros(); }

static void rest() {
  if ((int32_t)(micros() - due_us) < 0) return;
  due_us += STEP_US;
  read_row();
}

#endif
