/* Reckoning of a bake's time, phase by phase, before it runs: amounts of work (work.h) times times of a unit that were
 * measured once (rates.h). It is the one reckoning of all who say what a bake will take: `--backend auto`, the bake
 * itself before its light, and `kiln plan`, which puts what it has measured here in the place of some phases. */
#ifndef KILN_COORDINATOR_BAKE_RECKON_RECKON_H
#define KILN_COORDINATOR_BAKE_RECKON_RECKON_H

#include <jansson.h>

#include "coordinator/bake/reckon/work.h"

/* The phases, in the order in which a bake comes to them: name, and the row of phases in run.json that it is a part of.
 * `start` is the time of libraries, MPI and a device's driver that nothing hides; `kernels` that in which passes wait
 * for kernels, which a bake counts in the phase that waits. */
#define KILN_RECKON_PHASE_LIST(DO)                                                                                     \
    DO(start, "start")                                                                                                 \
    DO(import, "import")                                                                                               \
    DO(world, "scene and BVH")                                                                                         \
    DO(points, "surface points")                                                                                       \
    DO(validity, "validity")                                                                                           \
    DO(emission, "emission")                                                                                           \
    DO(kernels, "kernels")                                                                                             \
    DO(direct, "direct light")                                                                                         \
    DO(caustics, "caustics")                                                                                           \
    DO(bounces, "bounces")                                                                                             \
    DO(final, "final gather")                                                                                          \
    DO(quantities, "quantities")                                                                                       \
    DO(judging, "judging")                                                                                             \
    DO(probes, "probes")                                                                                               \
    DO(denoising, "denoising")                                                                                         \
    DO(lightmaps, "lightmaps")                                                                                         \
    DO(h5, "kiln.h5")                                                                                                  \
    DO(preview, "preview")                                                                                             \
    DO(rest, "other")

#define KILN_RECKON_PHASE_OF(id, name) KILN_RECKON_##id,
enum kiln_reckon_phase { KILN_RECKON_PHASE_LIST(KILN_RECKON_PHASE_OF) KILN_RECKON_PHASES };
#undef KILN_RECKON_PHASE_OF

enum kiln_reckon_backend { KILN_RECKON_EMBREE, KILN_RECKON_VULKAN, KILN_RECKON_BACKENDS };

/* A bake, and the machine that it runs on. */
struct kiln_reckon_question {
    struct kiln_work work;
    double threads; /* of all ranks */
    double ranks;   /* with a device each, where devices compute */
    double kernels; /* that a device needs and that are not kept from an earlier bake (kernels_kept.h) */
    double import;  /* s that the import took; negative: not known yet */
};

/* Seconds of the slowest rank. */
struct kiln_reckoned {
    double seconds[KILN_RECKON_PHASES];
    double total;
};

/* Reckons the bake on a backend. Pure. */
struct kiln_reckoned kiln_reckon_bake(const struct kiln_reckon_question *question, enum kiln_reckon_backend backend);

/* Puts seconds that were measured in the place of reckoned ones, and corrects the total. */
void kiln_reckon_put(struct kiln_reckoned *reckoned, enum kiln_reckon_phase phase, double seconds);

/* The name of a phase, as in run.json. */
const char *kiln_reckon_phase_name(enum kiln_reckon_phase phase);
/* The phase in which a row of phases of run.json is reckoned, or a role's phase (integrate/step.h): the one of that
 * name; `quantities` for all others. */
enum kiln_reckon_phase kiln_reckon_phase_of(const char *name);
/* Seconds of light on surfaces: direct light, caustics, bounces, final gather, quantities, judging of rounds. */
double kiln_reckon_light(const struct kiln_reckoned *reckoned);
/* Seconds of all that follows it: probes, lightmaps, files, the preview. */
double kiln_reckon_after(const struct kiln_reckoned *reckoned);

/* {"total": ..., and each phase that takes time by its name}. New reference; NULL if memory is short. */
json_t *kiln_reckon_json(const struct kiln_reckoned *reckoned);

#endif
