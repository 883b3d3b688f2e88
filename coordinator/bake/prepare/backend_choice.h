/* Choice of the backend for `--backend auto`: the one that is expected to finish the whole bake sooner
 * (bake/reckon/reckon.h). A GPU traces many times as fast as processors do, but takes some tenths of a second to start
 * and, in the first bake of its kind, seconds to make kernels; a small bake is done by then. */
#ifndef KILN_COORDINATOR_BAKE_PREPARE_BACKEND_CHOICE_H
#define KILN_COORDINATOR_BAKE_PREPARE_BACKEND_CHOICE_H

#include <stdbool.h>

#include "coordinator/bake/reckon/reckon.h"
#include "worker/light/lights.h"

struct kiln_backend_choice {
    bool asked;      /* --backend auto: this choice sets the backend */
    bool processors; /* Embree is expected to be done first */
    struct kiln_reckon_question question;
    struct kiln_reckoned reckoned[KILN_RECKON_BACKENDS]; /* Vulkan with a GPU for each rank */
};

/* Machine that a bake runs on, and what is known before it begins. */
struct kiln_backend_known {
    uint64_t threads; /* of all ranks */
    uint32_t ranks;
    double import;                        /* s that the import took; negative: unknown */
    double points;                        /* surface points; 0: unknown */
    const struct kiln_lights *lights;     /* NULL: unknown */
    const struct kiln_foretold *foretold; /* all rounds, as a trial told them; NULL: unknown */
};

/* Fills in the question of a choice: a job whose sample counts are settled, and its open scene. The materials of the
 * job need not be settled. Not collective. KILN_SYSTEM. */
int kiln_backend_ask(struct kiln_backend_choice *choice, const struct kiln_job *job, const struct kiln_scene *scene,
                     const struct kiln_backend_known *known, struct kiln_error *error);
/* Reckons the question on both backends, and which is done sooner. Pure. */
void kiln_backend_predict(struct kiln_backend_choice *choice);

/* Rays of surface points and probes: what a device's traversals are chosen by. */
double kiln_backend_rays(const struct kiln_backend_choice *choice);

#endif
