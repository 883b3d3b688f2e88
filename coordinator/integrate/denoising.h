/* Denoising of light while a bake runs: what lightmaps would show of it now. The error of published light is judged by
 * it (parts/published.h). The caller of kiln_integrate provides it, since integrators know no lightmaps. */
#ifndef KILN_COORDINATOR_INTEGRATE_DENOISING_H
#define KILN_COORDINATOR_INTEGRATE_DENOISING_H

#include "coordinator/field/rank_data.h"

enum { KILN_HALVES = 2 };

/* Luminance at a point as each of two independent halves of the samples found it, and its variance: that of one
 * half. */
struct kiln_halves {
    float light[KILN_HALVES], variance;
};

/* Calls for own tile runs. `give` fills in the halves of all its points; points that are not valid are not read. `take`
 * gets the denoised halves of all its points; `variance` has no meaning. Not called by several threads at once. */
struct kiln_denoising_calls {
    void (*give)(void *context, size_t tile_run, struct kiln_halves *points);
    void (*take)(void *context, size_t tile_run, const struct kiln_halves *points);
    void *context;
};

/* `run` is collective. It denoises both halves, each by itself, over a sample of the surface: `give` is called for tile
 * runs in the sample and around it, then `take` for those in the sample. The same sample and the same bits for any
 * number of ranks and threads. KILN_SYSTEM. */
struct kiln_denoising {
    int (*run)(void *context, const struct kiln_rank_data *own, const struct kiln_denoising_calls *calls,
               struct kiln_error *error);
    void *context;
};

#endif
