/* A sample of the surface, denoised while the bake runs, as lightmaps are at its end (output/map/denoise/regression.h).
 *
 * Space is divided into cubes of 48 texels a side, as wide as the scene's mean texel. A tile run belongs to the cube in
 * which its middle lies. Cubes are chosen by a hash, so that about 2^15 points lie in them. A scene with fewer points
 * is one cube. A cube is denoised by itself, with the tile runs up to 8 texels around it as neighbours. All ranks
 * receive all points of chosen cubes; each denoises some cubes. */
#ifndef KILN_COORDINATOR_BAKE_LIGHT_DENOISED_SAMPLE_H
#define KILN_COORDINATOR_BAKE_LIGHT_DENOISED_SAMPLE_H

#include <mpi.h>

#include "coordinator/integrate/denoising.h"
#include "worker/backend/backend.h"

/* Borrowed. `backend`: its device denoises if that is quicker. */
struct kiln_denoised_sample {
    MPI_Comm communicator;
    const struct kiln_scene *scene;
    const struct kiln_geometry *geometry;
    struct kiln_backend *backend;
    double area; /* m2, of the scene's triangles */
};

/* `run` of struct kiln_denoising, with a struct kiln_denoised_sample as its context. Collective. */
int kiln_denoised_sample_run(void *context, const struct kiln_rank_data *own, const struct kiln_denoising_calls *calls,
                             struct kiln_error *error);

#endif
