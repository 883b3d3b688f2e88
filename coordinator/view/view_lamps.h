/* Light of lamps on glossy surfaces in views (view_gloss.h), by multiple importance sampling.
 *
 * Two techniques are combined. Light sampling takes samples of the lights at the surface, with shadow rays
 * (worker/light/lights.h: one of the light tree, one of each directional light, one of an environment image by
 * luminance). Lobe sampling uses the continued ray when it hits a lamp or the environment. Both are weighted by the
 * power heuristic with densities per steradian, so that no light counts twice (Veach and Guibas, "Optimally Combining
 * Sampling Techniques for Monte Carlo Rendering", SIGGRAPH 1995: section 3, exponent 2). Point, spot and directional
 * lights are only sampled, as no ray can hit them. Mirrors, smooth glass and a uniform sky are left to continued rays.
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
    struct kiln_view_guide guide; /* sampling distribution of the continued ray */
    float weight[3];              /* throughput from the surface to the eye, by colour */
    float rgb[3];                 /* sum to which the light of lamps is added, W/(m2 sr) */
};

/* Departure of a ray from its previous surface; density 0: from the camera, or in the single direction of a mirror. */
struct kiln_view_way {
    struct kiln_dvec3 position, normal; /* of the surface; the normal as passed to kiln_lights_sample */
    float density;                      /* per steradian */
};

struct kiln_view_lamps;

/* Creates the state for up to `capacity` places at once. Borrows the source. KILN_SYSTEM. */
int kiln_view_lamps_create(struct kiln_view_lamps **lamps, const struct kiln_view_source *source, size_t capacity,
                           struct kiln_error *error);
void kiln_view_lamps_destroy(struct kiln_view_lamps **lamps);

/* Makes the departure record of a ray that continues from a place. */
struct kiln_view_way kiln_view_way(const struct kiln_particle_place *place, const struct kiln_particle_turn *turn);

/* Weight of a continued ray that hits a lamp or the environment, by the power heuristic, 0 to 1. */
double kiln_view_lamps_share(const struct kiln_view_lamps *lamps, const struct kiln_view_way *way,
                             const struct kiln_hit *hit, struct kiln_vec3 direction);

/* Samples the lights at `count` places, at most the capacity, and adds their weighted light to `rgb`. The same bits for
 * any number of threads and any grouping of places. Returns the status of the backend. */
int kiln_view_lamps_add(struct kiln_view_lamps *lamps, struct kiln_view_lit *places, size_t count,
                        struct kiln_error *error);

#endif
