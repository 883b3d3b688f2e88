/* Codes in surface data that a lookup from a hit reads, and tiles of lightmaps: worker/scene/geometry.h, surface.h and
 * scene.h. */
#ifndef KILN_SHADERS_SHARED_SURFACE_H
#define KILN_SHADERS_SHARED_SURFACE_H

#include "shaders/shared/language.h"

#define KILN_NONE 0xffffffffu /* "no texture", "no material", "no triangle", ... */

/* `material` of a hit record. */
#define KILN_RECORD_DOUBLE_SIDED 0x80000000u /* double-sided, and no part of a solid (worker/scene/solids.h) */
#define KILN_RECORD_EMITS 0x40000000u
#define KILN_RECORD_GLOSS 0x20000000u /* its material's gloss is simulated (kiln_scene_take_gloss) */
/* Light passes through the triangle: straight on, at least somewhere on it (worker/scene/holes.h), or refracted, if its
 * material's gloss is simulated. So its back does not indicate a solid. */
#define KILN_RECORD_CLEAR 0x10000000u
#define KILN_RECORD_MATERIAL 0x0fffffffu /* index of the material */

/* Two surfaces coincide if a perpendicular ray meets them within this share of the world's extent of each other:
 * rounding decides which it meets first. In a scene with coincident faces (worker/scene/coincident.h), a ray that looks
 * for the nearest surface takes the front of a coincident front and back. For oblique rays the distance grows as 1 /
 * cosine, for cosines down to the least. */
#define KILN_COINCIDENT KILN_RATIO32(1, 1048576)
#define KILN_COINCIDENT_LEAST_COSINE KILN_RATIO32(1, 64)

/* Wrapping of textures beyond their edges. */
#define KILN_WRAP_REPEAT 0u
#define KILN_WRAP_CLAMP 1u
#define KILN_WRAP_MIRROR 2u

/* ---- tiles of a lightmap ---- */

#define KILN_TILE_SIDE 8
#define KILN_TILE_TEXELS 64

/* Bit of texel (x, y) of a tile: x and y interleaved, x lowest. */
KILN_FUNCTION KILN_U32 kiln_morton8(KILN_U32 x, KILN_U32 y)
{
    return (x & 1u) | (y & 1u) << 1 | (x & 2u) << 1 | (y & 2u) << 2 | (x & 4u) << 2 | (y & 4u) << 3;
}

/* Number of the tile of texel (x, y) among those of a lightmap that is `tiles_x` tiles wide. */
KILN_FUNCTION KILN_U32 kiln_tile_of(KILN_U32 x, KILN_U32 y, KILN_U32 tiles_x) { return (y >> 3) * tiles_x + (x >> 3); }

/* Flag in the upper word of a tile's `first`: the other bits are the index of the tile's first entry among the splits.
 */
#define KILN_TILE_SPLIT_HIGH 0x80000000u

#endif
