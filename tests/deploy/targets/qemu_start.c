/* Starts a program on the Cortex-M4 of qemu's board mps2-an386: its unit for floats is switched on, what it prints
 * and its exit code go to the host by semihosting. */
#include <stdint.h>

extern uint32_t _stack_top;
int main(void);

static uint32_t ask_host(uint32_t operation, const void *argument)
{
    register uint32_t r0 __asm("r0") = operation;
    register const void *r1 __asm("r1") = argument;
    __asm volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

int put(int character)
{
    const char written = (char)character;
    (void)ask_host(3u, &written);
    return character;
}

void start(void)
{
    uint32_t ended[2] = {0x20026u, 0u}; /* the program ended, with a code */
    *(volatile uint32_t *)0xE000ED88u |= 0xFu << 20;
    __asm volatile("dsb\n\tisb");
    ended[1] = (uint32_t)main();
    (void)ask_host(0x20u, ended);
    for (;;) {
    }
}

__attribute__((section(".vectors"), used)) static void *const vectors[] = {&_stack_top, (void *)start};
