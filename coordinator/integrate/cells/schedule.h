/* Which steps a bake by "cells" has. `samples_direct`, `samples_bounce` and `samples_indirect` are those settings.
 *
 * Direct light comes first. Where a scene has mirrors, gloss and glass, light that comes from lamps by way of these
 * follows, in a step with samples_indirect: both together are what the first bounce gathers.
 *
 * Lean: direct light, in two steps where that pays (adapt.h); bounces with few samples, each of which gathers the
 * radiosity of the one before; one final gather with many samples, which reads the radiosity of direct light and all
 * bounces summed up (with a geometric tail, where that is asked for) and replaces what the bounces have found. The
 * noise of the cheap bounces averages out in it. The setting samples_bounce is the samples of the third bounce: the
 * first has 3 times as many, the second 1.5 times, the fourth and the fifth 1/2, all later ones 1/4, and none has less
 * than 2; after a step with more than 0.8 of the power of the one before, a bounce has samples_bounce at least. With a
 * number of bounces N given there are N - 1 bounces and the final gather; without, bounces go on until the tail is good
 * enough, for the scene and for each object's mean (tile_error.h), or diverges: a closed scene of albedo 1. Late ones
 * of these compute only where much is left (late.h).
 *
 * Equal: direct light; bounces with many samples, whose irradiance counts as it is. Without a number given they go on
 * until what is left is below 1e-5 of all. */
#ifndef KILN_COORDINATOR_INTEGRATE_CELLS_SCHEDULE_H
#define KILN_COORDINATOR_INTEGRATE_CELLS_SCHEDULE_H

#include "coordinator/integrate/settings.h"
#include "coordinator/integrate/step.h"

enum { KILN_BOUNCES_ALL = 254 };    /* at most so many where their number is not given */
#define KILN_TAIL_RATIO_MOST 0.9999 /* of a bounce to the one before, that a tail is reckoned with */

/* The number of the step that ends the light which has met no diffuse surface before: that of direct light, after its
 * pilot (adapt.h), or of caustics. The bounces follow. */
size_t kiln_cells_first(const struct kiln_integrate_settings *settings);

/* kiln_integrator.next */
bool kiln_cells_next(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                     size_t count, struct kiln_step *step);

/* Reflected power of step `i`, W, of a channel or the luminance; after a step of caustics, with direct light. `reports`
 * go on before reports[0] where that is such a step. */
enum { KILN_LUMINANCE = 3 };
double kiln_cells_reflected(const struct kiln_step_report *reports, size_t i, int channel);

/* Whether a geometric series from the last step on is good enough for the scene as a whole: two parts in a thousand.
 * Objects apart: tile_error.h. */
bool kiln_cells_settled(const struct kiln_step_report *reports, size_t count);

/* Reflected power of step `i` over that of the one before, luminance; 0 where the latter has none. Of a late bounce
 * (late.h), over the power that it gathers for. */
double kiln_cells_ratio(const struct kiln_step_report *reports, size_t i);

/* How power falls from bounce to bounce at the end of a list of steps. */
struct kiln_tail_fit {
    bool is_long;     /* a bounce has more than 0.8 of the one before: then the rest is of more than one ratio */
    double ratio[3];  /* of a bounce to the one before, each channel; of a long tail the mean over the second half */
    double latest[3]; /* of the last bounce to the one before */
    /* Error of the tail, relative to it: dq / (1 - q) of the luminance's ratio q. dq is the standard error of the mean
     * of the ratios that it is of, or half of what their two halves differ by; 0 of a tail that is not long and 1 where
     * there are fewer than KILN_TAIL_BOUNCES. */
    double error;
    bool diverges; /* q is above KILN_TAIL_RATIO_MOST: light hardly gets less */
};
enum { KILN_TAIL_BOUNCES = 8 };
void kiln_cells_fit_tail(const struct kiln_step_report *reports, size_t count, struct kiln_tail_fit *fit);

/* Whether the lean schedule adds a geometric tail to the bounces. */
static inline bool kiln_cells_adds_tail(const struct kiln_integrate_settings *settings)
{
    return settings->tail || settings->bounces < 0;
}

#endif
