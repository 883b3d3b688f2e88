/* The table of passes, and what every row promises on every backend: numbers of samples that differ from item to item
 * give each item the bits of its own number, however the batch is cut; results come in order, once each; rays are
 * counted alike on all backends; sums of two stretches of samples add up; with masks the points that are asked for have
 * the same bits, and the others are zero. The tests walk the table: a new row is tested once it has its parameters
 * below. Without a Vulkan device Embree alone is tested. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/surface/surface_build.h"
#include "shaders/shared/random.h"
#include "tests/unit/surface_scene.h"
#include "tests/unit/vulkan_device.h"
#include "worker/backend/extended.h"
#include "worker/light/lights.h"
#include "worker/pass/bidirectional.h"
#include "worker/pass/guided.h"
#include "worker/pass/land.h"
#include "worker/pass/links.h"
#include "worker/pass/occlusion.h"
#include "worker/pass/directions.h"
#include "worker/pass/patches.h"
#include "worker/pass/path.h"
#include "worker/pass/probes.h"
#include "worker/pass/radiance.h"
#include "worker/pass/reference.h"
#include "worker/scene/radiance_probes.h"
#include "worker/pass/point.h"
#include "worker/pass/validity.h"
#include "worker/pass/weighed.h"
#include "worker/scene/radiosity.h"

enum { PROBES = 24 };
#define FIRST_PROBE 0xfffffff8ull /* numbers pass 2^32 */

/* The parameters that each pass is tested with; NULL: it has none. */
static const struct kiln_occlusion_parameters near_by = {.distance =
                                                             2.0f}; /* the lamp is farther from most of the floor */
/* towards the floor and the box; numbers of pixels pass 2^32, far below the picture's middle */
static const struct kiln_path_parameters camera = {.position = {0.3f, 2.5f, 0.2f},
                                                   .forward = {0.0f, -1.0f, 0.0f},
                                                   .right = {0.4f, 0.0f, 0.0f},
                                                   .up = {0.0f, 0.0f, 0.4f},
                                                   .width = 1u << 31,
                                                   .height = 4,
                                                   .bounces = 2};
static const struct kiln_radiance_parameters map = {.basis = KILN_PROBE_CUBE, .side = 2};
static const struct kiln_guided_parameters follow = {.follows = true};
static const struct kiln_land_parameters landing = {.aims = NULL};    /* run by test_land.c, where lamps have targets */
static const struct kiln_caustic_techniques sharing = {.aims = NULL}; /* likewise: here nothing bends light */
/* paths of light add to the film of the whole picture, which is small therefore */
enum { WIDE = 8, HIGH = 3 };
static int64_t splats[3 * WIDE * HIGH];
static struct kiln_splat_film film = {.sums = splats};
static const struct kiln_bidirectional_parameters both_ways = {.camera = {.position = {0.3f, 2.5f, 0.2f},
                                                                          .forward = {0.0f, -1.0f, 0.0f},
                                                                          .right = {0.4f, 0.0f, 0.0f},
                                                                          .up = {0.0f, 0.0f, 0.4f},
                                                                          .width = WIDE,
                                                                          .height = HIGH,
                                                                          .bounces = 2},
                                                               .method = KILN_BIDIRECTIONAL_BDPT,
                                                               .film = &film};
static const struct kiln_reference_parameters twice = {.method = KILN_REFERENCE_BDPT, .bounces = 2};
/* points of the floor, whatever they are of, and nodes above that look down */
enum { POINTS = 2048, NODES = 20 };
static struct kiln_patch points_of_floor[POINTS + NODES];
static struct kiln_patch_node nodes_above[NODES];
static const struct kiln_patches_parameters pairs = {.points = points_of_floor, .nodes = nodes_above, .count = NODES};
/* a tree over four of those above, to which some points are linked as a whole */
static const uint32_t order_above[KILN_LINK_CHILDREN] = {POINTS, POINTS + 1, POINTS + 2, POINTS + 3};
static struct kiln_link_leaf leaves_above[KILN_LINK_CHILDREN];
static const struct kiln_link_node node_above = {
    .child = {KILN_LINK_LEAF, KILN_LINK_LEAF | 1u, KILN_LINK_LEAF | 2u, KILN_LINK_LEAF | 3u},
    .children = KILN_LINK_CHILDREN,
    .count = KILN_LINK_CHILDREN,
    .centre = {-0.85f, 2.0f, 0.3f},
    .normal = {0.0f, -1.0f, 0.0f},
    .radius = 0.23f,
    .area = 0.04f,
    .most_area = 0.01f,
    .covariance = {0.0133f, 0.0f, 0.0008f, 0.0f, 0.0f, 0.0f},
    .level = 1.0f};
