/* $title
 * Prints PASS or FAIL: whether the classifier answers here as where it was trained.
 *
 *     cc -std=c99 -O2 -Isrc selftest.c src/dse_selftest.c src/dse.c -o selftest
 *
 * On a board, -DPUT=uart_put names the function that sends a character.
 */
#include "dse.h"
#ifdef PUT
int PUT(int character);
#else
#include <stdio.h>
#define PUT putchar
#endif

static dse_t net;

int main(void)
{
    const uint8_t passed = dse_selftest(&net);
    const char *said = passed ? "PASS\n" : "FAIL\n";
    while (*said != '\0') {
        (void)PUT(*said++);
    }
    return passed ? 0 : 1;
}
