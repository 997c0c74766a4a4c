/* What weights.bin holds: little-endian, as 32-bit processors lay it out. */
struct dse_weights {
    uint32_t layout;
    uint32_t n_bytes;  /* of all */
    uint32_t checksum; /* CRC-32 of what follows these four */
    uint32_t unused;
@each tables
    $kind $name[$n];
@end
};

