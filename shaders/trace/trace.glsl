/* Tracing rays through the world.
 *
 *     kiln_hit kiln_trace_by_chance(vec3 origin, vec3 direction, uint seed, out vec3 tint);
 *
 * is the nearest triangle; one that is partly there with a chance that is its opacity. `tint`: the share of what it
 * sends that arrives.
 *
 *     kiln_hit kiln_trace_within(vec3 origin, vec3 direction, float limit, uint seed, out vec3 tint);
 *
 * is the same, of what is nearer than `limit`.
 *
 *     bool kiln_is_met(vec3 origin, vec3 direction, float limit, uint seed);
 *
 * is whether there is such a triangle before `limit`.
 *
 *     kiln_hit kiln_trace(vec3 origin, vec3 direction, float limit, uint preferred);
 *
 * is the nearest triangle that lets no light through anywhere and is nearer than `limit` (KILN_ENDLESS: any): for what
 * tells solids by. `preferred`: of a front and a back that coincide (KILN_COINCIDENT) which is met: KILN_FRONT or
 * KILN_BACK; KILN_EITHER: as of all other rays, the front where HAS_COINCIDENT is not 0, else rounding decides. The
 * others' distances are not exact, and only where KILN_ASKS_BURIED are they known.
 *
 *     vec3 kiln_through(vec3 origin, vec3 direction, float limit);
 *
 * is the share of light that comes from `limit` away: 0 with an opaque triangle in between.
 *
 * Directions are of unit length; a hit lies at a distance above 0. (u, v) are the weights of the triangle's corners 1
 * and 2. Triangles that may let rays through (worker/scene/geometry.h) are asked what they do when HAS_ALPHA is not 0.
 *
 * Kernels for compute walk the layout that TRAVERSAL tells; those compiled with KILN_PIPELINE call the device's own ray
 * tracing. */
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
