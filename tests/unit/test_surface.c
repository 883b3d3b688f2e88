#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "coordinator/surface/surface_build.h"
#include "tests/unit/surface_scene.h"
#include "worker/scene/clip.h"
#include "worker/scene/footprint.h"

struct built {
    struct fixture *fixture;
    struct kiln_geometry *geometry;
    struct kiln_surface *surface;
    struct kiln_surface_report report;
};

static struct kiln_geometry *create_geometry(struct fixture *f)
{
    struct kiln_geometry *g = NULL;
    struct kiln_error error = {""};
    if (kiln_geometry_create(&g, &f->scene, &error) != KILN_OK)
        fail_msg("%s", error.message);
    return g;
}

static void build(struct built *b, double cell_size, enum kiln_partition partition, uint32_t rank, uint32_t ranks,
                  uint32_t threads)
{
    struct kiln_error error = {""};
    kiln_surface_destroy(&b->surface);
    const struct kiln_surface_params params = {.scene = &b->fixture->scene,
                                               .geometry = b->geometry,
                                               .cell_size = cell_size,
                                               .partition = partition,
                                               .rank = rank,
                                               .ranks = ranks,
                                               .threads = threads};
    if (kiln_surface_build(&b->surface, &params, &b->report, &error) != KILN_OK)
        fail_msg("%s", error.message);
}

static void release(struct built *b)
{
    kiln_surface_destroy(&b->surface);
    kiln_geometry_destroy(&b->geometry);
    fixture_destroy(b->fixture);
}

/* Five cubes: plain, mirrored and sheared, flat, tiny lightmap, one far out; odd sizes; one with a dense mesh. */
static struct built cubes(void)
{
    static const double transforms[5][12] = {{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0},
                                             {-1, 0.3, 0, 5, 0, 2, 0, -1, 0.1, 0, 0.5, 2},
                                             {1, 0, 0, -4, 0, 0.01, 0, 0, 0, 0, 1, 0},
                                             {0.2, 0, 0, 0, 0, 0.2, 0, 4, 0, 0, 0.2, 0},
                                             {0, -3, 0, 20, 3, 0, 0, 7, 0, 0, 3, -9}};
    static const uint32_t sizes[5][2] = {{64, 48}, {37, 101}, {16, 200}, {1, 1}, {130, 65}};
    struct built b = {.fixture = fixture_create()};
    struct fixture *f = b.fixture;
    const uint32_t red = fixture_material(f, 0.75f, 0.25f, 0.125f), textured = fixture_material(f, 1.0f, 0.5f, 1.0f);
    uint32_t texture;
    uint8_t *texels = fixture_texture(f, 16, 16, &texture);
    for (int i = 0; i < 16 * 16 * 4; i++)
        texels[i] = (uint8_t)(i * 37 % 251);
    f->materials[textured].base_color_texture = texture;
    const uint32_t coarse = fixture_cube(f, 3, 0.5, red), dense = fixture_cube(f, 16, 0.5, textured);
    for (int i = 0; i < 5; i++)
        fixture_object(f, i == 1 || i == 3 ? dense : coarse, transforms[i], sizes[i][0], sizes[i][1]);
    b.geometry = create_geometry(f);
    return b;
}

static void areas_add_up(void **state)
{
    (void)state;
    struct built b = cubes();
    build(&b, 0.0, KILN_PARTITION_CELLS, 0, 1, 2);
    double area[5] = {0}, total = 0.0;
    for (size_t i = 0; i < b.surface->tile_run_count; i++) {
        struct kiln_point_cursor at = kiln_point_first(b.surface, i);
        for (uint32_t k = 0; k < b.surface->tile_runs[i].count; k++, kiln_point_next(b.surface, &at)) {
            assert_true(b.surface->area[at.point.at] > 0.0f);
            area[at.object] += (double)b.surface->area[at.point.at];
        }
    }
    /* the plain cube has 6 x 4 m2, the 3-fold one 9 times, the small one 1/25; the flat one two sides of 4 and four of
     * 0.04 */
    assert_true(fabs(area[0] / 24.0 - 1.0) < 1e-5);
    assert_true(fabs(area[2] / 8.16 - 1.0) < 1e-5);
    assert_true(fabs(area[3] / 0.96 - 1.0) < 1e-5);
    assert_true(fabs(area[4] / 216.0 - 1.0) < 1e-5);
    for (int i = 0; i < 5; i++)
        total += area[i];
    assert_true(fabs(total / b.report.area - 1.0) < 1e-6);
    assert_true(fabs(b.report.area / b.report.geometry_area - 1.0) < 1e-9);
    assert_true(b.report.worst_object_area_error < 1e-9);
    assert_int_equal(b.report.points, b.surface->point_count);
    assert_int_equal(b.report.texels, 64 * 48 + 37 * 101 + 16 * 200 + 1 + 130 * 65);
    release(&b);
}

