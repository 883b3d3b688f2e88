/* Seam smoothing: changes texels so that bilinear filtering gives the same value on both sides of a seam, by the least
 * squares of seam_system.h.
 *
 * Along every seam there are samples at distances of at most half a texel. What they read are texels of the surface and
 * of the margin. A texel of the margin begins as a copy of a surface texel, and weighs least. So where there is a
 * margin it takes what lies beyond the seam, and the surface changes little; where there is none, at the edge of the
 * image or where charts lie close together, the surface texels on both sides move towards each other. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_SEAMS_H
#define KILN_COORDINATOR_OUTPUT_MAP_SEAMS_H

#include "coordinator/output/map/chart_graph.h"
#include "coordinator/output/map/map.h"
#include "coordinator/output/map/seam_system.h"

struct kiln_seam_report {
    uint64_t samples; /* samples that were used */
    double mean;      /* mean luminance of direct + indirect over the object's surface texels */
    /* root mean square over the samples of the difference in luminance / mean */
    double difference_before, difference_after;
};

/* Smooths the planes of the map that are to be smoothed at seams, or with `smooth` false only measures the differences.
 * `nearest` is the result of kiln_nearest_texels with KILN_TEXEL_FILLED and kiln_borders_assign; a margin texel that
 * gets a value of its own becomes its own nearest one. The map must be filled; its margin will be, with copies.
 * Deterministic. Not for a map in bands, whose seams are solved by all ranks (joined.h). */
int kiln_seams_smooth(struct kiln_map *map, const struct kiln_chart_graph *graph, uint32_t *nearest, bool smooth,
                      struct kiln_seam_report *report, struct kiln_error *error);

/* The number of samples along an edge of so many texels, and the place of the i-th of them, 0 to 1. */
size_t kiln_seam_sample_count(const struct kiln_seam_edge *edge);
static inline float kiln_seam_sample_place(size_t i, size_t count) { return ((float)i + 0.5f) / (float)count; }

/* The four texels and weights, times `sign`, of bilinear filtering at texel coordinate (x, y), clamped at the edge of
 * the image. False if the map has no surface. */
bool kiln_seam_footprint(const struct kiln_map *map, const uint32_t *nearest, float x, float y, float sign,
                         uint32_t at[KILN_SEAM_SIDE], float weight[KILN_SEAM_SIDE]);

/* Whether both sides read the same: such a sample tells nothing. */
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

/* Numbers those texels of the map that have marks other than 0, in their order: marks[texel] becomes the number.
 * *texels is allocated and lists them. They are of the map's rows or of the one below. */
int kiln_seams_number(const struct kiln_map *map, uint32_t *marks, uint32_t **texels, size_t *count,
                      struct kiln_error *error);

#endif
