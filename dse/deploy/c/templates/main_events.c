typedef struct {
    int64_t t_us;
    uint16_t x, y;
    uint8_t polarity;
} event_t;

static dse_t net;
static event_t *events;
static size_t capacity;

static void add_row(const char *text)
{
    double value[4];
    unsigned i;
    event_t *event;
    if (n_rows == capacity) {
        capacity = 2 * capacity + 1024;
        events = realloc(events, capacity * sizeof *events);
        if (events == NULL) {
            refuse("no memory");
        }
    }
    for (i = 0; i < 4; i++) {
        char *end;
        value[i] = strtod(text, &end);
        if (end == text || value[i] != (double)(int64_t)value[i]) {
            refuse("an event must be four whole numbers: time in us, x, y, polarity");
        }
        for (text = end; *text == ',' || *text == ';' || *text == ' ' || *text == '\t'; text++) {
        }
    }
    if (value[1] < 0 || value[1] > 65535 || value[2] < 0 || value[2] > 65535) {
        refuse("x and y must be from 0 to 65535");
    }
    if (value[3] != 0 && value[3] != 1) {
        refuse("polarity must be 1 or 0");
    }
    if (n_rows > 0 && value[0] < (double)events[n_rows - 1].t_us) {
        refuse("time must never fall");
    }
    event = &events[n_rows++];
    event->t_us = (int64_t)value[0];
    event->x = (uint16_t)value[1];
    event->y = (uint16_t)value[2];
    event->polarity = (uint8_t)value[3];
}

/* First bin of the window; it must fit. */
static int64_t window_start(int64_t t0_us)
{
    int64_t start = 0, last = events[n_rows - 1].t_us - t0_us + 1, n_bins;
    if (last > END_US) {
        last = END_US;
    }
    n_bins = last <= START_US ? 0 : (last - START_US + BIN_US - 1) / BIN_US;
#ifdef N_BINS
    n_bins = N_BINS;
    if (last - START_US > (n_bins + 1) * (int64_t)BIN_US) {
        refuse("an event is later than a simulated trial: -DRECORDED compiles for recordings of a sensor");
    }
#endif
#ifdef WINDOW_AT_MIDDLE
    if (n_bins >= DSE_WINDOW) {
        start = (n_bins - DSE_WINDOW) / 2;
    }
#endif
#ifdef WINDOW_AT_CONTACT_ONSET
    {
        size_t e;
        int64_t bin = -1;
        double n = 0;
        for (e = 0; e < n_rows; e++) {
            const int64_t t = events[e].t_us - t0_us;
            const uint32_t column = (uint32_t)events[e].x - CROP_X, row = (uint32_t)events[e].y - CROP_Y;
            if (t < START_US || t >= END_US || column >= CROP_COLUMNS || row >= CROP_ROWS) {
                continue;
            }
            if ((t - START_US) / BIN_US != bin) {
                bin = (t - START_US) / BIN_US;
                n = 0;
            }
            n++;
            if (n >= ONSET) {
                break;
            }
        }
        if (e == n_rows) {
            refuse("the recording has no contact");
        }
        start = bin;
    }
#endif
    if (start + DSE_WINDOW > n_bins) {
        refuse("the recording is shorter than the window");
    }
    return start;
}

static void answer(void)
{
#ifdef T0_US
    const int64_t t0_us = T0_US;
#else
    const int64_t t0_us = events[0].t_us;
#endif
    const int64_t start = window_start(t0_us);
    int64_t bin = 0;
    size_t e = 0;
    dse_init(&net);
    dse_start(&net, t0_us);
    for (bin = 0; bin < start + DSE_WINDOW; bin++) {
        if (bin == start) {
            dse_reset(&net);
        }
        while (e < n_rows && dse_push(&net, events[e].t_us, events[e].x, events[e].y, events[e].polarity)) {
            e++;
        }
        dse_step(&net);
        if (bin >= start && dse_decision(&net) != DSE_UNDECIDED) {
            break;
        }
    }
    printf("%s,%.17g,%s\n", dse_class_name(dse_decision(&net)), dse_steps(&net) * (DSE_STEP_MS / DSE_STEPS_PER_SAMPLE),
           dse_confident(&net) ? "true" : "false");
    n_rows = 0;
}