static uint64_t morton_of_tile(const struct kiln_surface *s, const struct kiln_tile_run *f)
{
    const uint32_t x = f->tile % s->lightmaps[f->map].tiles_x, y = f->tile / s->lightmaps[f->map].tiles_x;
    uint64_t code = 0;
    for (uint32_t bit = 0; bit < 32; bit++)
        code |= (uint64_t)(x >> bit & 1) << (2 * bit) | (uint64_t)(y >> bit & 1) << (2 * bit + 1);
    return code;
}

/* One rank: the global order is what the header says, and find is its inverse for every texel there is. */
static void check_order(const struct built *b, enum kiln_partition partition)
{
    const struct kiln_surface *s = b->surface;
    uint64_t next = 0, found = 0;
    const struct kiln_tile_run *before = NULL;
    for (size_t i = 0; i < s->tile_run_count; i++) {
        const struct kiln_tile_run *f = &s->tile_runs[i];
        assert_int_equal(f->first.at, next);
        assert_int_equal(f->count, __builtin_popcountll(f->mask));
        assert_true(f->cell < s->cell_count);
        const bool cells = partition == KILN_PARTITION_CELLS;
        if (cells)
            assert_true(f->first.at >= s->cell_first[f->cell] && f->first.at + f->count <= s->cell_first[f->cell + 1]);
        if (before != NULL) {
            const bool same_cell = !cells || before->cell == f->cell;
            assert_true(!cells || before->cell <= f->cell);
            assert_true(!same_cell || before->map <= f->map);
            if (same_cell && before->map == f->map)
                assert_true(morton_of_tile(s, before) < morton_of_tile(s, f));
        }
        before = f;
        struct kiln_point_cursor at = kiln_point_first(s, i);
        for (uint32_t k = 0; k < f->count; k++, kiln_point_next(s, &at)) {
            assert_int_equal(kiln_surface_find(s, at.object, at.x, at.y).at, next);
            assert_int_equal(at.point.at, next - s->first.at);
            next++;
        }
        assert_int_equal(at.piece, s->piece_base[i + 1]);
        assert_int_equal(at.cdf, s->area_cdf_base[i + 1]);
    }
    assert_int_equal(next, s->point_count);
    for (uint32_t o = 0; o < b->fixture->scene.object_count; o++) {
        for (uint32_t y = 0; y < s->lightmaps[o].height; y++) {
            for (uint32_t x = 0; x < s->lightmaps[o].width; x++)
                found += kiln_surface_find(s, o, x, y).at != KILN_NO_POINT ? 1 : 0;
        }
    }
    assert_int_equal(found, s->point_count);
}

static void order_is_kept(void **state)
{
    (void)state;
    struct built b = cubes();
    for (int i = 0; i < 4; i++) {
        build(&b, i % 2 == 0 ? 0.0 : 0.3, i < 2 ? KILN_PARTITION_CELLS : KILN_PARTITION_OBJECTS, 0, 1, 1);
        check_order(&b, i < 2 ? KILN_PARTITION_CELLS : KILN_PARTITION_OBJECTS);
        if (i == 1)
            assert_true(b.surface->split_count > 100);
        if (i >= 2) {
            assert_int_equal(b.surface->split_count, 0);
            assert_null(b.surface->cell_first);
        }
    }
    release(&b);
}

