/* Fixed sets of directions over the hemisphere. All surface points use the same set, turned about each point's normal.
 * A direction is given by its projection to the unit disk below the hemisphere; uniform places in the disk are
 * cosine-distributed directions. Pure functions. */
#ifndef KILN_WORKER_SAMPLING_DIRECTION_SET_H
#define KILN_WORKER_SAMPLING_DIRECTION_SET_H

#include <stdint.h>

#include "worker/base/status.h"

/* Limits of kiln_directions_circles. Its time is quadratic in the number of directions: a second for 1024. Small sets
 * have few distinct heights above the surface, the same for all texels: in the Cornell box all indirect light is off by
 * 5.6 % with 16, 3.3 % with 32, 1.3 % with 64 and 0.2 % with 128. */
enum { KILN_CIRCLES_MOST = 4096, KILN_CIRCLES_LEAST = 64 };

struct kiln_direction {
    float radius; /* in the disk, 0 to 1: sine of the angle to the normal */
    float turn;   /* about the normal, of a circle, [0, 1) */
    float weight; /* share of the disk times the number of directions; the mean is 1 */
};

/* Fills `set` with `count` directions of a spherical Fibonacci spiral, which are even over the hemisphere; weights are
 * by the cosine (Keinert et al., "Spherical Fibonacci Mapping", SIGGRAPH Asia 2015, section 2). */
void kiln_directions_fibonacci(struct kiln_direction *set, uint32_t count);

/* Fills `set` with `count` directions whose places are even over the disk: each is placed at the centre of the largest
 * empty circle among the earlier ones (Laine et al., "Incremental Instant Radiosity for Real-Time Indirect
 * Illumination", EGSR 2007, section 3.4; Kahl, "RTX Radiosity", 2023, algorithm 9), to 1/64 of its radius. The weight
 * is the area of the place's Voronoi cell in the disk. The direction is taken at the middle of the cell, not at the
 * place, since many places lie on the rim, where rays run along the surface and find too little light. `count` is 1 at
 * least. */
int kiln_directions_circles(struct kiln_direction *set, uint32_t count, struct kiln_error *error);

#endif
