/* Tests of octrees (worker/scene/leaves.h, worker/store/octree.h, coordinator/surface/bricks.h): their points have all
 * of the surface's area, once; every place of the surface leads to the one point of its leaf and side, in one go and in
 * rounds; a wall thinner than a leaf has points on each face; what a footprint samples lies in its leaf; and a leaf
 * size that fits no grid is refused. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/surface/surface_build.h"
#include "tests/unit/surface_scene.h"
#include "worker/scene/footprint.h"
#include "worker/store/store.h"

struct world {
    struct fixture *fixture;
    struct kiln_geometry *geometry;
    struct kiln_surface *surface;
    struct kiln_surface_report report;
    struct kiln_store store;
};

/* A cube that is turned about all axes, one that is not and is mirrored, and a sheet of two sides at a slant. */
static struct world build(double leaf, double cell_size, enum kiln_partition partition)
{
    static const double uv[4] = {0.1, 0.9, 0.05, 0.95}, above[12] = {-1, 0, 0, 0, 0, 1, 0, 2.5, 0, 0, 1, 0},
                        turned[12] = {0.612, -0.354, 0.707, 4, 0.780, 0.127, -0.612, 0, 0.127, 0.927, 0.354, 0};
    struct world w = {.fixture = fixture_create()};
    struct fixture *f = w.fixture;
    const uint32_t grey = fixture_material(f, 0.5f, 0.5f, 0.5f), sheer = fixture_material(f, 0.5f, 0.5f, 0.5f);
    f->materials[sheer].double_sided = 1;
    const uint32_t cube = fixture_cube(f, 3, 0.6, grey), sheet = fixture_mesh(f);
    fixture_sheet(f, dvec3(-2, -1.5, 2), dvec3(4, 1, 0), dvec3(0, 0.5, -4), 5, uv, 0.5, sheer);
    (void)fixture_object(f, cube, turned, 8, 8);
    (void)fixture_object(f, cube, above, 8, 8);
    (void)fixture_object(f, sheet, NULL, 8, 8);
    assert_int_equal(kiln_geometry_create(&w.geometry, &f->scene, NULL), KILN_OK);
    assert_int_equal(kiln_leaves_lay(w.geometry, leaf, NULL), KILN_OK);
    const struct kiln_surface_params params = {.scene = &f->scene,
                                               .geometry = w.geometry,
                                               .cell_size = cell_size,
                                               .partition = partition,
                                               .ranks = 1,
                                               .threads = 2};
    assert_int_equal(kiln_surface_build(&w.surface, &params, &w.report, NULL), KILN_OK);
    kiln_store_build(&w.store, w.surface, w.geometry);
    return w;
}

static void release(struct world *w)
{
    kiln_surface_destroy(&w->surface);
    kiln_geometry_destroy(&w->geometry);
    fixture_destroy(w->fixture);
}

/* A place on the surface, and the point that the store finds in one go. */
struct hit {
    uint32_t triangle;
    float u, v;
    bool back;
    uint64_t place;
};

static struct hit hit_of(const struct world *w)
{
    struct fixture *f = w->fixture;
    struct hit h = {.triangle = (uint32_t)(fixture_random(f) * (double)w->geometry->triangle_count)};
    const double a = sqrt(fixture_random(f)), b = fixture_random(f);
    h.u = (float)(a * (1.0 - b));
    h.v = (float)(a * b);
    h.back = (w->geometry->records[h.triangle].material & KILN_RECORD_DOUBLE_SIDED) != 0 && fixture_random(f) < 0.5;
    h.place = kiln_octree_find(&w->store, h.triangle, h.u, h.v, h.back).at;
    return h;
}

/* The cursor of a point. */
static struct kiln_point_cursor cursor_of(const struct kiln_surface *s, uint64_t point)
{
    size_t run = 0;
    while (s->tile_runs[run].first.at + s->tile_runs[run].count <= point)
        run++;
    struct kiln_point_cursor at = kiln_point_first(s, run);
    while (at.point.at < point)
        kiln_point_next(s, &at);
    return at;
}