/* Same (object, texel), same data, whatever the cell size and partition are. */
static void cells_change_nothing_else(void **state)
{
    (void)state;
    struct built a = cubes(), b = cubes();
    build(&a, 0.0, KILN_PARTITION_CELLS, 0, 1, 1);
    build(&b, 0.7, KILN_PARTITION_OBJECTS, 0, 1, 2);
    assert_int_equal(a.surface->point_count, b.surface->point_count);
    for (size_t i = 0; i < a.surface->tile_run_count; i++) {
        struct kiln_point_cursor at = kiln_point_first(a.surface, i);
        for (uint32_t k = 0; k < a.surface->tile_runs[i].count; k++, kiln_point_next(a.surface, &at)) {
            const uint64_t p = at.point.at, q = kiln_surface_find(b.surface, at.object, at.x, at.y).at;
            assert_true(q != KILN_NO_POINT);
            assert_true(a.surface->area[p] == b.surface->area[q]);
            assert_int_equal(a.surface->piece_count[p], b.surface->piece_count[q]);
            assert_memory_equal(a.surface->albedo + 3 * p, b.surface->albedo + 3 * q, 6);
        }
    }
    release(&a);
    release(&b);
}

static void compare_global(const struct kiln_surface *a, const struct kiln_surface *b)
{
    assert_int_equal(a->point_count, b->point_count);
    assert_int_equal(a->tile_count, b->tile_count);
    assert_int_equal(a->split_count, b->split_count);
    assert_int_equal(a->cell_count, b->cell_count);
    assert_memory_equal(a->tiles, b->tiles, a->tile_count * sizeof *a->tiles);
    if (a->split_count > 0)
        assert_memory_equal(a->splits, b->splits, a->split_count * sizeof *a->splits);
    if (a->cell_first != NULL)
        assert_memory_equal(a->cell_first, b->cell_first, (a->cell_count + 1) * sizeof *a->cell_first);
}

static void shares_tile_the_whole(void **state)
{
    (void)state;
    static const uint32_t rank_counts[] = {1, 2, 3, 5, 8};
    for (int mode = 0; mode < 4; mode++) {
        const enum kiln_partition partition = mode % 2 == 0 ? KILN_PARTITION_CELLS : KILN_PARTITION_OBJECTS;
        const double size = mode < 2 ? 0.0 : 2.5;
        struct built whole = cubes(), own = cubes();
        build(&whole, size, partition, 0, 1, 1);
        const struct kiln_surface *w = whole.surface;
        for (size_t i = 0; i < sizeof rank_counts / sizeof *rank_counts; i++) {
            uint64_t point = 0, tile_run = 0, most = 0;
            for (uint32_t rank = 0; rank < rank_counts[i]; rank++) {
                build(&own, size, partition, rank, rank_counts[i], 1 + rank % 2);
                const struct kiln_surface *s = own.surface;
                compare_global(w, s);
                assert_int_equal(s->first.at, point);
                if (s->count > 0) {
                    const uint64_t pieces = w->piece_base[tile_run], shares = w->area_cdf_base[tile_run];
                    assert_memory_equal(s->tile_runs, w->tile_runs + tile_run,
                                        s->tile_run_count * sizeof *s->tile_runs);
                    assert_memory_equal(s->piece_count, w->piece_count + point, s->count * sizeof *s->piece_count);
                    assert_memory_equal(s->albedo, w->albedo + 3 * point, 3 * s->count * sizeof *s->albedo);
                    assert_memory_equal(s->area, w->area + point, s->count * sizeof *s->area);
                    assert_memory_equal(s->pieces, w->pieces + pieces,
                                        s->piece_base[s->tile_run_count] * sizeof *s->pieces);
                    if (s->area_cdf_base[s->tile_run_count] > 0)
                        assert_memory_equal(s->area_cdf, w->area_cdf + shares,
                                            s->area_cdf_base[s->tile_run_count] * sizeof *s->area_cdf);
                }
                most = s->count > most ? s->count : most;
                point += s->count;
                tile_run += s->tile_run_count;
            }
            assert_int_equal(point, w->point_count);
            assert_int_equal(tile_run, w->tile_run_count);
            assert_int_equal(most, own.report.points_max);
            const double imbalance = (double)most * rank_counts[i] / (double)w->point_count - 1.0;
            assert_true(imbalance <= 0.101);
            assert_float_equal(own.report.imbalance, imbalance, 1e-6);
        }
        release(&whole);
        release(&own);
    }
}

