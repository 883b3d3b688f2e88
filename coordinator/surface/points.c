#include <string.h>

#include "coordinator/surface/bricks.h"
#include "coordinator/surface/build.h"
#include "coordinator/surface/charts.h"
#include "worker/base/memory.h"

/* LARGE_...: more tiles or triangles in a lightmap, and all threads process it together. So they do if it would keep
 * one thread busy when the others are done: with more than SOME_TILES, and more of all tiles than 1 / PARTS_OF_SHARE of
 * a thread's share. Each smaller lightmap is processed by one thread. */
enum { LARGE_TILES = 4096, LARGE_TRIANGLES = 65536, SOME_TILES = 64, PARTS_OF_SHARE = 4 };

void kiln_build_fail(struct kiln_build *build, int status, const struct kiln_error *error)
{
#pragma omp critical(kiln_build_failure)
    if (build->status == KILN_OK) {
        if (build->error != NULL)
            *build->error = *error;
        __atomic_store_n(&build->status, status, __ATOMIC_RELAXED);
    }
}

bool kiln_build_failed(struct kiln_build *build)
{
    if (kiln_stop_asked(build->params->stop)) {
        struct kiln_error error;
        kiln_build_fail(build, kiln_give_up(&error), &error);
    }
    return __atomic_load_n(&build->status, __ATOMIC_RELAXED) != KILN_OK;
}

static uint64_t triangles_of(const struct kiln_build *build, size_t map)
{
    const struct kiln_surface *s = build->surface;
    const struct kiln_object_range *range = &build->geometry->ranges[kiln_map_object(s, (uint32_t)map)];
    return kiln_map_back(s, (uint32_t)map) ? range->two_sided : range->opaque_count + range->alpha_count;
}

static uint64_t tiles_of(const struct kiln_build *build, size_t map)
{
    const struct kiln_lightmap *lightmap = &build->surface->lightmaps[map];
    return (uint64_t)lightmap->tiles_x * lightmap->tiles_y;
}

static bool is_large(const struct kiln_build *build, size_t map)
{
    const uint64_t tiles = tiles_of(build, map);
    return tiles > LARGE_TILES || triangles_of(build, map) > LARGE_TRIANGLES ||
           (tiles > SOME_TILES && PARTS_OF_SHARE * build->threads * tiles > build->surface->tile_count);
}

void kiln_build_for_maps(struct kiln_build *build, const uint8_t *wanted,
                         void (*work)(struct kiln_build *build, uint32_t map, uint32_t threads, const void *context),
                         const void *context)
{
    const size_t count = build->surface->map_count;
    const int team = (int)build->threads;
#pragma omp parallel for schedule(dynamic) num_threads(team)
    for (size_t o = 0; o < count; o++) {
        if ((wanted == NULL || wanted[o]) && !is_large(build, o) && !kiln_build_failed(build))
            work(build, (uint32_t)o, 1, context);
    }
    for (size_t o = 0; o < count; o++) {
        if ((wanted == NULL || wanted[o]) && is_large(build, o) && !kiln_build_failed(build))
            work(build, (uint32_t)o, build->threads, context);
    }
}

static bool publishes_backs(const struct kiln_build *build, size_t object)
{
    const uint32_t flags = build->scene->objects[object].flags;
    return (flags & KILN_OBJECT_BOTH_SIDES) != 0 || (build->params->both_sides && (flags & KILN_OBJECT_ONE_SIDE) == 0);
}

/* Whether an object needs a lightmap of backs: rays meet them, or files show them. */
static bool has_backs(const struct kiln_build *build, size_t object)
{
    const bool met = (build->scene->objects[object].flags & KILN_OBJECT_RECEIVER_ONLY) == 0;
    return build->geometry->ranges[object].two_sided > 0 && (met || publishes_backs(build, object));
}

/* Number of lightmaps: one per object (in octrees one per side), or twice that if any object has backs. */
static uint32_t count_maps(const struct kiln_build *build)
{
    const size_t objects = build->scene->object_count, fronts = build->geometry->leaves != NULL ? KILN_SIDES : 1;
    for (size_t o = 0; o < objects; o++)
        if (has_backs(build, o))
            return (uint32_t)(2 * fronts * objects);
    return (uint32_t)(fronts * objects);
}

/* Sets a lightmap's size. A published lightmap of backs is as fine as that of the front. One that only rays read has
 * half as many texels a side, unless charts would then share texels. */