static void has_all_area_once(void **state)
{
    (void)state;
    struct world w = build(0.23, 0.0, KILN_PARTITION_CELLS);
    const struct kiln_surface *s = w.surface;
    double area = 0.0;
    uint64_t bits = 0;
    for (uint64_t p = 0; p < s->count; p++)
        area += (double)s->area[p];
    for (uint64_t t = 0; t < s->tile_count; t++)
        bits += (uint64_t)__builtin_popcountll(s->tiles[t].mask);
    assert_int_equal(bits, s->point_count);
    assert_true(s->point_count > 1000);
    assert_true(fabs(w.report.area / w.report.geometry_area - 1.0) < 1e-9);
    assert_true(w.report.worst_object_area_error < 1e-9);
    double backs = 0.0;
    for (size_t t = 0; t < w.geometry->triangle_count; t++)
        if ((w.geometry->records[t].material & KILN_RECORD_DOUBLE_SIDED) != 0)
            backs += kiln_geometry_triangle_area(w.geometry, t);
    assert_true(backs > 10.0 && fabs(area / (w.report.geometry_area + backs) - 1.0) < 1e-6);
    release(&w);
}

static void leads_to_the_leaf(void **state)
{
    static const double leaf = 0.11;
    (void)state;
    struct world w = build(leaf, 0.0, KILN_PARTITION_CELLS);
    for (int i = 0; i < 20000; i++) {
        const struct hit h = hit_of(&w);
        assert_true(h.place < w.surface->point_count);
        if (i % 50 != 0)
            continue;
        const struct kiln_point_cursor at = cursor_of(w.surface, h.place);
        const struct kiln_vec3 p = kiln_triangle_position(w.geometry, h.triangle, h.u, h.v);
        const struct kiln_dvec3 from = dvec3_scale(dvec3_sub(dvec3_of(p), w.geometry->leaf_origin), 1.0 / leaf);
        const double along[3] = {from.x, from.y, from.z};
        const uint32_t place[3] = {at.place.x, at.place.y, at.place.layer}, side = w.geometry->leaves[h.triangle].side;
        for (int k = 0; k < 3; k++)
            assert_true(fabs(along[kiln_leaf_axis(side, k)] - 0.5 - (double)place[k]) < 0.501);
        assert_int_equal(at.object, w.geometry->records[h.triangle].object);
        assert_int_equal(at.back, h.back);
        assert_int_equal(at.map % (KILN_SIDES * w.surface->object_count) / w.surface->object_count, side);
        const struct kiln_global_point same =
            kiln_surface_find_leaf(w.surface, at.map, at.place.x, at.place.y, at.place.layer);
        assert_int_equal(same.at, h.place);
    }
    release(&w);
}

/* Small cells: most bricks lie in several. */
static void goes_the_same_way_in_rounds(void **state)
{
    (void)state;
    for (int small = 0; small < 2; small++) {
        struct world w = build(0.17, small != 0 ? 0.3 : 0.0, KILN_PARTITION_CELLS);
        uint64_t *radiosity = calloc(kiln_store_count(&w.store), sizeof *radiosity);
        assert_true(small == 0 || w.surface->split_count > 0);
        for (int round = 0; round < 100; round++) {
            struct hit hits[KILN_STORE_WAYS];
            struct kiln_octree_ways octree;
            struct kiln_store_ways ways;
            uint64_t places[KILN_STORE_WAYS];
            for (uint32_t i = 0; i < KILN_STORE_WAYS; i++) {
                hits[i] = hit_of(&w);
                kiln_octree_enter(&w.store, &octree, &ways, i, hits[i].triangle, hits[i].u, hits[i].v, hits[i].back);
            }
            kiln_octree_reach(&w.store, &octree, &ways, KILN_STORE_WAYS);
            assert_int_equal(kiln_store_follow(&w.store, &ways, KILN_STORE_WAYS, radiosity, places), 0);
            for (uint32_t i = 0; i < KILN_STORE_WAYS; i++)
                assert_int_equal(places[i], hits[i].place);
        }
        free(radiosity);
        release(&w);
    }
}

static void samples_lie_in_their_leaf(void **state)
{
    (void)state;
    struct world w = build(0.29, 0.0, KILN_PARTITION_OBJECTS);
    const struct kiln_surface *s = w.surface;
    uint64_t seen = 0;
    for (size_t run = 0; run < s->tile_run_count; run++) {
        struct kiln_point_cursor at = kiln_point_first(s, run);
        for (uint32_t k = 0; k < s->tile_runs[run].count; k++, kiln_point_next(s, &at)) {
            struct kiln_footprint f;
            double area = 0.0;
            kiln_footprint_prepare(&f, &w.fixture->scene, w.geometry, s, &at);
            for (uint32_t i = 0; i < f.piece_count; i++)
                area += kiln_footprint_piece_area(&f, i);
            assert_true(fabs(area / (double)s->area[at.point.at] - 1.0) < 1e-5);
            for (int i = 0; i < 4; i++) {
                uint32_t triangle;
                float b1, b2;
                kiln_footprint_sample(&f, (float)(i % 2) * 0.9f + 0.04f, (float)(i / 2) * 0.9f + 0.04f, &triangle, &b1,
                                      &b2);
                seen += kiln_octree_find(&w.store, triangle, b1, b2, at.back).at == s->tile_runs[run].first.at + k;
            }
        }
    }
    assert_true(seen > 4 * s->point_count - s->point_count / 100); /* tiny pieces lie within rounding of the rim */
    release(&w);
}

