#include "coordinator/output/map/map.h"

#include <string.h>

#include "worker/base/memory.h"
#include "worker/scene/scene.h"

const struct kiln_map_planes kiln_map_light = {.count = KILN_MAP_PLANES,
                                               .smooth = {true, true, true, true, true, true, false}};

int kiln_map_create(struct kiln_map **map, uint32_t width, uint32_t height, const struct kiln_map_planes *planes,
                    struct kiln_error *error)
{
    *map = NULL;
    if ((uint64_t)width * height >= UINT32_MAX)
        return kiln_fail(error, KILN_CANNOT_CREATE,
                         "a lightmap of %u x %u texels is too large: at most 2^32 - 2 texels", width, height);
    int status = kiln_allocate(map, 1, sizeof **map, "a lightmap", error);
    if (status != KILN_OK)
        return status;
    struct kiln_map *made = *map;
    made->width = width;
    made->height = height;
    made->has = planes;
    const size_t count = kiln_map_texels(made);
    status = kiln_allocate(&made->planes, planes->count, sizeof *made->planes, "a lightmap's planes", error);
    for (uint32_t p = 0; status == KILN_OK && p < planes->count; p++)
        status = kiln_allocate(&made->planes[p], count, sizeof(float), "a lightmap's texels", error);
    if (status == KILN_OK)
        status = kiln_allocate(&made->area, count, sizeof(float), "a lightmap's areas", error);
    if (status == KILN_OK)
        status = kiln_allocate(&made->coverage, count, sizeof(float), "a lightmap's coverage", error);
    if (status == KILN_OK)
        status = kiln_allocate(&made->state, count, 1, "a lightmap's states", error);
    if (status == KILN_OK)
        status = kiln_allocate(&made->chart, count, sizeof(uint32_t), "a lightmap's charts", error);
    if (status != KILN_OK) {
        kiln_map_destroy(map);
        return status;
    }
    memset(made->chart, 0xff, count * sizeof *made->chart);
    return KILN_OK;
}

void kiln_map_destroy(struct kiln_map **map)
{
    if (*map == NULL)
        return;
    for (uint32_t p = 0; (*map)->planes != NULL && p < (*map)->has->count; p++)
        kiln_free(&(*map)->planes[p]);
    kiln_free(&(*map)->planes);
    kiln_free(&(*map)->area);
    kiln_free(&(*map)->coverage);
    kiln_free(&(*map)->state);
    kiln_free(&(*map)->chart);
    kiln_free(map);
}