static void size_lightmap(const struct kiln_build *build, uint32_t number, struct kiln_lightmap *map)
{
    const uint32_t o = kiln_map_object(build->surface, number);
    const struct kiln_object *object = &build->scene->objects[o];
    const bool back = kiln_map_back(build->surface, number);
    const bool shown = (object->flags & KILN_OBJECT_CASTER_ONLY) == 0;
    const bool both = publishes_backs(build, o);
    map->tile_first = build->surface->tile_count;
    if (back && !has_backs(build, o))
        return;
    map->published = shown && (!back || both);
    map->shift = back && !both && (object->flags & KILN_OBJECT_FINE_BACKS) == 0 ? 1 : 0;
    map->width = (object->lightmap_width - 1) / (1u << map->shift) + 1;
    map->height = (object->lightmap_height - 1) / (1u << map->shift) + 1;
    map->tiles_x = (map->width - 1) / KILN_TILE_SIDE + 1;
    map->tiles_y = (map->height - 1) / KILN_TILE_SIDE + 1;
}

static void number_blocks(struct kiln_build *build, uint32_t map)
{
    build->map_range[map + 1] =
        build->map_range[map] + (tiles_of(build, map) + KILN_RANGE_TILES - 1) / KILN_RANGE_TILES;
}

static int place_octrees(struct kiln_build *build)
{
    const int status = kiln_bricks_find(build, has_backs);
    for (uint32_t map = 0; map < build->surface->map_count && status == KILN_OK; map++)
        number_blocks(build, map);
    build->report->texels = KILN_TILE_TEXELS * build->surface->tile_count;
    return status;
}

static int place_lightmaps(struct kiln_build *build)
{
    const struct kiln_scene *scene = build->scene;
    struct kiln_surface *surface = build->surface;
    const uint32_t most = build->geometry->leaves != NULL ? UINT32_MAX / 2 / KILN_SIDES : UINT32_MAX / 2;
    if (scene->object_count > most)
        return kiln_fail(build->error, KILN_BAD_INPUT,
                         "the scene has %zu objects, and at most %u are possible: join some of them",
                         scene->object_count, most);
    surface->object_count = (uint32_t)scene->object_count;
    surface->map_count = surface->whole_maps = count_maps(build);
    int status = kiln_allocate(&surface->lightmaps, surface->map_count, sizeof *surface->lightmaps, "the lightmaps",
                               build->error);
    if (status == KILN_OK)
        status = kiln_allocate(&build->map_range, (size_t)surface->map_count + 1, sizeof *build->map_range,
                               "the lightmaps", build->error);
    if (status != KILN_OK)
        return status;
    if (build->geometry->leaves != NULL)
        return place_octrees(build);
    for (uint32_t o = 0; o < surface->map_count; o++) {
        struct kiln_lightmap *map = &surface->lightmaps[o];
        size_lightmap(build, o, map);
        if (tiles_of(build, o) >= UINT32_MAX)
            return kiln_fail(build->error, KILN_BAD_INPUT,
                             "object '%s': a lightmap of %u x %u texels is larger than kiln can hold: lower "
                             "--texels-per-metre or set "
                             "--lightmap-max",
                             kiln_scene_string(scene, scene->objects[kiln_map_object(surface, o)].name), map->width,
                             map->height);
        surface->tile_count += tiles_of(build, o);
        number_blocks(build, o);
        build->report->texels += (uint64_t)map->width * map->height;
    }
    return KILN_OK;
}

/* Estimated work of covering one tile of a lightmap, in units of one texel that lies within a triangle (about 50 ns). A
 * triangle costs 4 units whatever its size. A texel on a triangle's edge costs 10, since it is clipped; a triangle's
 * edges have about as many texels as the square root of those inside. */
static double work_of_tile(const struct kiln_build *build, size_t map)
{
    const double triangles = (double)triangles_of(build, map), texels = (double)tiles_of(build, map) * KILN_TILE_TEXELS;
    return triangles == 0.0 ? 0.0
                            : KILN_TILE_TEXELS * (texels + 4.0 * triangles + 10.0 * sqrt(triangles * texels)) / texels;
}

