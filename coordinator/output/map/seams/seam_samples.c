#include "coordinator/output/map/seams/seam_samples.h"

#include <math.h>

#include "worker/base/memory.h"
#include "worker/scene/scene.h"

enum { SIDE = KILN_SEAM_SIDE };

bool kiln_seam_footprint(const struct kiln_map *map, const uint32_t *nearest, float x, float y, float sign,
                         uint32_t at[KILN_SEAM_SIDE], float weight[KILN_SEAM_SIDE])
{
    const float fx = x - 0.5f, fy = y - 0.5f;
    const float bx = floorf(fx), by = floorf(fy);
    for (int k = 0; k < SIDE; k++) {
        const int64_t ix = (int64_t)bx + (k & 1), iy = (int64_t)by + (k >> 1);
        const int64_t cx = ix < 0 ? 0 : ix >= map->width ? map->width - 1 : ix;
        const int64_t cy = iy < 0 ? 0 : iy >= map->height ? map->height - 1 : iy;
        at[k] = (uint32_t)(cy * map->width + cx);
        if (nearest[at[k]] == KILN_NONE)
            return false;
        weight[k] = sign * ((k & 1) != 0 ? fx - bx : 1.0f - (fx - bx)) * ((k >> 1) != 0 ? fy - by : 1.0f - (fy - by));
    }
    return true;
}

size_t kiln_seam_sample_count(const struct kiln_seam_edge *edge)
{
    float longest = 0.0f;
    for (int side = 0; side < 2; side++) {
        const float length = hypotf(edge->texel[side][1][0] - edge->texel[side][0][0],
                                    edge->texel[side][1][1] - edge->texel[side][0][1]);
        longest = fmaxf(longest, length);
    }
    return (size_t)ceilf(2.0f * longest);
}

bool kiln_seam_same_texels(const struct kiln_seam_sample *sample)
{
    for (int k = 0; k < SIDE; k++)
        if (sample->at[k] != sample->at[SIDE + k] || sample->weight[k] != -sample->weight[SIDE + k])
            return false;
    return true;
}

/* Appends the samples of an edge; there is room for them. */
static void sample_edge(const struct kiln_map *map, const uint32_t *nearest, const struct kiln_seam_edge *edge,
                        struct kiln_seam_sample *samples, size_t *count)
{
    const size_t places = kiln_seam_sample_count(edge);
    for (size_t i = 0; i < places; i++) {
        const float t = kiln_seam_sample_place(i, places);
        struct kiln_seam_sample sample;
        bool inside = true;
        for (int side = 0; side < 2; side++) {
            const float *from = edge->texel[side][0], *to = edge->texel[side][1];
            inside = inside && kiln_seam_footprint(map, nearest, from[0] + t * (to[0] - from[0]),
                                                   from[1] + t * (to[1] - from[1]), side == 0 ? 1.0f : -1.0f,
                                                   sample.at + SIDE * side, sample.weight + SIDE * side);
        }
        if (inside && !kiln_seam_same_texels(&sample) && !kiln_seam_edge_of_light(map->planes, &sample))
            samples[(*count)++] = sample;
    }
}

int kiln_seams_sample(const struct kiln_map *map, const struct kiln_chart_graph *graph, const uint32_t *nearest,
                      struct kiln_seam_sample **samples, size_t *count, struct kiln_error *error)
{
    size_t capacity = 0;
    int status = KILN_OK;
    *samples = NULL;
    *count = 0;
    for (size_t i = 0; status == KILN_OK && i < graph->edge_count; i++) {
        status = kiln_grow(samples, &capacity, *count + kiln_seam_sample_count(&graph->edges[i]), sizeof **samples,
                           "seam samples", error);
        if (status == KILN_OK)
            sample_edge(map, nearest, &graph->edges[i], *samples, count);
    }
    return status;
}

int kiln_seams_number(const struct kiln_map *map, uint32_t *marks, uint32_t **texels, size_t *count,
                      struct kiln_error *error)
{
    const size_t first = kiln_map_first(map), below = kiln_map_end(map) + map->width,
                 end = below < kiln_map_texels(map) ? below : kiln_map_texels(map);
    size_t marked = 0;
    for (size_t i = first; i < end; i++)
        marked += marks[i] != 0;
    const int status = kiln_allocate(texels, marked, sizeof **texels, "a seam's texels", error);
    *count = 0;
    for (size_t i = first; status == KILN_OK && i < end; i++)
        if (marks[i] != 0) {
            (*texels)[*count] = (uint32_t)i;
            marks[i] = (uint32_t)(*count)++;
        }
    return status;
}
