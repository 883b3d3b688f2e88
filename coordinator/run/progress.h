/* What a person at the terminal sees while kiln works: phases, a bar with the time left, and a closing table.
 *
 * On a terminal the present phase is one line that is redrawn at most ten times a second and becomes "NAME  TIME" when
 * the phase ends. Anywhere else a line is printed every nine seconds, without control characters. A thread sees to that
 * once a second, whether or not something was finished meanwhile; it calls no MPI. Only rank 0 shows anything. Not
 * collective; used by one thread. */
#ifndef KILN_COORDINATOR_RUN_PROGRESS_H
#define KILN_COORDINATOR_RUN_PROGRESS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

struct kiln_progress;

/* NULL, which every function here accepts and which shows nothing, when `quiet` is set, when rank is not 0, or when
 * there is no memory for it: progress is never a reason to fail. Writes to stderr. */
struct kiln_progress *kiln_progress_create(bool quiet, int rank);

/* One that shows nothing, has no thread and only lets others watch; NULL when there is no memory for it. */
struct kiln_progress *kiln_progress_create_silent(void);

/* Called after each change, on the thread that made it: seconds left of the phase are -1 while they are not known. */
typedef void (*kiln_progress_watch)(void *data, const char *name, uint64_t done, uint64_t total, double seconds_left);
void kiln_progress_observe(struct kiln_progress *progress, kiln_progress_watch watch, void *data);

/* The same with everything given and without a thread, which only calls kiln_progress_beat: for tests. `stream` NULL:
 * nothing is shown. `clock` returns seconds. */
struct kiln_progress *kiln_progress_create_on(FILE *stream, bool terminal, int columns, double (*clock)(void *),
                                              void *clock_data);
/* Shows the present phase again when it is time. */
void kiln_progress_beat(struct kiln_progress *progress);

/* Ends the phase before and begins one of `total` units (0: unknown, no bar and no time left). `name` is copied. */
void kiln_progress_phase(struct kiln_progress *progress, const char *name, uint64_t total);
/* `done` units of the present phase are finished, counted from its begin. Cheap: looks at the clock, seldom prints. */
void kiln_progress_advance(struct kiln_progress *progress, uint64_t done);
/* Ends the last phase. */
void kiln_progress_finish(struct kiln_progress *progress);
/* Takes the unfinished line off the terminal, so that a message can follow. Accepts a NULL inside; sets NULL. */
void kiln_progress_destroy(struct kiln_progress **progress);

/* Prints `rows` rows of `columns` cells (row by row; NULL is empty) in aligned columns, two blanks between, no blanks
 * at line ends. Cells go through kiln_text_plain and show 1,023 bytes at most. Bit i of `right` aligns column i to the
 * right. Width is counted in UTF-8 characters. */
void kiln_table_print(FILE *stream, const char *const *cells, size_t rows, size_t columns, uint32_t right);

/* Writes seconds for people: "0.35 s", "12.3 s", "3 min 05 s", "2 h 07 min". Returns `text`. */
char *kiln_duration_text(double seconds, char *text, size_t size);

#endif
