#include "coordinator/output/map/write/writer.h"

#include <string.h>

#include "coordinator/output/image.h"
#include "coordinator/output/map/bands/bands.h"
#include "coordinator/output/map/write/stages.h"
#include "worker/base/memory.h"

/* The covered texels of the map's rows. */
static uint64_t count_covered(const struct kiln_surface *surface, uint32_t object, const struct kiln_map *map)
{
    enum { ROWS = 8 }; /* of a tile: a band begins with one */
    const struct kiln_lightmap *lightmap = &surface->lightmaps[object];
    const uint64_t first = map->first_row / ROWS, end = (map->end_row + ROWS - 1) / ROWS;
    uint64_t covered = 0;
    for (uint64_t t = first * lightmap->tiles_x; t < end * lightmap->tiles_x; t++)
        covered += (uint64_t)__builtin_popcountll(surface->tiles[lightmap->tile_first + t].mask);
    return covered;
}

int kiln_writer_check_arrived(const struct kiln_writer *w, uint32_t object, struct kiln_error *error)
{
    const struct kiln_map *map = w->works[object].map;
    const uint64_t covered = count_covered(w->result->surface, object, map);
    uint64_t arrived = 0;
#pragma omp parallel for schedule(static) reduction(+ : arrived) if (kiln_map_texels(map) > KILN_IMAGE_ALONE)
    for (size_t i = kiln_map_first(map); i < kiln_map_end(map); i++)
        arrived += map->state[i] != KILN_TEXEL_MARGIN;
    if (arrived != covered)
        return kiln_fail(error, KILN_BUG, "object %u: %llu of its %llu points arrived where its lightmap is written",
                         object, (unsigned long long)arrived, (unsigned long long)covered);
    return KILN_OK;
}

void kiln_writer_drop(const struct kiln_writer *w, uint32_t object)
{
    kiln_map_stages_release(&w->works[object]);
    kiln_map_destroy(&w->works[object].map);
}

/* Keeps a ghost of a map. */
static void put_ghost(struct kiln_writer *w, const struct kiln_texel_record *record)
{
    struct kiln_map_ghosts *ghosts = &w->works[record->map].ghosts;
    if (record->valid == 0)
        return;
#pragma omp critical(kiln_put_ghost)
    {
        ghosts->size = sizeof *record + w->layers.planes.count * sizeof(float);
        if (w->ghost_status == KILN_OK)
            w->ghost_status = kiln_grow(&ghosts->records, &ghosts->capacity, ghosts->count + 1, ghosts->size,
                                        "texels of objects that touch", &w->ghost_error);
        if (w->ghost_status == KILN_OK)
            memcpy(ghosts->records + ghosts->count++ * ghosts->size, record, ghosts->size);
    }
}

void kiln_writer_put_point(void *context, const struct kiln_texel_record *record)
{
    struct kiln_writer *w = context;
    struct kiln_map *map = w->works[record->map].map;
    if (record->from != record->map) {
        put_ghost(w, record);
        return;
    }
    const size_t texel = (size_t)record->y * map->width + record->x;
    const struct kiln_mesh *mesh =
        &w->result->scene->meshes[w->result->scene->objects[kiln_map_object(w->result->surface, record->map)].mesh];
    map->state[texel] = record->valid != 0 ? KILN_TEXEL_VALID : KILN_TEXEL_FILLED;
    map->area[texel] = record->area;
    map->coverage[texel] = record->coverage;
    map->chart[texel] = (uint32_t)(w->result->geometry->stored_triangle[record->triangle] - mesh->triangle_first);
    for (uint32_t p = 0; record->valid != 0 && p < map->has->count; p++)
        map->planes[p][texel] = record->values[p];
}

int kiln_writer_open(const struct kiln_writer *w, uint32_t object, struct kiln_error *error)
{
    const struct kiln_lightmap *lightmap = &w->result->surface->lightmaps[object];
    struct kiln_map_work *work = &w->works[object];
    if (work->map != NULL)
        return KILN_OK;
    work->result = w->result;
    work->params = w->params;
    work->layers = &w->layers;
    work->object = object;
    work->device = w->device;
    work->graphs = w->graphs;
    work->report = &w->reports[object];
    *work->report = (struct kiln_lightmap_report){.map = object};
    return work->in_bands
               ? kiln_map_create_band(&work->map, lightmap->width, lightmap->height, &w->layers.planes, w->bands, error)
               : kiln_map_create(&work->map, lightmap->width, lightmap->height, &w->layers.planes, error);
}
