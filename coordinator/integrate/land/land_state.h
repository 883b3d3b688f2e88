/* State shared by the source files of land.h: land.c (the step), land_size.c (numbers of paths and bytes), land_aims.c
 * (shares of paths for each aim), land_paths.c (traces paths and exchanges their landings), land_pilots.c (pilot paths,
 * from which the others learn), land_trial.c (whether caustics are worth their noise), land_spread.c (spreads light
 * over nearby points), land_pool.c (what stays specks), land_save.c (checkpoints), land_give.c (answers). No other file
 * includes it. */
#ifndef KILN_COORDINATOR_INTEGRATE_LAND_LAND_STATE_H
#define KILN_COORDINATOR_INTEGRATE_LAND_LAND_STATE_H

#include "coordinator/field/field_blocks.h"
#include "coordinator/integrate/land/land.h"
#include "coordinator/integrate/land/land_exchange.h"
#include "coordinator/integrate/land/land_pool.h"
#include "coordinator/integrate/land/land_trial.h"
#include "coordinator/integrate/land/merge.h"
#include "worker/base/arena.h"
#include "worker/light/aims.h"
#include "worker/pass/weighed.h"
#include "worker/scene/footprint.h"

/* Largest number of tile runs whose answers are computed at once. */
enum { KILN_LANDING_GIVEN_TILE_RUNS = 2048 };

/* Block "landing" of a checkpoint, stored once: the progress of the step. The blocks after it are "landing_learnt" and
 * "landing_paths", stored once, one element per aim; "landing_moments", one for each rank, also by aim; "landing_sums"
 * and, if landings are merged, "landing_merged", one element per point. */
struct kiln_landing_saved {
    uint64_t step; /* number of the step */
    uint64_t iteration, done, photons, aims;
    double radius;
};
_Static_assert(sizeof(struct kiln_landing_saved) == 48, "a record has no gaps");

struct kiln_landing {
    const struct kiln_integrate_params *params;
    struct kiln_solution *solution;
    const struct kiln_saved *saved;
    struct kiln_aims *aims;
    uint64_t photons;         /* light paths of an iteration */
    struct kiln_backend *own; /* of the step: Embree, if the bake's backend is a device that cannot run all passes */
    /* with --caustics vcm, else NULL: the emission whose light paths and gather rays share, and their weights */
    struct kiln_emission *emission;
    struct kiln_mirror_images *images; /* NULL if no flat mirror reflects a lamp without extent */
    struct kiln_caustic_techniques techniques;
    struct kiln_landing_weights landing_weights;
    /* moments: this rank's second moments of the iteration, by aim; learnt: those of all iterations so far; paths: the
     * number of paths behind these */
    uint64_t *moments;
    double *learnt, *paths, *weights;
    uint64_t iteration, done; /* iterations completed; paths completed of the next one */
    /* values at the beginning of the current block: the state that a checkpoint may store */
    uint64_t *moments_before, rays_before;
    struct kiln_landing_saved record;
    bool begun;     /* a step has begun: the checkpoint knows no later step, and its files may be deleted by then */
    bool restored;  /* the moments and landings so far come from a checkpoint */
    bool pilots;    /* the current paths are pilots, which bring no light; a checkpoint stores nothing of them */
    size_t *landed; /* for each part of a batch (one per thread): number of landings, then offset in the output */
    double speed;   /* paths per second of this rank's last block; 0: no block yet */
    /* of the current step */
    struct kiln_land_exchange exchange;
    struct kiln_landing_sum *sums; /* of own points; if they are merged, only of iterations with the current radius */
    struct kiln_point_result *results;
    /* of own points, until they move, if the bake has several such steps; with --caustics merge and vcm, else NULL: m2,
     * area that can be lit; and places, found when first needed */
    float *lit;
    struct kiln_merge_place *places;
    /* for spreading landings over nearby points (--caustics merge, vcm); else NULL */
    struct kiln_merged *merged;
    struct kiln_merge *merge;          /* made when it is first needed, and kept as `places` are */
    bool merging;                      /* it has the radius of the current step */
    struct kiln_landing_sum *gathered; /* --caustics vcm: the light found by gather rays, as landings; else NULL */
    float *tried[2];                   /* W, luminance: landings of each half of the pilots at own points; or NULL */
    int half;                          /* half to which the current pilots belong */
    double radius;                     /* m, initial radius; with --caustics vcm the largest */
    struct kiln_arena arena;
};

