/* Time left of a whole command, from what its stages are expected to take and what they have taken.
 *
 * A stage is a part of the command whose seconds are expected as one number: import, light, lightmaps. Expectations
 * come from a reckoning or a table (bake/prepare/stages.h) and may be wrong by much, so they are corrected:
 *
 * - a stage that tells which share of it is done, and what it has left, is believed the more, the more of it is done;
 * - a stage that tells nothing is expected to end at a constant rate: of an expectation of x s, x exp(-t / x) s are
 * left after t s, and from x s on at least 0.3 t;
 * - stages to come are multiplied by what the stages that are over have taken over what was expected of them, with a
 * tenth of all that is expected counted as exact, and by no more than KILN_TIME_LEFT_FACTOR either way. Stages whose
 * expectation is rough do not count here.
 *
 * The time left follows these within KILN_TIME_LEFT_SMOOTH seconds. The share of the whole that is done never falls: of
 * what was missing so far, the fraction dt / (dt + left) is done in dt seconds. With a true time left the share grows
 * at a constant rate, and it always would reach 1 when the time left is over.
 *
 * All times are seconds of one clock. Plain data; zero is a command of which nothing is known. Not collective. */
#ifndef KILN_COORDINATOR_RUN_TIME_LEFT_H
#define KILN_COORDINATOR_RUN_TIME_LEFT_H

#include <stdbool.h>
#include <stddef.h>

enum { KILN_STAGES_MAX = 24 };

#define KILN_TIME_LEFT_FACTOR 10.0
#define KILN_TIME_LEFT_SMOOTH 2.0
#define KILN_STAGE_UNKNOWN (-1.0) /* s */

/* A stage of a command, in the order in which they come. */
struct kiln_stage {
    const char *name; /* of the phase that begins it; a static string */
    double seconds;   /* that it is expected to take; KILN_STAGE_UNKNOWN: only it knows, once it has told */
    bool rough;       /* which hangs on more than the speed of the machine */
};

struct kiln_time_left {
    struct kiln_stage stages[KILN_STAGES_MAX];
    bool over[KILN_STAGES_MAX];
    size_t count;           /* 0: nothing is expected, and the time left is unknown */
    size_t present;         /* index of the stage under way; `count`: none */
    double begin, since;    /* when the command began, and the stage under way */
    double expected, taken; /* s, of all stages that are over */
    double share, left;     /* as the stage under way has told them at `told`: fraction done, and s; -1: unknown */
    double told;
    /* of the whole, as shown at `updated`: fraction done; s left, -1: unknown */
    double whole_share, whole_left, updated;
};

/* The command begins. */
void kiln_time_left_begin(struct kiln_time_left *t, double now);
/* Sets what all stages are expected to take, at most KILN_STAGES_MAX of them. May be called again when more is known;
 * stages that were over stay so, and so does the one under way if it is among them. */
void kiln_time_left_expect(struct kiln_time_left *t, const struct kiln_stage *stages, size_t count, double now);
/* Phase `name` begins. If it is the name of a stage to come, the stage under way and all before this one are over.
 * Otherwise it belongs to the stage under way. */
void kiln_time_left_phase(struct kiln_time_left *t, const char *name, double now);
/* The stage under way tells which fraction of it is done, and how many seconds it has left; -1: it does not know. */
void kiln_time_left_tell(struct kiln_time_left *t, double share, double left, double now);
/* The last stage is over. */
void kiln_time_left_end(struct kiln_time_left *t, double now);

/* Brings whole_share and whole_left up to date. */
void kiln_time_left_update(struct kiln_time_left *t, double now);

#endif
