static dse_t net;
static dse_sample_t *samples;
static size_t capacity;

static void add_row(const char *text)
{
    unsigned i;
    if ((n_rows + 1) * DSE_SENSORS > capacity) {
        capacity = 2 * capacity + 1024 * DSE_SENSORS;
        samples = realloc(samples, capacity * sizeof *samples);
        if (samples == NULL) {
            refuse("no memory");
        }
    }
    for (i = 0; i < DSE_SENSORS; i++) {
        char *end;
        const double value = strtod(text, &end);
        if (end == text) {
            refuse("a sample must have a number of every sensor");
        }
#ifndef DSE_REAL_SAMPLES
        if (!(value > -16777216.0 && value < 16777216.0) || value != (double)(int32_t)value) {
            refuse("a sample must be a whole number below 2^24; for others compile with -DDSE_REAL_SAMPLES");
        }
#else
        if (!(value > -3.4028235677973366e38 && value < 3.4028235677973366e38)) { /* none that rounds to infinity */
            refuse("a sample must be a finite number");
        }
#endif
        samples[n_rows * DSE_SENSORS + i] = (dse_sample_t)value;
        for (text = end; *text == ',' || *text == ';' || *text == ' ' || *text == '\t'; text++) {
        }
    }
    if (*text != '\0' && *text != '\n' && *text != '\r') {
        refuse("a sample must have one number of every sensor, and no more");
    }
    n_rows++;
}

/* First sample of the window; it must fit. */
static size_t window_start(void)
{
    size_t start = 0;
#ifdef WINDOW_AT_MIDDLE
    if (n_rows >= DSE_WINDOW) {
        start = (n_rows - DSE_WINDOW) / 2;
    }
#endif
#ifdef WINDOW_AT_CONTACT_ONSET
    for (;; start++) {
        unsigned i;
        int moved = 0;
        if (start == n_rows) {
            refuse("the recording has no contact");
        }
        for (i = 0; i < DSE_SENSORS; i++) {
            const float d = (float)samples[start * DSE_SENSORS + i] - (float)samples[i];
            moved |= (double)(d < 0 ? -d : d) >= ONSET;
        }
        if (moved) {
            break;
        }
    }
#endif
    if (start + DSE_WINDOW > n_rows) {
        refuse("the recording is shorter than the window");
    }
    return start;
}

static void answer(void)
{
    const size_t start = window_start();
    size_t t;
    dse_init(&net);
    for (t = 0; t < start + DSE_WINDOW && dse_decision(&net) == DSE_UNDECIDED; t++) {
        if (t == start) {
            dse_reset(&net);
        }
        dse_push(&net, samples + t * DSE_SENSORS);
        if (t >= start) {
            dse_step(&net);
        }
    }
    printf("%s,%.17g,%s\n", dse_class_name(dse_decision(&net)), dse_steps(&net) * (DSE_STEP_MS / DSE_STEPS_PER_SAMPLE),
           dse_confident(&net) ? "true" : "false");
    n_rows = 0;
}