/* Says which lightmap each range belongs to, and divides the ranges between the ranks by estimated work. */
static int assign_blocks(struct kiln_build *build)
{
    const uint64_t count = build->map_range[build->surface->map_count];
    uint64_t *work = NULL, *bounds = NULL;
    int status = kiln_allocate(&work, count, sizeof *work, "the work of the ranks", build->error);
    if (status == KILN_OK)
        status =
            kiln_allocate(&bounds, (size_t)build->workers + 1, sizeof *bounds, "the work of the ranks", build->error);
    if (status != KILN_OK)
        goto end;
    for (size_t o = 0; o < build->surface->map_count; o++) {
        const double work_a_tile = work_of_tile(build, o);
        uint64_t tiles = tiles_of(build, o);
        for (uint64_t b = build->map_range[o]; b < build->map_range[o + 1]; b++) {
            const uint64_t here = tiles < KILN_RANGE_TILES ? tiles : KILN_RANGE_TILES;
            build->tile_ranges[b].map = (uint32_t)o;
            work[b] = (uint64_t)((double)here * work_a_tile);
            tiles -= here;
        }
    }
    kiln_partition_cut(work, count, build->workers, bounds);
    build->own_first = bounds[build->worker];
    build->own_end = bounds[build->worker + 1];
end:
    kiln_free(&work);
    kiln_free(&bounds);
    return status;
}

int kiln_build_measure(struct kiln_build *build)
{
    const struct kiln_scene *scene = build->scene;
    int status;
    KILN_TRY(place_lightmaps(build));
    KILN_TRY(kiln_allocate(&build->object_area, scene->object_count, sizeof *build->object_area, "the objects' areas",
                           build->error));
    KILN_TRY(kiln_allocate(&build->tile_ranges, build->map_range[build->surface->map_count], sizeof *build->tile_ranges,
                           "the blocks of lightmap tiles", build->error));
    KILN_TRY(assign_blocks(build));
    KILN_TRY(kiln_grid_choose(&build->grid, build->geometry, build->params->cell_size, build->error));
end:
    return build->exchange->agree(build->exchange->context, status, build->error);
}

/* Writes the tiles of a lightmap in Morton order: descends a quadtree and leaves out what lies outside. Returns the end
 * of what it wrote. */
static uint32_t *order_tiles(uint32_t *out, const struct kiln_lightmap *map, uint32_t x, uint32_t y, uint32_t side)
{
    if (x >= map->tiles_x || y >= map->tiles_y)
        return out;
    if (side == 1) {
        *out = y * map->tiles_x + x;
        return out + 1;
    }
    const uint32_t half = side / 2;
    out = order_tiles(out, map, x, y, half);
    out = order_tiles(out, map, x + half, y, half);
    out = order_tiles(out, map, x, y + half, half);
    return order_tiles(out, map, x + half, y + half, half);
}

/* Sums over the pieces of one texel, while its tile is covered. */
struct texel_sum {
    double area;
    struct kiln_dvec3 moment; /* sum of area x centroid, m3 */
    uint32_t pieces, chart;
    bool shared;
};

static void add_to_texel(const struct kiln_build *build, struct texel_sum *sum, const struct kiln_coverage_piece *piece)
{
    const struct kiln_geometry *g = build->geometry;
    struct kiln_vec3 corner[3];
    uint64_t vertex[3];
    kiln_geometry_corners(g, piece->triangle, corner);
    kiln_geometry_stored_vertices(build->scene, g, piece->triangle, vertex);
    const uint32_t chart = build->vertex_chart != NULL ? build->vertex_chart[vertex[0]] : 0;
    if (sum->pieces == 0)
        sum->chart = chart;
    else if (sum->chart != chart)
        sum->shared = true;
    const struct kiln_dvec3 position =
        dvec3_add(dvec3_scale(dvec3_of(corner[0]), 1.0 - piece->b1 - piece->b2),
                  dvec3_add(dvec3_scale(dvec3_of(corner[1]), piece->b1), dvec3_scale(dvec3_of(corner[2]), piece->b2)));
    sum->moment = dvec3_add(sum->moment, dvec3_scale(position, piece->area));
    sum->area += piece->area;
    sum->pieces++;
}

