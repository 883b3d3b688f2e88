/* A particle of light at a surface whose material is taken with its gloss (kiln_scene_take_gloss): what its diffuse
 * part takes up, and the way on. For light that is traced from the lights on the host, whatever the backend, and for
 * rays of views, which go the other way; pure functions, thread-safe. */
#ifndef KILN_WORKER_BACKEND_PARTICLE_H
#define KILN_WORKER_BACKEND_PARTICLE_H

#include "shaders/shared/bsdf.h"
#include "worker/backend/backend.h"
#include "worker/material/surface_bsdf.h"

/* Whether there is such a surface for who meets it from this side. */
bool kiln_particle_turns(const struct kiln_backend_params *params, const struct kiln_hit *hit);

/* What random numbers hang on: a key, the number of the particle, and how many surfaces it has met before. */
struct kiln_particle_chance {
    uint32_t key, number, surface;
};

/* What of a particle's flux, by colour, comes to the surface through the body of glass that it was in (`arrives`) and
 * is taken up there; and what goes on, of a particle that has `weight` of its flux at the lights left: its way by the
 * adjoint of the scattering function (KILN_IMPORTANCE and kiln_shading_correction of shaders/shared/bsdf.h), through
 * lobes that are not diffuse, times what it counts more for having gone on by chance (kiln_chain_chance). `mode` is
 * KILN_IMPORTANCE; or KILN_RADIANCE for rays from the eye, which go by the scattering function itself. `lobes`:
 * kiln_scene_lobes. */
struct kiln_particle_turn {
    float arrives[3], taken_up[3], goes_on[3]; /* shares; all of `goes_on` 0: it ends here */
    struct kiln_vec3 origin, direction;
    bool mirrored; /* it goes on in the one direction of a mirror or of smooth glass */
};
struct kiln_particle_turn kiln_particle_turn(const struct kiln_backend_params *params,
                                             const struct kiln_gloss_lobes *lobes, const struct kiln_hit *hit,
                                             struct kiln_vec3 direction, const float weight[3],
                                             const struct kiln_particle_chance *chance, uint32_t mode);

#endif
