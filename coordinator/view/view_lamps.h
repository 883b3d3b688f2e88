/* Light from lamps at the surfaces with gloss that rays of views meet (view_gloss.h).
 *
 * Such a light finds the eye in two ways: a sample of the lights at the surface (worker/light/lights.h: one of the
 * tree, one of each directional light, one of an environment with an image, by its luminance), with a shadow ray; and
 * the ray that goes on from there and meets the lamp or the environment. Both are weighed by the power heuristic (Veach
 * and Guibas, "Optimally Combining Sampling Techniques for Monte Carlo Rendering", SIGGRAPH 1995: section 3, exponent
 * 2), with densities per steradian: no light counts twice. No ray meets points, spots and suns: all of these is the
 * samples'. Mirrors and smooth glass are left to rays, and so is a sky of one radiance all over.
 *
 * Not collective. */
#ifndef KILN_COORDINATOR_VIEW_VIEW_LAMPS_H
#define KILN_COORDINATOR_VIEW_VIEW_LAMPS_H

#include "coordinator/view/view_guide.h"
#include "coordinator/view/view_light.h"
#include "worker/backend/particle.h"

/* A surface with gloss that a ray has met. */
struct kiln_view_lit {
    struct kiln_particle_place place;
    struct kiln_particle_chance chance;
    struct kiln_view_guide guide; /* by which the ray goes on from there */
    float weight[3];              /* what of the light that it sends reaches the eye, by colour */
    float rgb[3];                 /* what lamps bring there, W/(m2 sr), is added */
};

/* How a ray has left the surface before; density 0: of the camera, or in the one direction of a mirror. */
struct kiln_view_way {
    struct kiln_dvec3 position, normal; /* of the place; of the normal as kiln_lights_sample is given it */
    float density;                      /* per steradian */
};

struct kiln_view_lamps;

/* Borrows the source; room for `capacity` places at once. KILN_SYSTEM. */
int kiln_view_lamps_create(struct kiln_view_lamps **lamps, const struct kiln_view_source *source, size_t capacity,
                           struct kiln_error *error);
void kiln_view_lamps_destroy(struct kiln_view_lamps **lamps);

/* The way of a ray that goes on from a place. */
struct kiln_view_way kiln_view_way(const struct kiln_particle_place *place, const struct kiln_particle_turn *turn);

/* The share of what a ray brings of the lamp or of the environment that it meets, 0 to 1. */
double kiln_view_lamps_share(const struct kiln_view_lamps *lamps, const struct kiln_view_way *way,
                             const struct kiln_hit *hit, struct kiln_vec3 direction);

/* Samples the lights at `count` places, at most the capacity, and adds what they bring. The same bits for any number of
 * threads, and for any places together. The status of the backend. */
int kiln_view_lamps_add(struct kiln_view_lamps *lamps, struct kiln_view_lit *places, size_t count,
                        struct kiln_error *error);

#endif
