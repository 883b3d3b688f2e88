/* The sums of one step over its points, in fixed point, so that neither ranks nor threads nor their order change them:
 * the powers of energy.h, and the reflected power of groups of tiles, by which an integrator judges its tail.
 *
 * Each thread adds to tallies of its own; those are then added to the ledger, and at the end of the step over all
 * ranks. */
#ifndef KILN_COORDINATOR_INTEGRATE_LEDGER_H
#define KILN_COORDINATOR_INTEGRATE_LEDGER_H

#include "coordinator/integrate/energy.h"
#include "coordinator/integrate/step.h"
#include "coordinator/job/choices.h"
#include "worker/backend/emission.h"
#include "worker/base/arena.h"
#include "worker/pass/point.h"
#include "worker/scene/surface.h"

/* The powers; by channel. */
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

/* Sums of a thread. Zero: nothing. */
struct kiln_tally {
    struct kiln_exact_sum sums[KILN_SUMS];
};

/* Sums of one tile run, apart from others: tile runs of one group meet. Zero: nothing. */
struct kiln_tile_run_tally {
    struct kiln_exact_sum reflected; /* luminance */
    double variance;                 /* of the luminance of incident (+ escaped + blocked) */
};

struct kiln_ledger {
    double unit, unit_squared; /* of the sums: W; of the variance: W^2 */
    struct kiln_exact_sum sums[KILN_SUMS], variance;
    /* Reflected power, luminance, of groups of tiles whose light is a result (kiln_map_is_result): of the present step
     * (of all ranks once `before` and `total` are brought up to date), of the step before, and of all steps. */
    size_t group_count;
    struct kiln_exact_sum *group_now;
    double *group_before, *group_total;
    struct kiln_arena arena;
};

/* `emitted`: luminance of the lights' power, W, which the units are chosen by. KILN_SYSTEM. Release with
 * kiln_ledger_release, in any case. */
int kiln_ledger_create(struct kiln_ledger *ledger, const struct kiln_surface *surface, double emitted,
                       struct kiln_error *error);
void kiln_ledger_release(struct kiln_ledger *ledger);

/* The lights' power, to within a factor of two, as it stands in the unit: that one is kept in checkpoints. */
double kiln_ledger_power(const struct kiln_ledger *ledger);

/* The groups' powers are of no step: before the first of a series whose tail is judged. */
void kiln_ledger_forget_groups(struct kiln_ledger *ledger);

/* A step begins: its sums are zero. */
void kiln_ledger_begin_step(struct kiln_ledger *ledger);

/* One point's answer, of which a gather's share that escaped or was blocked says what became of the radiosity that the
 * point sent (`sent`, unpacked; NULL: the step gathers nothing). `area` in m2, as far as it is there to be lit. */
struct kiln_ledger_point {
    double area;
    const float *albedo; /* 3 */
    const float *sent;   /* 3; or NULL */
};
void kiln_tally_add(const struct kiln_ledger_point *point, const struct kiln_point_mean *result, double unit,
                    struct kiln_tally *tally, struct kiln_tile_run_tally *tile_run);

/* Points of one tile run whose answers have lost nothing to glass and gloss, in order. Doubles of what are floats. */
struct kiln_tally_run {
    uint32_t count;
    bool sends; /* the step gathers: `sent`, `escaped`, `blocked` and `samples` are there */
    double area[KILN_TILE_TEXELS], incident[3][KILN_TILE_TEXELS], albedo[3][KILN_TILE_TEXELS];
    double sent[3][KILN_TILE_TEXELS], escaped[KILN_TILE_TEXELS], blocked[KILN_TILE_TEXELS];
    double error[KILN_TILE_TEXELS], samples[KILN_TILE_TEXELS];
};
/* Notes a point's answer, as kiln_tally_add takes it. */
void kiln_tally_note(struct kiln_tally_run *run, const struct kiln_ledger_point *point,
                     const struct kiln_point_mean *result);
/* The same sums as kiln_tally_add of each. */
void kiln_tally_add_run(const struct kiln_tally_run *run, double unit, struct kiln_tally *tally,
                        struct kiln_tile_run_tally *tile_run);

/* Not by two threads at once. The surface is that of the tile run's owner. */
void kiln_ledger_add(struct kiln_ledger *ledger, const struct kiln_tally *tally);
void kiln_ledger_add_tile_run(struct kiln_ledger *ledger, const struct kiln_surface *surface,
                              const struct kiln_tile_run *tile_run, const struct kiln_tile_run_tally *tally);

/* Collective. The step's powers over all ranks. */
int kiln_ledger_end_step(struct kiln_ledger *ledger, MPI_Comm communicator, struct kiln_step_energy *energy,
                         struct kiln_error *error);

/* Knowledge of a bake besides its steps, so that its ledger can be closed. The integrator and the companions
 * change what they know better: `close` of each. */
struct kiln_energy_closing {
    enum kiln_caustics caustics; /* that the steps have found; at first those of the settings */
    double
        albedo_scale; /* of what a point sends, the part that gathers read, at first 1; the rest counts as absorbed */
};

/* The balance of a whole bake: emitted light against where the counted steps found it; and what of it has met no
 * diffuse surface before, traced from the lights against found. */
void kiln_energy_close(struct kiln_energy *energy, const struct kiln_step_reports *steps,
                       const struct kiln_emission_result *emission, const struct kiln_energy_closing *closing);

#endif
