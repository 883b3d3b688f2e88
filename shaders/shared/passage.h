/* What surfaces let through, and how chance decides whether one is there. */
#ifndef KILN_SHADERS_SHARED_PASSAGE_H
#define KILN_SHADERS_SHARED_PASSAGE_H

#include "shaders/shared/random.h"

/* The most that any triangle which is not opaque can do to light: what a backend has to be ready for. */
#define KILN_PASSAGE_NONE 0u  /* all triangles are opaque */
#define KILN_PASSAGE_MASK 1u  /* holes: every position lets all light through, or none */
#define KILN_PASSAGE_BLEND 2u /* a fraction of the light, the same for all colours */
#define KILN_PASSAGE_TINT 3u  /* a fraction of the light that depends on colour */

/* A surface of at least this opacity is there where chance must have no part. */
#define KILN_OPACITY_HALF 0.5f

/* So little light that it is none: optical depths, -log2 of what comes through, end at this one. */
#define KILN_DEPTH_MOST 48

/* Whether chance takes a surface of that opacity for there: by a hash of the ray's seed and the triangle. */
KILN_FUNCTION bool kiln_is_there(KILN_U32 seed, KILN_U32 triangle, float opacity)
{
    return KILN_TO_F32(kiln_hash2(seed, triangle) >> 8) * KILN_RATIO32(1, 16777216) < opacity;
}

/* Share of a material's surface that is there, by its alpha; `mode` is one of KILN_ALPHA_... */
#define KILN_ALPHA_OPAQUE 0u
#define KILN_ALPHA_MASK 1u
#define KILN_ALPHA_BLEND 2u
KILN_FUNCTION float kiln_coverage(KILN_U32 mode, float cutoff, float alpha)
{
    return mode == KILN_ALPHA_OPAQUE ? 1.0f : mode == KILN_ALPHA_MASK ? (alpha >= cutoff ? 1.0f : 0.0f) : alpha;
}

#endif
