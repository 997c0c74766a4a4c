/* Levels and tables of 64 bits: where double has 32, as on AVR, this does not compile. */
typedef char dse_needs_a_double_of_64_bits[sizeof(double) >= 8 ? 1 : -1];