static const struct kiln_link_sent sent_above = {
    .radiosity = {1.0f, 2.0f, 3.0f}, .moment = {{0.03f}, {-0.03f}, {0.0f, 0.0f, 0.02f}}, .light = {.now = 1.0f}};
static const struct kiln_links_parameters linked = {.points = points_of_floor,
                                                    .order = order_above,
                                                    .leaves = leaves_above,
                                                    .count = KILN_LINK_CHILDREN,
                                                    .nodes = &node_above,
                                                    .node_count = 1,
                                                    .sent = &sent_above,
                                                    .error = 0.01,
                                                    .stream = 2};
static const struct kiln_directions_parameters by_cosine = {.scale = 1.0};
static const struct kiln_probe_parameters all_lamps = {.leaves = 0};
static const void *const parameters[KILN_PASS_COUNT] = {[KILN_PASS_INDEX_probes] = &all_lamps,
                                                        [KILN_PASS_INDEX_occlusion] = &near_by,
                                                        [KILN_PASS_INDEX_path] = &camera,
                                                        [KILN_PASS_INDEX_radiance] = &map,
                                                        [KILN_PASS_INDEX_guided] = &follow,
                                                        [KILN_PASS_INDEX_land] = &landing,
                                                        [KILN_PASS_INDEX_bidirectional] = &both_ways,
                                                        [KILN_PASS_INDEX_weighed] = &sharing,
                                                        [KILN_PASS_INDEX_reference] = &twice,
                                                        [KILN_PASS_INDEX_patches] = &pairs,
                                                        [KILN_PASS_INDEX_links] = &linked,
                                                        [KILN_PASS_INDEX_directions] = &by_cosine};

struct world {
    struct fixture *fixture;
    struct kiln_geometry *geometry;
    struct kiln_lights *lights;
    struct kiln_surface *surface;
    struct kiln_vec3 positions[PROBES];
    uint64_t *radiosity;
};

static void place_patches(struct world *w)
{
    assert_true(w->surface->point_count <= POINTS);
    for (int i = 0; i < POINTS; i++)
        points_of_floor[i] =
            (struct kiln_patch){.place = vec3((float)(i % 32) * 0.1f - 1.6f, 0.01f, (float)(i / 32) * 0.1f - 1.6f),
                                .normal = vec3(0.0f, 1.0f, 0.0f),
                                .number = (uint32_t)i};
    for (int i = 0; i < NODES; i++) {
        nodes_above[i] = (struct kiln_patch_node){.patch = {.place = vec3((float)i * 0.1f - 1.0f, 2.0f, 0.3f),
                                                            .normal = vec3(0.0f, -1.0f, 0.0f),
                                                            .edge_s = vec3(0.1f, 0.0f, 0.0f),
                                                            .edge_t = vec3(0.0f, 0.0f, 0.1f),
                                                            .area = 0.01f,
                                                            .number = (uint32_t)(POINTS + i)},
                                                  .radiosity = {1.0f, 2.0f, 3.0f}};
        nodes_above[i].centre = nodes_above[i].patch.place;
        points_of_floor[POINTS + i] = nodes_above[i].patch;
    }
    for (int i = 0; i < KILN_LINK_CHILDREN; i++) {
        const struct kiln_patch *p = &nodes_above[i].patch;
        leaves_above[i] = (struct kiln_link_leaf){.place = p->place,
                                                  .centre = p->centre,
                                                  .normal = p->normal,
                                                  .area = p->area,
                                                  .number = p->number,
                                                  .radiosity = {1.0f, 2.0f, 3.0f + (float)i},
                                                  .now = 1.0f};
    }
}

