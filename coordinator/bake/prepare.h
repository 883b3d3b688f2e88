/* From a job to everything that light transport needs: scene file, geometry, lights, backend, surface points. */
#ifndef KILN_COORDINATOR_BAKE_PREPARE_H
#define KILN_COORDINATOR_BAKE_PREPARE_H

#include <mpi.h>

#include "coordinator/run/control.h"
#include "coordinator/mpi/node_memory.h"
#include "coordinator/run/phases.h"
#include "coordinator/job/job.h"
#include "coordinator/run/progress.h"
#include "coordinator/import/import.h"
#include "coordinator/surface/surface_build.h"
#include "worker/backend/backend.h"
#include "worker/light/lights.h"

/* The best of Embree's instruction sets that this processor has, and the cores that this process may use as one of
 * `node_ranks` on its node: when it is not bound to some of the machine's, it shares them. */
const char *kiln_own_instruction_set(void);
uint32_t kiln_own_cores(int node_ranks);

struct kiln_prepared {
    MPI_Comm communicator;
    int rank, ranks, node_rank, node_ranks;
    struct kiln_node_memory *node; /* holds geometry and the map of the surface */
    uint32_t threads;
    char instruction_set[16];
    struct kiln_import_report import; /* rank 0 */
    struct kiln_scene *scene;
    struct kiln_geometry *geometry;
    struct kiln_lights *lights;
    struct kiln_backend *backend;
    struct kiln_surface *surface;
    struct kiln_surface_report surface_report;
};

/* What a bake adds. */
struct kiln_prepare_care {
    /* what asks to stop: KILN_STOPPED within a few seconds, in every phase; NULL: nothing does */
    struct kiln_control *control;
    /* Collective. Called as soon as the scene is open, when p->surface is NULL, and again when the surface is there,
     * before any ray of the validity pass: whether the bake can be made as it is asked for, as far as that can be said
     * by then. NULL: it can. */
    int (*refuse)(void *context, const struct kiln_prepared *p, struct kiln_error *error);
    void *context;
};

/* Collective. Whether all ranks have the instruction set called `name`. */
bool kiln_instruction_set_common(MPI_Comm communicator, const char *name);

/* Collective. Rank 0 imports the job's scene to `scene_file`, all map it; one rank of each node
 * builds the geometry, which the others share, and so they share the map of the surface; every rank builds its BVH; all
 * find the surface points together, and each fills in its own; the validity pass runs. Phases "import", "scene and
 * BVH", "surface points", "validity" are begun. `care` may be NULL. Destroy with kiln_prepared_destroy. */
int kiln_prepare(struct kiln_prepared **prepared, MPI_Comm communicator, const struct kiln_job *job,
                 const char *scene_file, struct kiln_phases *phases, struct kiln_progress *progress,
                 const struct kiln_prepare_care *care, struct kiln_error *error);
void kiln_prepared_destroy(struct kiln_prepared **prepared);

#endif
