/* Progress display on stderr: one bar for the whole command, with the time left of the whole and the name of the
 * present phase; and tables.
 *
 * On a terminal the bar is one line, redrawn at most ten times a second and cleared at the end. Elsewhere a line
 * without control characters is printed every nine seconds. A thread updates the display once a second, also when no
 * progress was reported; it does not call MPI. Only rank 0 displays anything. Not collective; used by one thread.
 *
 * The whole is what kiln_progress_expect has announced (time_left.h). Until then bar and time left are those of the
 * present phase. */
#ifndef KILN_COORDINATOR_RUN_PROGRESS_H
#define KILN_COORDINATOR_RUN_PROGRESS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "coordinator/run/time_left.h"

struct kiln_progress;

/* Creates the display. Returns NULL when `quiet` is set, when `rank` is not 0, or when memory is short; all functions
 * here accept NULL and then show nothing. */
struct kiln_progress *kiln_progress_create(bool quiet, int rank);

/* Creates a progress without display and thread, which only calls its observer. NULL when memory is short. */
struct kiln_progress *kiln_progress_create_silent(void);

/* State of the display. */
struct kiln_progress_state {
    const char *phase;  /* borrowed */
    double phase_share; /* fraction of the phase that is done, 0 to 1; -1: unknown */
    double share;       /* of the whole, which never falls; -1: unknown */
    double left;        /* s, of the whole; -1: unknown */
};

/* The observer, called after each change by the thread that made it, and once a second by the display's thread. */
typedef void (*kiln_progress_watch)(void *data, const struct kiln_progress_state *state);
void kiln_progress_observe(struct kiln_progress *progress, kiln_progress_watch watch, void *data);

/* For tests: creates a display without a thread; call kiln_progress_beat instead. Nothing is shown if `stream` is NULL.
 * `clock` returns seconds. */
struct kiln_progress *kiln_progress_create_on(FILE *stream, bool terminal, int columns, double (*clock)(void *),
                                              void *clock_data);
/* Redraws the present phase if it is due. */
void kiln_progress_beat(struct kiln_progress *progress);

/* Announces the stages of the command, which are copied (kiln_time_left_expect). */
void kiln_progress_expect(struct kiln_progress *progress, const struct kiln_stage *stages, size_t count);

/* Returns the seconds left of the stage under way, of whose present phase the fraction `share` is done (-1: unknown);
 * -1: unknown. Called within kiln_progress_phase and kiln_progress_advance. */
typedef double (*kiln_progress_reckoning)(void *data, double share);
/* Asks `reckoning` for the time left of the stage under way, which has several phases, until it is set to NULL. */
void kiln_progress_reckon(struct kiln_progress *progress, kiln_progress_reckoning reckoning, void *data);

/* Ends the previous phase and begins one of `total` units of work; 0: unknown. A phase with the name of an announced
 * stage begins that stage. `name` is copied. */
void kiln_progress_phase(struct kiln_progress *progress, const char *name, uint64_t total);
/* Reports that `done` units are finished since the present phase began. Cheap: reads the clock and seldom prints. */
void kiln_progress_advance(struct kiln_progress *progress, uint64_t done);
/* Clears the line from the terminal, so that something can be printed; it comes back with the next progress. */
void kiln_progress_make_room(struct kiln_progress *progress);
/* Ends the last phase, and the command. */
void kiln_progress_finish(struct kiln_progress *progress);
/* Clears the unfinished line from the terminal, so that a message can follow. *progress may be NULL, and is set to
 * NULL. */
void kiln_progress_destroy(struct kiln_progress **progress);

/* Prints a table of `rows` x `columns` cells, given row by row (NULL: an empty cell), in aligned columns with two
 * spaces between them and none at line ends. Cells pass through kiln_text_plain and show at most 1,023 bytes. Bit i of
 * `right` aligns column i to the right. Widths count UTF-8 characters. */
void kiln_table_print(FILE *stream, const char *const *cells, size_t rows, size_t columns, uint32_t right);

/* Formats a duration: "0.35 s", "12.3 s", "3 min 05 s", "2 h 07 min". Returns `text`. */
char *kiln_duration_text(double seconds, char *text, size_t size);

#endif