/* A floor, a box sunk into it by a part of a texel, a lamp. */
static void build(struct world *w)
{
    static const double flat[4] = {0.02, 0.98, 0.02, 0.98}, sunk[12] = {0.5, 0, 0, 0.07, 0, 0.5, 0, 0.43, 0, 0, 0.5, 0};
    *w = (struct world){.fixture = fixture_create()};
    struct fixture *f = w->fixture;
    const uint32_t grey = fixture_material(f, 0.5f, 0.5f, 0.5f), lamp = fixture_material(f, 0, 0, 0);
    memcpy(f->materials[lamp].emission, (const float[3]){5, 4, 3}, sizeof f->materials[lamp].emission);
    fixture_mesh(f);
    fixture_sheet(f, dvec3(-2, 0, 2), dvec3(4, 0, 0), dvec3(0, 0, -4), 3, flat, 0.2, grey);
    fixture_cube(f, 1, 0.0, grey);
    fixture_mesh(f);
    fixture_sheet(f, dvec3(-0.5, 2.9, -0.5), dvec3(1, 0, 0), dvec3(0, 0, 1), 1, flat, 0.0, lamp);
    fixture_object(f, 0, NULL, 28, 28);
    fixture_object(f, 1, sunk, 18, 12);
    fixture_object(f, 2, NULL, 4, 4);
    assert_int_equal(kiln_geometry_create(&w->geometry, &f->scene, NULL), KILN_OK);
    assert_int_equal(kiln_lights_create(&w->lights, &f->scene, w->geometry, NULL), KILN_OK);
    const struct kiln_surface_params params = {.scene = &f->scene, .geometry = w->geometry, .ranks = 1, .threads = 1};
    assert_int_equal(kiln_surface_build(&w->surface, &params, &(struct kiln_surface_report){0}, NULL), KILN_OK);
    w->radiosity = calloc(w->surface->point_count, sizeof *w->radiosity);
    for (uint64_t i = 0; i < w->surface->point_count; i++) {
        const float level = 1.0f + (float)fixture_random(f), rgb[3] = {level, 2.0f * level, 0.5f};
        w->radiosity[i] = kiln_radiosity_pack(rgb, kiln_hash1((uint32_t)i));
    }
    w->surface->guide = calloc(w->surface->count, KILN_GUIDE_FLOATS * sizeof *w->surface->guide);
    for (uint64_t i = 0; i < KILN_GUIDE_FLOATS * w->surface->count; i++) /* more light from near the normals */
        w->surface->guide[i] = i % 256 < 96 ? 3.0f : 0.1f;
    place_patches(w);
    for (int i = 0; i < PROBES; i++)
        w->positions[i] = vec3((float)(4.0 * fixture_random(f) - 2.0), (float)(2.0 * fixture_random(f) + 0.01),
                               (float)(4.0 * fixture_random(f) - 2.0));
}

static void release(struct world *w)
{
    free(w->radiosity);
    free(w->surface->guide);
    kiln_surface_destroy(&w->surface);
    kiln_lights_destroy(&w->lights);
    kiln_geometry_destroy(&w->geometry);
    fixture_destroy(w->fixture);
}

/* Results of a run, in the order of items. */
struct kept {
    const struct kiln_surface *surface; /* NULL: items are positions or pixels */
    size_t result_bytes, first, next;   /* items */
    char *results;
    uint64_t *offset; /* of each item's first result, and one more */
    uint32_t *taken;  /* how often each item was taken; NULL: they come in order */
};

static int keep(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    (void)error;
    struct kept *k = context;
    assert_true(count > 0);
    if (k->taken == NULL)
        assert_true(first >= k->next); /* in order, none twice */
    else
        for (size_t i = first - k->first; i < first - k->first + count; i++)
            assert_int_equal(k->taken[i]++, 0);
    k->next = first + count;
    const uint64_t begin = k->offset[first - k->first], end = k->offset[first - k->first + count];
    memcpy(k->results + begin * k->result_bytes, results, (end - begin) * k->result_bytes);
    return KILN_OK;
}

/* kiln_take_some: items that are left out have undefined results. */
static int keep_some(void *context, size_t first, size_t count, const uint32_t *samples, const void *results,
                     struct kiln_error *error)
{
    (void)error;
    struct kept *k = context;
    const uint64_t begin = k->offset[first - k->first];
    assert_true(count > 0);
    for (size_t i = 0; i < count; i++) {
        const uint64_t own = k->offset[first - k->first + i], end = k->offset[first - k->first + i + 1];
        if (samples[i] == 0)
            continue;
        assert_int_equal(k->taken[first - k->first + i]++, 0);
        memcpy(k->results + own * k->result_bytes, (const char *)results + (own - begin) * k->result_bytes,
               (end - own) * k->result_bytes);
    }
    return KILN_OK;
}

static struct kept keeper(const struct world *w, const struct kiln_pass *pass, struct kiln_batch *all)
{
    const bool surface = pass->domain == KILN_DOMAIN_TILE_RUNS;
    *all = (struct kiln_batch){.first = surface || pass->is_whole ? 0 : FIRST_PROBE,
                               .count = surface ? w->surface->tile_run_count : PROBES,
                               .positions = pass->domain == KILN_DOMAIN_POSITIONS ? w->positions : NULL,
                               .stream = pass->has_streams ? 2 : 0,
                               .take = keep};
    struct kept k = {.surface = surface ? w->surface : NULL, .result_bytes = pass->result_bytes, .first = all->first};
    k.offset = calloc(all->count + 1, sizeof *k.offset);
    for (size_t i = 0; i < all->count; i++)
        k.offset[i + 1] = k.offset[i] + (surface ? w->surface->tile_runs[i].count : 1);
    k.results = malloc(k.offset[all->count] * k.result_bytes);
    memset(k.results, 0xa5, k.offset[all->count] * k.result_bytes);
    return k;
}

static void drop(struct kept *k)
{
    free(k->results);
    free(k->offset);
    free(k->taken);
}

