/* Shared parts of paths and chains: they go from surface to surface ray by ray, with random numbers of their own, and
 * ask for light straight from the lights where they meet a surface. A walk is one thread's. */
#ifndef KILN_WORKER_BACKEND_EMBREE_WALK_H
#define KILN_WORKER_BACKEND_EMBREE_WALK_H

#include "worker/backend/embree/meeting.h"
#include "worker/backend/embree/passage.h"

/* Notes of what chains find (worker/pass/row_chains.h). */
struct chain_notes {
    uint32_t *words;
    size_t count, room;
    uint64_t last; /* where the last point stands */
    bool failed;   /* memory was short */
};

struct walk {
    const struct embree_backend *b;
    struct embree_context *context;
    struct kiln_light_choice *choices; /* borrowed, light_choices_room of them; NULL: light is not asked for */
    uint32_t key, k;                   /* what random numbers hang on; number of the sample (shaders/shared/path.h) */
    uint32_t leaves;                   /* KILN_LEAVES_...: lamps whose light by sharp lobes is left out */
    uint64_t rays;                     /* traced so far; walk_trace does not count */
    struct chain_notes *notes;         /* borrowed: of the points that answer a chain; NULL: nobody asks */
};

/* Two numbers in (0, 1) for this use. */
void walk_draw(const struct walk *w, uint32_t use, double *u, double *v);

/* Traces a ray, whose chances hang on the number of `use`. `tint` is multiplied by what it passes. False: it meets
 * nothing. */
bool walk_trace(const struct walk *w, struct kiln_vec3 origin, struct kiln_vec3 direction, uint32_t use, float tint[3],
                struct RTCRayHit *ray);

/* Adds `weight` times what `lobes` of surface number `surface` (of a diffuse one: 1 / pi) send on of light straight
 * from the lights, W/(m2 sr), by colour: one sample of the light tree, one of each directional light, two of an
 * environment with an image. What sharp lobes do with light that rays meet themselves is left out, and so is a constant
 * sky. Shadow rays are counted. */
void walk_lights(struct walk *w, const struct meeting *m, uint32_t surface, uint32_t lobes, const float weight[3],
                 float sum[3]);

/* The radiance of the environment from a direction, W/(m2 sr), times `weight`, is added. */
void walk_environment(const struct walk *w, struct kiln_vec3 direction, const float weight[3], float sum[3]);

/* Adds the emission of surface m to where the walk comes from, W/(m2 sr), times `weight`. */
void walk_emission(const struct walk *w, const struct meeting *m, const float weight[3], float sum[3]);

#endif
