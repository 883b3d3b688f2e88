/* A companion is what accompanies the steps of an integrator: it prepares what a step gathers from, answers in the
 * place of rays, chooses which points are computed, takes the answers too, or sees to the points when a step is over.
 * One struct of functions for each; the table of all is companions.c, one folder for each (or for a few that belong
 * together) holds its code.
 *
 * The lockstep runner, its batches, checkpoints, the moving of points between ranks, the energy ledger, run.json, the
 * identity of a bake and `kiln plan` walk the table. A new one is a folder, its line in the list below, and its row.
 *
 * A companion with `by_step` accompanies the steps whose `with` names it (KILN_WITH), which the integrator says; any
 * other accompanies all steps of a bake that wants it, and sees from the step what is to do. */
#ifndef KILN_COORDINATOR_INTEGRATE_COMPANION_H
#define KILN_COORDINATOR_INTEGRATE_COMPANION_H

#include "coordinator/integrate/integrate.h"
#include "coordinator/job/job.h"
#include "worker/backend/backend.h"

/* The names of all companions, in the order of their calls: each is a struct kiln_companion_NAME. */
#define KILN_COMPANION_LIST(DO)                                                                                        \
    DO(seen) DO(blocks) DO(nodes) DO(reach) DO(probes) DO(landing) DO(patches) DO(senders) DO(groups) DO(kept) DO(parts)

#define KILN_COMPANION_PLACE(name) KILN_COMPANION_PLACE_##name,
enum kiln_companion_place { KILN_COMPANION_LIST(KILN_COMPANION_PLACE) KILN_COMPANIONS };
#undef KILN_COMPANION_PLACE

/* The bit of a companion in `with` of a step. */
#define KILN_WITH(name) (1u << KILN_COMPANION_PLACE_##name)

/* Whether a step has any of the companions whose bits are given. */
static inline bool kiln_step_has(const struct kiln_step *step, uint32_t bits) { return (step->with & bits) != 0; }

enum { KILN_COMPANION_ARRAYS = 7 }; /* maximum number of checkpoint blocks of a companion */

struct kiln_batches;
struct kiln_saved;
struct kiln_taker;

/* Parts of the lockstep runner (run/) that companions use. Borrowed, and valid as long as the companions exist. */
struct kiln_companion_site {
    const struct kiln_integrate_params *params;
    struct kiln_solution *solution;
    struct kiln_batches *batches;
    struct kiln_taker *taker;
    const struct kiln_saved *saved;
    bool plans; /* for `kiln plan`: only params is set, and there are no data of points */
};

/* Data of a job from which memory is estimated. */
struct kiln_companion_demand {
    const struct kiln_integrate_settings *settings;
    uint64_t points; /* of all ranks */
    double own;      /* points of the rank that has most */
    uint32_t ranks;
    bool device;        /* a device computes */
    uint64_t triangles; /* of the scene */
    uint64_t host_bvh;  /* bytes of a BVH that the host makes of it beside a device; 0: it has one anyway */
    /* of the companion that is asked; all zeros: it has measured nothing */
    const struct kiln_companion_measured *measured;
};

/* Input for measuring a companion, for `kiln plan`: a process that has all points. Borrowed. */
struct kiln_companion_sample {
    const struct kiln_integrate_params *params; /* of one rank */
    uint64_t points;                            /* of all ranks */
    uint32_t ranks;                             /* that the plan is for */
    double probe_seconds; /* s of one rank, for light paths of the irradiance volume (bake/volume/probe_paths.h) */
};

enum { KILN_COMPANION_TEXT = 160 };

/* Findings for `kiln plan`. All zeros: none. */
struct kiln_companion_measured {
    double seconds; /* of one rank that answers a step for all points */
    /* fields that are 0, and take no disk, at this share of the points; ended by NULL; NULL: none */
    const char *const *dark;
    double dark_share;
    json_t *json;                   /* what `kiln plan --json` says of it, under its name; NULL: nothing */
    char text[KILN_COMPANION_TEXT]; /* a line beside the time of the exchange; empty: none */
    void *own;                      /* of kiln_allocate: what it wants to know again when it is asked for its demand */
};

