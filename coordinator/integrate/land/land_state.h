/* State shared by the files of land.h: land.c (the step), land_size.c (how many paths and bytes), land_aims.c (how
 * paths are shared out), land_paths.c (tracing them and exchanging what lands), land_pilots.c (paths that teach the
 * others), land_trial.c (whether they are worth it), land_spread.c (spreading over points nearby), land_pool.c (what
 * stays specks), land_save.c (checkpoints), land_give.c (answers). Nothing else includes it. */
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

/* Tile runs whose answers are given at once, at most. */
enum { KILN_LANDING_GIVEN_TILE_RUNS = 256 };

/* The block "landing" of a checkpoint, once: where the step stands. After it "landing_learnt" and "landing_paths",
 * once, an element an aim; "landing_moments", likewise, of each rank; "landing_sums" and, where they are merged,
 * "landing_merged", an element a point. */
struct kiln_landing_saved {
    uint64_t step; /* its number */
    uint64_t iteration, done, photons, aims;
    double radius;
};
_Static_assert(sizeof(struct kiln_landing_saved) == 48, "a record has no gaps");

struct kiln_landing {
    const struct kiln_integrate_params *params;
    struct kiln_solution *solution;
    const struct kiln_saved *saved;
    struct kiln_aims *aims;
    uint64_t photons;         /* of an iteration */
    struct kiln_backend *own; /* of the step: Embree, where the bake's backend is a device that leaves it some */
    /* --caustics vcm, else NULL; what light paths share their light with, and how much */
    struct kiln_emission *emission;
    struct kiln_mirror_images *images; /* or NULL, where no flat mirror shows a lamp without extent */
    struct kiln_caustic_techniques techniques;
    struct kiln_landing_weights landing_weights;
    /* of an iteration: this rank's second moments by aim; of all so far: by aim, and the paths that they are of */
    uint64_t *moments;
    double *learnt, *paths, *weights;
    uint64_t iteration, done; /* iterations that are done; paths of the next one */
    /* as they were when the block under way began: of all of it that a checkpoint has */
    uint64_t *moments_before, rays_before;
    struct kiln_landing_saved record;
    bool begun;     /* a step has: the checkpoint has nothing of those after it, and its files may be gone by then */
    bool restored;  /* what was learnt and landed before, from a checkpoint */
    bool pilots;    /* the paths under way bring no light; a checkpoint has nothing of them */
    size_t *landed; /* of parts of a batch, as many as there are threads: how many paths land; then where theirs go */
    double speed;   /* paths a second, of this rank's last block; 0: there was none */
    /* of the step */
    struct kiln_land_exchange exchange;
    struct kiln_landing_sum *sums; /* of own points; where they are merged, of iterations of the radius under way */
    struct kiln_point_result *results;
    float *lit; /* m2, an own point: area that is there to be lit; with --caustics merge and vcm, else NULL */
    /* where what lands is spread over points nearby (--caustics merge, vcm); else NULL */
    struct kiln_merged *merged;
    struct kiln_merge *merge;          /* from when it is first spread on */
    struct kiln_landing_sum *gathered; /* of --caustics vcm, or NULL: what rays find, as if it had landed */
    float *tried[2]; /* W, luminance: what each half of the pilots has landed at own points; or NULL */
    int half;        /* of which the pilot under way is */
    double radius;   /* m, at first; of --caustics vcm the largest */
    struct kiln_arena arena;
};

/* Whether gather rays find a part of the light. */
static inline bool kiln_landing_shares(const struct kiln_landing *l) { return l->emission != NULL; }
/* And has them, which needs light paths. */
static inline bool kiln_landing_gathers(const struct kiln_landing *l)
{
    return kiln_landing_shares(l) && l->aims->count > 0;
}
/* Whether what has landed in an iteration is spread over points nearby. */
static inline bool kiln_landing_merges(const struct kiln_landing *l)
{
    return l->params->settings->caustics == KILN_CAUSTICS_MERGE;
}
/* Whether what gather rays find is spread with what lands. */
static inline bool kiln_landing_spreads_rays(const struct kiln_landing *l)
{
    return kiln_landing_gathers(l) && kiln_landing_spreads(l->params->settings);
}
/* Rays of a point in the step, but for objects that no path meets. */
static inline uint32_t kiln_landing_own_rays(const struct kiln_landing *l)
{
    return kiln_landing_rays(l->params->settings, kiln_solution_step(l->solution)->step.samples, l->images != NULL);
}
/* And the first of them in the sequence; parts of a bake follow each other. */
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

