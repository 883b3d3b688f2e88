/* The lightmap of one object while stages (stage.h) turn it from gathered points into an image with a value in every
 * texel. Nothing here is collective. */
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
    KILN_MAP_PLANES_MAX = 128 + 6 * KILN_GROUPS_MAX /* groups: direct and total light, 6 each */
};

/* Planes of a map: their number; `smooth`: whether seams in the plane are smoothed; `direction`: whether the plane is
 * the first of three that hold a direction, a unit vector, or zero where there is none. */
struct kiln_map_planes {
    uint32_t count;
    bool smooth[KILN_MAP_PLANES_MAX], direction[KILN_MAP_PLANES_MAX];
};

/* Number of planes that are smoothed. The first six are. */
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

struct kiln_bands;

/* Halo: the number of rows that a band of a map may have in addition, above and below its own. */
enum { KILN_BANDS_HALO = 2 };

/* Map: arrays of width x height texels, top row (v = 0) first. It has all rows of the lightmap, or only a band of them
 * (bands.h). */
struct kiln_map {
    uint32_t width, height;
    uint32_t first_row, end_row;       /* the rows that it has, [first_row, end_row) */
    const struct kiln_bands *bands;    /* borrowed; NULL: it has all rows */
    const struct kiln_map_planes *has; /* borrowed */
    float **planes;                    /* has->count */
    float *area;                       /* m2 of surface in the texel */
    float *coverage;                   /* fraction of the texel's square that the layout covers, 0 to 1 */
    uint8_t *state;                    /* enum kiln_texel_state */
    /* chart of the first piece of surface in the texel, or its triangle in the mesh until a stage reads charts;
     * KILN_NONE in the margin */
    uint32_t *chart;
    /* region number of each texel of the lightmap; walls separate regions of the surface (walls.c). NULL: no walls.
     * Owned by the map */
    uint32_t *region;
};

/* Tells whether two texels lie on one surface: in the same chart, with no wall between them. */
static inline bool kiln_map_together(const struct kiln_map *map, uint32_t a, uint32_t b)
{
    return map->chart[a] == map->chart[b] && (map->region == NULL || map->region[a] == map->region[b]);
}

/* Creates a map whose texels are all margin, which borrows `planes`. KILN_CANNOT_CREATE for 2^32 - 1 texels or more. */
int kiln_map_create(struct kiln_map **map, uint32_t width, uint32_t height, const struct kiln_map_planes *planes,
                    struct kiln_error *error);
void kiln_map_destroy(struct kiln_map **map);

/* Creates a map, as kiln_map_create does, with only the rows [first_row, end_row) of a lightmap in bands (bands.h). It
 * borrows `bands`. Its arrays take memory only where they are touched. */
int kiln_map_create_rows(struct kiln_map **map, uint32_t width, uint32_t height, const struct kiln_map_planes *planes,
                         const struct kiln_bands *bands, uint32_t first_row, uint32_t end_row,
                         struct kiln_error *error);

/* Number of texels of the whole lightmap; index of the map's first texel; index after its last; number of its rows. */
static inline size_t kiln_map_texels(const struct kiln_map *map) { return (size_t)map->width * map->height; }
static inline size_t kiln_map_first(const struct kiln_map *map) { return (size_t)map->width * map->first_row; }
static inline size_t kiln_map_end(const struct kiln_map *map) { return (size_t)map->width * map->end_row; }
static inline uint32_t kiln_map_rows(const struct kiln_map *map) { return map->end_row - map->first_row; }

/* Allocates an array with an element of `size` bytes, zero, for each texel of the lightmap. It takes memory as the
 * map's own arrays do. kiln_map_free frees it and sets the pointer to NULL. */
int kiln_map_allocate(const struct kiln_map *map, void *pointer, size_t size, const char *what,
                      struct kiln_error *error);
void kiln_map_free(const struct kiln_map *map, void *pointer, size_t size);

#endif
