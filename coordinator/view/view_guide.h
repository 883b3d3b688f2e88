/* Where rays of a view that go on from rough gloss find light that their lobes rarely meet, such as a wall that a gap
 * lights, learnt from some rays beforehand: by the tail of a lobe alone such finds are white specks.
 *
 * Surfaces with gloss are cut into regions, cells of 1/6 of the scene's longest side, by the six sides that a surface
 * may face; what rays find is cut into cells of 1/12. Of each region the 16 cells are kept that bring most of the
 * second moment of what its rays found: each is a source, a ball of 3/4 of a cell's side about the mean place of the
 * finds, chosen by its part of the moment, and sampled evenly within the cone in which it is seen. A ray goes by a
 * source with a chance that falls with the lobe's width, and with how alike what the rays found was; else by the lobe.
 * It counts by the density of both together (Veach and Guibas, "Optimally Combining Sampling Techniques for Monte Carlo
 * Rendering", SIGGRAPH 1995, section 3.2): no light is gained or lost, whatever was learnt.
 *
 * Not collective. The same bits for any number of threads. */
#ifndef KILN_COORDINATOR_VIEW_VIEW_GUIDE_H
#define KILN_COORDINATOR_VIEW_VIEW_GUIDE_H

#include "worker/backend/particle.h"

struct kiln_view_guides;

/* Room for `capacity` lessons. KILN_SYSTEM. */
int kiln_view_guides_create(struct kiln_view_guides **guides, const struct kiln_geometry *geometry, size_t capacity,
                            struct kiln_error *error);
void kiln_view_guides_destroy(struct kiln_view_guides **guides);

/* The region that a place belongs to; by chance that of a cell beside it. KILN_NONE where rays go by the lobe alone: at
 * mirrors and glass. Thread-safe. */
uint32_t kiln_view_guides_region(const struct kiln_view_guides *guides, const struct kiln_particle_place *place,
                                 const struct kiln_particle_chance *chance);

/* How far away what is no surface counts as found, m. */
float kiln_view_guides_far(const struct kiln_view_guides *guides);

/* A ray that went on by the lobe from a place of this region met `found`, and brought `value` in the end: value over
 * density of the lobe times radiance. Those of KILN_NONE, and beyond the capacity, are left out. */
void kiln_view_guides_learn(struct kiln_view_guides *guides, uint32_t region, struct kiln_vec3 found, float value);
/* Makes sources of what was learnt, and frees the rest. */
void kiln_view_guides_finish(struct kiln_view_guides *guides);

struct kiln_view_source_ball;

/* How rays leave a place; `count` 0: by the lobe. */
struct kiln_view_guide {
    const struct kiln_view_source_ball *balls;
    uint32_t count;
    float radius, share; /* m; with what chance they go by a ball */
};
struct kiln_view_guide kiln_view_guides_at(const struct kiln_view_guides *guides, uint32_t region,
                                           const struct kiln_particle_place *place);

/* The density per steradian with which a ray leaves the place in a unit direction for which the lobe alone has
 * `density`. Thread-safe. */
float kiln_view_guide_density(const struct kiln_view_guide *guide, const struct kiln_particle_place *place,
                              struct kiln_vec3 direction, float density);

/* The way on of a ray, as kiln_particle_turn has it. Thread-safe. */
struct kiln_particle_turn kiln_view_guide_turn(const struct kiln_view_guide *guide,
                                               const struct kiln_particle_place *place, const float weight[3],
                                               const struct kiln_particle_chance *chance);

#endif
