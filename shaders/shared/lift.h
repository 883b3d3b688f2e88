/* Lifted ray origins on coarse meshes with smooth normals (Hanika, "Hacking the Shadow Terminator", Ray Tracing Gems
 * II, 2021, chapter 4).
 *
 * Facets of such a mesh can turn away from a light that the smooth surface still faces, or shadow each other: black
 * facets appear at the terminator. So a ray begins about where the smooth surface is: the place is projected onto the
 * tangent plane of each corner that it lies below, and the three places are averaged by the barycentric weights. Only
 * the part of the offset along the facet's normal is used here. With corners V_i, their normals N_i and the facet's n,
 *
 *   lift = sum_(i < j) b_i b_j max(0, L_ij + L_ji),      L_ij = (N_i . (V_i - V_j)) (N_i . n)
 *
 * which is 0 at the corners and along edges over which the surface is flat or hollow. Hanika clamps each corner by
 * itself. Clamping by edges instead gives no lift where all normals lean one way, as on a bumpy plane. */
#ifndef KILN_SHADERS_SHARED_LIFT_H
#define KILN_SHADERS_SHARED_LIFT_H

#include "shaders/shared/language.h"

/* Cosines between a corner normal and the facet's normal: below the first the corner counts less, below the second not
 * at all. Normals that were averaged over the edges of a box do not indicate a round surface. */
#define KILN_LIFT_WHOLE 0.7f
#define KILN_LIFT_NONE 0.6f
/* Largest lift, as a share of the distance to the next surface above, which the origin must not pass through. */
#define KILN_LIFT_CLEAR 0.5f

/* Half of max(0, L_ij + L_ji), m, for the corner pairs 0-1, 0-2, 1-0, 1-2, 2-0, 2-1. */
struct kiln_lift {
    float at[6];
};

/* Returns the lift along the normal, m, at barycentric weights b1 and b2 of corners 1 and 2. */
KILN_FUNCTION float kiln_lift_at(KILN_STRUCT kiln_lift lift, float b1, float b2)
{
    const float b0 = 1.0f - b1 - b2;
    return b0 * float_max(0.0f, b1 * lift.at[0] + b2 * lift.at[1]) +
           b1 * float_max(0.0f, b0 * lift.at[2] + b2 * lift.at[3]) +
           b2 * float_max(0.0f, b0 * lift.at[4] + b1 * lift.at[5]);
}

#endif
