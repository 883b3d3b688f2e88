/* Densities with which gather rays and light paths sample the light of lamps: worker/backend/embree/techniques.h. Needs
 * shaders/bidirectional.glsl before it. */

/* Data of the land pass, which lie before struct kiln_gpu_both. */
KILN_ARRAY(LandArray, kiln_gpu_land, 8);
#define LAND LandArray(push.both - KILN_GPU_LAND_BYTES).at[0]

#include "shaders/aims.glsl"
#include "shaders/shared/caustic_weights.h"

/* The parts of a vertex that these densities depend on. */
struct Lit {
    vec3 position, normal; /* light_normal */
    uint triangle;
};

Lit lit_of(Vertex v) { return Lit(v.m.position, light_normal(v), v.m.triangle); }

real techniques_connect(uint light, Lit v, real3 place, real3 direction)
{
    if (light_kind(KILN_GPU_KIND_SKY) && light == emission_environment())
        return 0;
    return kiln_light_connect(light, real3(v.position), real3(v.normal), place, direction);
}

real techniques_emission(uint light, Lit v, real3 place, real3 direction)
{
    return real(LAND.iterations) * kiln_aim_density(light, v.triangle, place, direction);
}
