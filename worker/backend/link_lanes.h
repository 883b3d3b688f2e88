/* Links pass (worker/pass/links.h) in SIMD lanes: visibility of a node from all points of a tile, and the light
 * gathered from it. A lane is a point, numbered by its bit in the tile. Values of lanes outside the mask are undefined.
 * Each lane's results have the same bits as if computed alone. */
#ifndef KILN_WORKER_BACKEND_LINK_LANES_H
#define KILN_WORKER_BACKEND_LINK_LANES_H

#include "worker/pass/link_factors.h"

struct kiln_link_lanes {
    double at[3][KILN_TILE_TEXELS], n[3][KILN_TILE_TEXELS], s[3][KILN_TILE_TEXELS]; /* as struct kiln_patch_receiver */
    bool smooth;
};

/* Masks of points by their decision at a node: those that open it and go on to its children, those that stop at it, and
 * those of the latter that have the whole node above their horizon. */
struct kiln_link_lane_choices {
    uint64_t open, stands, whole;
};
struct kiln_link_lane_choices kiln_link_lanes_judge(const struct kiln_link_lanes *lanes,
                                                    const struct kiln_link_node *node, double square_error,
                                                    uint64_t mask);

/* Factors of one link. */
struct kiln_link_lane_factors {
    double factor[KILN_TILE_TEXELS], shading[KILN_TILE_TEXELS], inverse[KILN_TILE_TEXELS];
    /* 1/m: gradients of `factor` and `shading` with respect to the node's place, for lanes in `whole` */
    double slope[3][KILN_TILE_TEXELS], shading_slope[3][KILN_TILE_TEXELS];
    double light[3][KILN_TILE_TEXELS]; /* W/m2: radiosity of leaf points, for lanes that see part of the node */
    uint64_t whole; /* lanes with the whole node above their horizon; the others' factors are still missing */
};
void kiln_link_lanes_factors(const struct kiln_link_lanes *lanes, const struct kiln_link_node *node, uint64_t mask,
                             struct kiln_link_lane_factors *factors);

/* A link through which points gather light. */
struct kiln_link_lane_link {
    uint64_t sees, other;     /* points that see it, and points that do not although some of their neighbours do */
    double light[3];          /* radiosity, W/m2 */
    double moment[3][3];      /* as in struct kiln_link_sent */
    double filter[3];         /* transmittance by colour */
    double through;           /* mean transmittance */
    double now, square, more; /* luminance that errors refer to; increase of its mean square; of its variance */
    double reach;             /* error of the light of a wholly visible node, times its distance; 0: a point */
    bool by_first;            /* errors refer to geometric factors */
    bool smooth;              /* as of the lanes */
    double unsure[KILN_TILE_TEXELS]; /* variance of visibility */
};

struct kiln_link_lane_sums {
    double row[KILN_TILE_TEXELS], incident[3][KILN_TILE_TEXELS], irradiance[3][KILN_TILE_TEXELS];
    double now[KILN_TILE_TEXELS]; /* luminance of irradiance by the light to which errors refer */
    double variance[KILN_TILE_TEXELS];
};
void kiln_link_lanes_add(struct kiln_link_lane_sums *restrict sums,
                         const struct kiln_link_lane_factors *restrict factors,
                         const struct kiln_link_lane_link *restrict link);

#endif