/* Whether gather rays compute a part of the caustics (--caustics vcm). */
static inline bool kiln_landing_shares(const struct kiln_landing *l) { return l->emission != NULL; }
/* Whether gather rays are traced for that part, which requires light paths. */
static inline bool kiln_landing_gathers(const struct kiln_landing *l)
{
    return kiln_landing_shares(l) && l->aims->count > 0;
}
/* Whether the landings of an iteration are spread over nearby points. */
static inline bool kiln_landing_merges(const struct kiln_landing *l)
{
    return l->params->settings->caustics == KILN_CAUSTICS_MERGE;
}
/* Whether the light found by gather rays is spread together with the landings. */
static inline bool kiln_landing_spreads_rays(const struct kiln_landing *l)
{
    return kiln_landing_gathers(l) && kiln_landing_spreads(l->params->settings);
}
/* Rays per point in the step, except on objects that light paths do not meet. */
static inline uint32_t kiln_landing_own_rays(const struct kiln_landing *l)
{
    return kiln_landing_rays(l->params->settings, kiln_solution_step(l->solution)->step.samples, l->images != NULL);
}
/* Index of the first of these rays in the sample sequence; parts of a bake take consecutive ranges. */
static inline uint32_t kiln_landing_first_ray(const struct kiln_landing *l)
{
    const struct kiln_step *step = &kiln_solution_step(l->solution)->step;
    return kiln_landing_own_rays(l) < step->samples ? step->part * kiln_landing_own_rays(l) : step->first_sample;
}
static inline uint64_t kiln_landing_iterations(const struct kiln_landing *l)
{
    return kiln_solution_step(l->solution)->step.iterations;
}

/* ---- land_aims.c ---- */

/* Resets the state to that before the first path of a step. */
void kiln_landing_forget(struct kiln_landing *l);
/* Running sum of second moments over consecutive paths of one aim, since most neighbours in the order share their aim.
 * Zero at first. */
struct kiln_landing_moments {
    uint32_t aim;
    uint64_t sum;
};
/* Adds the second moment of a path of `aim` with the given luminance, W. Threads may call it at once, each with its own
 * `moments`. */
void kiln_landing_note_moment(struct kiln_landing *l, struct kiln_landing_moments *moments, uint32_t aim,
                              double luminance);
/* Adds the remaining sum, after the last path. */
void kiln_landing_note_rest(struct kiln_landing *l, struct kiln_landing_moments *moments);
/* Distributes `paths` paths of the next iteration over the aims, by the moments learnt. */
void kiln_landing_aim(struct kiln_landing *l, uint64_t paths);
/* Collective. Adds an iteration's moments to those learnt, then distributes `paths` paths of the next one over the
 * aims. */
void kiln_landing_correct_aims(struct kiln_landing *l, uint64_t paths);

/* ---- land_paths.c ---- */

/* Runs a pass on the device or on the host, whichever can run it (kiln_landing_host). */
int kiln_landing_run_pass(struct kiln_landing *l, const struct kiln_pass *pass, const void *parameters,
                          const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error);
/* Batch size for a pass: `of_the_host` on the host, a multiple of it on a device. */
uint64_t kiln_landing_at_once(const struct kiln_landing *l, uint64_t of_the_host);

/* Processes a range of this rank's work and adds its rays. */
typedef int (*kiln_landing_work)(struct kiln_landing *l, uint64_t first, uint64_t count, uint64_t *rays,
                                 struct kiln_error *error);
/* Collective. Processes this rank's work [begin, end) in batches of `at_once` and waits for the other ranks. Saves and
 * stops on request. */
int kiln_landing_work_through(struct kiln_landing *l, uint64_t begin, uint64_t end, uint64_t at_once,
                              kiln_landing_work work, int status, struct kiln_error *error);
/* Collective. Traces the remaining paths of iteration `number` of the bake. `before`: paths of earlier iterations, for
 * the progress display. */
int kiln_landing_run_paths(struct kiln_landing *l, uint64_t number, uint64_t before, kiln_take_landings take_landings,
                           struct kiln_error *error);

/* ---- land_pilots.c ---- */

/* Number of pilot paths in all rounds; 0: no pilots. */
uint64_t kiln_landing_pilot_paths(const struct kiln_landing *l);
/* Collective. Traces pilot paths, which bring no light: they determine how all iterations distribute their paths over
 * aims. Each of a few rounds learns from those before. */
int kiln_landing_run_pilots(struct kiln_landing *l, struct kiln_error *error);

/* ---- land_spread.c ---- */

/* Collective. Spreads the landings of all iterations with one radius over the points within it (--caustics merge). */
int kiln_landing_merge(struct kiln_landing *l, struct kiln_error *error);
/* Collective. Gathers rays at all own points and spreads their light together with the landings (--caustics vcm). A
 * checkpoint stores nothing of it: a resumed bake gathers again. */
int kiln_landing_spread(struct kiln_landing *l, struct kiln_error *error);

/* ---- land_save.c ---- */

/* Collective. Restores the state from a checkpoint made within this step. */
int kiln_landing_restore(struct kiln_landing *l, struct kiln_error *error);

/* ---- land_give.c ---- */

/* Fraction of the point's surface that exists, as in gather passes: kiln_point_result.present. */
float kiln_landing_presence(const struct kiln_landing *l, const struct kiln_surface *surface,
                            const struct kiln_point_cursor *at);
/* Whether an own tile run is a receiver: light paths do not meet it. */
bool kiln_landing_is_receiver(const struct kiln_landing *l, size_t tile_run);
/* Returns the end of the stretch of own tile runs from `first`, before `end`, that are all receivers or all not. */
size_t kiln_landing_same_kind(const struct kiln_landing *l, size_t first, size_t end);

#endif
