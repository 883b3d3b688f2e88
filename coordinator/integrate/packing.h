/* Rounding of a surface point's radiosity when it is packed. */
#ifndef KILN_COORDINATOR_INTEGRATE_PACKING_H
#define KILN_COORDINATOR_INTEGRATE_PACKING_H

#include "worker/sampling/keys.h"
#include "worker/scene/surface.h"

/* Random bits for the stochastic rounding of a texel's radiosity. They depend on the texel's identity (`bit` is its
 * place in the tile run's mask) and on the stream, never on its place in the global order. */
static inline uint32_t kiln_packing_hash(const struct kiln_tile_run *f, uint32_t bit, uint32_t stream)
{
    return kiln_hash2(kiln_hash2(f->map, f->tile), stream * KILN_TILE_TEXELS + bit);
}

/* Albedo of the own point `own`. */
static inline void kiln_point_albedo(const struct kiln_surface *surface, struct kiln_own_point own, float albedo[3])
{
    for (int c = 0; c < 3; c++)
        albedo[c] = (float)surface->albedo[3 * own.at + (uint64_t)c] * (1.0f / 65535.0f);
}

#endif