/* One triangle pair over texels 2.5 .. 5.25 by 1.25 .. 3.5 of an 8 x 8 lightmap: coverage and areas are known. */
static void coverage_is_exact(void **state)
{
    (void)state;
    struct built b = {.fixture = fixture_create()};
    struct fixture *f = b.fixture;
    const uint32_t grey = fixture_material(f, 0.5f, 0.5f, 0.5f);
    const uint32_t mesh = fixture_mesh(f);
    const double uv[4] = {2.5 / 8, 5.25 / 8, 1.25 / 8, 3.5 / 8};
    fixture_sheet(f, dvec3(0, 0, 0), dvec3(2.75, 0, 0), dvec3(0, 2.25, 0), 1, uv, 0.0, grey);
    fixture_object(f, mesh, NULL, 8, 8);
    b.geometry = create_geometry(f);
    build(&b, 0.0, KILN_PARTITION_CELLS, 0, 1, 1);
    assert_int_equal(b.surface->point_count, 4 * 3);
    static const double wide[4] = {0.5, 1.0, 1.0, 0.25}, high[3] = {0.75, 1.0, 0.5};
    uint32_t wholes = 0;
    for (uint32_t y = 0; y < 8; y++) {
        for (uint32_t x = 0; x < 8; x++) {
            const uint64_t p = kiln_surface_find(b.surface, 0, x, y).at;
            const bool covered = x >= 2 && x < 6 && y >= 1 && y < 4;
            assert_int_equal(p != KILN_NO_POINT, covered);
            if (!covered)
                continue;
            assert_true(fabs((double)b.surface->area[p] - wide[x - 2] * high[y - 1]) < 1e-6);
            wholes += kiln_point_whole(b.surface, (struct kiln_own_point){p});
            assert_int_equal(b.surface->albedo[3 * p], 32768);
            assert_int_equal(b.surface->visible[p], 0xffff);
        }
    }
    assert_int_equal(wholes, 0); /* the diagonal runs through both inner texels */
    assert_int_equal(b.report.overlapped_texels, 0);
    release(&b);
}

/* In texels, by the outline (kiln_clip_fraction goes by the weights). */
static double polygon_area(const struct kiln_clip_corner *polygon, uint32_t corners)
{
    double twice = 0.0;
    for (uint32_t i = 0; i < corners; i++) {
        const struct kiln_clip_corner *a = &polygon[i], *b = &polygon[(i + 1) % corners];
        twice += a->x * b->y - b->x * a->y;
    }
    return 0.5 * fabs(twice);
}

/* Pieces: ascending triangles, shares that are the areas found by clipping anew, ending at 1; whole where the corners
 * are in. */
static void pieces_are_right(void **state)
{
    (void)state;
    struct built b = cubes();
    build(&b, 0.0, KILN_PARTITION_CELLS, 0, 1, 2);
    const struct kiln_surface *s = b.surface;
    uint64_t wholes = 0, many = 0;
    for (size_t i = 0; i < s->tile_run_count; i++) {
        struct kiln_point_cursor at = kiln_point_first(s, i);
        for (uint32_t k = 0; k < s->tile_runs[i].count; k++, kiln_point_next(s, &at)) {
            const uint32_t count = kiln_piece_count(s, at.point);
            double sum = 0.0;
            for (uint32_t j = 0; j < count; j++) {
                const uint32_t t = s->pieces[at.piece + j];
                assert_true(j == 0 || t > s->pieces[at.piece + j - 1]);
                assert_int_equal(b.geometry->records[t].object, at.object);
                double corner[3][2];
                struct kiln_clip_corner polygon[KILN_CLIP_CORNERS];
                kiln_geometry_texel_corners(&b.fixture->scene, b.geometry, t, corner);
                const uint32_t corners = kiln_clip_triangle(corner, at.x, at.y, at.x + 1.0, at.y + 1.0, polygon);
                const double texels = polygon_area(polygon, corners);
                const double scale =
                    kiln_geometry_triangle_area(b.geometry, t) / (0.5 * fabs(kiln_clip_twice_area(corner)));
                sum += texels * scale;
                if (j + 1 < count)
                    assert_true(fabs((double)s->area_cdf[at.cdf + j] * (double)s->area[at.point.at] - sum) <=
                                1e-6 * (double)s->area[at.point.at]);
                assert_true(kiln_point_whole(s, at.point) == (count == 1 && texels > 1.0 - 1e-9));
            }
            assert_true(fabs(sum / (double)s->area[at.point.at] - 1.0) < 1e-6);
            wholes += kiln_point_whole(s, at.point);
            many += count > 10;
        }
    }
    assert_true(wholes > 1000);
    assert_true(many >= 1); /* the cube of one texel has thousands */
    release(&b);
}

