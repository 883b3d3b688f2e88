/* Seam system: the least squares that make both sides of seams equal, and their solution. It knows no lightmap, so that
 * it can be that of one map (seams.h) or of several whose objects touch (joined.h).
 *
 * A sample is a place on a seam where each of two sides has four values with the weights of bilinear filtering. For
 * each plane the values x that samples read minimise
 *
 *     sum over samples (value on side 0 - value on side 1)^2 + w sum over values a (x - baked)^2,
 *
 * where a is the area that the value stands for relative to the mean of those that stand for any (at least 0.1; 0.01
 * for those that stand for none), and w = KILN_SEAM_WEIGHT (after Iwanicki, "Lighting technology of The Last of Us",
 * 2013). The bilinear weights of both sides sum to one, so the sum of a x does not change: energy moves across the
 * seam, and none is created. A value that would leave the range of the baked values around it is held at its end, and
 * the others are solved again. Planes are solved separately, so that direct + indirect = total still holds.
 *
 * Values that samples connect, directly or through others, are a part of the system. Parts are solved separately, by
 * Cholesky factors (coordinator/math/cholesky.h), which give the minimum but for rounding. Planes with values in a part
 * that are not finite stay as they are there.
 *
 * Nothing is collective. The result depends on the order of values and samples, and on nothing else. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_SEAMS_SEAM_SYSTEM_H
#define KILN_COORDINATOR_OUTPUT_MAP_SEAMS_SEAM_SYSTEM_H

#include "coordinator/output/map/map.h"

#define KILN_SEAM_WEIGHT 0.1

/* If the values on both sides differ by more than this factor, the edge is one of the light, such as a wall between two
 * rooms on the seam, and not an error of sampling. Such samples are left out, and black stays black. */
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

/* Replaces the values of every `step`-th plane from the first one on. Uses as many threads as are set. KILN_SYSTEM:
 * values are of no use then. */
int kiln_seam_system_solve(struct kiln_seam_system *system, uint32_t first, uint32_t step, struct kiln_error *error);

/* Whether the light itself has an edge at the sample (KILN_SEAM_CONTRAST). The sample's entries are indices in
 * `planes`, the first six of which are light. */
bool kiln_seam_edge_of_light(float *const *planes, const struct kiln_seam_sample *sample);
/* Root mean square over the samples of the difference in luminance; 0 without samples. */
double kiln_seam_difference(float *const *planes, const struct kiln_seam_sample *samples, size_t count);

#endif
