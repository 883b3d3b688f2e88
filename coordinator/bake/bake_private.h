/* The state of a bake, and the parts of the pipeline in the order in which bake.c calls them. All functions here are
 * collective unless they say otherwise, and return the same status on all ranks. */
#ifndef KILN_COORDINATOR_BAKE_BAKE_PRIVATE_H
#define KILN_COORDINATOR_BAKE_BAKE_PRIVATE_H

#include "coordinator/bake/bake.h"
#include "coordinator/bake/light/denoised_sample.h"
#include "coordinator/bake/light/density_check.h"
#include "coordinator/bake/prepare/prepare.h"
#include "coordinator/bake/light/visible_from.h"
#include "coordinator/bake/volume/volume.h"
#include "coordinator/files/folder.h"
#include "coordinator/integrate/integrate.h"
#include "coordinator/integrate/relight/transport.h"
#include "coordinator/output/map/write/lightmaps.h"
#include "coordinator/output/points_ahead.h"
#include "coordinator/output/vertex_light.h"
#include "coordinator/view/view.h"
#include "worker/backend/emission.h"
#include "worker/light/light_groups.h"

struct kiln_bake {
    const struct kiln_job *job, *asked; /* `job` is settled (materials.h); `asked` is the job as the caller gave it */
    MPI_Comm communicator;
    struct kiln_job settled;        /* storage of `job` once the scene is imported: materials.h */
    enum kiln_gloss_mode materials; /* as asked for */
    int rank;
    bool makes_scene, keeps_scene; /* rank 0: the folder had no scene file; it had one, which is kept */
    char scene_file[KILN_PATH_SIZE];
    double begin; /* MPI_Wtime() */
    struct kiln_phases phases;
    struct kiln_trace *trace;       /* NULL: none */
    struct kiln_watchdog *watchdog; /* NULL: none */
    struct kiln_control *control;
    struct kiln_checkpoint *checkpoint;
    json_t *identity;
    struct kiln_progress *progress;
    struct kiln_prepared *prepared;
    struct kiln_visible_from visible; /* points that the views of the job need, if it names any */
    struct kiln_emission_result emission;
    struct kiln_round_listener listener;                           /* bake_expect.c */
    struct kiln_integrate_settings light_settings, probe_settings; /* settings of surface light and of probes */
    struct kiln_reference_parameters paths; /* the settings point to it with --method path, bdpt and vcm */
    struct kiln_field_set fields;
    struct kiln_integrate_params light_params;
    struct kiln_denoised_sample denoised; /* what `denoising` works with */
    struct kiln_denoising denoising;      /* judges published light */
    struct kiln_beside beside;            /* thread that packs `ahead` while light steps run */
    struct kiln_points_ahead *ahead;      /* NULL: nothing was packed */
    double ahead_start;                   /* MPI_Wtime() */
    struct kiln_solution *solution;
    struct kiln_volume_result volume;
    struct kiln_lightmap_report *lightmaps;
    struct kiln_density_check density;
    struct kiln_vertex_light vertices;
    struct kiln_light_groups groups; /* bake_groups.c; owned; count 0: no groups of lights */
    uint64_t probe_rays;
    bool same_probes; /* the probes of the checkpoint can be used */
    bool saves;       /* during light steps and the probe pass: stopping then writes a checkpoint */
    bool light_done;  /* everything is done except writing the files */
    /* transport (hits of rays) that is kept or replayed: bake_transport.c */
    struct kiln_transport transport;
    struct kiln_folder transport_folder;
    json_t *transport_identity; /* rank 0 */
    char **transport_files;     /* paths relative to the output folder; set once the files are complete */
    size_t transport_file_count;
    json_t *preview; /* rank 0: its camera and exposure; NULL: none */
    char preview_text[KILN_VIEWPOINT_TEXT];
    bool exported;       /* scene.glb has been written */
    json_t *report;      /* rank 0: content of run.json */
    const uint8_t *only; /* bake_states.c: lightmaps to write (output.h); NULL: all */
    json_t *state;       /* part of run.json about the state being written; NULL: no state */
};

/* ---- bake_phase.c ---- */

/* Agrees on errors at the end of a phase. Time spent waiting for other ranks does not count for the phase. */
int kiln_bake_end_phase(struct kiln_bake *bake, int status, struct kiln_error *error);

/* ---- bake_folder.c: the output folder ---- */

