/* Share of light that counts as incident at points whose materials have gloss: kiln_chain_taken_up at the point's
 * middle. Needs shaders/position.glsl before it. */
#ifndef KILN_SHADERS_TAKEN_UP_GLSL
#define KILN_SHADERS_TAKEN_UP_GLSL

#include "shaders/shared/chain.h"
#include "shaders/shared/layout_point_gloss.h"

KILN_ARRAY(PointGlossArray, kiln_gpu_point_gloss, 4);

/* Share of the light from a direction that counts as incident. `cosine`: to the shading normal of the point's own side.
 */
float kiln_taken_up(kiln_gpu_point p, uint64_t parts, float cosine)
{
    if ((p.flags & KILN_GPU_POINT_GLOSS) == 0u)
        return 1.0;
    if (!(cosine > 0.0))
        return 0.0;
    const kiln_gpu_point_gloss g =
        PointGlossArray(parts + uint64_t(p.first_piece - KILN_GPU_POINT_GLOSS_PIECES) * 56ul).at[0];
    kiln_bsdf_lobes l;
    l.p.model = g.model;
    l.p.thin_wall = 1u; /* the coat is that of the point's own side */
    l.p.specular = g.specular;
    l.p.specular_color = vec3(g.color);
    l.matt = g.matt;
    l.face = g.face;
    l.coat.strength = g.coat;
    l.coat.face = g.coat_face;
    return kiln_chain_taken_up(l, cosine);
}

#endif
