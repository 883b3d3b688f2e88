#include "coordinator/output/map/map.h"

#include <string.h>
#include <sys/mman.h>

#include "coordinator/output/image.h"
#include "worker/base/memory.h"
#include "worker/scene/scene.h"

const struct kiln_map_planes kiln_map_light = {.count = KILN_MAP_PLANES,
                                               .smooth = {true, true, true, true, true, true, false}};

/* Zeroes an array. Several threads do so if it is large, so that they also create its pages. */
static void clear(void *array, size_t bytes)
{
    enum { AT_ONCE = 1 << 18 };
#pragma omp parallel for schedule(static) if (bytes > AT_ONCE)
    for (size_t at = 0; at < bytes; at += AT_ONCE)
        memset((char *)array + at, 0, bytes - at < AT_ONCE ? bytes - at : AT_ONCE);
}

static int allocate_whole(const struct kiln_map *map, void *pointer, size_t size, const char *what,
                          struct kiln_error *error)
{
    const int status = kiln_allocate_bare(pointer, kiln_map_texels(map), size, what, error);
    void *array;
    memcpy(&array, pointer, sizeof array);
    if (status == KILN_OK)
        clear(array, kiln_map_texels(map) * size);
    return status;
}

/* Pages of a band that nobody has touched are zero and take no memory. */
int kiln_map_allocate(const struct kiln_map *map, void *pointer, size_t size, const char *what,
                      struct kiln_error *error)
{
    const size_t bytes = kiln_map_texels(map) * size;
    if (map->bands == NULL)
        return allocate_whole(map, pointer, size, what, error);
    void *pages = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    if (pages == MAP_FAILED)
        return kiln_fail_errno(error, KILN_SYSTEM, "out of address space: %zu bytes for %s", bytes, what);
    (void)madvise(pages, bytes, MADV_NOHUGEPAGE); /* otherwise single texels of other bands would occupy large pages */
    memcpy(pointer, &pages, sizeof pages);
    return KILN_OK;
}

void kiln_map_free(const struct kiln_map *map, void *pointer, size_t size)
{
    void *pages = NULL;
    if (map->bands == NULL) {
        kiln_free(pointer);
        return;
    }
    memcpy(&pages, pointer, sizeof pages);
    if (pages != NULL)
        (void)munmap(pages, kiln_map_texels(map) * size);
    pages = NULL;
    memcpy(pointer, &pages, sizeof pages);
}

/* Clears the charts of the map's rows, and of the neighbouring rows that it may read. */
static void clear_charts(struct kiln_map *map)
{
    const size_t first = kiln_map_first(map), end = kiln_map_end(map),
                 halo = map->bands != NULL ? (size_t)KILN_BANDS_HALO * map->width : 0,
                 from = first > halo ? first - halo : 0,
                 to = end + halo < kiln_map_texels(map) ? end + halo : kiln_map_texels(map);
#pragma omp parallel for schedule(static) if (to - from > KILN_IMAGE_ALONE)
    for (size_t i = from; i < to; i++)
        map->chart[i] = KILN_NONE;
}

static int create(struct kiln_map **map, const struct kiln_map *shape, struct kiln_error *error)
{
    *map = NULL;
    if ((uint64_t)shape->width * shape->height >= UINT32_MAX)
        return kiln_fail(error, KILN_CANNOT_CREATE,
                         "a lightmap of %u x %u texels is too large: at most 2^32 - 2 texels", shape->width,
                         shape->height);
    int status = kiln_allocate(map, 1, sizeof **map, "a lightmap", error);
    if (status != KILN_OK)
        return status;
    struct kiln_map *made = *map;
    *made = *shape;
    KILN_TRY(kiln_allocate(&made->planes, made->has->count, sizeof *made->planes, "a lightmap's planes", error));
    for (uint32_t p = 0; p < made->has->count; p++)
        KILN_TRY(kiln_map_allocate(made, &made->planes[p], sizeof(float), "a lightmap's texels", error));
    KILN_TRY(kiln_map_allocate(made, &made->area, sizeof(float), "a lightmap's areas", error));
    KILN_TRY(kiln_map_allocate(made, &made->coverage, sizeof(float), "a lightmap's coverage", error));
    KILN_TRY(kiln_map_allocate(made, &made->state, 1, "a lightmap's states", error));
    KILN_TRY(kiln_map_allocate(made, &made->chart, sizeof(uint32_t), "a lightmap's charts", error));
end:
    if (status != KILN_OK) {
        kiln_map_destroy(map);
        return status;
    }
    clear_charts(made);
    return KILN_OK;
}

int kiln_map_create(struct kiln_map **map, uint32_t width, uint32_t height, const struct kiln_map_planes *planes,
                    struct kiln_error *error)
{
    return create(map, &(struct kiln_map){.width = width, .height = height, .end_row = height, .has = planes}, error);
}

int kiln_map_create_rows(struct kiln_map **map, uint32_t width, uint32_t height, const struct kiln_map_planes *planes,
                         const struct kiln_bands *bands, uint32_t first_row, uint32_t end_row, struct kiln_error *error)
{
    const struct kiln_map shape = {
        .width = width, .height = height, .first_row = first_row, .end_row = end_row, .has = planes, .bands = bands};
    return create(map, &shape, error);
}

void kiln_map_destroy(struct kiln_map **map)
{
    struct kiln_map *m = *map;
    if (m == NULL)
        return;
    for (uint32_t p = 0; m->planes != NULL && p < m->has->count; p++)
        kiln_map_free(m, &m->planes[p], sizeof(float));
    kiln_free(&m->planes);
    kiln_map_free(m, &m->area, sizeof(float));
    kiln_map_free(m, &m->coverage, sizeof(float));
    kiln_map_free(m, &m->state, 1);
    kiln_map_free(m, &m->chart, sizeof(uint32_t));
    kiln_map_free(m, &m->region, sizeof(uint32_t));
    kiln_free(map);
}