static uint64_t run(struct kiln_backend *backend, const struct kiln_pass *pass, struct kiln_batch batch, struct kept *k)
{
    struct kiln_error error = {""};
    uint64_t rays = 0;
    batch.context = k;
    k->next = k->first;
    if (kiln_backend_run(backend, pass, parameters[pass->index], &batch, &rays, &error) != KILN_OK)
        fail_msg("%s: %s", pass->name, error.message);
    return rays;
}

/* Each item's number of samples, in stretches of one and more; 0: left out. */
static uint32_t number_of(size_t item)
{
    static const uint32_t numbers[] = {4, 4, 9, 0, 0, 16, 5, 5, 5, 1};
    return numbers[item % (sizeof numbers / sizeof *numbers)];
}

/* A batch whose numbers differ against batches where all items have one of them. */
static void numbers_may_differ(struct kiln_backend *backend, const struct world *w, const struct kiln_pass *pass)
{
    struct kiln_batch all;
    struct kept mixed = keeper(w, pass, &all), uniform = keeper(w, pass, &all);
    uint32_t *numbers = calloc(all.count, sizeof *numbers);
    uint64_t expected_rays = 0;
    for (size_t i = 0; i < all.count; i++)
        numbers[i] = number_of(i);
    struct kiln_batch batch = all;
    batch.samples_each = numbers;
    mixed.taken = calloc(all.count, sizeof *mixed.taken);
    const uint64_t rays = run(backend, pass, batch, &mixed);
    for (uint32_t number = 1; number <= 16; number++)
        for (size_t i = 0; i < all.count; i++) {
            if (numbers[i] != number)
                continue;
            struct kiln_batch one = kiln_batch_range(&all, all.first + i, 1);
            one.samples = number;
            expected_rays += run(backend, pass, one, &uniform);
        }
    assert_true(rays > 0 && rays == expected_rays);
    for (size_t i = 0; i < all.count; i++) { /* what was left out is as it was in both */
        const uint64_t begin = mixed.offset[i] * pass->result_bytes, end = mixed.offset[i + 1] * pass->result_bytes;
        assert_memory_equal(mixed.results + begin, uniform.results + begin, end - begin);
        assert_true(numbers[i] != 0 || (unsigned char)mixed.results[begin] == 0xa5);
    }
    /* the same results together with those of items that are left out */
    struct kept some = keeper(w, pass, &all);
    some.taken = calloc(all.count, sizeof *some.taken);
    batch.take_some = keep_some;
    assert_true(run(backend, pass, batch, &some) == rays);
    assert_memory_equal(some.taken, mixed.taken, all.count * sizeof *some.taken);
    assert_memory_equal(some.results, mixed.results, some.offset[all.count] * pass->result_bytes);
    drop(&some);
    /* all items at once, where a device takes many to a chunk */
    batch = all;
    batch.samples = 9;
    (void)run(backend, pass, batch, &uniform);
    for (size_t i = 0; i < all.count; i++)
        if (numbers[i] == 9)
            assert_memory_equal(mixed.results + mixed.offset[i] * pass->result_bytes,
                                uniform.results + mixed.offset[i] * pass->result_bytes,
                                (mixed.offset[i + 1] - mixed.offset[i]) * pass->result_bytes);
    free(numbers);
    drop(&mixed);
    drop(&uniform);
}

/* The points of an item that are asked for: none, one, some or all. */
static uint64_t mask_of(size_t item)
{
    static const uint64_t masks[] = {0x0041000000810012ull, UINT64_MAX, 0, 1, 0x8888888888888888ull, 0x1ull << 20};
    return masks[item % (sizeof masks / sizeof *masks)];
}

/* A batch with masks against one without. */
static void points_may_be_left_out(struct kiln_backend *backend, const struct world *w, const struct kiln_pass *pass)
{
    struct kiln_batch all;
    struct kept some = keeper(w, pass, &all), every = keeper(w, pass, &all);
    struct kiln_selection *chosen = calloc(all.count, sizeof *chosen);
    uint64_t asked = 0, lit = 0, points = 0;
    static const char zeros[256];
    for (size_t i = 0; i < all.count; i++)
        chosen[i].computed = mask_of(i);
    all.samples = 9;
    const uint64_t every_ray = run(backend, pass, all, &every);
    all.selections = chosen;
    const uint64_t rays = run(backend, pass, all, &some);
    for (size_t i = 0; i < all.count; i++)
        for (uint64_t k = 0; k < every.offset[i + 1] - every.offset[i]; k++, points++) {
            const size_t at = (every.offset[i] + k) * pass->result_bytes;
            const bool is_asked = (chosen[i].computed >> k & 1u) != 0;
            const char *expected = is_asked ? every.results + at : zeros;
            assert_memory_equal(some.results + at, expected, pass->result_bytes);
            asked += is_asked;
            lit += is_asked && memcmp(every.results + at, zeros, pass->result_bytes) != 0;
        }
    assert_true(lit > 20 && asked < points / 2 && rays > 0 && rays < every_ray * 2 / 3);
    free(chosen);
    drop(&some);
    drop(&every);
}

