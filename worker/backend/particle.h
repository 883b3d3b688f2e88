/* Scattering of a light particle at a surface with simulated gloss (kiln_scene_take_gloss): absorption by the diffuse
 * part, and continuation. Used for light traced from the lights on the host, with any backend, and for view rays, which
 * go the other way. Pure functions, thread-safe. */
#ifndef KILN_WORKER_BACKEND_PARTICLE_H
#define KILN_WORKER_BACKEND_PARTICLE_H

#include "shaders/shared/path.h"
#include "worker/backend/backend.h"
#include "worker/light/lights.h"
#include "worker/material/surface_bsdf.h"

/* Whether a hit from this side is on a surface with simulated gloss. */
bool kiln_particle_turns(const struct kiln_backend_params *params, const struct kiln_hit *hit);

/* Seed of random numbers: a key, the number of the particle, and the number of surfaces that it has met before. */
struct kiln_particle_chance {
    uint32_t key, number, surface;
};

/* Draws two random numbers in (0, 1) for a use at the seed's surface: KILN_PATH_... of shaders/shared/path.h. */
void kiln_particle_draw(const struct kiln_particle_chance *chance, uint32_t use, double *u, double *v);

/* Hit of a particle or view ray on a surface with simulated gloss. Directions in it are in the frame of the surface's
 * front. */
struct kiln_particle_place {
    const struct kiln_backend_params *params;
    struct kiln_hit hit;
    const struct kiln_gloss *gloss;
    struct kiln_vec3 position, normal; /* normal: geometric, of the front */
    struct kiln_frame frame;
    struct kiln_bsdf_lobes lobes;
    struct kiln_vec3 o;             /* direction towards the particle's origin */
    uint32_t others;                /* mask of non-diffuse lobes */
    struct kiln_bsdf_choice choice; /* probabilities of the non-diffuse lobes */
    float arrives[3];               /* transmittance, by colour, of the glass body that it came through */
};
/* Prepares the surface at a hit. `lobes`: kiln_scene_lobes; `direction`: of the particle, unit. */
struct kiln_particle_place kiln_particle_place(const struct kiln_backend_params *params,
                                               const struct kiln_gloss_lobes *lobes, const struct kiln_hit *hit,
                                               struct kiln_vec3 direction);

/* Scattering event of a particle at the surface: the shares of its flux, by colour, that are absorbed and that
 * continue, both including `arrives`, and the continuation. `weight`: remaining share of the flux emitted. The
 * direction is sampled from non-diffuse lobes, by the adjoint of the scattering function (KILN_IMPORTANCE and
 * kiln_shading_correction of shaders/shared/bsdf.h). Russian roulette (kiln_chain_chance) increases the flux of
 * survivors. `mode` is KILN_IMPORTANCE; or KILN_RADIANCE for view rays, which use the scattering function itself. */
struct kiln_particle_turn {
    float taken_up[3], goes_on[3]; /* shares of the flux; all of `goes_on` 0: the particle ends here */
    struct kiln_vec3 origin, direction;
    bool mirrored; /* it continues in the single direction of a mirror or smooth glass */
    float density; /* else density of the direction, per steradian, without the survival probability */
};
struct kiln_particle_turn kiln_particle_turn(const struct kiln_particle_place *place, const float weight[3],
                                             const struct kiln_particle_chance *chance, uint32_t mode);

/* Scattering event of a view ray whose direction was sampled otherwise, with this density per steradian. The survival
 * probability depends on the light that the lobes scatter in that direction. */
struct kiln_particle_turn kiln_particle_turn_to(const struct kiln_particle_place *place, const float weight[3],
                                                const struct kiln_particle_chance *chance, struct kiln_vec3 direction,
                                                float density);

/* Splits a view ray at smooth glass into both the reflected and the transmitted ray, instead of choosing one by chance:
 * each is weighted by its share, and neither ends by chance. False: there are no two, or a coat lies over them. */
bool kiln_particle_part(const struct kiln_particle_place *place, const struct kiln_particle_chance *chance,
                        struct kiln_particle_turn turns[2]);

/* Whether the non-diffuse lobes scatter only in the directions of mirrors and smooth glass. */
bool kiln_particle_is_smooth(const struct kiln_particle_place *place);

/* Finds the main direction that a view ray shows at a surface without a diffuse part: that of its mirror or of its
 * smooth glass (dispersing glass: for green), whichever scatters more; and that one's share, times `arrives`. False:
 * the surface is of another kind. */
bool kiln_particle_shows(const struct kiln_particle_place *place, struct kiln_vec3 *origin, struct kiln_vec3 *direction,
                         float share[3]);

/* Evaluates scattering by non-diffuse lobes from unit `direction`, which points away from the place, to a view ray's
 * origin, times the cosine, and the density with which the ray would continue in that direction. 0 for mirrors and
 * smooth glass. */
struct kiln_bsdf_value kiln_particle_scatter(const struct kiln_particle_place *place, struct kiln_vec3 direction);

/* Makes the shadow ray of a light sample drawn at the place. The light arrives if the ray hits nothing over the
 * returned length, m, tinted as by kiln_backend_intersect. If the light has a position in the scene the ray starts
 * there, so that nothing behind the light is in its way. */
float kiln_particle_shadow(const struct kiln_particle_place *place, const struct kiln_light_sample *sample,
                           struct kiln_vec3 *origin, struct kiln_vec3 *direction);

#endif
