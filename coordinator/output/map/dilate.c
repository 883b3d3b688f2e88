#include "coordinator/output/map/stage.h"

uint64_t kiln_map_dilate(struct kiln_map *map, const uint32_t *nearest)
{
    const size_t count = kiln_map_texels(map);
    uint64_t dilated = 0;
#pragma omp parallel for schedule(static) reduction(+ : dilated)
    for (size_t i = 0; i < count; i++) {
        if (map->state[i] != KILN_TEXEL_MARGIN || nearest[i] == KILN_NONE)
            continue;
        for (uint32_t p = 0; p < map->has->count; p++)
            map->planes[p][i] = map->planes[p][nearest[i]];
        dilated++;
    }
    return dilated;
}

static int run(struct kiln_map_work *work, struct kiln_error *error)
{
    (void)error;
    work->report->dilated = kiln_map_dilate(work->map, work->nearest);
    return KILN_OK;
}

const struct kiln_map_stage kiln_map_stage_dilate = {.name = "dilate", .features = KILN_MAP_NEAREST, .run = run};
