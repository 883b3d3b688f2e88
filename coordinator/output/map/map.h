/* The lightmap of one object while stages (stage.h) turn it from gathered points into an image with a value in every
 * texel; and what the stages "fill" and "dilate" do. Nothing is collective; all of it is deterministic and depends on
 * this object only. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_MAP_H
#define KILN_COORDINATOR_OUTPUT_MAP_MAP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "coordinator/job/job.h"
#include "worker/base/status.h"

/* The first planes of every map. The planes of other fields follow (layers.h). */
enum kiln_map_plane {
    KILN_MAP_DIRECT = 0,   /* 3 planes, W/m2 */
    KILN_MAP_INDIRECT = 3, /* 3 planes, W/m2 */
    KILN_MAP_ERROR = 6,    /* standard error of the luminance of direct + indirect */
    KILN_MAP_PLANES = 7,
    KILN_MAP_PLANES_MAX = 128 + 6 * KILN_GROUPS_MAX /* of a group direct light and all of it */
};

/* Number of planes of a map, the planes whose seams are smoothed, and those with which the three planes of a direction
 * begin: unit vectors, or zero where there is none. */
struct kiln_map_planes {
    uint32_t count;
    bool smooth[KILN_MAP_PLANES_MAX], direction[KILN_MAP_PLANES_MAX];
};

/* How many planes are smoothed. The first six are. */
static inline uint32_t kiln_map_smooth_planes(const struct kiln_map_planes *planes)
{
    uint32_t count = 0;
    for (uint32_t p = 0; p < planes->count; p++)
        count += planes->smooth[p];
    return count;
}

/* The planes of a map without other fields: direct and indirect light, whose seams are smoothed, and the error. */
extern const struct kiln_map_planes kiln_map_light;

enum kiln_texel_state {
    KILN_TEXEL_MARGIN = 0, /* not on a surface */
    KILN_TEXEL_FILLED = 1, /* on a surface, but no light could be gathered there */
    KILN_TEXEL_VALID = 2   /* on a surface, gathered */
};

/* Arrays of width x height, top row (v = 0) first. */
struct kiln_map {
    uint32_t width, height;
    const struct kiln_map_planes *has; /* borrowed */
    float **planes;                    /* has->count */
    float *area;                       /* m2 of surface in the texel */
    float *coverage;                   /* fraction of the texel's square that the layout covers, 0 to 1 */
    uint8_t *state;                    /* enum kiln_texel_state */
    /* chart of the first piece of surface in the texel, or its triangle in the mesh until a stage reads charts;
     * KILN_NONE in the margin */
    uint32_t *chart;
};

/* Creates a map whose texels are all margin, which borrows `planes`. KILN_CANNOT_CREATE for 2^32 - 1 texels or more. */
int kiln_map_create(struct kiln_map **map, uint32_t width, uint32_t height, const struct kiln_map_planes *planes,
                    struct kiln_error *error);
void kiln_map_destroy(struct kiln_map **map);

static inline size_t kiln_map_texels(const struct kiln_map *map) { return (size_t)map->width * map->height; }

/* Fills every KILN_TEXEL_FILLED texel from its surroundings. Within a chart, layer by layer outward from the valid
 * texels: the mean of the known neighbours, with edge neighbours counting twice. A chart without valid texels takes the
 * nearest known texels of the object. An object without valid texels stays 0. */
int kiln_map_fill(struct kiln_map *map, struct kiln_error *error);

/* Finds for every texel the index (y * width + x) of the nearest texel whose state is at least `least`: exact Euclidean
 * distance between centres, among equals the smaller column, then the smaller row (Meijster, Roerdink and Hesselink
 * 2000, in linear time). KILN_NONE everywhere if there is no such texel. `nearest` has width x height entries. */
int kiln_nearest_texels(const uint8_t *state, uint8_t least, uint32_t width, uint32_t height, uint32_t *nearest,
                        struct kiln_error *error);

/* Copies to every margin texel the values of the texel that `nearest` gives for it: one of the surface, or itself.
 * Returns the number of margin texels, or 0 if there are no others. */
uint64_t kiln_map_dilate(struct kiln_map *map, const uint32_t *nearest);

#endif