/* A batch in which some of the points asked for take fewer samples, against batches in which all take so many. */
static void points_may_take_fewer(struct kiln_backend *backend, const struct world *w, const struct kiln_pass *pass)
{
    enum { SAMPLES = 24 };
    struct kiln_batch all;
    struct kept mixed = keeper(w, pass, &all), many = keeper(w, pass, &all), few = keeper(w, pass, &all);
    struct kiln_selection *chosen = calloc(2 * all.count, sizeof *chosen), *of_few = chosen + all.count;
    uint64_t differ = 0;
    for (size_t i = 0; i < all.count; i++) {
        chosen[i].computed = of_few[i].computed = mask_of(i);
        of_few[i].few = i % 3 == 0 ? 0x0101010101010102ull : i % 3 == 1 ? UINT64_MAX : 0;
    }
    all.samples = SAMPLES;
    all.selections = chosen;
    const uint64_t many_rays = run(backend, pass, all, &many);
    all.selections = of_few;
    const uint64_t rays = run(backend, pass, all, &mixed);
    all.selections = chosen;
    all.samples = kiln_batch_few(SAMPLES);
    const uint64_t few_rays = run(backend, pass, all, &few);
    for (size_t i = 0; i < all.count; i++)
        for (uint64_t k = 0; k < many.offset[i + 1] - many.offset[i]; k++) {
            const size_t at = (many.offset[i] + k) * pass->result_bytes;
            const bool is_few = (of_few[i].few >> k & 1u) != 0;
            const char *expected = is_few ? few.results + at : many.results + at;
            assert_memory_equal(mixed.results + at, expected, pass->result_bytes);
            differ += is_few && memcmp(many.results + at, expected, pass->result_bytes) != 0;
        }
    assert_true(kiln_batch_few(SAMPLES) == 3 && differ > 10 && rays < many_rays && rays > few_rays);
    free(chosen);
    drop(&mixed);
    drop(&many);
    drop(&few);
}

/* A third of the items goes to others, from the end; the rest is given out in parts of up to `most`. */
struct given {
    size_t next, end, most;
};

static size_t give(void *context, size_t first, size_t count)
{
    struct given *g = context;
    const size_t left = g->end - g->next, some = count < g->most ? count : g->most;
    assert_int_equal(first, g->next); /* in order, none twice */
    g->next += some < left ? some : left;
    return g->next - first;
}

/* A batch that is claimed, `numbers`: with different numbers of samples, against one that is not: what is claimed has
 * the same results, and nothing else is computed. */
static void items_may_be_claimed(struct kiln_backend *backend, const struct world *w, const struct kiln_pass *pass,
                                 const uint32_t *numbers)
{
    struct kiln_batch all;
    struct kiln_backend_info info;
    struct kept some = keeper(w, pass, &all), every = keeper(w, pass, &all);
    struct given given = {all.first, all.first + all.count * 2 / 3, 3};
    const struct kiln_claims claims = {give, &given};
    kiln_backend_info(backend, &info);
    all.samples = 9;
    all.samples_each = numbers;
    some.taken = calloc(all.count, sizeof *some.taken);
    every.taken = calloc(all.count, sizeof *every.taken);
    (void)run(backend, pass, all, &every);
    all.claims = &claims;
    (void)run(backend, pass, all, &some);
    assert_true(given.next == (kiln_backend_claims(&info, pass, numbers != NULL) ? given.end : all.first + given.most));
    for (size_t i = 0; i < all.count; i++) {
        const uint64_t begin = some.offset[i] * pass->result_bytes, end = some.offset[i + 1] * pass->result_bytes;
        if (all.first + i < given.next)
            assert_memory_equal(some.results + begin, every.results + begin, end - begin);
        assert_int_equal(some.taken[i], all.first + i < given.next && (numbers == NULL || numbers[i] > 0));
    }
    drop(&some);
    drop(&every);
}

/* Some tile runs of another rank, whose surface is like the own one, and then the own ones again. */
static void others_may_be_computed(struct kiln_backend *backend, const struct world *w, const struct kiln_pass *pass)
{
    struct kiln_error error = {""};
    struct kiln_batch all;
    struct kept every = keeper(w, pass, &all), some = keeper(w, pass, &all), again = keeper(w, pass, &all);
    const struct kiln_surface other = *w->surface;
    all.samples = 9;
    (void)run(backend, pass, all, &every);
    const struct kiln_others others = {&other, all.count / 3, all.count / 3};
    const size_t begin = some.offset[others.first] * pass->result_bytes,
                 end = some.offset[others.first + others.count] * pass->result_bytes;
    assert_int_equal(kiln_backend_set_others(backend, others, &error), KILN_OK);
    (void)run(backend, pass, kiln_batch_range(&all, others.first, others.count), &some);
    assert_int_equal(kiln_backend_set_others(backend, (struct kiln_others){.surface = NULL}, &error), KILN_OK);
    (void)run(backend, pass, all, &again);
    assert_memory_equal(some.results + begin, every.results + begin, end - begin);
    assert_memory_equal(again.results, every.results, every.offset[all.count] * pass->result_bytes);
    drop(&every);
    drop(&some);
    drop(&again);
}

