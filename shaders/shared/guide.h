/* Path guide of a tile run (worker/pass/guided.h), in C and GLSL: a density over the unit square, constant in each of
 * KILN_GUIDE_SIDE x KILN_GUIDE_SIDE cells; in a coarser guide, groups of cells have equal densities. It is one array of
 * floats: the edges of the rows, from 0 to 1; for each row the edges of its columns; from KILN_GUIDE_WEIGHTS on 1 /
 * density of each cell. worker/backend/guide.h makes it. */
#ifndef KILN_SHADERS_SHARED_GUIDE_H
#define KILN_SHADERS_SHARED_GUIDE_H

#include "shaders/shared/language.h"
#include "shaders/shared/mask.h"

#define KILN_GUIDE_SIDE 16u
#define KILN_GUIDE_EDGES (KILN_GUIDE_SIDE + 1u)
#define KILN_GUIDE_WEIGHTS (KILN_GUIDE_EDGES * KILN_GUIDE_EDGES)
#define KILN_GUIDE_SIZE (KILN_GUIDE_WEIGHTS + KILN_GUIDE_SIDE * KILN_GUIDE_SIDE)

#define KILN_GUIDE_FLOATS 4u /* number of training values for each point of the tile run */

#ifdef KILN_GLSL /* shaders/kernel.glsl comes before */
KILN_ARRAY(GuideRef, float, 4);
#    define KILN_GUIDE GuideRef
#    define KILN_GUIDE_AT(guide, i) guide.at[i]
#else
#    define KILN_GUIDE const float *
#    define KILN_GUIDE_AT(guide, i) (guide)[i]
#endif

/* Finds the interval that contains x in (0, 1), by four bisections; the edges begin at `first`. Branch-free, so that C
 * compilers vectorise it. */
KILN_FUNCTION KILN_U32 kiln_guide_interval(KILN_GUIDE guide, KILN_U32 first, float x)
{
    KILN_U32 i = x >= KILN_GUIDE_AT(guide, first + 8u) ? 8u : 0u;
    i += x >= KILN_GUIDE_AT(guide, first + i + 4u) ? 4u : 0u;
    i += x >= KILN_GUIDE_AT(guide, first + i + 2u) ? 2u : 0u;
    return i + (x >= KILN_GUIDE_AT(guide, first + i + 1u) ? 1u : 0u);
}

/* Maps x from interval i to the i-th of 16 equal intervals; the result is below 1. */
KILN_FUNCTION float kiln_guide_stretch(KILN_GUIDE guide, KILN_U32 first, KILN_U32 i, float x)
{
    const float low = KILN_GUIDE_AT(guide, first + i), t = (x - low) / (KILN_GUIDE_AT(guide, first + i + 1u) - low);
    const float y = (KILN_TO_F32(KILN_TO_I32(i)) + t) * KILN_RATIO32(1, 16);
    return y < KILN_FLOAT_BELOW_ONE ? y : KILN_FLOAT_BELOW_ONE;
}

/* Warps a uniform point of the unit square to one distributed by the guide's density. `cell` receives row *
 * KILN_GUIDE_SIDE + column; returns 1 / density there. */
KILN_FUNCTION float kiln_guide_warp(KILN_GUIDE guide, KILN_INOUT(float) u, KILN_INOUT(float) v, KILN_OUT(KILN_U32) cell)
{
    const KILN_U32 i = kiln_guide_interval(guide, 0u, KILN_AT(u)), row = (i + 1u) * KILN_GUIDE_EDGES,
                   j = kiln_guide_interval(guide, row, KILN_AT(v));
    KILN_AT(u) = kiln_guide_stretch(guide, 0u, i, KILN_AT(u));
    KILN_AT(v) = kiln_guide_stretch(guide, row, j, KILN_AT(v));
    KILN_AT(cell) = i * KILN_GUIDE_SIDE + j;
    return KILN_GUIDE_AT(guide, KILN_GUIDE_WEIGHTS + KILN_AT(cell));
}

/* Returns the coarse cell, of side x side, that contains a cell of the guide; `side` divides KILN_GUIDE_SIDE. */
KILN_FUNCTION KILN_U32 kiln_guide_coarse(KILN_U32 cell, KILN_U32 side)
{
    return cell / KILN_GUIDE_SIDE * side / KILN_GUIDE_SIDE * side + cell % KILN_GUIDE_SIDE * side / KILN_GUIDE_SIDE;
}

#endif
