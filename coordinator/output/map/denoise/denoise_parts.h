/* Parts: the points of a lightmap in bands (bands.h), divided in space for denoising. Neighbours are close in space but
 * anywhere on the layout, so a band of rows has neighbours in all other bands. Each rank denoises a part of space with
 * about the same number of points: it receives them from all bands, and returns the results.
 *
 * Space is divided into cubes, separately for each power of two of texel size; a cube consists of whole cells of
 * neighbours.h. A part is a group of adjacent cubes: their bounding box is cut across its longest side, repeatedly, so
 * that points are shared out evenly. A point's result depends, sweep by sweep of the regression, on its neighbours, on
 * theirs, and so on. So a part includes, besides its own points, the cubes that may contain these; the farther away,
 * the less data is needed. A point has the same bits wherever the cuts are. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_DENOISE_DENOISE_PARTS_H
#define KILN_COORDINATOR_OUTPUT_MAP_DENOISE_DENOISE_PARTS_H

#include "coordinator/output/map/map.h"
#include "coordinator/output/map/denoise/neighbours.h"

/* Distance of a point that no sweep reads. */
enum { KILN_SUBDOMAIN_FAR = UINT8_MAX };

/* Input of a rank for a lightmap: points of its band, and some of other lightmaps. */
struct kiln_subdomain_given {
    const struct kiln_map *map;
    const struct kiln_neighbour_point *points;
    const uint64_t *keys; /* unique among the points of all ranks: below 2^32 the `order` of a point of the map,
                           * above it a position in the order of other points */
    size_t count, planes;
    float *const *values; /* of each plane, indexed by the points' `index` */
};

/* Points to denoise on a rank: those with an index below `own` are its part, the others only serve as neighbours. */
struct kiln_subdomain {
    struct kiln_neighbour_point *points;
    size_t count, own, planes;
    float **values;                 /* of each plane, indexed by the points' `index` */
    uint8_t *far;                   /* by index: distance in neighbour steps from own points (regression.h) */
    struct kiln_subdomain_way *way; /* private */
};

/* Collective. Sends the points to the parts that need them, and receives this rank's. */
int kiln_subdomain_create(struct kiln_subdomain **parts, const struct kiln_subdomain_given *given,
                          struct kiln_error *error);
/* Collective. Returns the values of own points to their bands. */
int kiln_subdomain_give_back(const struct kiln_subdomain *parts, const struct kiln_subdomain_given *given,
                             struct kiln_error *error);
void kiln_subdomain_destroy(struct kiln_subdomain **parts);

#endif