/* The mean of a textured texel: 2 x 2 blocks of the texture under each texel, known colours. */
static void albedo_is_the_mean(void **state)
{
    (void)state;
    struct built b = {.fixture = fixture_create()};
    struct fixture *f = b.fixture;
    const uint32_t material = fixture_material(f, 1.0f, 0.5f, 1.0f);
    uint32_t texture;
    uint8_t *texels = fixture_texture(f, 16, 16, &texture);
    for (int i = 0; i < 256; i++) {
        texels[4 * i] = i / 16 % 2 == 0 ? 255 : 0; /* red: every other row */
        texels[4 * i + 1] = 255;
        texels[4 * i + 2] = i % 2 == 0 ? 255 : 51; /* blue: every other column */
        texels[4 * i + 3] = i % 2 == 0 ? 255 : 0;  /* alpha: the same columns */
    }
    f->materials[material].base_color_texture = texture;
    const uint32_t mesh = fixture_mesh(f);
    const double uv[4] = {0.0, 1.0, 0.0, 1.0};
    fixture_sheet(f, dvec3(0, 0, 0), dvec3(1, 0, 0), dvec3(0, 1, 0), 1, uv, 0.0, material);
    fixture_object(f, mesh, NULL, 8, 8);
    for (int masked = 0; masked < 2; masked++) {
        f->materials[material].alpha_mode = masked ? KILN_ALPHA_MASK : KILN_ALPHA_OPAQUE;
        f->materials[material].alpha_cutoff = 0.5f;
        kiln_geometry_destroy(&b.geometry);
        b.geometry = create_geometry(f);
        assert_int_equal(b.geometry->opaque_count, masked ? 0 : 2);
        build(&b, 0.0, KILN_PARTITION_CELLS, 0, 1, 1);
        assert_int_equal(b.surface->point_count, 64);
        for (uint32_t i = 0; i < 64; i++) {
            const uint64_t p = kiln_surface_find(b.surface, 0, i % 8, i / 8).at;
            const double tolerance = 1e-4;
            assert_true(fabs(b.surface->albedo[3 * p] / 65535.0 - 0.5) < tolerance);
            assert_true(fabs(b.surface->albedo[3 * p + 1] / 65535.0 - 0.5) < 1e-4);
            assert_true(fabs(b.surface->albedo[3 * p + 2] / 65535.0 - (masked ? 1.0 : 0.6)) < tolerance);
        }
    }
    release(&b);
}

static void shared_texels_are_counted(void **state)
{
    (void)state;
    struct built b = {.fixture = fixture_create()};
    struct fixture *f = b.fixture;
    const uint32_t grey = fixture_material(f, 0.5f, 0.5f, 0.5f);
    const uint32_t mesh = fixture_mesh(f);
    const double left[4] = {0.0, 3.4 / 8, 0.0, 1.0}, right[4] = {3.6 / 8, 1.0, 0.0, 1.0};
    fixture_sheet(f, dvec3(0, 0, 0), dvec3(1, 0, 0), dvec3(0, 1, 0), 2, left, 0.0, grey);
    fixture_sheet(f, dvec3(0, 0, 1), dvec3(1, 0, 0), dvec3(0, 1, 0), 2, right, 0.0, grey);
    fixture_object(f, mesh, NULL, 8, 8);
    b.geometry = create_geometry(f);
    build(&b, 0.0, KILN_PARTITION_CELLS, 0, 1, 1);
    assert_int_equal(b.surface->point_count, 64);
    assert_int_equal(b.report.overlapped_texels, 8); /* column 3 */
    assert_true(b.report.worst_object_area_error < 1e-9);
    release(&b);
}

