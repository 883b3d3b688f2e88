/* Seam system: the least-squares problem that makes both sides of seams equal, and its solver. It does not refer to
 * lightmaps, so it serves one map (seams.h) as well as several maps whose objects touch (joined.h).
 *
 * A sample is a place on a seam. On each of its two sides it reads four values with the weights of bilinear filtering.
 * For each plane the values x that samples read minimise
 *
 *     sum over samples (value on side 0 - value on side 1)^2 + w sum over values a (x - baked)^2,
 *
 * where w = KILN_SEAM_WEIGHT, and a is the surface area of the value's texel, divided by the mean over values with an
 * area (at least 0.1; 0.01 for values without area) (after Iwanicki, "Lighting technology of The Last of Us", 2013).
 * The bilinear weights of both sides sum to one, so the sum of a x does not change: energy moves across the seam, and
 * none is created. A value that would leave the range of the baked values around it is clamped to that range, and the
 * others are solved again. Planes are solved separately, so that direct + indirect = total still holds.
 *
 * A connected component of the system, values that samples link directly or through others, is a part. Parts are solved
 * separately by Cholesky factorisation (coordinator/math/cholesky.h), which gives the minimum up to rounding. A plane
 * with non-finite values in a part stays unchanged in that part.
 *
 * Nothing is collective. The result depends on the order of values and samples, and on nothing else. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_SEAMS_SEAM_SYSTEM_H
#define KILN_COORDINATOR_OUTPUT_MAP_SEAMS_SEAM_SYSTEM_H

#include "coordinator/output/map/map.h"

#define KILN_SEAM_WEIGHT 0.1

/* Contrast limit of a sample: if the values on both sides differ by more than this factor, the light itself has an edge
 * there, such as a wall between two rooms on the seam. Such samples are left out, and black stays black. */
#define KILN_SEAM_CONTRAST 8.0f

enum { KILN_SEAM_SIDE = 4, KILN_SEAM_ENTRIES = 2 * KILN_SEAM_SIDE };

/* One row of the system: the sum of weight x value over its entries should be 0. The first KILN_SEAM_SIDE entries are
 * side 0; those of side 1 have negative weights. */
struct kiln_seam_sample {
    uint32_t at[KILN_SEAM_ENTRIES]; /* which values */
    float weight[KILN_SEAM_ENTRIES];
};

struct kiln_seam_system {
    size_t unknown_count, sample_count;
    struct kiln_seam_sample *samples; /* `at` are numbers of unknowns */
    float *area;                      /* of each unknown, m2 */
    uint32_t plane_count;             /* the first six are direct and indirect light (map.h) */
    float **planes;
};

/* Allocates areas and planes of `unknown_count` values, and `sample_count` samples. KILN_SYSTEM; the system can be
 * destroyed then, too. */
int kiln_seam_system_create(struct kiln_seam_system **system, size_t unknown_count, size_t sample_count,
                            uint32_t plane_count, struct kiln_error *error);
void kiln_seam_system_destroy(struct kiln_seam_system **system);

/* Solves every `step`-th plane from plane `first` on and replaces its values. Uses as many threads as are set.
 * KILN_SYSTEM; the values are then unusable. */
int kiln_seam_system_solve(struct kiln_seam_system *system, uint32_t first, uint32_t step, struct kiln_error *error);

/* Tells whether the light itself has an edge at the sample (KILN_SEAM_CONTRAST). The sample's entries are indices into
 * `planes`, whose first six are light. */
bool kiln_seam_edge_of_light(float *const *planes, const struct kiln_seam_sample *sample);
/* Root mean square over the samples of the difference in luminance; 0 without samples. */
double kiln_seam_difference(float *const *planes, const struct kiln_seam_sample *samples, size_t count);

#endif
