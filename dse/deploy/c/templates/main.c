/* $title
 * Reads recordings from stdin, $rows, and prints an answer
 * for each. A line of text before the first number is skipped; an empty line ends a recording.
 *
 *     cc -std=c99 -O2 -Isrc main.c src/dse.c -o touch
 *     ./touch < recording.csv
 */
#include "dse.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define WINDOW_AT_$window_at
#define ONSET $onset
@if bin_us
#define BIN_US $bin_us
@each crop
#define $name $value
@end
@if n_bins
#ifndef RECORDED /* trials begin at 0; recordings with their first event */
#define T0_US $t0_us
#define N_BINS $n_bins
#endif
@end
@end

static char line[$longest_line];
static unsigned long line_number;
static size_t n_rows; /* of the recording so far */

static void refuse(const char *what)
{
    fprintf(stderr, "line %lu: %s\n", line_number, what);
    exit(2);
}

@include main_${front_end}.c
@if apart

@include load_file.c
@end

int main(void)
{
    unsigned long n_recordings = 0;
@if apart
    if (!load()) {
        refuse("weights.bin here is not of this program");
    }
@end
    printf("answer,time_ms,decided\n");
    while (fgets(line, sizeof line, stdin) != NULL) {
        const char *text = line + strspn(line, " \t\r\n");
        line_number++;
        if (strchr(line, '\n') == NULL && !feof(stdin)) {
            refuse("the line is too long");
        }
        if (*text == '\0') {
            if (n_rows > 0) {
                answer();
            }
        } else if (line_number > 1 || strchr("+-.0123456789", *text) != NULL) {
            add_row(text);
            n_recordings += n_rows == 1;
        }
    }
    if (n_rows > 0) {
        answer();
    }
    if (n_recordings == 0) {
        refuse("there is no row of numbers");
    }
    return 0;
}
