static bool is_open, touched, is_over;  // the window; contact in the step before; this recording's window
static unsigned long at;                // step of the recording

static void begin_recording() {
  at = 0;
  is_open = touched = is_over = false;
  dse_init(&net);
}

// Ends a step. Until a window begins, every step is taken for its first one.
static void end_step(bool touches) {
  dse_step(&net);
  if (!is_open && !is_over && at + 1 > WINDOW_FIRST && touches && !touched) is_open = true;
  touched = ONSET > 0 && touches;
  if (is_open && dse_decision(&net) != DSE_UNDECIDED) {
    Serial.println(dse_class_name(dse_decision(&net)));
    is_open = false;
    is_over = RECORDING > 0;
  }
  at += RECORDING > 0 || at == 0;
  if (at == RECORDING) {
    is_open = false;
    is_over = true;
  }
  if (at == EVERY) {
    begin_recording();
  } else if (!is_open) {
    dse_reset(&net);
  }
}