static void ranks_may_help(struct kiln_backend *backend, const struct world *w, const struct kiln_pass *pass)
{
    uint32_t *numbers = calloc(w->surface->tile_run_count, sizeof *numbers);
    for (size_t i = 0; i < w->surface->tile_run_count; i++)
        numbers[i] = number_of(i);
    items_may_be_claimed(backend, w, pass, NULL);
    items_may_be_claimed(backend, w, pass, numbers);
    others_may_be_computed(backend, w, pass);
    free(numbers);
}

/* Sum over all points of the irradiance that a stretch of samples adds up to, red; and samples of all points. */
static double stretch(struct kiln_backend *backend, const struct world *w, const struct kiln_pass *pass, uint32_t first,
                      uint32_t samples, uint64_t *count)
{
    struct kiln_batch all;
    struct kept k = keeper(w, pass, &all);
    double sum = 0.0;
    all.samples = samples;
    all.first_sample = first;
    (void)run(backend, pass, all, &k);
    for (uint64_t i = 0; i < w->surface->count; i++) {
        const struct kiln_point_result *r =
            (const void *)(k.results + i * pass->result_bytes); /* of both passes the same */
        const bool valid = kiln_point_valid(w->surface, (struct kiln_own_point){i});
        assert_true(r->count == (valid ? samples : 0) && (valid || r->irradiance[0] == 0.0f));
        assert_true(kiln_point_mean(r).count == r->count && isfinite(kiln_point_mean(r).irradiance[0]));
        sum += (double)r->irradiance[0];
        *count += r->count;
    }
    drop(&k);
    return sum;
}

/* The same of pixels. */
static double pixel_stretch(struct kiln_backend *backend, const struct world *w, const struct kiln_pass *pass,
                            uint32_t first, uint32_t samples, uint64_t *count)
{
    struct kiln_batch all;
    struct kept k = keeper(w, pass, &all);
    double sum = 0.0;
    all.samples = samples;
    all.first_sample = first;
    (void)run(backend, pass, all, &k);
    for (size_t i = 0; i < all.count; i++) {
        const struct kiln_path_result *r = (const struct kiln_path_result *)(const void *)k.results + i;
        assert_true(r->count == samples && isfinite(r->radiance[0]) && r->square >= 0.0f);
        sum += (double)r->radiance[0];
        *count += r->count;
    }
    drop(&k);
    return sum;
}

/* Results are sums over the samples: 5 and then 11 of the sequence come to what 16 do, up to their noise. */
static void sums_add_up(struct kiln_backend *backend, const struct world *w, const struct kiln_pass *pass)
{
    uint64_t counts[2] = {0, 0};
    const bool pixels = pass->domain == KILN_DOMAIN_PIXELS;
    double (*const add)(struct kiln_backend *, const struct world *, const struct kiln_pass *, uint32_t, uint32_t,
                        uint64_t *) = pixels ? pixel_stretch : stretch;
    const double parts = add(backend, w, pass, 0, 5, &counts[0]) + add(backend, w, pass, 5, 11, &counts[0]);
    const double whole = add(backend, w, pass, 0, 16, &counts[1]);
    print_message("%s: 5 and 11 samples sum up to %.6g, 16 to %.6g\n", pass->name, parts, whole);
    if (pass->index == KILN_PASS_INDEX_caustic ||
        pass->index == KILN_PASS_INDEX_weighed) { /* nothing here is glossy: tests/unit/test_chain.c */
        assert_true(counts[0] == counts[1] && parts == 0.0 && whole == 0.0);
        return;
    }
    const double noise = pass->index == KILN_PASS_INDEX_guided      ? 0.03
                         : pass->index == KILN_PASS_INDEX_reference ? 0.1
                                                                    : 0.01;
    assert_true(counts[0] == counts[1] && whole > 0.0 && fabs(parts / whole - 1.0) < noise);
}

/* Whether devices refuse it. */
static bool is_of_processors(const struct kiln_pass *pass)
{
#define IS(name) || pass == &kiln_pass_##name
    return false KILN_PASS_LIST_OF_PROCESSORS(IS);
#undef IS
}

/* Chains through whole materials: a software device needs over a minute to make each kernel. */
static bool takes_minutes(const struct kiln_pass *pass)
{
    return getenv("KILN_TEST_FULL") == NULL &&
           (pass->index == KILN_PASS_INDEX_caustic || pass->index == KILN_PASS_INDEX_weighed);
}