/* Two sheets of 1 m2, one above the other: the upper one looks up, the lower one down (`apart`) or up. */
static struct world build_sheets(double height, bool apart, double leaf)
{
    static const double uv[4] = {0.1, 0.4, 0.1, 0.4};
    const struct kiln_dvec3 x = dvec3(1, 0, 0), y = dvec3(0, 1, 0);
    struct world w = {.fixture = fixture_create()};
    struct fixture *f = w.fixture;
    const uint32_t grey = fixture_material(f, 0.5f, 0.5f, 0.5f), wall = fixture_mesh(f);
    fixture_sheet(f, dvec3(0, 0, height), x, y, 1, uv, 0.0, grey);
    fixture_sheet(f, dvec3(0, 0, 0), apart ? y : x, apart ? x : y, 1, uv, 0.0, grey);
    (void)fixture_object(f, wall, NULL, 8, 8);
    assert_int_equal(kiln_geometry_create(&w.geometry, &f->scene, NULL), KILN_OK);
    assert_int_equal(kiln_leaves_lay(w.geometry, leaf, NULL), KILN_OK);
    const struct kiln_surface_params params = {.scene = &f->scene, .geometry = w.geometry, .ranks = 1, .threads = 1};
    assert_int_equal(kiln_surface_build(&w.surface, &params, &w.report, NULL), KILN_OK);
    kiln_store_build(&w.store, w.surface, w.geometry);
    return w;
}

/* The faces of a wall a tenth of a leaf thick: one object, one leaf, and two points there. */
static void keeps_the_faces_of_a_thin_wall_apart(void **state)
{
    (void)state;
    struct world w = build_sheets(0.01, true, 0.1);
    assert_int_equal(w.surface->point_count, 2 * 11 * 11);
    const uint64_t front = kiln_octree_find(&w.store, 0, 0.3f, 0.3f, false).at,
                   back = kiln_octree_find(&w.store, 2, 0.3f, 0.3f, false).at;
    assert_true(front < w.surface->point_count && back < w.surface->point_count && front != back);
    const struct kiln_point_cursor a = cursor_of(w.surface, front), b = cursor_of(w.surface, back);
    assert_int_equal(a.place.layer, b.place.layer);
    assert_int_not_equal(a.map, b.map);
    release(&w);
}

/* The upper sheet lies where two layers of leaves meet, exactly: in the upper one of them, and nowhere else. */
static void a_sheet_between_layers_lies_in_one(void **state)
{
    (void)state;
    struct world w = build_sheets(0.125, false, 0.25);
    assert_int_equal(w.surface->point_count, 2 * 5 * 5);
    assert_true(fabs(w.report.area - 2.0) < 1e-9);
    const struct kiln_point_cursor low = cursor_of(w.surface, kiln_octree_find(&w.store, 2, 0.3f, 0.3f, false).at),
                                   high = cursor_of(w.surface, kiln_octree_find(&w.store, 0, 0.3f, 0.3f, false).at);
    assert_int_equal(low.place.layer, 0);
    assert_int_equal(high.place.layer, 1);
    release(&w);
}

static void refuses_leaves_that_fit_no_grid(void **state)
{
    (void)state;
    struct world w = build(0.5, 0.0, KILN_PARTITION_CELLS);
    struct kiln_geometry *g = NULL;
    struct kiln_error error;
    assert_int_equal(kiln_geometry_create(&g, &w.fixture->scene, NULL), KILN_OK);
    assert_int_equal(kiln_leaves_lay(g, 1e-7, &error), KILN_BAD_INPUT);
    assert_non_null(strstr(error.message, "--leaf-size"));
    assert_int_equal(kiln_leaves_lay(g, -1.0, &error), KILN_BAD_INPUT);
    kiln_geometry_destroy(&g);
    release(&w);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(has_all_area_once),
        cmocka_unit_test(leads_to_the_leaf),
        cmocka_unit_test(goes_the_same_way_in_rounds),
        cmocka_unit_test(samples_lie_in_their_leaf),
        cmocka_unit_test(keeps_the_faces_of_a_thin_wall_apart),
        cmocka_unit_test(a_sheet_between_layers_lies_in_one),
        cmocka_unit_test(refuses_leaves_that_fit_no_grid),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
