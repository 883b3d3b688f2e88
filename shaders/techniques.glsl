/* What gather rays and light paths know of each other: worker/backend/embree/techniques.h. Needs LAND and
 * shaders/bidirectional.glsl before it. */
#include "shaders/aims.glsl"
#include "shaders/shared/caustic_weights.h"

real techniques_connect(uint light, Vertex v, real3 place, real3 direction)
{
    if (light_kind(KILN_GPU_KIND_SKY) && light == emission_environment())
        return 0;
    return emission_connect(light, real3(v.m.position), real3(light_normal(v)), place, direction);
}

real techniques_emission(uint light, Vertex v, real3 place, real3 direction)
{
    return real(LAND.iterations) * aim_density(light, target_of(v.m.triangle), place, direction);
}
