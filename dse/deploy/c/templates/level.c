@if is_delta
#ifdef DSE_REAL_SAMPLES
typedef double level_t;
#define LEVEL_UNIT 1.0
#else
typedef int32_t level_t;
#define LEVEL_UNIT $level_unit
#endif

@end
