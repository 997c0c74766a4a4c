@if leak
/* trunc(x * keep / unit) without more than 32 bits: exact, since both terms have the sign of x. */
#define LEAK(x, keep, unit) (((x) / (unit) * (keep)) + ((x) % (unit) * (keep) / (unit)))

@end
@if decayed
#define SATURATED(x) (((x) < -32768) ? -32768 : (((x) > 32767) ? 32767 : (int32_t)(x)))

/* x less x / 2^shift, which rounds down, but at least 1 nearer to 0 where x is positive. */
static int32_t decayed(int32_t x, uint32_t shift)
{
    uint32_t lost;
    if (x > 0) {
        lost = (uint32_t)x >> shift;
        return x - ((lost > 0u) ? (int32_t)lost : 1);
    }
    lost = ((uint32_t)-x + ((uint32_t)1 << shift) - 1u) >> shift;
    return x + (int32_t)lost;
}

@end
