/* Blocks (coordinator/integrate/sparse/blocks.h): a flat sheet has squares of K x K texels, a wall and a sharp edge cut
 * them, and each of a block's points has its turn. Nodes (nodes.h): points mix those of their side of the wall, so that
 * what is linear is kept. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>

#include "coordinator/integrate/sparse/blocks.h"
#include "coordinator/integrate/sparse/nodes.h"
#include "coordinator/surface/surface_build.h"
#include "tests/unit/surface_scene.h"
#include "worker/light/lights.h"
#include "worker/scene/footprint.h"

struct world {
    struct fixture *fixture;
    struct kiln_geometry *geometry;
    struct kiln_lights *lights;
    struct kiln_backend *backend;
    struct kiln_surface *surface;
    uint16_t *block;
};

/* A floor of 32 x 32 texels, 1/8 m wide; a wall without thickness stands on it, a sixteenth of a texel beside the
 * middle of one, across all of it. */
static void build(struct world *w, uint32_t scale)
{
    static const double flat[4] = {0.0, 1.0, 0.0, 1.0};
    *w = (struct world){.fixture = fixture_create()};
    struct fixture *f = w->fixture;
    const uint32_t grey = fixture_material(f, 0.5f, 0.5f, 0.5f);
    fixture_mesh(f);
    fixture_sheet(f, dvec3(-2, 0, 2), dvec3(4, 0, 0), dvec3(0, 0, -4), 1, flat, 0.0, grey);
    fixture_mesh(f);
    fixture_sheet(f, dvec3(0.57, 0, 3), dvec3(0, 0, -6), dvec3(0, 2, 0), 1, flat, 0.0, grey);
    fixture_object(f, 0, NULL, 32, 32);
    fixture_object(f, 1, NULL, 4, 4);
    assert_int_equal(kiln_geometry_create(&w->geometry, &f->scene, NULL), KILN_OK);
    assert_int_equal(kiln_lights_create(&w->lights, &f->scene, w->geometry, NULL), KILN_OK);
    const struct kiln_surface_params params = {
        .scene = &f->scene, .geometry = w->geometry, .cell_size = 0.6, .whole_tiles = true, .ranks = 1, .threads = 1};
    assert_int_equal(kiln_surface_build(&w->surface, &params, &(struct kiln_surface_report){0}, NULL), KILN_OK);
    const struct kiln_backend_params of_backend = {
        .scene = &f->scene, .geometry = w->geometry, .lights = w->lights, .threads = 1};
    assert_int_equal(kiln_backend_create(&w->backend, "embree", &of_backend, NULL), KILN_OK);
    w->block = calloc(w->surface->count, sizeof *w->block);
    assert_int_equal(kiln_blocks_find(w->surface, w->backend, 1, scale, w->block, NULL, NULL), KILN_OK);
}

static void release(struct world *w)
{
    free(w->block);
    kiln_backend_destroy(&w->backend);
    kiln_surface_destroy(&w->surface);
    kiln_lights_destroy(&w->lights);
    kiln_geometry_destroy(&w->geometry);
    fixture_destroy(w->fixture);
}

static void look_at_blocks(uint32_t scale)
{
    struct world w;
    uint64_t whole = 0, cut = 0;
    build(&w, scale);
    for (size_t f = 0; f < w.surface->tile_run_count; f++) {
        const struct kiln_tile_run *run = &w.surface->tile_runs[f];
        const uint64_t own = kiln_own_of_global(w.surface, run->first).at;
        if (run->map != 0)
            continue;
        assert_int_equal(run->count, KILN_TILE_TEXELS); /* cells cut no tile */
        for (uint32_t k = 0; k < run->count; k++) {
            const uint32_t first = w.block[own + k], tile = run->tile % 4 * 8;
            const uint32_t x = tile + kiln_morton8_x(k), from = tile + kiln_morton8_x(first);
            assert_true(first <= k && w.block[own + first] == first);
            /* the wall stands within column 20, whose middle is on its far side */
            assert_true((x < 20) == (from < 20) || x == 20 || from == 20);
            assert_true(abs((int)x - (int)from) < (int)scale &&
                        abs((int)kiln_morton8_y(k) - (int)kiln_morton8_y(first)) < (int)scale);
            if (x / scale != 20 / scale) {
                const uint32_t square = k / (scale * scale) * (scale * scale);
                assert_int_equal(first, square);
                whole++;
            } else {
                cut += first != k / (scale * scale) * (scale * scale);
            }
        }
    }
    assert_true(whole >= 512 && (scale == 1 || cut >= 32));
    release(&w);
}

static void squares_and_a_wall(void **state)
{
    (void)state;
    for (uint32_t scale = 1; scale <= 8; scale *= 2)
        look_at_blocks(scale);
}

