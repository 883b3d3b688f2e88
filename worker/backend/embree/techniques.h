/* Densities with which gather rays and light paths find the light of lamps (worker/pass/caustic_weights.h); both use
 * the same functions. Thread-safe. */
#ifndef KILN_WORKER_BACKEND_EMBREE_TECHNIQUES_H
#define KILN_WORKER_BACKEND_EMBREE_TECHNIQUES_H

#include "worker/backend/embree/bidirectional_subpaths.h"
#include "worker/backend/embree/light_samples.h"
#include "worker/light/aims.h"
#include "worker/pass/weighed.h"

/* Returns kiln_emission_connect for a light sample at vertex v; 0 for a constant sky, which is never sampled. `light`,
 * `place` and `direction` as in that function. */
static inline double techniques_connect(const struct kiln_caustic_techniques *t, uint32_t light, const struct vertex *v,
                                        struct kiln_dvec3 place, struct kiln_dvec3 direction)
{
    if (light == kiln_emission_environment(t->emission) && light_sky_is_constant(t->emission->lights))
        return 0.0;
    return kiln_emission_connect(t->emission, light, dvec3_of(v->m.position), subpaths_light_normal(v), place,
                                 direction);
}

/* Returns kiln_aims_density of the light paths of all iterations, for the aim whose target contains vertex v. */
static inline double techniques_emission(const struct kiln_caustic_techniques *t, uint32_t light,
                                         const struct vertex *v, struct kiln_dvec3 place, struct kiln_dvec3 direction)
{
    return (double)t->iterations * kiln_aims_density(t->aims, light, v->m.triangle, place, direction);
}

#endif
