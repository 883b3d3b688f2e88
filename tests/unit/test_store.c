/* Tests of the store that is compiled in (worker/store/store.h): in one go and in rounds a hit leads to the same place,
 * which is that of its texel; on fronts and backs, in tiles that lie in several cells, and on both sides of a wall that
 * divides a texel. Its arrays are all that it says it takes. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdlib.h>
#include <string.h>

#include "coordinator/surface/surface_build.h"
#include "tests/unit/surface_scene.h"
#include "worker/base/memory.h"
#include "worker/store/store.h"

struct world {
    struct fixture *fixture;
    struct kiln_geometry *geometry;
    struct kiln_surface *surface;
    struct kiln_store store;
};

/* A sheet of two sides over a cube, in cells of that size, m: of 0.35 so small that most tiles lie in several. */
static struct world build(double cell_size)
{
    static const double uv[4] = {0.1, 0.9, 0.05, 0.95}, above[12] = {1, 0, 0, 0, 0, 1, 0, 2, 0, 0, 1, 0};
    struct world w = {.fixture = fixture_create()};
    struct fixture *f = w.fixture;
    const uint32_t grey = fixture_material(f, 0.5f, 0.5f, 0.5f), leaf = fixture_material(f, 0.5f, 0.5f, 0.5f);
    f->materials[leaf].double_sided = 1;
    const uint32_t cube = fixture_cube(f, 2, 0.0, grey), sheet = fixture_mesh(f);
    fixture_sheet(f, dvec3(-2, 0, 2), dvec3(4, 0, 0), dvec3(0, 0, -4), 4, uv, 0.2, leaf);
    (void)fixture_object(f, cube, above, 48, 32);
    (void)fixture_object(f, sheet, NULL, 40, 56);
    assert_int_equal(kiln_geometry_create(&w.geometry, &f->scene, NULL), KILN_OK);
    const struct kiln_surface_params params = {
        .scene = &f->scene, .geometry = w.geometry, .cell_size = cell_size, .ranks = 1, .threads = 1};
    assert_int_equal(kiln_surface_build(&w.surface, &params, &(struct kiln_surface_report){0}, NULL), KILN_OK);
    kiln_store_build(&w.store, w.surface, w.geometry);
    return w;
}

static void release(struct world *w)
{
    kiln_surface_destroy(&w->surface);
    kiln_geometry_destroy(&w->geometry);
    fixture_destroy(w->fixture);
}

/* A hit, and the place that the store finds in one go. */
struct hit {
    uint32_t triangle;
    float u, v;
    bool back;
    uint64_t place;
};

static struct hit hit_of(const struct world *w)
{
    struct hit h = {.triangle = (uint32_t)(fixture_random(w->fixture) * (double)w->geometry->triangle_count),
                    .u = (float)fixture_random(w->fixture)};
    const bool two_sided = (w->geometry->records[h.triangle].material & KILN_RECORD_DOUBLE_SIDED) != 0;
    h.v = (1.0f - h.u) * (float)fixture_random(w->fixture);
    h.back = two_sided && fixture_random(w->fixture) < 0.5;
    h.place = kiln_store_find(&w->store, h.triangle, h.u, h.v, h.back).at;
    return h;
}

/* The lightmap and the texel that the hit lies on. */
static uint32_t texel_of(const struct world *w, const struct hit *h, uint32_t *x, uint32_t *y)
{
    const struct kiln_hit_record *record = &w->geometry->records[h->triangle];
    const struct kiln_lightmap *front = &w->surface->lightmaps[record->object];
    const uint32_t number = record->object + (h->back ? w->surface->object_count : 0);
    *x = (uint32_t)kiln_hit_column(record, h->u, h->v, front->width) >> w->surface->lightmaps[number].shift;
    *y = (uint32_t)kiln_hit_row(record, h->u, h->v, front->height) >> w->surface->lightmaps[number].shift;
    return number;
}

/* Some hits in rounds, against their places in one go; how many were left open. */
static uint32_t follow(const struct world *w, const struct hit *hits, uint32_t count, const uint64_t *radiosity)
{
    struct kiln_store_ways ways;
    uint64_t places[KILN_STORE_WAYS];
    for (uint32_t i = 0; i < count; i++)
        kiln_store_enter(&w->store, &ways, i, hits[i].triangle, hits[i].u, hits[i].v, hits[i].back);
    const uint32_t open = kiln_store_follow(&w->store, &ways, count, radiosity, places);
    for (uint32_t k = 0; k < open; k++) {
        const struct hit *h = &hits[ways.open[k]];
        const struct kiln_global_point place = {places[ways.open[k]]};
        places[ways.open[k]] = kiln_store_settle(&w->store, h->triangle, h->u, h->v, h->back, place).at;
    }
    for (uint32_t i = 0; i < count; i++)
        assert_int_equal(places[i], hits[i].place);
    return open;
}

static uint32_t follow_many(const struct world *w)
{
    struct hit hits[KILN_STORE_WAYS];
    uint64_t *radiosity = calloc(kiln_store_count(&w->store), sizeof *radiosity);
    uint32_t open = 0;
    for (uint32_t round = 0; round < 400; round++) {
        const uint32_t count = round % KILN_STORE_WAYS + 1;
        for (uint32_t i = 0; i < count; i++)
            hits[i] = hit_of(w);
        open += follow(w, hits, count, radiosity);
    }
    free(radiosity);
    return open;
}