/* In sixteen bounces each of sixteen points gathers once, and its answer is that of all; small blocks take few samples.
 */
static void each_has_its_turn(void **state)
{
    (void)state;
    struct world w;
    uint64_t few = 0;
    build(&w, 4);
    for (size_t f = 0; f < w.surface->tile_run_count; f++) {
        const struct kiln_tile_run *run = &w.surface->tile_runs[f];
        const uint16_t *block = w.block + kiln_own_of_global(w.surface, run->first).at;
        uint32_t size[KILN_TILE_TEXELS] = {0}, turns[KILN_TILE_TEXELS] = {0};
        for (uint32_t k = 0; k < run->count; k++)
            size[block[k]]++;
        for (uint32_t bounce = 0; bounce < 16; bounce++) {
            const struct kiln_step step = {.stream = bounce};
            struct kiln_sparse draw, again;
            kiln_blocks_draw(&draw, w.surface, run, block, 4, 5, &step);
            kiln_blocks_draw(&again, w.surface, run, block, 4, 5, &step);
            assert_true(draw.selection.computed == again.selection.computed);
            for (uint32_t k = 0; k < run->count; k++) {
                assert_int_equal(block[draw.mixture[k].place[0]], block[k]);
                assert_true((draw.selection.computed >> draw.mixture[k].place[0] & 1u) != 0);
                turns[k] += (uint32_t)(draw.selection.computed >> k & 1u);
                assert_true((draw.selection.few >> k & 1u) ==
                            ((draw.selection.computed >> k & 1u) != 0 && size[block[k]] <= 4));
                few += draw.selection.few >> k & 1u;
            }
        }
        for (uint32_t k = 0; k < run->count; k++)
            assert_true(size[block[k]] != 16 || turns[k] == 1);
    }
    assert_true(few > 0);
    release(&w);
}

/* The mean column, or row, of what a point mixes. */
static double mixed_texel(const struct kiln_mixture *m, bool row)
{
    double sum = 0.0;
    for (uint32_t i = 0; i < m->count; i++)
        sum += m->weight[i] * (row ? kiln_morton8_y(m->place[i]) : kiln_morton8_x(m->place[i]));
    return sum;
}

/* A point of a full tile: mixes nodes alone, on its side of the wall; away from the wall what is linear is kept. */
static void look_at_mixture(const struct kiln_tile_run *run, uint32_t k, const struct kiln_mixture *m, uint64_t nodes)
{
    const uint32_t tile = run->tile % 4 * 8, x = tile + kiln_morton8_x(k);
    double sum = 0.0;
    for (uint32_t i = 0; i < m->count; i++) {
        const uint32_t from = tile + kiln_morton8_x(m->place[i]);
        assert_true((nodes >> m->place[i] & 1u) != 0 && m->weight[i] > 0.0);
        assert_true((x < 20) == (from < 20) || x == from);
        sum += m->weight[i];
    }
    assert_true(sum > 0.999999 && sum < 1.000001 && m->count >= 1);
    assert_true((nodes >> k & 1u) == (m->count == 1 && m->place[0] == k));
    if (tile < 16 || tile >= 24) {
        assert_true(fabs(mixed_texel(m, false) - kiln_morton8_x(k)) < 0.02);
        assert_true(fabs(mixed_texel(m, true) - kiln_morton8_y(k)) < 0.02);
    } else if (x >= 19 && x <= 21) { /* close to the wall */
        assert_true(m->count == 1 && m->place[0] == k);
    }
}

/* Points mix nodes; a node has its own answer. */
static void points_mix_nodes(void **state)
{
    (void)state;
    struct world w;
    build(&w, 1);
    for (uint32_t scale = 2; scale <= 4; scale *= 2) {
        uint64_t *mixtures = calloc(w.surface->count, sizeof *mixtures);
        assert_int_equal(kiln_anchors_find(w.surface, w.backend, 1, scale, mixtures, NULL), KILN_OK);
        for (size_t f = 0; f < w.surface->tile_run_count; f++) {
            const struct kiln_tile_run *run = &w.surface->tile_runs[f];
            struct kiln_sparse drawn;
            kiln_nodes_draw(&drawn, w.surface, run, mixtures + kiln_own_of_global(w.surface, run->first).at);
            const uint64_t nodes = drawn.selection.computed;
            if (run->map != 0)
                continue;
            if (run->tile % 4 != 2)
                assert_int_equal(__builtin_popcountll(nodes), KILN_TILE_TEXELS / (scale * scale));
            for (uint32_t k = 0; k < run->count; k++)
                look_at_mixture(run, k, &drawn.mixture[k], nodes);
        }
        free(mixtures);
    }
    release(&w);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(squares_and_a_wall), cmocka_unit_test(each_has_its_turn),
                                       cmocka_unit_test(points_mix_nodes)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