/* Covers one tile and appends its unplaced runs, one for each cell that a texel of it lies in. */
static int cover_tile(const struct kiln_build *build, const struct kiln_coverage *coverage, uint32_t tile,
                      struct kiln_coverage_scratch *scratch, struct kiln_tile_range *tile_range,
                      struct kiln_error *error)
{
    int status = kiln_coverage_tile(coverage, tile, UINT64_MAX, scratch, error);
    if (status == KILN_OK)
        status = kiln_grow(&tile_range->runs, &tile_range->capacity, tile_range->count + KILN_TILE_TEXELS,
                           sizeof *tile_range->runs, "the tile runs found", error);
    if (status != KILN_OK || scratch->count == 0)
        return status;
    struct texel_sum sums[KILN_TILE_TEXELS] = {0};
    for (size_t i = 0; i < scratch->count; i++)
        add_to_texel(build, &sums[scratch->pieces[i].bit], &scratch->pieces[i]);
    const size_t first = tile_range->count;
    for (uint32_t bit = 0; bit < KILN_TILE_TEXELS; bit++) {
        const struct texel_sum *sum = &sums[bit];
        if (sum->pieces == 0)
            continue;
        const uint64_t code = kiln_grid_code(&build->grid, dvec3_scale(sum->moment, 1.0 / sum->area));
        size_t at = first;
        while (at < tile_range->count && tile_range->runs[at].code != code)
            at++;
        struct kiln_unplaced_run *run = &tile_range->runs[at];
        if (at == tile_range->count) {
            *run = (struct kiln_unplaced_run){.code = code, .tile = tile};
            tile_range->count++;
        }
        const uint32_t kept = sum->pieces < KILN_PIECES_MOST ? sum->pieces : KILN_PIECES_MOST;
        run->mask |= 1ull << bit;
        run->pieces += kept;
        run->cdf_entries += kept - 1;
        tile_range->area += sum->area;
        tile_range->overlapped_texels += sum->shared ? 1 : 0;
    }
    return KILN_OK;
}

/* Shrinks a range's array to what it holds: there may be very many small objects. */
static int trim_block(struct kiln_tile_range *tile_range, struct kiln_error *error)
{
    struct kiln_unplaced_run *exact = NULL;
    if (tile_range->capacity == tile_range->count)
        return KILN_OK;
    const int status = kiln_allocate(&exact, tile_range->count, sizeof *exact, "the tile runs found", error);
    if (status != KILN_OK)
        return status;
    if (tile_range->count > 0)
        memcpy(exact, tile_range->runs, tile_range->count * sizeof *exact);
    kiln_free(&tile_range->runs);
    tile_range->runs = exact;
    tile_range->capacity = tile_range->count;
    return KILN_OK;
}

static double area_of(const struct kiln_build *build, uint32_t object)
{
    const struct kiln_object_range *range = &build->geometry->ranges[object];
    double area = 0.0;
    for (uint64_t k = 0; k < range->opaque_count + range->alpha_count; k++)
        area += kiln_geometry_triangle_area(build->geometry, k < range->opaque_count
                                                                 ? range->opaque_first + k
                                                                 : range->alpha_first + k - range->opaque_count);
    return area;
}

static void cover_map(struct kiln_build *build, uint32_t number, uint32_t threads, const void *context)
{
    (void)context;
    const struct kiln_lightmap *map = &build->surface->lightmaps[number];
    const uint64_t tiles = tiles_of(build, number), block_first = build->map_range[number],
                   block_last = build->map_range[number + 1];
    const uint64_t own_first = block_first > build->own_first ? block_first : build->own_first;
    const uint64_t own_end = block_last < build->own_end ? block_last : build->own_end;
    struct kiln_error error;
    struct kiln_coverage coverage = {0};
    uint32_t *order = NULL;
    uint32_t side = 1;
    const int team = (int)threads;
    if (triangles_of(build, number) == 0 || own_first >= own_end)
        return;
    if (own_first == block_first && number < build->surface->object_count)
        build->object_area[number] = area_of(build, number);
    int status = kiln_allocate(&order, tiles, sizeof *order, "the order of a lightmap's tiles", &error);
    if (status == KILN_OK)
        status =
            kiln_coverage_create(&coverage, build->scene, build->geometry, build->surface, number, threads, &error);
    if (status != KILN_OK) {
        kiln_build_fail(build, status, &error);
        goto end;
    }
    while (side < map->tiles_x || side < map->tiles_y)
        side *= 2;
    if (coverage.leaves) /* bricks are in Morton order */
        for (uint32_t i = 0; i < tiles; i++)
            order[i] = i;
    else
        order_tiles(order, map, 0, 0, side);
#pragma omp parallel num_threads(team)
    {
        struct kiln_coverage_scratch scratch = {0};
        struct kiln_error own;
#pragma omp for schedule(dynamic)
        for (uint64_t b = own_first; b < own_end; b++) {
            struct kiln_tile_range *tile_range = &build->tile_ranges[b];
            const uint64_t first = (b - block_first) * KILN_RANGE_TILES;
            const uint64_t last = first + KILN_RANGE_TILES < tiles ? first + KILN_RANGE_TILES : tiles;
            for (uint64_t i = first; i < last && !kiln_build_failed(build); i++) {
                const int failed = cover_tile(build, &coverage, order[i], &scratch, tile_range, &own);
                if (failed != KILN_OK)
                    kiln_build_fail(build, failed, &own);
            }
            const int failed = trim_block(tile_range, &own);
            if (failed != KILN_OK)
                kiln_build_fail(build, failed, &own);
        }
        kiln_coverage_scratch_destroy(&scratch);
    }
end:
    kiln_coverage_destroy(&coverage);
    kiln_free(&order);
}

