static dse_t net;
static uint8_t *spikes;
static size_t capacity;

static void add_row(const char *text)
{
    unsigned long i;
    if ((n_rows + 1) * DSE_CHANNELS > capacity) {
        capacity = 2 * capacity + 1024 * (size_t)DSE_CHANNELS;
        spikes = realloc(spikes, capacity);
        if (spikes == NULL) {
            refuse("no memory");
        }
    }
    for (i = 0; i < DSE_CHANNELS; i++) {
        if (*text != '0' && *text != '1') {
            refuse("a step must have 1 or 0 of every channel");
        }
        spikes[n_rows * DSE_CHANNELS + i] = (uint8_t)(*text - '0');
        for (text++; *text == ',' || *text == ';' || *text == ' ' || *text == '\t'; text++) {
        }
    }
    if (*text != '\0' && *text != '\n' && *text != '\r') {
        refuse("a step must have 1 or 0 of every channel, and no more");
    }
    n_rows++;
}

/* First step of the window; it must fit. */
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
        unsigned long i, n = 0;
        if (start == n_rows) {
            refuse("the recording has no contact");
        }
        for (i = 0; i < DSE_CHANNELS; i++) {
            n += spikes[start * DSE_CHANNELS + i];
        }
        if ((double)n >= ONSET) {
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
    unsigned long i;
    dse_init(&net);
    for (t = start; t < start + DSE_WINDOW && dse_decision(&net) == DSE_UNDECIDED; t++) {
        for (i = 0; i < DSE_CHANNELS; i++) {
            if (spikes[t * DSE_CHANNELS + i]) {
                dse_push_spike(&net, (uint16_t)i);
            }
        }
        dse_step(&net);
    }
    printf("%s,%.17g,%s\n", dse_class_name(dse_decision(&net)), dse_steps(&net) * (DSE_STEP_MS / DSE_STEPS_PER_SAMPLE),
           dse_confident(&net) ? "true" : "false");
    n_rows = 0;
}