/* 70,000 triangles in one texel: the largest 32,767 stay, the area is that of all. */
static void crowded_texel(void **state)
{
    (void)state;
    struct built b = {.fixture = fixture_create()};
    struct fixture *f = b.fixture;
    const uint32_t grey = fixture_material(f, 0.5f, 0.5f, 0.5f);
    const uint32_t mesh = fixture_mesh(f);
    const double uv[4] = {0.1, 0.9, 0.1, 0.9};
    fixture_sheet(f, dvec3(0, 0, 0), dvec3(1, 0, 0), dvec3(0, 1, 0), 187, uv, 0.6, grey);
    fixture_object(f, mesh, NULL, 1, 1);
    b.geometry = create_geometry(f);
    assert_int_equal(b.geometry->triangle_count, 2 * 187 * 187);
    build(&b, 0.0, KILN_PARTITION_CELLS, 0, 1, 2);
    assert_int_equal(b.surface->point_count, 1);
    assert_int_equal(b.surface->piece_count[0], 32767);
    assert_true(b.surface->area_cdf[32765] <= 1.0f);
    assert_true(fabsf(b.surface->area[0] - 1.0f) < 1e-5f);
    double least = 1.0, dropped_most = 0.0;
    uint64_t next = 0;
    for (uint32_t t = 0; t < b.geometry->triangle_count; t++) {
        const double area = kiln_geometry_triangle_area(b.geometry, t);
        if (next < 32767 && b.surface->pieces[next] == t) {
            least = fmin(least, area);
            next++;
        } else {
            dropped_most = fmax(dropped_most, area);
        }
    }
    assert_int_equal(next, 32767);
    assert_true(dropped_most <= least * (1.0 + 1e-9));
    release(&b);
}

static void nothing_there(void **state)
{
    (void)state;
    struct built b = {.fixture = fixture_create()};
    struct fixture *f = b.fixture;
    const uint32_t grey = fixture_material(f, 0.5f, 0.5f, 0.5f);
    b.geometry = create_geometry(f);
    for (uint32_t rank = 0; rank < 3; rank++) {
        build(&b, 0.0, rank == 1 ? KILN_PARTITION_OBJECTS : KILN_PARTITION_CELLS, rank, 3, 1);
        assert_int_equal(
            b.surface->point_count + b.surface->tile_count + b.surface->cell_count + b.surface->tile_run_count, 0);
    }
    /* an object without triangles, one whose triangles have no area, one that is a single point of the surface */
    const uint32_t empty = fixture_mesh(f);
    const uint32_t flat = fixture_mesh(f);
    const double uv[4] = {0.2, 0.8, 0.2, 0.8};
    fixture_sheet(f, dvec3(0, 0, 0), dvec3(1, 0, 0), dvec3(2, 0, 0), 2, uv, 0.0, grey);
    const uint32_t small = fixture_mesh(f);
    fixture_sheet(f, dvec3(0, 0, 5), dvec3(1, 0, 0), dvec3(0, 1, 0), 1, uv, 0.0, grey);
    fixture_object(f, empty, NULL, 33, 9);
    fixture_object(f, flat, NULL, 12, 12);
    fixture_object(f, small, NULL, 1, 1);
    kiln_geometry_destroy(&b.geometry);
    b.geometry = create_geometry(f);
    uint64_t points = 0;
    for (uint32_t rank = 0; rank < 5; rank++) {
        build(&b, 0.0, KILN_PARTITION_CELLS, rank, 5, 1);
        assert_int_equal(b.surface->point_count, 1);
        assert_int_equal(b.surface->cell_count, 1);
        points += b.surface->count;
        if (b.surface->count == 1) {
            assert_int_equal(b.surface->piece_count[0], 2);
            assert_true(fabsf(b.surface->area[0] - 1.0f) < 1e-6f);
        }
    }
    assert_int_equal(points, 1);
    release(&b);
}

/* A layout that folds triangles to lines and points: their surface goes to the texels of their centroids, on the far
 * edge of the lightmap and on texel borders too; one that leaves the lightmap is told. */
