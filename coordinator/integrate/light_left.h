/* Time left of the light of a bake, from what its steps have taken so far.
 *
 * The steps of the present round are those that kiln_steps_next has after the reported ones, where a number of bounces
 * that is not given is that of the part before. A step takes what the last step of its role took (of its bounce, if
 * there was one), times its samples and the points that it computes; before any, it takes what a sample took so far.
 *
 * Rounds to come are not known. For an error of published light they are foretold after each round (foretold.h), and by
 * a trial before the first. Without that, of an error e of published light after n samples, n (e / asked)^2 are needed.
 * In the round under way e falls less than with the root of its samples, which only some points get. Before the first
 * round has ended, kiln_light_left_rounds has a guess. With a target error the share of the unfinished points is taken
 * to halve with each doubling of the samples. */
#ifndef KILN_COORDINATOR_INTEGRATE_LIGHT_LEFT_H
#define KILN_COORDINATOR_INTEGRATE_LIGHT_LEFT_H

#include "coordinator/integrate/settings.h"
#include "coordinator/integrate/step.h"

/* Samples of all rounds over those of the first one, for an error of published light, before anything is known. */
double kiln_light_left_rounds(double published_error);

/* Reports of all steps so far, of which the last is under way, and the seconds of each. Borrowed. */
struct kiln_light_so_far {
    const struct kiln_integrate_settings *settings;
    const struct kiln_step_reports *steps;
    const double *seconds;
    double share;  /* of the step under way, of its present phase: fraction done; -1: unknown */
    double rounds; /* struct kiln_integrate_params */
};

/* Seconds left of the light; -1: unknown, as no step has taken any time, or memory is short. Not collective. */
double kiln_light_left(const struct kiln_light_so_far *so_far);

/* The clock of the steps, on the rank that shows progress. Zero is none; release with kiln_light_clock_release. */
struct kiln_light_clock {
    const struct kiln_integrate_settings *settings;
    const struct kiln_step_reports *steps;
    double *seconds; /* of each step */
    size_t count, room;
    double since;  /* MPI_Wtime() when the last step began */
    double rounds; /* struct kiln_integrate_params */
};

/* The step last reported begins, or goes on. Steps that the clock has not seen, of earlier runs, have taken the seconds
 * of their reports. */
void kiln_light_clock_step(struct kiln_light_clock *clock);
/* kiln_progress_reckoning; `clock` is a struct kiln_light_clock. */
double kiln_light_clock_left(void *clock, double share);
void kiln_light_clock_release(struct kiln_light_clock *clock);

#endif