/* Input for the size of the files that a bake keeps beside its results. */
struct kiln_companion_kept {
    const struct kiln_job *job;
    uint64_t points;
    bool goes_on; /* rays from mirrors, gloss and glass, or they are tinted */
};

/* Memory of a rank, bytes: during the whole light transport; additionally in a step of the companion; on the device. */
struct kiln_companion_bytes {
    uint64_t always, in_step, device;
};

/* Objects of run.json that companions add to, in the order in which they are filled in. */
enum kiln_report_place {
    KILN_REPORT_SETTINGS,  /* `job`, of which kiln.h5 has a copy: told has nothing but the job */
    KILN_REPORT_MATERIALS, /* `materials`, where some are more than diffuse */
    KILN_REPORT_STEP,      /* of a step, in `bounces` or `quantities` */
    KILN_REPORT_LIGHT,     /* the whole report, after `tail` */
    KILN_REPORT_ERROR,     /* `error` */
    KILN_REPORT_RANKS,     /* the whole report, after `memory` */
    KILN_REPORT_MPI,       /* `mpi` */
    KILN_REPORT_FILES,     /* the whole report, after `volume` */
    KILN_REPORT_PLACES
};

enum { KILN_COMPANION_COUNTS = 12 }; /* of a rank, that a companion has for the report, at most */

/* Input for the report of a bake. Borrowed; NULL where it is of another place of the report. */
struct kiln_companion_told {
    const struct kiln_job *job;
    const struct kiln_scene *scene;
    const struct kiln_solution *solution;
    const struct kiln_step_report *step; /* KILN_REPORT_STEP */
    const uint64_t *counts;              /* of all ranks: KILN_COMPANION_COUNTS of the companion that is asked */
};

/* A companion. Functions may be NULL if there is nothing to do. `self` is the result of `create`, else NULL. Collective
 * functions return the same status on all ranks. */
struct kiln_companion {
    const char *name;
    bool by_step;
    /* Batches of own tile runs are cut before they reach a backend: it cannot claim parts of them on demand, and no
     * points are traced on trial before the first step. */
    bool whole_batches;

    /* Options of bake that its light hangs on, which are a part of a bake's identity (bake/identity/identity.h), and
     * such that change no light; each list is ended by NULL, and may be NULL. Identities keep their order from version
     * to version: the former follow option `identity_after`, which no companion has; NULL: they come last. */
    const char *const *identity, *const *no_identity;
    const char *identity_after;

    /* Whether a bake uses the companion. */
    bool (*wanted)(const struct kiln_integrate_params *params);
    /* Makes `self`, before any data of points exist. Not collective. `destroy` is always called later, also with self
     * NULL. */
    int (*create)(void **self, const struct kiln_companion_site *site, struct kiln_error *error);
    void (*destroy)(void **self);
    /* Collective. Called once the own points have their data (also from a checkpoint), before the first step. */
    int (*settle)(void **self, const struct kiln_companion_site *site, struct kiln_error *error);
    /* Collective. After the last step. */
    int (*end)(void *self, const struct kiln_companion_site *site, struct kiln_error *error);

    /* `makes`: whether the companion makes the parameters of a pass. `parameters` makes those of a step, which gathers
     * from the packed radiosity of all points; called before before_step. They are valid until the next call.
     * Collective. */
    bool (*makes)(const struct kiln_pass *pass);
    int (*parameters)(void *self, const uint64_t *radiosity, struct kiln_step *step, struct kiln_error *error);
    /* Collective. Called before the batches of the step last reported, at its beginning or when it is resumed. May
     * write checkpoints. */
    int (*before_step)(void *self, const struct kiln_companion_site *site, struct kiln_error *error);
    /* Collective. Called when all batches of the step are done on all ranks, before its sums are added up. */
    int (*complete)(void *self, const struct kiln_companion_site *site, struct kiln_error *error);
    /* Collective. Called after the integrator has ended the step; `unit` is that of exact sums of power, W. */
    int (*after_step)(void *self, const struct kiln_companion_site *site, double unit, struct kiln_error *error);

