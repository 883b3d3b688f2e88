/* Light paths that land (worker/pass/land.h), while they are in progress. All paths advance together, surface by
 * surface. Each has a slot (shaders/subpaths.glsl), and the kernels are
 *
 *   land.comp        begins paths; ends them at diffuse surfaces, or where rays hit nothing
 *   path_rays.comp   finds the surfaces that the rays hit, and separates those with gloss
 *   land_first.comp  at first surfaces, which have gloss: finds the density of rays there
 *   land_on.comp     lets paths land on gloss, or continue from there
 *   land_cross.comp  adds their light to spheres of probes on the way to the surfaces that their rays hit
 *
 * Directions, random numbers and estimators equal those of worker/backend/embree/land.c. */
KILN_PUSH(kiln_gpu_both_push);

layout(constant_id = 6) const uint METHOD = 0u; /* KILN_GPU_LAND_BEGINS, KILN_GPU_LAND_SHARES, ... or not */
const bool BEGINS = (METHOD & KILN_GPU_LAND_BEGINS) != 0u, SHARES = (METHOD & KILN_GPU_LAND_SHARES) != 0u,
           CROSSES = (METHOD & KILN_GPU_LAND_CROSSES) != 0u, POINTS = false;

#include "shaders/bidirectional.glsl"
#include "shaders/subpaths.glsl"
#include "shaders/techniques.glsl"
#include "shaders/shared/land.h"

KILN_ARRAY(LandingArray, kiln_gpu_landing, 4);
KILN_ARRAY(SpheresArray, kiln_gpu_spheres, 8);
#define SPHERES SpheresArray(LAND.spheres).at[0]

const uint ASTRAY = 0u, LANDED = 1u, ESCAPED = 2u, BLOCKED = 3u, ABSORBED = 4u; /* enum kiln_land_end */
const float FLOAT_MOST = 3.40282347e38;

uint slot;
kiln_gpu_subpath path;
kiln_gpu_land_path more;
kiln_hit hit;
vec3 weight; /* share of the path's initial weight that is left at the surface */

/* Loads the path in the slot, whose ray has hit a surface. */
void load()
{
    path = SUBPATH(slot);
    more = LAND_PATH(slot);
    hit = hit_of(path.triangle, path.u, path.v, path.distance);
    weight = vec3_in(path.weight) * vec3_in(path.tint);
}

kiln_caustic_landing sums_then()
{
    return kiln_caustic_landing(real(more.place_or_sums[0]), real(more.place_or_sums[1]));
}

void keep_sums(kiln_caustic_landing sums)
{
    LAND_PATH(slot).place_or_sums = real[3](sums.hit, sums.sampled, 0);
}

real3 flux_then() { return real3_of(more.flux); }

/* A path that ends after `length` surfaces without landing. */
kiln_gpu_landing landing_of(uint end, uint length)
{
    return kiln_gpu_landing(float[3](0.0, 0.0, 0.0), 0.0, 0.0, 0.0, KILN_GPU_NONE, KILN_GPU_NONE,
                            end | length << KILN_GPU_LAND_LENGTH);
}

/* A path that lands on its surface, which takes up the share `taken_up` of its flux. */
kiln_gpu_landing land(Vertex v, float taken_up)
{
    kiln_gpu_landing landing = landing_of(LANDED, path.surface);
    const float above = dot(v.m.normal, v.from);
    uint64_t point;
    if ((more.flags & KILN_GPU_LAND_IMAGED) == 0u &&
        kiln_store_point(kiln_store_enter(hit.triangle, hit.u, hit.v, hit.back), point)) {
        landing.point_low = uint(point);
        landing.point_high = uint(point >> 32);
    }
    landing.shading = above > 0.0 ? max(0.0, dot(v.m.shading, v.from)) / above : 1.0;
    landing.taken_up = taken_up;
    if (SHARES) {
        const real others = kiln_caustic_others(LAND.mis, sums_then());
        landing.others = float(min(others, real(FLOAT_MOST)));
    }
    return landing;
}

/* The path's answer. */
void finish(kiln_gpu_landing landing, real3 flux)
{
    const uint end = landing.end & KILN_GPU_LAND_END;
    if (end == LANDED || end == ESCAPED || end == BLOCKED)
        landing.flux = floats_of(vec3(flux * real3(weight)));
    LandingArray(push.sums + KILN_GPU_LANDING_BYTES * slot).at[0] = landing;
}
