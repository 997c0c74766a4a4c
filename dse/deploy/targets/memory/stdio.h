/* stdin and stdout in memory, which the emulator fills before a run and reads after it. What includes this lies
 * outside the memory of the program, and is not counted. */
#ifndef MEMORY_STDIO_H
#define MEMORY_STDIO_H

#include <stddef.h>
#include <stdint.h>

#pragma clang section text = ".host.text" rodata = ".host.rodata" data = ".host.data" bss = ".host.bss"

enum { stdin, stdout };

#define MEMORY_WORDS 0x200000u
uint32_t memory_in[MEMORY_WORDS], memory_out[MEMORY_WORDS];
uint32_t memory_n_in, memory_n_out; /* words */
uint32_t memory_read;

static size_t fread(void *to, size_t size, size_t n, int file)
{
    const size_t words = size / 4 * n;
    size_t i;
    if (file != stdin || memory_read + words > memory_n_in) {
        return 0;
    }
    for (i = 0; i < words; i++) {
        __builtin_memcpy((char *)to + 4 * i, &memory_in[memory_read + i], 4);
    }
    memory_read += (uint32_t)words;
    return n;
}

static size_t fwrite(const void *from, size_t size, size_t n, int file)
{
    if (file != stdout || size != 4 || n != 1 || memory_n_out == MEMORY_WORDS) {
        return 0;
    }
    __builtin_memcpy(&memory_out[memory_n_out++], from, 4);
    return 1;
}

#endif