    /* Narrows the selection of points of tile run `tile_run` of `data`; at first all are selected. Pure. */
    void (*select)(const struct kiln_integrate_settings *settings, const struct kiln_step *step,
                   const struct kiln_rank_data *data, size_t tile_run, struct kiln_selection *selection);
    /* `field`: the field (field/fields.c) on which `select` is based. `find` fills it in for the own points, before
     * settle, and in `kiln plan` for all points. Not collective. */
    const char *field;
    int (*find)(const struct kiln_integrate_params *params, const struct kiln_rank_data *data,
                struct kiln_error *error);
    /* Computes the results of a batch of own tile runs in place of the backend, and calls the batch's `take`. Ranks do
     * not steal work in such a step, and the cost of its points does not predict the next step. */
    int (*answer)(void *self, const struct kiln_batch *batch, struct kiln_error *error);
    /* Receives the results of a tile run, in addition to the integrator. Called by several threads at once. */
    void (*take)(const void *self, const struct kiln_taking *taking, const struct kiln_rank_data *data,
                 const struct kiln_tile_run *tile_run, const void *results);
    /* Factor on the expected speed of a step, by its samples alone, before any of it was timed: 1 or less. */
    double (*weight)(const struct kiln_step *step);

    /* ---- separate lights that the companion keeps besides the scene's; linear changes apply to them too ---- */
    /* Collective. Called after the integrator has exchanged radiosity; `restored`: that of a resumed step. */
    void (*exchange)(void *self, bool restored);
    /* Calls `change` for each of the separate lights, on own data that refer to that light. */
    void (*each_light)(const void *self, void (*change)(const struct kiln_rank_data *own));
    /* Adds, in each separate light, `factor` times the radiosity of the last step to the sums of `count` own points. */
    void (*extend)(const void *self, struct kiln_own_point first, uint64_t count, const float factor[3]);

    /* All light is computed: changes what the energy ledger is to be closed with. The same on all ranks. */
    void (*close)(const struct kiln_companion_site *site, struct kiln_energy_closing *closing);

    /* Collective. Called before and after points move to other ranks: bounds[r] will be the first point of rank r, and
     * bounds[ranks] the number of all points. */
    int (*before_move)(void *self, const struct kiln_companion_site *site, const uint64_t *bounds,
                       struct kiln_error *error);
    int (*after_move)(void *self, const struct kiln_companion_site *site, struct kiln_error *error);

    /* Makes the blocks for a checkpoint within the step: fills in at most KILN_COMPANION_ARRAYS, which borrow, and
     * returns their number. The companion reads them itself, in before_step of the resumed step. */
    size_t (*blocks)(void *self, struct kiln_array_range *blocks);
    /* Bytes of a point in these blocks. */
    uint64_t (*saved_bytes)(const struct kiln_integrate_settings *settings);
    /* Whether a report that was read from a checkpoint is plausible. */
    bool (*is_sane)(const struct kiln_step_report *report);

    /* Row in the table of phases of what it traces beside the steps, and seconds of it that were for a step. */
    const char *phase;
    double (*beside)(const struct kiln_step_report *report);
    /* Adds to the fields of the identity what options alone do not say. */
    void (*identify)(const struct kiln_job *job, json_t *fields);
    /* Counts of this rank for the report, which are added up over all. */
    void (*count)(const struct kiln_solution *solution, uint64_t counts[KILN_COMPANION_COUNTS]);
    /* Adds its part to run.json, at each of the places. Asked of bakes that do not want it, too: adds nothing then. */
    void (*report[KILN_REPORT_PLACES])(const struct kiln_companion_told *told, json_t *json);

    /* For `kiln plan`, of a companion that is wanted: tries some of what it will do. Not collective. */
    int (*measure)(const struct kiln_companion_sample *sample, struct kiln_companion_measured *measured,
                   struct kiln_error *error);
    /* For `kiln plan`: bytes of the files that it keeps beside the results for a step; `step` NULL: for all together.
     */
    uint64_t (*files)(const struct kiln_companion_kept *kept, const struct kiln_step *step);
    /* For `kiln plan`: adds the memory of a rank. */
    void (*demand)(const struct kiln_companion_demand *demand, struct kiln_companion_bytes *bytes);
    /* Ratio of a step's time with the companion to its time without. */
    double (*share)(const struct kiln_step *step);
};

#define KILN_COMPANION_DECLARE(name) extern const struct kiln_companion kiln_companion_##name;
KILN_COMPANION_LIST(KILN_COMPANION_DECLARE)
#undef KILN_COMPANION_DECLARE

