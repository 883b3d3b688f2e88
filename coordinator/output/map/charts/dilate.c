#include "coordinator/output/map/charts/dilate.h"

#include "coordinator/output/map/bands/bands.h"
#include "coordinator/output/map/stage.h"

int kiln_map_dilate(struct kiln_map *map, const uint32_t *nearest, uint64_t *dilated, struct kiln_error *error)
{
    const size_t first = kiln_map_first(map), end = kiln_map_end(map);
    uint64_t count = 0;
    int status = kiln_bands_fetch(map, nearest, error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for schedule(static) reduction(+ : count)
    for (size_t i = first; i < end; i++) {
        if (map->state[i] != KILN_TEXEL_MARGIN || nearest[i] == KILN_NONE)
            continue;
        for (uint32_t p = 0; p < map->has->count; p++)
            map->planes[p][i] = map->planes[p][nearest[i]];
        count++;
    }
    if (dilated == NULL)
        return KILN_OK;
    *dilated = count;
    return kiln_bands_count(map, dilated, 1, error);
}

static int run(struct kiln_map_work *work, struct kiln_error *error)
{
    return kiln_map_dilate(work->map, work->nearest, &work->report->dilated, error);
}

const struct kiln_map_stage kiln_map_stage_dilate = {.name = "dilate", .features = KILN_MAP_NEAREST, .run = run};
