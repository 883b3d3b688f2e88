/* Samples along seams, and the texels that they read (seams.h, seam_system.h). Nothing is collective. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_SEAMS_SEAM_SAMPLES_H
#define KILN_COORDINATOR_OUTPUT_MAP_SEAMS_SEAM_SAMPLES_H

#include "coordinator/output/map/charts/chart_graph.h"
#include "coordinator/output/map/map.h"
#include "coordinator/output/map/seams/seam_system.h"

/* Number of samples along a seam edge, by its length in texels; position of the i-th sample on the edge, 0 to 1. */
size_t kiln_seam_sample_count(const struct kiln_seam_edge *edge);
static inline float kiln_seam_sample_place(size_t i, size_t count) { return ((float)i + 0.5f) / (float)count; }

/* Finds the four texels of bilinear filtering at texel coordinate (x, y), clamped at the edge of the image, and their
 * weights, multiplied by `sign`. Returns false if the map has no surface. */
bool kiln_seam_footprint(const struct kiln_map *map, const uint32_t *nearest, float x, float y, float sign,
                         uint32_t at[KILN_SEAM_SIDE], float weight[KILN_SEAM_SIDE]);

/* Tells whether both sides of a sample read the same texels. Such a sample is useless. */
bool kiln_seam_same_texels(const struct kiln_seam_sample *sample);

/* Lists the samples at the map's own seams; their entries are texels. The margin must be filled. *samples is
 * allocated, or NULL. */
int kiln_seams_sample(const struct kiln_map *map, const struct kiln_chart_graph *graph, const uint32_t *nearest,
                      struct kiln_seam_sample **samples, size_t *count, struct kiln_error *error);

/* Puts a solved value into a smoothed plane. */
static inline void kiln_seam_set(struct kiln_map *map, uint32_t *nearest, uint32_t plane, uint32_t texel, float value)
{
    if (map->planes[plane][texel] == value)
        return;
    map->planes[plane][texel] = value;
    nearest[texel] = texel; /* as it is already on the surface */
}

/* Numbers the texels whose mark is not 0, in ascending order: marks[texel] becomes the number. Allocates *texels, the
 * list of these texels. They lie in the rows of the map or in the row below. */
int kiln_seams_number(const struct kiln_map *map, uint32_t *marks, uint32_t **texels, size_t *count,
                      struct kiln_error *error);

#endif
