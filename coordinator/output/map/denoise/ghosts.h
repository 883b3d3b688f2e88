/* Ghosts: texels of other lightmaps that a map sees across its joints (joints.h). Denoising uses them as neighbours, so
 * that it does not stop where an object ends but its surface continues. Ghosts are read, not changed.
 *
 * Ghosts are selected by whole tiles: those partly within KILN_GHOST_TEXELS of a joint, on the layout of their own
 * map. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_DENOISE_GHOSTS_H
#define KILN_COORDINATOR_OUTPUT_MAP_DENOISE_GHOSTS_H

#include "coordinator/output/map/seams/joints.h"

/* Twice the radius of denoising: the neighbours of a fit across the joint then have neighbours on all sides too. */
#define KILN_GHOST_TEXELS 16.0f

/* A tile of lightmap `from` whose texels are ghosts of lightmap `to`. */
struct kiln_ghost_tile {
    uint32_t from, tile, to; /* tile: y * tiles_x + x */
};

struct kiln_ghosts {
    size_t count;
    struct kiln_ghost_tile *tiles; /* ordered by `from`, `tile` and `to`; unique */
};

/* Lists all ghost tiles. Depends on joints and sizes only; not collective. */
int kiln_ghosts_create(struct kiln_ghosts **ghosts, const struct kiln_joints *joints,
                       const struct kiln_surface *surface, struct kiln_error *error);
void kiln_ghosts_destroy(struct kiln_ghosts **ghosts);

/* Returns the number of lightmaps for which a tile consists of ghosts; *first is their first index in `tiles`. 0 for
 * NULL. */
size_t kiln_ghosts_of(const struct kiln_ghosts *ghosts, uint32_t from, uint32_t tile, size_t *first);

#endif