static void collapsed_triangles_keep_their_area(void **state)
{
    (void)state;
    static const double lines[6][4] = {{0.2, 0.2, 0.2, 0.8}, {0.2, 0.9, 0.5, 0.5}, {0.25, 0.25, 0.1, 0.7},
                                       {1, 1, 0, 1},         {1, 1, 1, 1},         {0, 0.3, 0, 0}};
    struct built b = {.fixture = fixture_create()};
    struct fixture *f = b.fixture;
    const uint32_t grey = fixture_material(f, 0.5f, 0.5f, 0.5f);
    for (int i = 0; i < 6; i++) {
        const uint32_t mesh = fixture_mesh(f);
        fixture_sheet(f, dvec3(0, 0, i), dvec3(1, 0, 0), dvec3(0, 1, 0), 3, lines[i], 0.0, grey);
        fixture_object(f, mesh, NULL, 12, 12);
    }
    b.geometry = create_geometry(f);
    build(&b, 0.0, KILN_PARTITION_CELLS, 0, 1, 2);
    assert_true(b.report.worst_object_area_error < 1e-9);
    assert_true(b.surface->point_count >= 12);
    assert_true(kiln_surface_find(b.surface, 4, 11, 11).at != KILN_NO_POINT);
    check_order(&b, KILN_PARTITION_CELLS);
    for (size_t i = 0; i < b.surface->tile_run_count; i++) {
        struct kiln_point_cursor at = kiln_point_first(b.surface, i);
        for (uint32_t k = 0; k < b.surface->tile_runs[i].count; k++, kiln_point_next(b.surface, &at)) {
            struct kiln_footprint footprint;
            double mean[2] = {0.0, 0.0};
            kiln_footprint_prepare(&footprint, &f->scene, b.geometry, b.surface, &at);
            for (uint32_t j = 0; j < 1024; j++) {
                uint32_t triangle;
                float b1, b2;
                kiln_footprint_sample(&footprint, ((float)(j % 32) + 0.5f) / 32, ((float)(j / 32) + 0.5f) / 32,
                                      &triangle, &b1, &b2);
                mean[0] += (double)b1 / 1024;
                mean[1] += (double)b2 / 1024;
            }
            /* over the whole triangles */
            assert_true(fabs(mean[0] - 1.0 / 3) < 0.01 && fabs(mean[1] - 1.0 / 3) < 0.01);
        }
    }
    for (size_t v = 0; v < 16; v++)
        f->lightmap[v].x += 2.0f; /* beside the lightmap */
    f->lightmap[0].x -= 0.5f;
    build(&b, 0.0, KILN_PARTITION_CELLS, 0, 1, 2);
    assert_int_equal(b.report.worst_object, 0);
    assert_true(b.report.worst_object_area_error > 0.05);
    release(&b);
}

static void cell_sizes(void **state)
{
    (void)state;
    struct built b = cubes();
    build(&b, 0.0, KILN_PARTITION_CELLS, 0, 1, 1);
    assert_true(b.report.cells_total <= 1u << 20);
    assert_true(b.report.points / b.report.cells_occupied >= 1024);
    const double chosen = b.report.cell_size;
    build(&b, 0.0, KILN_PARTITION_CELLS, 2, 7, 1);
    assert_true(b.report.cell_size == chosen);
    build(&b, 1.0, KILN_PARTITION_CELLS, 0, 1, 1);
    assert_true(b.report.cell_size == 1.0);
    const struct kiln_vec3 side = vec3_sub(b.geometry->bounds_max, b.geometry->bounds_min);
    assert_int_equal(b.report.cells[0], (uint64_t)ceilf(side.x));
    build(&b, 1e6, KILN_PARTITION_CELLS, 0, 1, 1);
    assert_int_equal(b.surface->cell_count, 1);
    struct kiln_error error = {""};
    struct kiln_surface *s = NULL;
    struct kiln_surface_report report;
    static const double bad[] = {-1.0, NAN, INFINITY, 1e-12};
    for (int i = 0; i < 4; i++) {
        const struct kiln_surface_params params = {
            .scene = &b.fixture->scene, .geometry = b.geometry, .cell_size = bad[i], .ranks = 1};
        assert_int_equal(kiln_surface_build(&s, &params, &report, &error), KILN_BAD_INPUT);
        assert_null(s);
        assert_true(strlen(error.message) > 20);
    }
    const struct kiln_surface_params params = {
        .scene = &b.fixture->scene, .geometry = b.geometry, .rank = 2, .ranks = 2};
    assert_int_equal(kiln_surface_build(&s, &params, &report, &error), KILN_USAGE);
    release(&b);
}

