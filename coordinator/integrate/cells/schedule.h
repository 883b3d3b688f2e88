/* Schedules: the steps of a bake by "cells". `samples_direct`, `samples_bounce` and `samples_indirect` are the
 * settings.
 *
 * Direct light comes first. In scenes with mirrors, gloss and glass, a step of caustics with samples_indirect follows:
 * the light of lamps that arrives by way of these. The first bounce gathers both together.
 *
 * Lean: direct light, in two steps where that pays (adapt.h); bounces with few samples, each of which gathers the
 * radiosity of the one before; one final gather with many samples. The final gather reads the sum of the radiosity of
 * direct light and all bounces (with a geometric tail, if asked for) and replaces the results of the bounces; it
 * averages out the noise of the cheap bounces. The setting samples_bounce is the samples of the third bounce. The first
 * has 3 times as many, the second 1.5 times, the fourth and the fifth 1/2, all later ones 1/4, and none has less than
 * 2. After a step with more than 0.8 of the power of the one before, a bounce has at least samples_bounce. With a given
 * number of bounces N there are N - 1 bounces and the final gather. Otherwise bounces go on until the tail is accurate
 * enough, for the scene and for each object's mean (tile_error.h), or diverges, as in a closed scene of albedo 1. Late
 * bounces compute only tiles with much remaining light (late.h).
 *
 * Equal: direct light; then bounces with many samples, whose irradiance is the result. Without a given number they go
 * on until the remaining light is below 1e-5 of all. */
#ifndef KILN_COORDINATOR_INTEGRATE_CELLS_SCHEDULE_H
#define KILN_COORDINATOR_INTEGRATE_CELLS_SCHEDULE_H

#include "coordinator/integrate/settings.h"
#include "coordinator/integrate/step.h"

enum { KILN_BOUNCES_ALL = 254 };    /* maximum if their number is not given */
#define KILN_TAIL_RATIO_MOST 0.9999 /* highest ratio of successive bounces for a tail */

/* The index of the last step of light that has not met a diffuse surface yet: direct light, after its pilot (adapt.h),
 * or caustics. The bounces follow. */
size_t kiln_cells_first(const struct kiln_integrate_settings *settings);

/* kiln_integrator.next */
bool kiln_cells_next(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                     size_t count, struct kiln_step *step);

/* Reflected power of step `i`, W, of a channel or the luminance; a step of caustics includes that of direct light. If
 * reports[0] is such a step, the entry before it must exist. */
enum { KILN_LUMINANCE = 3 };
double kiln_cells_reflected(const struct kiln_step_report *reports, size_t i, int channel);

/* Whether a geometric series from the last step on is accurate enough for the scene as a whole: to two parts in a
 * thousand, or a tenth of a coarser target. Single objects: tile_error.h. */
bool kiln_cells_settled(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                        size_t count);

/* Reflected power of step `i` divided by that of the step before, luminance; 0 if the latter is 0. For a late bounce
 * (late.h), the divisor is the power for which it gathers. */
double kiln_cells_ratio(const struct kiln_step_report *reports, size_t i);

/* Fit of the decay of power from bounce to bounce at the end of a list of steps. */
struct kiln_tail_fit {
    bool is_long;     /* a bounce has more than 0.8 of the one before: then one ratio does not fit the rest */
    double ratio[3];  /* of successive bounces, each channel; in a long tail the mean over the second half */
    double latest[3]; /* of the last bounce to the one before */
    /* Relative error of the tail: dq / (1 - q) for the luminance's ratio q. dq is the standard error of the averaged
     * ratios' mean, or half the difference of the means of their two halves. The error is 0 for a tail that is not
     * long; for a long one with fewer than KILN_TAIL_BOUNCES it is 1. */
    double error;
    bool diverges; /* q is above KILN_TAIL_RATIO_MOST: light hardly decreases */
};
enum { KILN_TAIL_BOUNCES = 8 };
void kiln_cells_fit_tail(const struct kiln_step_report *reports, size_t count, struct kiln_tail_fit *fit);

/* Whether the lean schedule adds a geometric tail to the bounces. */
static inline bool kiln_cells_adds_tail(const struct kiln_integrate_settings *settings)
{
    return settings->tail || settings->bounces < 0;
}

#endif
