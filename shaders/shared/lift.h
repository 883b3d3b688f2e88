/* Lifted origins: where rays begin on coarse meshes with smooth normals (Hanika, "Hacking the Shadow Terminator", Ray
 * Tracing Gems II, 2021, chapter 4).
 *
 * Facets of such a mesh turn away from a light that the smooth surface still faces, and hide it from one another: black
 * facets at the terminator. So a ray begins where the smooth surface is about: the place is projected onto the tangent
 * plane of each corner that it lies below, and the three places are averaged by the barycentric weights. Here only the
 * part of that along the facet's normal is taken. With corners V_i, their normals N_i and the facet's n,
 *
 *   lift = sum_(i < j) b_i b_j max(0, L_ij + L_ji),      L_ij = (N_i . (V_i - V_j)) (N_i . n)
 *
 * which is 0 at the corners and along edges over which the surface is flat or hollow. Hanika takes what is above 0 of
 * each corner by itself; by edges normals that lean all one way, as of a bumpy plane, lift nothing. */
#ifndef KILN_SHADERS_SHARED_LIFT_H
#define KILN_SHADERS_SHARED_LIFT_H

#include "shaders/shared/language.h"

/* Corner normals farther from the facet's than the first cosine count less, and not at all from the second on: normals
 * that were averaged over the edges of a box are no sign of a round surface. */
#define KILN_LIFT_WHOLE 0.7f
#define KILN_LIFT_NONE 0.6f
/* Largest lift of an origin, as a share of the way to what lies above the place: it must not pass through. */
#define KILN_LIFT_CLEAR 0.5f

/* Half of max(0, L_ij + L_ji), m: of corner 0 to 1 and 2, of 1 to 0 and 2, of 2 to 0 and 1. */
struct kiln_lift {
    float at[6];
};

/* m along the normal, at weights b1 and b2 of corners 1 and 2. */
KILN_FUNCTION float kiln_lift_at(KILN_STRUCT kiln_lift lift, float b1, float b2)
{
    const float b0 = 1.0f - b1 - b2;
    return b0 * float_max(0.0f, b1 * lift.at[0] + b2 * lift.at[1]) +
           b1 * float_max(0.0f, b0 * lift.at[2] + b2 * lift.at[3]) +
           b2 * float_max(0.0f, b0 * lift.at[4] + b1 * lift.at[5]);
}

#endif
