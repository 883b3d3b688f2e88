/* Path guiding for rays that continue from rough gloss in a view. Training rays learn where bright light is that lobes
 * rarely hit, such as a wall lit through a gap; sampled by the tail of a lobe alone it would give white specks.
 *
 * Glossy surfaces are divided into regions: cells of 1/6 of the scene's longest side, times the six axis directions
 * that a surface may face. The hit points of training rays are binned in cells of 1/12. Each region keeps the 12 cells
 * with the largest part of the second moment of the light found, and gets 6 such cells of the whole picture. Each
 * becomes a source: a ball with a radius of 3/4 of a cell's side about the mean hit point. A source is chosen in
 * proportion to its moment and sampled uniformly in its cone. A ray samples a source, or else the lobe. The probability
 * of a source is at most 1/2, and lower for narrow lobes and uniform light. The ray is divided by the combined density
 * of both (Veach and Guibas, "Optimally Combining Sampling Techniques for Monte Carlo Rendering", SIGGRAPH 1995,
 * section 3.2), so the result is unbiased whatever was learnt.
 *
 * Not collective. The same bits for any number of threads. */
#ifndef KILN_COORDINATOR_VIEW_VIEW_GUIDE_H
#define KILN_COORDINATOR_VIEW_VIEW_GUIDE_H

#include "worker/backend/particle.h"

struct kiln_view_guides;

/* Creates guides with room for `capacity` training samples. KILN_SYSTEM. */
int kiln_view_guides_create(struct kiln_view_guides **guides, const struct kiln_geometry *geometry, size_t capacity,
                            struct kiln_error *error);
void kiln_view_guides_destroy(struct kiln_view_guides **guides);

/* Finds the region of a place, randomly jittered to neighbouring cells. KILN_NONE at mirrors and glass, where rays are
 * sampled by the lobe alone. Thread-safe. */
uint32_t kiln_view_guides_region(const struct kiln_view_guides *guides, const struct kiln_particle_place *place,
                                 const struct kiln_particle_chance *chance);

/* Distance at which rays that hit no surface are recorded as hits, m. */
float kiln_view_guides_far(const struct kiln_view_guides *guides);

/* Records a training sample: a ray, sampled by the lobe at a place of this region, hit `found`. `value` is lobe value /
 * density x radiance. Samples of KILN_NONE, and those beyond the capacity, are ignored. */
void kiln_view_guides_learn(struct kiln_view_guides *guides, uint32_t region, struct kiln_vec3 found, float value);
/* Makes the sources from the training samples, and frees these. */
void kiln_view_guides_finish(struct kiln_view_guides *guides);

struct kiln_view_source_ball;

/* Sampling distribution of rays that leave a place; `count` 0: the lobe alone. */
struct kiln_view_guide {
    const struct kiln_view_source_ball *balls;
    uint32_t count;
    float radius, share; /* m; probability of sampling a ball */
};
struct kiln_view_guide kiln_view_guides_at(const struct kiln_view_guides *guides, uint32_t region,
                                           const struct kiln_particle_place *place);

/* Density per steradian with which a ray leaves the place in a unit direction; `density`: that of the lobe alone.
 * Thread-safe. */
float kiln_view_guide_density(const struct kiln_view_guide *guide, const struct kiln_particle_place *place,
                              struct kiln_vec3 direction, float density);

/* Samples the next direction of a ray; result as of kiln_particle_turn. Thread-safe. */
struct kiln_particle_turn kiln_view_guide_turn(const struct kiln_view_guide *guide,
                                               const struct kiln_particle_place *place, const float weight[3],
                                               const struct kiln_particle_chance *chance);

#endif
