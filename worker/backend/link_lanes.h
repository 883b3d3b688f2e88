/* How all points of a tile see a node, and what they gather from it: the links pass (worker/pass/links.h) in SIMD
 * lanes. A lane is a point, by its bit in the tile; what lanes have that no mask names does not matter. Each lane has
 * the bits that it would have alone. */
#ifndef KILN_WORKER_BACKEND_LINK_LANES_H
#define KILN_WORKER_BACKEND_LINK_LANES_H

#include "worker/pass/link_factors.h"

struct kiln_link_lanes {
    double at[3][KILN_TILE_TEXELS], n[3][KILN_TILE_TEXELS], s[3][KILN_TILE_TEXELS]; /* as struct kiln_patch_receiver */
    bool smooth;
};

/* Choices of a mask's points: those that go on to the node's children, those that stop at it, and of these those that
 * have it whole before them. */
struct kiln_link_lane_choices {
    uint64_t open, stands, whole;
};
struct kiln_link_lane_choices kiln_link_lanes_judge(const struct kiln_link_lanes *lanes,
                                                    const struct kiln_link_node *node, double square_error,
                                                    uint64_t mask);

/* Factors of one link. */
struct kiln_link_lane_factors {
    double factor[KILN_TILE_TEXELS], shading[KILN_TILE_TEXELS], inverse[KILN_TILE_TEXELS];
    /* 1/m: gradients of both by the node's place, of those that have it whole before them */
    double slope[3][KILN_TILE_TEXELS], shading_slope[3][KILN_TILE_TEXELS];
    double light[3][KILN_TILE_TEXELS]; /* radiosity of the points that those below are looked at by, W/m2 */
    uint64_t whole; /* the lanes that have the node whole before them; of the others factors are to be found */
};
void kiln_link_lanes_factors(const struct kiln_link_lanes *lanes, const struct kiln_link_node *node, uint64_t mask,
                             struct kiln_link_lane_factors *factors);

/* Link by which points gather light. */
struct kiln_link_lane_link {
    uint64_t sees, other;     /* points that see it, and such as do not, though some beside them do */
    double light[3];          /* radiosity, W/m2 */
    double moment[3][3];      /* as in struct kiln_link_sent */
    double filter[3];         /* what is let through */
    double through;           /* the mean of that */
    double now, square, more; /* luminance that errors are of; what its mean square, and its variance, grow by */
    double reach;             /* what a node's light is off by where it is seen whole, times its distance; 0: a point */
    bool by_first;            /* errors are of geometric factors */
    bool smooth;              /* as of the lanes */
    double unsure[KILN_TILE_TEXELS]; /* the variance of what is seen */
};

struct kiln_link_lane_sums {
    double row[KILN_TILE_TEXELS], incident[3][KILN_TILE_TEXELS], irradiance[3][KILN_TILE_TEXELS];
    double now[KILN_TILE_TEXELS]; /* luminance of irradiance by the light that errors are of */
    double variance[KILN_TILE_TEXELS];
};
void kiln_link_lanes_add(struct kiln_link_lane_sums *restrict sums,
                         const struct kiln_link_lane_factors *restrict factors,
                         const struct kiln_link_lane_link *restrict link);

#endif