/* Rank 0, with the folder locked. The first keeps the scene file of an earlier bake under a second name, since
 * importing replaces the file. The second drops that name; if the bake was refused, it restores the earlier scene file
 * or, if there was none, removes the new one. */
void kiln_bake_keep_scene(struct kiln_bake *bake);
void kiln_bake_settle_scene(const struct kiln_bake *bake, bool refused);
/* Checks, before any work, that the results and the timeline can be written. */
int kiln_bake_check_folder(struct kiln_bake *bake, struct kiln_error *error);
/* Makes room for the results: removes the manifest and run.json of an earlier bake, which will no longer be true, and
 * those files of it that this bake does not replace. */
int kiln_bake_clear_folder(struct kiln_bake *bake, struct kiln_error *error);

/* ---- bake_begin.c: before the first ray ---- */

/* Makes and locks the output folder, and opens the checkpoint. The checkpoint determines the instruction set unless the
 * job names one. */
int kiln_bake_take_charge(struct kiln_bake *bake, struct kiln_error *error);
/* Prepares the bake (prepare.h), and refuses what can be refused: a checkpoint of another bake, too little memory or
 * disk, results that cannot be written. Continues with the instruction set of the checkpoint if all ranks have it, to
 * keep the bits of the bake. */
int kiln_bake_prepare(struct kiln_bake *bake, struct kiln_error *error);

/* ---- bake_expect.c: before the light ---- */

/* Reckons the time of the bake (bake/reckon/reckon.h) from what is known when its surface points are there, into
 * prepared->expected of rank 0, and says so. */
int kiln_bake_expect(struct kiln_bake *bake, struct kiln_error *error);
/* kiln_round_listener; `bake` is a struct kiln_bake: reckons again with what the first round has taken, and says so if
 * it is much else. */
void kiln_bake_expect_again(void *bake, const struct kiln_step_reports *steps);

/* ---- bake_light.c: light on surfaces, and the volume ---- */

/* Collective. Fills in the settings, fields and parameters of the light of a prepared bake. */
int kiln_bake_settle_light(struct kiln_bake *bake, struct kiln_error *error);
int kiln_bake_light(struct kiln_bake *bake, struct kiln_error *error);
/* Checks the texel density, if the job asks for that and there is light. */
int kiln_bake_check_density(struct kiln_bake *bake, struct kiln_error *error);
/* Gathers the probes, if the job has any. */
int kiln_bake_volume(struct kiln_bake *bake, struct kiln_error *error);
/* Writes a checkpoint of the complete light, probes included. Returns KILN_STOPPED, or the error of writing. */
int kiln_bake_save(struct kiln_bake *bake, struct kiln_error *error);

/* ---- bake_transport.c: transport (hits of rays), kept or replayed; without such an option these do nothing ---- */

/* Refuses a bake whose transport cannot be kept, and a scene that differs from the scene of the kept transport. */
int kiln_bake_transport_check(struct kiln_bake *bake, const struct kiln_prepared *prepared, struct kiln_error *error);
/* Opens the folder of transport and fills in bake->transport. Called before the light is computed. */
int kiln_bake_transport_begin(struct kiln_bake *bake, struct kiln_error *error);
/* Writes the index of the transport and fills in bake->transport_files. Called after the light is computed. */
int kiln_bake_transport_write(struct kiln_bake *bake, struct kiln_error *error);
/* For run.json, on rank 0. New reference; NULL: there is none. */
json_t *kiln_bake_transport_json(struct kiln_bake *bake);
/* Not collective. */
void kiln_bake_transport_release(struct kiln_bake *bake);

/* ---- bake_states.c: bakes many states of a scene loaded once; for a job with --states or --listen ---- */

/* Bakes all states; replaces the steps after kiln_bake_prepare. Fills in bake->report with a summary. */
int kiln_bake_states(struct kiln_bake *bake, struct kiln_error *error);

/* ---- bake_groups.c: groups of lights; nothing without --light-groups ---- */

/* Fills in bake->groups. Refuses group names that the scene does not have, and bakes that cannot separate the light of
 * groups. */
int kiln_bake_groups_sort(struct kiln_bake *bake, struct kiln_error *error);
/* Not collective. */
void kiln_bake_groups_release(struct kiln_bake *bake);

/* ---- bake_results.c: the files ---- */

/* Writes all files of results; the manifest last. */
int kiln_bake_write(struct kiln_bake *bake, struct kiln_error *error);

#endif
