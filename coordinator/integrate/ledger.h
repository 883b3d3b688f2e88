/* Energy ledger: the sums of one step over its points, in fixed point, so that ranks, threads and order do not change
 * them. They are the powers of energy.h, and the reflected power of groups of tiles, from which an integrator estimates
 * its tail.
 *
 * Each thread adds to its own tally. Tallies are added to the ledger, which is summed over all ranks at the end of the
 * step. */
#ifndef KILN_COORDINATOR_INTEGRATE_LEDGER_H
#define KILN_COORDINATOR_INTEGRATE_LEDGER_H

#include "coordinator/integrate/energy.h"
#include "coordinator/integrate/step.h"
#include "coordinator/job/choices.h"
#include "worker/backend/emission.h"
#include "worker/base/arena.h"
#include "worker/pass/point.h"
#include "worker/scene/surface.h"

/* Offsets of the powers, three channels each. */
enum {
    KILN_SUM_INCIDENT = 0,
    KILN_SUM_REFLECTED = 3,
    KILN_SUM_SENT = 6,
    KILN_SUM_ESCAPED = 9,
    KILN_SUM_BLOCKED = 12,
    KILN_SUM_GLASS = 15,
    KILN_SUM_GLOSS = 18,
    KILN_SUMS = 21
};

/* Sums of one thread; all zero at first. */
struct kiln_tally {
    struct kiln_exact_sum sums[KILN_SUMS];
};

/* Separate sums of one tile run, since tile runs of one group are added together. Zero at first. */
struct kiln_tile_run_tally {
    struct kiln_exact_sum reflected; /* luminance */
    double variance;                 /* of the luminance of incident (+ escaped + blocked) */
};

struct kiln_ledger {
    double unit, unit_squared; /* of the sums: W; of the variance: W^2 */
    struct kiln_exact_sum sums[KILN_SUMS], variance;
    /* Reflected power, luminance, of groups of tiles whose light is written out (kiln_map_is_result): of the current
     * step (over all ranks once `before` and `total` are updated), of the step before, and of all steps. */
    size_t group_count;
    struct kiln_exact_sum *group_now;
    double *group_before, *group_total;
    struct kiln_arena arena;
};

/* `emitted`: luminance of the lights' power, W; it determines the units of the sums. KILN_SYSTEM. Release with
 * kiln_ledger_release, in any case. */
int kiln_ledger_create(struct kiln_ledger *ledger, const struct kiln_surface *surface, double emitted,
                       struct kiln_error *error);
void kiln_ledger_release(struct kiln_ledger *ledger);

/* Returns the lights' power within a factor of two, derived from the unit, which checkpoints store. */
double kiln_ledger_power(const struct kiln_ledger *ledger);

/* Clears the groups' powers, before the first step of a series whose tail is estimated. */
void kiln_ledger_forget_groups(struct kiln_ledger *ledger);

/* A step begins: its sums are zero. */
void kiln_ledger_begin_step(struct kiln_ledger *ledger);

/* Input of kiln_tally_add for one point. `sent`, unpacked, is the radiosity that the point sent; the gather's fractions
 * escaped and blocked tell what became of it. NULL: the step gathers nothing. `area`: m2 that can be lit. */
struct kiln_ledger_point {
    double area;
    const float *albedo; /* 3 */
    const float *sent;   /* 3; or NULL */
};
void kiln_tally_add(const struct kiln_ledger_point *point, const struct kiln_point_mean *result, double unit,
                    struct kiln_tally *tally, struct kiln_tile_run_tally *tile_run);

/* Batch of points of one tile run, in order, without losses to glass and gloss. Doubles, converted from floats. */
struct kiln_tally_run {
    uint32_t count;
    bool sends; /* the step gathers: `sent`, `escaped`, `blocked` and `samples` are there */
    double area[KILN_TILE_TEXELS], incident[3][KILN_TILE_TEXELS], albedo[3][KILN_TILE_TEXELS];
    double sent[3][KILN_TILE_TEXELS], escaped[KILN_TILE_TEXELS], blocked[KILN_TILE_TEXELS];
    double error[KILN_TILE_TEXELS], samples[KILN_TILE_TEXELS];
};
/* Appends a point, with the arguments of kiln_tally_add. */
void kiln_tally_note(struct kiln_tally_run *run, const struct kiln_ledger_point *point,
                     const struct kiln_point_mean *result);
/* Adds the batch: the same sums as kiln_tally_add for each point. */
void kiln_tally_add_run(const struct kiln_tally_run *run, double unit, struct kiln_tally *tally,
                        struct kiln_tile_run_tally *tile_run);

/* Add a tally to the ledger; not by two threads at once. The surface is that of the tile run's owner. */
void kiln_ledger_add(struct kiln_ledger *ledger, const struct kiln_tally *tally);
void kiln_ledger_add_tile_run(struct kiln_ledger *ledger, const struct kiln_surface *surface,
                              const struct kiln_tile_run *tile_run, const struct kiln_tile_run_tally *tally);

/* Collective. Sums the step's powers over all ranks. */
int kiln_ledger_end_step(struct kiln_ledger *ledger, MPI_Comm communicator, struct kiln_step_energy *energy,
                         struct kiln_error *error);

/* Knowledge of a bake besides its steps, so that its ledger can be closed. The integrator and the companions
 * change what they know better: `close` of each. */
struct kiln_energy_closing {
    enum kiln_caustics caustics; /* that the steps have found; at first those of the settings */
    double
        albedo_scale; /* of what a point sends, the part that gathers read, at first 1; the rest counts as absorbed */
};

/* Fills in the energy balance of a whole bake: the light that lamps emit, and where the counted steps found that it
 * went. Also compares light that has met no diffuse surface yet: as traced from the lights, and as the steps found it
 * at surface points. */
void kiln_energy_close(struct kiln_energy *energy, const struct kiln_step_reports *steps,
                       const struct kiln_emission_result *emission, const struct kiln_energy_closing *closing);

#endif
