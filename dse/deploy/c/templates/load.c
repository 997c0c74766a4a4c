
uint8_t dse_load(dse_t *net, const void *block, uint32_t n_bytes)
{
    const struct dse_weights *weights = (const struct dse_weights *)block;
    const uint8_t *byte = (const uint8_t *)block;
    uint32_t sum = 0xFFFFFFFFu, i, k;
    net->weights = NULL;
    if ((n_bytes < sizeof(struct dse_weights)) || (weights->layout != LAYOUT) || (weights->n_bytes > n_bytes)) {
        return 0;
    }
    for (i = 16; i < weights->n_bytes; i++) {
        sum ^= byte[i];
        for (k = 0; k < 8u; k++) {
            sum = (sum >> 1) ^ (((sum & 1u) != 0u) ? 0xEDB88320u : 0u);
        }
    }
    if ((sum ^ 0xFFFFFFFFu) != weights->checksum) {
        return 0;
    }
    net->weights = weights;
    return 1;
}
