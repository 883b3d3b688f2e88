/* Preparation of a bake: turns a job into all inputs of light transport, which are the scene file, geometry, lights,
 * backend and surface points. */
#ifndef KILN_COORDINATOR_BAKE_PREPARE_PREPARE_H
#define KILN_COORDINATOR_BAKE_PREPARE_PREPARE_H

#include <mpi.h>

#include "coordinator/bake/prepare/backend_choice.h"
#include "coordinator/bake/prepare/import_scene.h"
#include "coordinator/bake/points/enclosed_lights.h"
#include "coordinator/run/control.h"
#include "coordinator/mpi/node_memory.h"
#include "coordinator/run/phases.h"
#include "coordinator/job/job.h"
#include "coordinator/run/progress.h"
#include "coordinator/import/import.h"
#include "coordinator/surface/surface_build.h"
#include "worker/backend/backend.h"
#include "worker/light/lights.h"

/* The best of Embree's instruction sets that this processor has. Not collective. */
const char *kiln_own_instruction_set(void);
/* The number of cores for this process as one of `node_ranks` ranks of its node: the cores it is bound to or, if it is
 * not bound, its share of all cores. Not collective. */
uint32_t kiln_own_cores(int node_ranks);

struct kiln_prepared {
    MPI_Comm communicator;
    int rank, ranks, node_rank, node_ranks;
    struct kiln_node_memory *node; /* holds the geometry and the surface's map */
    uint32_t threads;
    char instruction_set[16];
    struct kiln_scene_import import; /* `report`: rank 0 */
    double import_seconds;
    struct kiln_scene *scene;
    struct kiln_object *coarser; /* objects of the halved scene of kiln_prepare_coarser; else NULL */
    struct kiln_geometry *geometry;
    double leaf_size; /* m; 0: the store is the lightmap */
    struct kiln_lights *lights;
    struct kiln_lights *direct_lights; /* subset of `lights` without patches; NULL: all */
    struct kiln_backend_choice choice; /* the same on all ranks */
    /* rank 0, in a bake, once its surface points are there: the time it is expected to take; what is over, as measured
     */
    struct kiln_reckoned expected;
    struct kiln_foretold foretold;    /* likewise: the rounds, by a trial */
    double expected_then;             /* likewise: s of the whole bake, as its first round told; 0: it told nothing */
    struct kiln_backend_start *start; /* until the backend is created */
    struct kiln_backend *backend;
    struct kiln_backend_building *building; /* private: the backend under construction */
    struct kiln_aside built; /* backend built during the search for surface points; count is 0: built before */
    double first_pass;       /* MPI_Wtime() when the validity pass began */
    struct kiln_surface *surface;
    struct kiln_surface_report surface_report;
    struct kiln_enclosed_light *enclosed; /* rank 0, in a bake: enclosed lamps */
    size_t enclosed_count;
};

/* Additional checks that a bake needs during preparation. */
struct kiln_prepare_care {
    /* may ask to stop; kiln_prepare then returns KILN_STOPPED within a few seconds, in every phase. NULL: never */
    struct kiln_control *control;
    /* Collective. Checks whether the bake is possible, as far as that is known. Called when the scene is open
     * (p->surface is NULL then), and again when the surface exists, before the first ray of the validity pass. NULL: no
     * checks. */
    int (*refuse)(void *context, const struct kiln_prepared *p, struct kiln_error *error);
    void *context;
    /* --backend auto takes a device if there is one, even if processors are predicted to be faster */
    bool device_first;
};

/* Collective. Whether all ranks have the instruction set called `name`. */
bool kiln_instruction_set_common(MPI_Comm communicator, const char *name);

/* Collective over `communicator`. Imports the job's scene to `scene_file` (import_scene.h), and all ranks map that
 * file. One rank of each node builds the geometry and the surface's map, which the ranks of the node share. Every rank
 * builds its own BVH. All ranks find the surface points together, and each fills in its own points. The BVH is built at
 * the same time if a device is looked for or `care->control` is set. Then the validity pass runs. Begins the phases
 * "import", "scene and BVH", "surface points" and "validity". `care` may be NULL. Destroy with kiln_prepared_destroy.
 */
int kiln_prepare(struct kiln_prepared **prepared, MPI_Comm communicator, const struct kiln_job *job,
                 const char *scene_file, struct kiln_phases *phases, struct kiln_progress *progress,
                 const struct kiln_prepare_care *care, struct kiln_error *error);
/* Collective. Prepares the same scene with half as many texels a side in each lightmap, rounded up, and with its own
 * backend, lights and surface. `fine` is borrowed, and must outlive the result. `control` may ask to stop:
 * KILN_STOPPED. Destroy with kiln_prepared_destroy. */
int kiln_prepare_coarser(struct kiln_prepared **prepared, const struct kiln_prepared *fine, const struct kiln_job *job,
                         struct kiln_control *control, struct kiln_error *error);
/* Collective. Computes the albedo of the own points from the current materials of the scene, 3 values a point as in
 * kiln_surface.albedo. The surface is built once more for this. Release with kiln_free. KILN_SYSTEM. */
int kiln_prepare_albedo(const struct kiln_prepared *prepared, const struct kiln_job *job, uint16_t **albedo,
                        struct kiln_error *error);
void kiln_prepared_destroy(struct kiln_prepared **prepared);

#endif
