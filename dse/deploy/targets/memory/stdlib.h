#ifndef MEMORY_STDLIB_H
#define MEMORY_STDLIB_H

static inline void exit(int code)
{
    (void)code;
    __builtin_trap();
}

#endif
