/* Tracing rays through the world.
 *
 *     kiln_hit kiln_trace_by_chance(vec3 origin, vec3 direction, uint seed, out vec3 tint);
 *
 * finds the nearest triangle; one with an opacity is hit with this probability. `tint`: share of its light that arrives
 * at the origin.
 *
 *     kiln_hit kiln_trace_within(vec3 origin, vec3 direction, float limit, uint seed, out vec3 tint);
 *
 * does the same, for triangles nearer than `limit`.
 *
 *     bool kiln_is_met(vec3 origin, vec3 direction, float limit, uint seed);
 *
 * tells whether there is such a triangle before `limit`.
 *
 *     kiln_hit kiln_trace(vec3 origin, vec3 direction, float limit, uint preferred);
 *
 * finds the nearest triangle that is opaque everywhere and nearer than `limit` (KILN_ENDLESS: any), to recognize
 * solids. `preferred`: which face of a coincident front and back is hit (KILN_COINCIDENT): KILN_FRONT or KILN_BACK;
 * KILN_EITHER: as for all other rays, the front where HAS_COINCIDENT is not 0, else rounding decides. With KILN_FRONT
 * or KILN_BACK distances are not exact, and they are supported only where KILN_ASKS_BURIED.
 *
 *     vec3 kiln_through(vec3 origin, vec3 direction, float limit);
 *
 * returns the share of light that arrives from `limit` away: 0 with an opaque triangle in between.
 *
 *     kiln_hit kiln_trace_either(vec3 origin, vec3 direction, float limit, bool occlusion, uint seed, out vec3 tint);
 *
 * is kiln_through, which `tint` gets, where `occlusion` is true, else kiln_trace_within: for kernels with both kinds of
 * rays in one loop, which so have the code of tracing once.
 *
 * Directions are unit vectors; hits have a distance above 0. (u, v) are the weights of the triangle's corners 1 and 2.
 * Triangles that may let rays through (worker/scene/geometry.h) are evaluated when HAS_ALPHA is not 0.
 *
 * Compute kernels traverse the layout that TRAVERSAL selects; kernels compiled with KILN_PIPELINE use the device's own
 * ray tracing. */
#ifndef KILN_SHADERS_TRACE_GLSL
#define KILN_SHADERS_TRACE_GLSL

const uint KILN_EITHER = 0u, KILN_FRONT = 1u, KILN_BACK = 2u;

#ifdef KILN_VALIDITY
const bool KILN_ASKS_BURIED = true;
#else
const bool KILN_ASKS_BURIED = false;
#endif

struct kiln_hit {
    uint triangle; /* KILN_GPU_NONE: nothing */
    float u, v, distance;
    bool back; /* met from behind */
};

#ifdef KILN_PIPELINE
#    include "shaders/trace/pipeline.glsl"
#else
#    include "shaders/trace/compute.glsl"
#endif

#endif
