/* A particle of light at a surface whose material is taken with its gloss (kiln_scene_take_gloss): what its diffuse
 * part takes up, and the way on. For light that is traced from the lights on the host, whatever the backend, and for
 * rays of views, which go the other way; pure functions, thread-safe. */
#ifndef KILN_WORKER_BACKEND_PARTICLE_H
#define KILN_WORKER_BACKEND_PARTICLE_H

#include "shaders/shared/path.h"
#include "worker/backend/backend.h"
#include "worker/light/lights.h"
#include "worker/material/surface_bsdf.h"

/* Whether there is such a surface for who meets it from this side. */
bool kiln_particle_turns(const struct kiln_backend_params *params, const struct kiln_hit *hit);

/* Seed of random numbers: a key, the number of the particle, and how many surfaces it has met before. */
struct kiln_particle_chance {
    uint32_t key, number, surface;
};

/* Two random numbers in (0, 1) for a use at that surface: KILN_PATH_... of shaders/shared/path.h. */
void kiln_particle_draw(const struct kiln_particle_chance *chance, uint32_t use, double *u, double *v);

/* Such a surface, where a particle or a ray of a view has met it. Directions within are in the frame of its front. */
struct kiln_particle_place {
    const struct kiln_backend_params *params;
    struct kiln_hit hit;
    const struct kiln_gloss *gloss;
    struct kiln_vec3 position, normal; /* normal: geometric, of the front */
    struct kiln_frame frame;
    struct kiln_bsdf_lobes lobes;
    struct kiln_vec3 o;             /* where it came from */
    uint32_t others;                /* its lobes that are not diffuse */
    struct kiln_bsdf_choice choice; /* among these */
    float arrives[3];               /* share of what comes through the body of glass that it was in, by colour */
};
/* `lobes`: kiln_scene_lobes; `direction`: of the particle, unit. */
struct kiln_particle_place kiln_particle_place(const struct kiln_backend_params *params,
                                               const struct kiln_gloss_lobes *lobes, const struct kiln_hit *hit,
                                               struct kiln_vec3 direction);

/* A particle's turn at the surface: the shares of its flux, by colour, that are taken up and that go on, both with what
 * `arrives`, and the way on. `weight`: what is left of its flux at the lights. The way goes by the adjoint of the
 * scattering function (KILN_IMPORTANCE and kiln_shading_correction of shaders/shared/bsdf.h), through lobes that are
 * not diffuse. The flux counts more for having gone on by chance (kiln_chain_chance). `mode` is KILN_IMPORTANCE; or
 * KILN_RADIANCE for rays from the eye, which go by the scattering function itself. */
struct kiln_particle_turn {
    float taken_up[3], goes_on[3]; /* shares; all of `goes_on` 0: it ends here */
    struct kiln_vec3 origin, direction;
    bool mirrored; /* it goes on in the one direction of a mirror or of smooth glass */
    float density; /* else with this one, per steradian, but for the chance to go on at all */
};
struct kiln_particle_turn kiln_particle_turn(const struct kiln_particle_place *place, const float weight[3],
                                             const struct kiln_particle_chance *chance, uint32_t mode);

/* The same of a ray of a view whose direction was drawn otherwise, with this density per steradian. Whether it goes on
 * at all hangs on what the lobes would have sent that way. */
struct kiln_particle_turn kiln_particle_turn_to(const struct kiln_particle_place *place, const float weight[3],
                                                const struct kiln_particle_chance *chance, struct kiln_vec3 direction,
                                                float density);

/* Both ways on of a ray of a view from smooth glass, reflected and let through, in the place of one of them by chance:
 * each counts by its share, and neither ends by chance. False: there are no two, or a coat lies over them. */
bool kiln_particle_part(const struct kiln_particle_place *place, const struct kiln_particle_chance *chance,
                        struct kiln_particle_turn turns[2]);

/* Whether the lobes that are not diffuse send light in the directions of mirrors and smooth glass only. */
bool kiln_particle_is_smooth(const struct kiln_particle_place *place);

/* Where most of what a ray of a view shows of such a surface comes from, if it has no diffuse part: the one direction
 * of its mirror, or of its smooth glass (of dispersing glass for green), whichever sends more; and the share that this
 * sends, times what `arrives`. False: the surface is another. */
bool kiln_particle_shows(const struct kiln_particle_place *place, struct kiln_vec3 *origin, struct kiln_vec3 *direction,
                         float share[3]);

/* Returns the scattering by lobes that are not diffuse, of light from unit `direction`, which points away from the
 * place, to where a ray of a view came from, times the cosine, and the density with which the ray goes on there. 0 of
 * mirrors and smooth glass. */
struct kiln_bsdf_value kiln_particle_scatter(const struct kiln_particle_place *place, struct kiln_vec3 direction);

/* The shadow ray of a sample of a light that was drawn at the place: the light comes through if the ray meets nothing
 * on the length that is returned, m, tinted as kiln_backend_intersect says. Where the light has a place in the scene
 * the ray starts there, so that what lies behind the light is not on its way. */
float kiln_particle_shadow(const struct kiln_particle_place *place, const struct kiln_light_sample *sample,
                           struct kiln_vec3 *origin, struct kiln_vec3 *direction);

#endif