/* All companions, each at its index, ended by NULL: the default of `companions` of kiln_integrate_params. */
extern const struct kiln_companion *const kiln_companions[];

/* Whether a step has companion `place` of a table. */
static inline bool kiln_companion_is_with(const struct kiln_companion *const *table, size_t place,
                                          const struct kiln_step *step)
{
    return !table[place]->by_step || (step->with >> place & 1u) != 0;
}

/* The companion that computes a step's results in place of its pass; NULL: none does. */
const struct kiln_companion *kiln_companion_answering(const struct kiln_companion *const *table,
                                                      const struct kiln_step *step);
/* Whether some companion of the step selects points. */
bool kiln_companions_select(const struct kiln_companion *const *table, const struct kiln_step *step);
/* Fills in the fields by which the companions select points. Not collective. */
int kiln_companions_find(const struct kiln_companion *const *table, const struct kiln_integrate_params *params,
                         const struct kiln_rank_data *data, struct kiln_error *error);
/* Whether a report that was read from a checkpoint is plausible to all companions of the table. */
bool kiln_companions_are_sane(const struct kiln_companion *const *table, const struct kiln_step_report *report);
/* The ratio of a step's time with its companions to its time without. */
double kiln_companions_share(const struct kiln_companion *const *table, const struct kiln_step *step);
/* Fills in the counts of this rank, KILN_COMPANION_COUNTS for each companion of the table. */
void kiln_companions_count(const struct kiln_companion *const *table, const struct kiln_solution *solution,
                           uint64_t *counts);
/* Adds what the companions of the table tell at a place of the report. `counts`: of all; NULL: of none. */
void kiln_companions_report(const struct kiln_companion *const *table, enum kiln_report_place place,
                            const struct kiln_companion_told *told, const uint64_t *counts, json_t *json);
/* Has the companions of the table measured, each at its place. Release with kiln_companions_forget, in any case. */
int kiln_companions_measure(const struct kiln_companion *const *table, const struct kiln_companion_sample *sample,
                            struct kiln_companion_measured *measured, struct kiln_error *error);
void kiln_companions_forget(const struct kiln_companion *const *table, struct kiln_companion_measured *measured);
/* Adds what the companions of the table say of what was measured, each by its name. */
void kiln_companions_tell_measured(const struct kiln_companion *const *table,
                                   const struct kiln_companion_measured *measured, json_t *json);
/* Seconds of one rank for a step whose pass is not run, for all points. */
double kiln_companions_seconds(const struct kiln_companion *const *table,
                               const struct kiln_companion_measured *measured, const struct kiln_step *step);
/* The share of the points at which a field is 0 by a companion's doing. */
double kiln_companions_dark(const struct kiln_companion *const *table, const struct kiln_companion_measured *measured,
                            const char *field);
/* The memory that the companions of the table need, by what was measured of them. */
struct kiln_companion_bytes kiln_companions_demand(const struct kiln_companion *const *table,
                                                   const struct kiln_companion_measured *measured,
                                                   const struct kiln_companion_demand *demand);
/* Bytes of the files that are kept beside the results for a step; NULL: for all steps together. */
uint64_t kiln_companions_files(const struct kiln_companion *const *table, const struct kiln_companion_kept *kept,
                               const struct kiln_step *step);
/* Bytes of a point in the checkpoint of a step that has all the companions that a bake wants. */
uint64_t kiln_companions_saved_bytes(const struct kiln_companion *const *table,
                                     const struct kiln_integrate_params *params);
/* The points of a tile run that are computed in a step. */
struct kiln_selection kiln_companions_selection(const struct kiln_companion *const *table,
                                                const struct kiln_integrate_settings *settings,
                                                const struct kiln_step *step, const struct kiln_rank_data *data,
                                                size_t tile_run);
/* Fills in the selections of a batch of tile runs of `data`, where some companion of the step selects points. They
 * stand in *selections, with room for *room: zero at first, then grown as kiln_grow has it. KILN_SYSTEM. */
int kiln_companions_choose(const struct kiln_companion *const *table, const struct kiln_integrate_settings *settings,
                           const struct kiln_step *step, const struct kiln_rank_data *data, struct kiln_batch *batch,
                           struct kiln_selection **selections, size_t *room, struct kiln_error *error);

#endif