static void cuts_are_near_the_mean(void **state)
{
    (void)state;
    uint64_t units[200], cuts[301], random = 7;
    for (int round = 0; round < 200; round++) {
        const size_t count = (size_t)(round % 200);
        const uint32_t ranks = 1 + (uint32_t)round * 37 % 300;
        uint64_t total = 0, largest = 0;
        for (size_t i = 0; i < count; i++) {
            random = random * 6364136223846793005u + 1442695040888963407u;
            units[i] = (random >> 40) % (round % 3 == 0 ? 2 : 1000);
            if (round % 5 == 0)
                units[i] <<= 46; /* totals near 2^64 */
            total += units[i];
            largest = units[i] > largest ? units[i] : largest;
        }
        kiln_partition_cut(units, count, ranks, cuts);
        assert_int_equal(cuts[0], 0);
        assert_int_equal(cuts[ranks], count);
        for (uint32_t r = 0; r < ranks; r++) {
            assert_true(cuts[r] <= cuts[r + 1] && cuts[r + 1] <= count);
            uint64_t share = 0;
            for (uint64_t i = cuts[r]; i < cuts[r + 1]; i++)
                share += units[i];
            assert_true(share <= total / ranks + 1 + largest);
        }
    }
}

/* Beyond the number of cells shares are cut between tile runs, at the same ones as where somebody has a list of them
 * all. */
static void tile_runs_are_cut_alike(void **state)
{
    (void)state;
    static const uint32_t ranks[] = {2, 7, 60, 2000};
    struct built b = cubes();
    build(&b, 100.0, KILN_PARTITION_CELLS, 0, 1, 1);
    assert_int_equal(b.surface->cell_count, 1);
    const size_t count = b.surface->tile_run_count;
    uint64_t *points = calloc(count, sizeof *points), cuts[2001];
    for (size_t f = 0; f < count; f++)
        points[f] = b.surface->tile_runs[f].count;
    for (int i = 0; i < 4; i++) {
        kiln_partition_cut(points, count, ranks[i], cuts);
        for (uint32_t r = 0, step = ranks[i] / 12 + 1; r < ranks[i]; r += step) {
            uint64_t first = 0;
            for (uint64_t f = 0; f < cuts[r]; f++)
                first += points[f];
            build(&b, 100.0, KILN_PARTITION_CELLS, r, ranks[i], 2);
            assert_int_equal(b.surface->first.at, first);
            assert_int_equal(b.surface->tile_run_count, cuts[r + 1] - cuts[r]);
        }
    }
    free(points);
    release(&b);
}

/* A line cuts a polygon into two parts that add up to it, and each lies on its side. */
static void lines_cut_polygons(void **state)
{
    (void)state;
    const double corner[3][2] = {{-0.5, -0.25}, {1.75, 0.0}, {0.25, 2.0}};
    for (int i = 0; i < 64; i++) {
        const double angle = 0.1 * i;
        const float line[3] = {(float)cos(angle), (float)sin(angle), (float)(0.02 * i - 0.4)},
                    other[3] = {-line[0], -line[1], -line[2]};
        struct kiln_clip_corner whole[KILN_CLIP_CORNERS], part[2][KILN_CLIP_CORNERS], middle;
        const uint32_t count = kiln_clip_triangle(corner, 0.0, 0.0, 1.0, 1.0, whole);
        double area = 0.0;
        for (int side = 0; side < 2; side++) {
            const float *l = side == 0 ? line : other;
            memcpy(part[side], whole, sizeof whole);
            const uint32_t corners = kiln_clip_line(part[side], count, l);
            assert_true(corners <= count + 1);
            for (uint32_t k = 0; k < corners; k++)
                assert_true((double)l[0] * part[side][k].x + (double)l[1] * part[side][k].y <= (double)l[2] + 1e-12);
            area += kiln_clip_fraction(part[side], corners, &middle);
        }
        assert_true(fabs(area - kiln_clip_fraction(whole, count, &middle)) < 1e-12);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(areas_add_up),
        cmocka_unit_test(order_is_kept),
        cmocka_unit_test(cells_change_nothing_else),
        cmocka_unit_test(shares_tile_the_whole),
        cmocka_unit_test(coverage_is_exact),
        cmocka_unit_test(pieces_are_right),
        cmocka_unit_test(albedo_is_the_mean),
        cmocka_unit_test(shared_texels_are_counted),
        cmocka_unit_test(crowded_texel),
        cmocka_unit_test(nothing_there),
        cmocka_unit_test(collapsed_triangles_keep_their_area),
        cmocka_unit_test(cell_sizes),
        cmocka_unit_test(cuts_are_near_the_mean),
        cmocka_unit_test(tile_runs_are_cut_alike),
        cmocka_unit_test(lines_cut_polygons),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
