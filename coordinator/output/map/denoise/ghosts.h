/* Ghosts: the texels of other lightmaps that a map sees across its joints (joints.h). Denoising takes them for
 * neighbours, so that it does not stop where an object ends and its surface goes on. Their values are read, not
 * changed.
 *
 * Ghosts come by whole tiles: those of which a part lies within KILN_GHOST_TEXELS of a joint, on the layout of the map
 * that they are from. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_DENOISE_GHOSTS_H
#define KILN_COORDINATOR_OUTPUT_MAP_DENOISE_GHOSTS_H

#include "coordinator/output/map/seams/joints.h"

/* Twice the radius of denoising: a fit across the joint has neighbours that were judged from all sides. */
#define KILN_GHOST_TEXELS 16.0f

/* A tile of lightmap `from` whose texels are ghosts of lightmap `to`. */
struct kiln_ghost_tile {
    uint32_t from, tile, to; /* tile: y * tiles_x + x */
};

struct kiln_ghosts {
    size_t count;
    struct kiln_ghost_tile *tiles; /* by `from`, `tile` and `to`; none twice */
};

/* Lists all. Depends on joints and sizes only; not collective. */
int kiln_ghosts_create(struct kiln_ghosts **ghosts, const struct kiln_joints *joints,
                       const struct kiln_surface *surface, struct kiln_error *error);
void kiln_ghosts_destroy(struct kiln_ghosts **ghosts);

/* The number of lightmaps that have a tile as ghosts; *first is the first of them in `tiles`. 0 for NULL. */
size_t kiln_ghosts_of(const struct kiln_ghosts *ghosts, uint32_t from, uint32_t tile, size_t *first);

#endif