/* Runs every pass, validity first; gives the rays of each. */
static void run_all(const struct world *w, const char *name, uint64_t rays[KILN_PASS_COUNT])
{
    struct kiln_error error = {""};
    struct kiln_backend *backend = NULL;
    const bool is_embree = strcmp(name, "embree") == 0;
    const struct kiln_backend_params params = {
        .scene = &w->fixture->scene, .geometry = w->geometry, .lights = w->lights, .threads = 2, .seed = 7};
    if (kiln_backend_create(&backend, name, &params, &error) != KILN_OK ||
        kiln_backend_set_surface(backend, w->surface, &error) != KILN_OK ||
        kiln_backend_set_radiosity(backend, w->radiosity, &error) != KILN_OK)
        fail_msg("%s: %s", name, error.message);
    const struct kiln_batch points = {
        .count = w->surface->tile_run_count, .take = kiln_validity_keep, .context = w->surface};
    uint64_t ignored = 0, partly = 0;
    assert_int_equal(kiln_backend_run(backend, &kiln_pass_validity, NULL, &points, &ignored, &error), KILN_OK);
    for (uint64_t i = 0; i < w->surface->count; i++)
        partly += w->surface->visible[i] != 0 && w->surface->visible[i] != 0xffff;
    assert_true(partly > 4);
    for (int i = 0; i < KILN_PASS_COUNT; i++) {
        const struct kiln_pass *pass = kiln_passes[i];
        struct kiln_batch all;
        struct kept k = keeper(w, pass, &all);
        all.samples = pass->is_sampled ? 9 : 0;
        rays[i] = 1;
        if (!kiln_backend_takes(backend, pass, parameters[i])) {
            assert_true(!is_embree && is_of_processors(pass));
            assert_int_equal(kiln_backend_run(backend, pass, parameters[i], &all, &ignored, &error), KILN_USAGE);
            drop(&k);
            continue;
        }
        if (pass->domain == KILN_DOMAIN_LIGHT_PATHS || (!is_embree && takes_minutes(pass))) {
            drop(&k);
            continue;
        }
        rays[i] = run(backend, pass, all, &k);
        assert_true(k.next == all.first + all.count && (rays[i] > 0 || pass == &kiln_pass_shapes));
        drop(&k);
        if (pass->is_sampled)
            numbers_may_differ(backend, w, pass);
        if (pass->is_masked)
            points_may_be_left_out(backend, w, pass);
        if (pass->is_masked && pass->is_sampled)
            points_may_take_fewer(backend, w, pass);
        if (pass->is_divisible)
            sums_add_up(backend, w, pass);
        if (pass->is_stealable)
            ranks_may_help(backend, w, pass);
    }
    kiln_backend_destroy(&backend);
}

static void every_pass_on_every_backend(void **state)
{
    (void)state;
    struct world w;
    uint64_t rays[2][KILN_PASS_COUNT];
    build(&w);
    run_all(&w, "embree", rays[0]);
    if (vulkan_device_is_there()) {
        run_all(&w, "vulkan", rays[1]);
        for (int i = 0; i < KILN_PASS_COUNT; i++) {
            print_message("%s: %llu rays, on Vulkan %llu\n", kiln_passes[i]->name, (unsigned long long)rays[0][i],
                          (unsigned long long)rays[1][i]);
            assert_true(is_of_processors(kiln_passes[i]) || takes_minutes(kiln_passes[i]) ||
                        fabs((double)rays[1][i] / (double)rays[0][i] - 1.0) < 0.002); /* rounding decides a few */
        }
    }
    release(&w);
}

static void rows_are_in_order(void **state)
{
    (void)state;
    static const double zeros[64];
    for (size_t i = 0; i < KILN_PASS_COUNT; i++) {
        const struct kiln_pass *pass = kiln_passes[i];
        assert_true(pass != NULL && (size_t)pass->index == i && pass->name != NULL && pass->what != NULL);
        assert_true(pass->result_bytes > 0 && (parameters[i] != NULL) == (pass->parameter_bytes > 0));
        for (size_t k = 0; k < i; k++)
            assert_string_not_equal(pass->name, kiln_passes[k]->name);
        if (pass->figures == NULL)
            continue;
        struct kiln_pass_figures figures;
        assert_true(pass->figure_count > 0 && pass->figure_count <= KILN_PASS_FIGURES && pass->unit != NULL);
        for (size_t c = 0; c < pass->figure_count; c++)
            assert_non_null(pass->figure_names[c]);
        assert_true(pass->result_bytes <= sizeof zeros);
        pass->figures(zeros, &figures); /* an invalid point's result */
        assert_true(figures.sound && figures.level == 0.0 && figures.error == 0.0);
    }
}

