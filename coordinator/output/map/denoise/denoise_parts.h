/* Parts: the points of a lightmap in bands (bands.h), divided in space for denoising. Neighbours lie near each other in
 * space, wherever they are on the layout, so that a band of rows has neighbours in all others. Each rank denoises a
 * part of space with about as many points as the others, which come to it from all bands, and gives back what they have
 * become.
 *
 * Space is divided into cubes, for texels of each power of two of their own, of which each has some cells of
 * neighbours.h whole. Parts are cubes that lie together: the box of all is cut across its longest side, again and
 * again, so that points are shared out evenly. What becomes of a point is told, sweep by sweep of the regression, by
 * its neighbours, by theirs, and so on. A part sees, besides its own points, the cubes that these may be in; of those
 * that are further away less has to be known. So a point has the same bits wherever the cuts are. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_DENOISE_DENOISE_PARTS_H
#define KILN_COORDINATOR_OUTPUT_MAP_DENOISE_DENOISE_PARTS_H

#include "coordinator/output/map/map.h"
#include "coordinator/output/map/denoise/neighbours.h"

/* How far a point is that no sweep looks at. */
enum { KILN_PARTS_FAR = UINT8_MAX };

/* Data of a rank on a lightmap: points of its band, and some of other lightmaps. */
struct kiln_parts_given {
    const struct kiln_map *map;
    const struct kiln_neighbour_point *points;
    const uint64_t *keys; /* no two points of all ranks have the same: below 2^32 the `order` of a point of the map,
                           * above it a place in the order of others */
    size_t count, planes;
    float *const *values; /* of each plane, by the points' index */
};

/* Points to denoise on a rank: the first `own` by index are its part, the others are there for their neighbours. */
struct kiln_parts {
    struct kiln_neighbour_point *points;
    size_t count, own, planes;
    float **values;             /* of each plane, by the points' index */
    uint8_t *far;               /* by the points' index: how far they are from own ones (regression.h) */
    struct kiln_parts_way *way; /* private */
};

/* Collective. Sends the points to the parts that need them. */
int kiln_parts_create(struct kiln_parts **parts, const struct kiln_parts_given *given, struct kiln_error *error);
/* Collective. Puts the values of own points where they came from. */
int kiln_parts_give_back(const struct kiln_parts *parts, const struct kiln_parts_given *given,
                         struct kiln_error *error);
void kiln_parts_destroy(struct kiln_parts **parts);

#endif