/* Covers this rank's ranges. Needs the charts of their meshes during that time only. */
static int cover_own(struct kiln_build *build)
{
    uint8_t *wanted = NULL;
    int status;
    KILN_TRY(kiln_allocate(&wanted, build->scene->mesh_count, sizeof *wanted, "the meshes to cover", build->error));
    for (uint64_t b = build->own_first; b < build->own_end; b++)
        wanted[build->scene->objects[kiln_map_object(build->surface, build->tile_ranges[b].map)].mesh] = 1;
    if (build->geometry->leaves == NULL)
        KILN_TRY(kiln_charts_find(&build->vertex_chart, build->scene, wanted, build->threads, build->error));
    kiln_build_for_maps(build, NULL, cover_map, NULL);
    KILN_TRY(build->status);
end:
    kiln_free(&build->vertex_chart);
    kiln_free(&wanted);
    return status;
}

/* The sums of one range as they are sent to all ranks, so that all add the same numbers in the same order. */
struct block_sums {
    uint64_t tile_range, overlapped_texels;
    double area, object_area; /* m2; object_area is used from an object's first range only */
};

/* kiln_surface_taker for a struct kiln_build */
static void receive_sums(void *taker, const void *records, size_t count)
{
    struct kiln_build *build = taker;
    const struct block_sums *sums = records;
    for (size_t i = 0; i < count; i++) {
        struct kiln_tile_range *tile_range = &build->tile_ranges[sums[i].tile_range];
        tile_range->area = sums[i].area;
        tile_range->overlapped_texels = sums[i].overlapped_texels;
        if (tile_range->map < build->surface->object_count && build->map_range[tile_range->map] == sums[i].tile_range)
            build->object_area[tile_range->map] = sums[i].object_area;
    }
}

static int exchange_sums(struct kiln_build *build, int status)
{
    struct block_sums *sums = NULL;
    const size_t count = (size_t)(build->own_end - build->own_first);
    if (status == KILN_OK)
        status = kiln_allocate(&sums, count, sizeof *sums, "the areas of lightmap tiles", build->error);
    for (size_t i = 0; i < count && status == KILN_OK; i++) {
        const struct kiln_tile_range *tile_range = &build->tile_ranges[build->own_first + i];
        const double whole = tile_range->map < build->surface->object_count ? build->object_area[tile_range->map] : 0.0;
        sums[i] = (struct block_sums){build->own_first + i, tile_range->overlapped_texels, tile_range->area, whole};
    }
    status = build->exchange->allgather(build->exchange->context, status, sums, count, sizeof *sums, receive_sums,
                                        build, build->error);
    kiln_free(&sums);
    return status;
}

static void report_areas(struct kiln_build *build)
{
    struct kiln_surface_report *report = build->report;
    for (size_t o = 0; o < build->scene->object_count; o++) {
        double area = 0.0;
        for (size_t map = o; map < kiln_front_maps(build->surface); map += build->scene->object_count)
            for (uint64_t b = build->map_range[map]; b < build->map_range[map + 1]; b++) {
                area += build->tile_ranges[b].area;
                report->overlapped_texels += build->tile_ranges[b].overlapped_texels;
            }
        if (build->surface->bricks != NULL) /* the first octree of an object may have no ranges */
            build->object_area[o] = area_of(build, (uint32_t)o);
        report->area += area;
        report->geometry_area += build->object_area[o];
        if (!(build->object_area[o] > 0.0))
            continue;
        const double wrong = fabs(area / build->object_area[o] - 1.0);
        if (wrong > report->worst_object_area_error) {
            report->worst_object_area_error = wrong;
            report->worst_object = (uint32_t)o;
        }
    }
}

int kiln_build_cover(struct kiln_build *build)
{
    const int status = exchange_sums(build, cover_own(build));
    if (status == KILN_OK)
        report_areas(build);
    return status;
}
