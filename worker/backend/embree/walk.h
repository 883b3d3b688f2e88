/* Walks: shared parts of paths and chains. They go from surface to surface ray by ray, with their own random numbers,
 * and sample direct light at each surface. A walk belongs to one thread. */
#ifndef KILN_WORKER_BACKEND_EMBREE_WALK_H
#define KILN_WORKER_BACKEND_EMBREE_WALK_H

#include "worker/backend/embree/meeting.h"
#include "worker/backend/embree/passage.h"

/* Recorded findings of chains (worker/pass/row_chains.h). */
struct chain_notes {
    uint32_t *words;
    size_t count, room;
    uint64_t last; /* position of the last point */
    bool failed;   /* out of memory */
};

struct walk {
    const struct embree_backend *b;
    struct embree_context *context;
    struct kiln_light_choice *choices; /* borrowed, light_choices_room of them; NULL: lights are not sampled */
    uint32_t key, k;                   /* key of random numbers; number of the sample (shaders/shared/path.h) */
    uint32_t leaves;                   /* KILN_LEAVES_...: lamps whose light by sharp lobes is left out */
    uint64_t rays;                     /* rays traced so far, without those of walk_trace */
    struct chain_notes *notes;         /* borrowed: records the points found by a chain; NULL: not requested */
};

/* Draws two random numbers in (0, 1) for this use. */
void walk_draw(const struct walk *w, uint32_t use, double *u, double *v);

/* Traces a ray; the number of `use` seeds its random decisions. `tint` is multiplied by the transmittance along the
 * ray. False: no hit. */
bool walk_trace(const struct walk *w, struct kiln_vec3 origin, struct kiln_vec3 direction, uint32_t use, float tint[3],
                struct RTCRayHit *ray);

/* Adds `weight` times the direct light scattered by `lobes` of surface number `surface` (diffuse: 1 / pi), W/(m2 sr),
 * by colour: one sample of the light tree, one of each directional light, two of an environment image. Left out are
 * light by sharp lobes that rays can find themselves, and a constant sky. Shadow rays are counted. */
void walk_lights(struct walk *w, const struct meeting *m, uint32_t surface, uint32_t lobes, const float weight[3],
                 float sum[3]);

/* Adds the radiance of the environment from a direction, W/(m2 sr), times `weight`. */
void walk_environment(const struct walk *w, struct kiln_vec3 direction, const float weight[3], float sum[3]);

/* Adds the emission of surface m towards the walk's previous place, W/(m2 sr), times `weight`. */
void walk_emission(const struct walk *w, const struct meeting *m, const float weight[3], float sum[3]);

#endif
