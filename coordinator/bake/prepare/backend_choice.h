/* Choice of the backend for `--backend auto`: the one that is expected to finish the whole bake sooner. A GPU traces
 * many times as fast as processors do, but takes some tenths of a second to start; a small bake is done by then. */
#ifndef KILN_COORDINATOR_BAKE_PREPARE_BACKEND_CHOICE_H
#define KILN_COORDINATOR_BAKE_PREPARE_BACKEND_CHOICE_H

#include <stdbool.h>
#include <stdint.h>

#include "coordinator/job/job.h"
#include "worker/scene/scene.h"

/* Facts about a bake before its surface points are known. */
struct kiln_backend_question {
    uint64_t triangles; /* in the world, instances expanded */
    uint64_t points;    /* estimated by the texels of all lightmaps, most of which are covered */
    double rays;        /* of light and probes, of all ranks */
    uint64_t threads;   /* of all ranks */
    uint32_t ranks;
};

/* A prediction from speeds that were measured once (backend_choice.c). It leaves out work that takes both backends the
 * same time: import, points, files. So it compares backends; `kiln plan` forecasts the time of a bake. */
struct kiln_backend_choice {
    bool asked;            /* --backend auto: this choice sets the backend */
    bool processors;       /* Embree is expected to be done first */
    double embree_seconds; /* BVH and light */
    double vulkan_seconds; /* start, BVH and light, with a GPU for each rank */
    struct kiln_backend_question question;
};

/* Collects the facts for a job whose sample counts are settled and whose scene is open. Not collective. */
struct kiln_backend_question kiln_backend_ask(const struct kiln_job *job, const struct kiln_scene *scene,
                                              uint64_t threads, uint32_t ranks);
/* Fills in the seconds of both backends and which is faster. */
void kiln_backend_predict(struct kiln_backend_choice *choice);

#endif
