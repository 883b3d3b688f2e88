/* Passage of rays through surfaces that let light through: as worker/backend/embree/passage.h. */
#ifndef KILN_SHADERS_TRACE_ALPHA_GLSL
#define KILN_SHADERS_TRACE_ALPHA_GLSL

#include "shaders/material.glsl"

const uint KILN_SOLID = 0u, KILN_BY_CHANCE = 1u, KILN_THROUGH = 2u; /* enum embree_question */
const float KILN_DARK = 3.5527136788005009e-15;                     /* 2^-48: so little light is none */

/* Whether a mask has a hole there. */
bool kiln_is_hole(uint triangle, float u, float v)
{
    const vec2 alpha_cutoff = kiln_surface_alpha(triangle, u, v);
    return alpha_cutoff.x < alpha_cutoff.y;
}

/* Whether a ray that searches for solids passes the triangle. */
bool kiln_is_clear(uint triangle)
{
    return (MaterialWords(SCENE.records + uint64_t(triangle) * 32ul).at[7] & KILN_RECORD_CLEAR) != 0u;
}

/* Whether the ray continues behind the surface; if so, multiplies `share` by the light let through. */
bool kiln_passes(uint question, uint seed, uint triangle, float u, float v, vec3 direction, inout vec3 share)
{
    if (question == KILN_SOLID)
        return kiln_is_clear(triangle);
    if (HAS_ALPHA == KILN_PASSAGE_MASK)
        return kiln_is_hole(triangle, u, v);
    const kiln_passage p = kiln_surface_passage(triangle, u, v, kiln_passage_cosine(triangle, direction));
    if (question == KILN_THROUGH) {
        share *= p.through;
        return max(max(share.r, share.g), share.b) > KILN_DARK;
    }
    if (kiln_is_there(seed, triangle, p.opacity))
        return false;
    if (HAS_ALPHA >= KILN_PASSAGE_TINT)
        share *= min(p.through / (1.0 - p.opacity), 1.0);
    return true;
}

#endif
