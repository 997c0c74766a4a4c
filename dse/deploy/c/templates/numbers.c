#ifdef DSE_REAL_SAMPLES
/* Whether all samples are finite, told by their exponents: compilers may take every float for finite. */
static uint8_t are_numbers(const dse_sample_t *sample)
{
    union {
        float value;
        uint32_t bits;
    } of;
    uint32_t k;
    for (k = 0; k < DSE_SENSORS; k++) {
        of.value = sample[k];
        if ((of.bits & 0x7F800000u) == 0x7F800000u) {
            return 0;
        }
    }
    return 1;
}
#endif