static void hits_lead_to_their_texels(void **state)
{
    (void)state;
    struct world w = build(0.35);
    uint32_t backs = 0, split = 0;
    assert_true(w.surface->split_count > 100);
    for (int i = 0; i < 20000; i++) {
        const struct hit h = hit_of(&w);
        uint32_t x, y;
        const uint32_t number = texel_of(&w, &h, &x, &y);
        const struct kiln_lightmap *map = &w.surface->lightmaps[number];
        assert_true(h.place < kiln_store_count(&w.store)); /* no slivers here */
        assert_int_equal(h.place, kiln_surface_find(w.surface, number, x, y).at);
        backs += h.back;
        split += (w.surface->tiles[map->tile_first + kiln_tile_of(x, y, map->tiles_x)].first & KILN_TILE_SPLIT) != 0;
    }
    assert_true(backs > 1000 && split > 1000);
    assert_int_equal(follow_many(&w), 0);
    release(&w);
}

static const float MARGIN = 0.01f; /* of a texel: so near to a wall hits are of neither side */

/* Divides every texel of a tile that has a point, by a wall across its middle column: what is right of it is another
 * point. */
static void divide_a_tile(struct kiln_surface *s, uint64_t number, uint64_t beyond)
{
    struct kiln_tile *tile = &s->tiles[number];
    const uint64_t points = (uint64_t)__builtin_popcountll(tile->mask);
    assert_true((tile->first & KILN_TILE_SPLIT) == 0 && points > 0 && s->divided_count == 0);
    size_t room = s->split_count;
    assert_int_equal(kiln_allocate(&s->divided, points, sizeof *s->divided, "divided texels", NULL), KILN_OK);
    assert_int_equal(kiln_grow(&s->splits, &room, s->split_count + points, sizeof *s->splits, "splits", NULL), KILN_OK);
    for (uint64_t rest = tile->mask; rest != 0; rest &= rest - 1, s->divided_count++) {
        const uint64_t i = s->divided_count;
        s->divided[i] =
            (struct kiln_divided_texel){.part = {{tile->first + i}, {beyond}, {KILN_NO_POINT}, {KILN_NO_POINT}},
                                        .lines = {1.0f, 0.0f, 0.5f},
                                        .margin = MARGIN,
                                        .line_count = 1,
                                        .codes = {0xffffff10u, 0xffffffffu},
                                        .tile = number};
        s->splits[s->split_count + i] = (struct kiln_split_tile_run){rest & ~(rest - 1), {KILN_TILE_SPLIT | i}};
    }
    tile->first = KILN_TILE_SPLIT | s->split_count;
    s->split_count += points;
}

static void walls_divide_texels(void **state)
{
    (void)state;
    struct world w = build(2.0);
    uint64_t tile = 0, sides[2] = {0, 0}, near = 0;
    for (uint64_t i = 0, most = 0; i < w.surface->tile_count; i++) {
        const uint64_t points = (uint64_t)__builtin_popcountll(w.surface->tiles[i].mask);
        if ((w.surface->tiles[i].first & KILN_TILE_SPLIT) == 0 && points > most) {
            most = points;
            tile = i;
        }
    }
    const uint64_t first = w.surface->tiles[tile].first, beyond = w.surface->point_count - 1;
    divide_a_tile(w.surface, tile, beyond);
    assert_true(first + w.surface->divided_count < beyond);
    for (int i = 0; i < 200000; i++) {
        const struct hit h = hit_of(&w);
        uint32_t x, y;
        const uint32_t number = texel_of(&w, &h, &x, &y);
        const struct kiln_lightmap *map = &w.surface->lightmaps[number];
        if (map->tile_first + kiln_tile_of(x, y, map->tiles_x) != tile)
            continue;
        const float along = kiln_hit_x(&w.geometry->records[h.triangle], h.u, h.v) / (float)(1u << map->shift);
        const float place = along - floorf(along) - 0.5f;
        const bool right = place > 0.0f;
        if (fabsf(fabsf(place) - MARGIN) < 1e-5f)
            continue;
        if (fabsf(place) < MARGIN) {
            assert_true(h.place == KILN_NO_POINT);
            near++;
            continue;
        }
        assert_int_equal(h.place, right ? beyond : kiln_surface_find(w.surface, number, x, y).at);
        sides[right]++;
    }
    assert_true(sides[0] > 50 && sides[1] > 50 && near > 0);
    assert_true(follow_many(&w) > 0);
    release(&w);
}

static void bytes_are_those_of_the_arrays(void **state)
{
    (void)state;
    struct world w = build(0.35);
    struct kiln_store_array arrays[KILN_STORE_ARRAYS];
    const struct kiln_surface *s = w.surface;
    uint64_t bytes = 0;
    kiln_store_arrays(&w.store, arrays);
    for (size_t i = 0; i < KILN_STORE_ARRAYS; i++) {
        assert_true(arrays[i].what != NULL && (arrays[i].bytes == 0 || arrays[i].data != NULL));
        bytes += arrays[i].bytes;
    }
    assert_int_equal(kiln_store_bytes(&w.store), bytes);
    assert_int_equal(bytes, s->map_count * 32 + (s->tile_count + s->split_count) * 16);
    assert_int_equal(kiln_store_count(&w.store), s->point_count);
    release(&w);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(hits_lead_to_their_texels),
                                       cmocka_unit_test(walls_divide_texels),
                                       cmocka_unit_test(bytes_are_those_of_the_arrays)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