/* A call that does not keep to the row is refused with a sentence, before a backend sees it. */
static void wrong_calls_are_refused(void **state)
{
    (void)state;
    struct world w;
    struct kiln_error error;
    struct kiln_backend *backend = NULL;
    uint64_t rays = 0;
    const struct kiln_selection chosen = {.computed = 1};
    build(&w);
    const struct kiln_backend_params params = {
        .scene = &w.fixture->scene, .geometry = w.geometry, .lights = w.lights, .threads = 1};
    assert_int_equal(kiln_backend_create(&backend, "embree", &params, &error), KILN_OK);
    for (int i = 0; i < KILN_PASS_COUNT; i++) {
        const struct kiln_pass *pass = kiln_passes[i];
        struct kiln_batch all;
        struct kept k = keeper(&w, pass, &all);
        all.context = &k;
        all.samples = pass->is_sampled ? 1 : 0;
        if (pass->domain == KILN_DOMAIN_TILE_RUNS || pass->domain == KILN_DOMAIN_LIGHT_PATHS ||
            pass->reads_radiosity) { /* nothing was handed over yet */
            assert_int_equal(kiln_backend_run(backend, pass, parameters[i], &all, &rays, &error), KILN_BUG);
            assert_non_null(strstr(error.message, pass->name));
        }
        drop(&k);
    }
    assert_int_equal(kiln_backend_set_surface(backend, w.surface, &error), KILN_OK);
    assert_int_equal(kiln_backend_set_radiosity(backend, w.radiosity, &error), KILN_OK);
    for (int i = 0; i < KILN_PASS_COUNT; i++) {
        const struct kiln_pass *pass = kiln_passes[i];
        struct kiln_batch all;
        struct kept k = keeper(&w, pass, &all);
        all.context = &k;
        all.samples = pass->is_sampled ? 0 : 1;
        assert_int_equal(kiln_backend_run(backend, pass, parameters[i], &all, &rays, &error), KILN_BUG);
        all.samples = 1 - all.samples;
        all.positions = all.positions != NULL ? NULL : w.positions;
        assert_int_equal(kiln_backend_run(backend, pass, parameters[i], &all, &rays, &error), KILN_BUG);
        all.positions = all.positions != NULL ? NULL : w.positions;
        all.selections = &chosen;
        if (!pass->is_masked)
            assert_int_equal(kiln_backend_run(backend, pass, parameters[i], &all, &rays, &error), KILN_BUG);
        all.selections = NULL;
        all.stream = pass->has_streams ? all.stream : 1;
        if (!pass->has_streams)
            assert_int_equal(kiln_backend_run(backend, pass, parameters[i], &all, &rays, &error), KILN_BUG);
        drop(&k);
    }
    assert_true(rays == 0);
    kiln_backend_destroy(&backend);
    release(&w);
}

/* A compact BVH gives the same bits. */
static void compact_trees_give_the_same(void **state)
{
    (void)state;
    struct world w;
    struct kiln_error error = {""};
    struct kiln_backend *backends[2] = {NULL, NULL};
    build(&w);
    for (int i = 0; i < 2; i++) {
        const struct kiln_backend_params params = {.scene = &w.fixture->scene,
                                                   .geometry = w.geometry,
                                                   .lights = w.lights,
                                                   .threads = 2,
                                                   .seed = 7,
                                                   .tree_memory = i == 0 ? UINT64_MAX : 1};
        struct kiln_backend_info info;
        assert_int_equal(kiln_backend_create(&backends[i], "embree", &params, &error), KILN_OK);
        assert_int_equal(kiln_backend_set_surface(backends[i], w.surface, &error), KILN_OK);
        assert_int_equal(kiln_backend_set_radiosity(backends[i], w.radiosity, &error), KILN_OK);
        kiln_backend_info(backends[i], &info);
        assert_true(info.compact_tree == (i == 1));
    }
    const struct kiln_pass *const passes[] = {&kiln_pass_direct, &kiln_pass_gather};
    for (int p = 0; p < 2; p++) {
        struct kiln_batch all;
        struct kept k[2] = {keeper(&w, passes[p], &all), keeper(&w, passes[p], &all)};
        all.samples = 16;
        assert_true(run(backends[0], passes[p], all, &k[0]) == run(backends[1], passes[p], all, &k[1]));
        assert_memory_equal(k[0].results, k[1].results, k[0].offset[all.count] * k[0].result_bytes);
        drop(&k[0]);
        drop(&k[1]);
    }
    kiln_backend_destroy(&backends[0]);
    kiln_backend_destroy(&backends[1]);
    release(&w);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rows_are_in_order),
        cmocka_unit_test(wrong_calls_are_refused),
        cmocka_unit_test(every_pass_on_every_backend),
        cmocka_unit_test(compact_trees_give_the_same),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
