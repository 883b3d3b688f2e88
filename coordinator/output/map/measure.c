#include <math.h>

#include "coordinator/output/image.h"
#include "coordinator/output/map/stage.h"

/* Texels per metre that the object really has: the square root of covered texels / area. */
static double density_of(const struct kiln_map *map)
{
    double texels = 0.0, area = 0.0;
    for (size_t i = 0; i < kiln_map_texels(map); i++) {
        texels += (double)map->coverage[i];
        area += (double)map->area[i];
    }
    return area > 0.0 ? sqrt(texels / area) : 0.0;
}

/* Over gathered texels: mean luminance by area, and root mean square of the standard error relative to it. `caustic`:
 * the first of the planes of caustics; KILN_MAP_PLANES_MAX: there are none. */
static void measure_light(const struct kiln_map *map, uint32_t caustic, struct kiln_lightmap_report *report)
{
    double area = 0.0, light = 0.0, squares = 0.0;
    for (size_t i = 0; i < kiln_map_texels(map); i++) {
        if (map->state[i] != KILN_TEXEL_VALID)
            continue;
        float rgb[3];
        for (int c = 0; c < 3; c++)
            rgb[c] = map->planes[KILN_MAP_DIRECT + c][i] + map->planes[KILN_MAP_INDIRECT + c][i] +
                     (caustic < KILN_MAP_PLANES_MAX ? map->planes[caustic + (uint32_t)c][i] : 0.0f);
        const double own = (double)map->area[i], error = (double)map->planes[KILN_MAP_ERROR][i];
        area += own;
        light += own * (double)kiln_rgb_luminance(rgb[0], rgb[1], rgb[2]);
        squares += own * error * error;
    }
    report->mean = area > 0.0 ? light / area : 0.0;
    report->error = report->mean > 0.0 ? sqrt(squares / area) / report->mean : 0.0;
}

/* Reports on the map as it was gathered. Changes nothing. */
static int run(struct kiln_map_work *work, struct kiln_error *error)
{
    (void)error;
    const struct kiln_map *map = work->map;
    measure_light(map, kiln_layers_plane(work->layers, work->result->fields, "caustic"), work->report);
    for (size_t i = 0; i < kiln_map_texels(map); i++) {
        work->report->valid += map->state[i] == KILN_TEXEL_VALID;
        work->report->filled += map->state[i] == KILN_TEXEL_FILLED;
    }
    work->report->texels_per_metre = density_of(map);
    return KILN_OK;
}

const struct kiln_map_stage kiln_map_stage_measure = {.name = "measure", .run = run};
