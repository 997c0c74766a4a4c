/* Points the classifier at weights.bin, which must stay where it is read to. */
static int load(void)
{
    static uint64_t block[$n_words];
    FILE *file = fopen("weights.bin", "rb");
    size_t n = 0;
    if (file != NULL) {
        n = fread(block, 1, sizeof block, file);
        (void)fclose(file);
    }
    return dse_load(&net, block, (uint32_t)n);
}