/* As before the first path of a step. */
void kiln_landing_forget(struct kiln_landing *l);
/* Second moments of paths one after the other, of which many that follow each other are of one aim. Zero at first. */
struct kiln_landing_moments {
    uint32_t aim;
    uint64_t sum;
};
/* Adds that of a path by `aim` that counts so much, W. Several threads may, each with moments of its own. */
void kiln_landing_note_moment(struct kiln_landing *l, struct kiln_landing_moments *moments, uint32_t aim,
                              double luminance);
/* After the last path. */
void kiln_landing_note_rest(struct kiln_landing *l, struct kiln_landing_moments *moments);
/* Shares `paths` of the next iteration out by what was learnt. */
void kiln_landing_aim(struct kiln_landing *l, uint64_t paths);
/* Collective. Adds an iteration's moments to those learnt, and shares `paths` of the next one out. */
void kiln_landing_correct_aims(struct kiln_landing *l, uint64_t paths);

/* ---- land_paths.c ---- */

/* Runs a pass where it can be run (kiln_landing_host). */
int kiln_landing_run_pass(struct kiln_landing *l, const struct kiln_pass *pass, const void *parameters,
                          const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error);
/* How much of a pass's work is handed over at once: more to a device. */
uint64_t kiln_landing_at_once(const struct kiln_landing *l, uint64_t of_the_host);

/* Does some of this rank's work, and adds its rays. */
typedef int (*kiln_landing_work)(struct kiln_landing *l, uint64_t first, uint64_t count, uint64_t *rays,
                                 struct kiln_error *error);
/* Collective. Does the work [begin, end) of this rank, so much at once, and waits for the others; saves and stops when
 * that is asked for. */
int kiln_landing_work_through(struct kiln_landing *l, uint64_t begin, uint64_t end, uint64_t at_once,
                              kiln_landing_work work, int status, struct kiln_error *error);
/* Collective. The rest of the paths of an iteration, by its number among all of the bake. `before`: paths before them,
 * for the progress. */
int kiln_landing_run_paths(struct kiln_landing *l, uint64_t number, uint64_t before, kiln_take_landings take_landings,
                           struct kiln_error *error);

/* ---- land_pilots.c ---- */

/* Pilot paths of all rounds; 0: there are none. */
uint64_t kiln_landing_pilot_paths(const struct kiln_landing *l);
/* Collective. Paths that teach how those of all iterations are shared out, in a few rounds of which each learns from
 * those before, and bring no light. */
int kiln_landing_run_pilots(struct kiln_landing *l, struct kiln_error *error);

/* ---- land_spread.c ---- */

/* Collective. What has landed in iterations of one radius goes to the points within it (--caustics merge). */
int kiln_landing_merge(struct kiln_landing *l, struct kiln_error *error);
/* Collective. The rays of all own points, and with what has landed that is spread (--caustics vcm). A checkpoint has
 * nothing of them: a bake that goes on gathers again. */
int kiln_landing_spread(struct kiln_landing *l, struct kiln_error *error);

/* ---- land_save.c ---- */

/* Collective. Takes over what a checkpoint within this step has. */
int kiln_landing_restore(struct kiln_landing *l, struct kiln_error *error);

/* ---- land_give.c ---- */

/* Share of the point's surface that is present, as for the passes that gather: kiln_point_result.present. */
float kiln_landing_presence(const struct kiln_landing *l, const struct kiln_surface *surface,
                            const struct kiln_point_cursor *at);
/* Whether no path meets an own tile run. */
bool kiln_landing_is_receiver(const struct kiln_landing *l, size_t tile_run);
/* The end of the own tile runs from `first` on, before `end`, that paths meet, or do not, alike. */
size_t kiln_landing_same_kind(const struct kiln_landing *l, size_t first, size_t end);

#endif
