
static dse_sample_t first[DSE_SENSORS];

// Whether a sensor is as far from its first sample as a contact moves it.
static bool touches(const dse_sample_t *row) {
  bool is_far = false;
  for (unsigned i = 0; i < DSE_SENSORS; i++) {
    if (at == 0) first[i] = row[i];
    const float d = (float)row[i] - (float)first[i];
    is_far |= (d < 0 ? -d : d) >= (float)ONSET;
  }
  return is_far;
}
