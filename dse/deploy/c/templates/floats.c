@if is_rounded
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF /* every product is rounded, as by the engine */
#elif defined(__GNUC__)
#pragma GCC optimize ("fp-contract=off")
#endif
@if needs_double
@include long_double.c
@else
@if encoder
#ifdef DSE_REAL_SAMPLES
@include long_double.c
#endif
@end
@end

@end
