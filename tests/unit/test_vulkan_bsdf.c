/* Tests of scattering functions on a device: what they are made of, against the host; and whole materials, by the same
 * checks as the host's own (bsdf_checks.h). KILN_TEST_FULL: of all roughnesses and angles. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "shaders/shared/bsdf.h"
#include "shaders/shared/random.h"
#include "tests/modules.h"
#include "tests/unit/bsdf_checks.h"
#include "tests/unit/vulkan_device.h"

enum { QUERIES = 20000, VECTORS = 6, NUMBERS = 7 };

struct query {
    struct kiln_vec3 o;
    float alpha_x, alpha_y, eta, u, v;
};
struct answer {
    struct kiln_vec3 vectors[VECTORS]; /* h, i, glossy, beckmann, even, spread */
    float numbers[NUMBERS];            /* fresnel, facets, visible, lost, reflected, Beckmann's facets, grooves */
};
struct push {
    uint64_t scene, queries, answers;
    uint32_t count;
};

static float uniform(uint32_t *seed) { return kiln_unit_float(kiln_hash1((*seed)++)); }

static struct query any_query(uint32_t *seed)
{
    struct query q = {.u = uniform(seed), .v = uniform(seed)};
    const float z = 0.01f + 0.99f * uniform(seed), turn = 6.2831853f * uniform(seed), r = sqrtf((1 - z) * (1 + z));
    q.o = vec3(r * cosf(turn), r * sinf(turn), z);
    q.alpha_x = 0.01f + 0.99f * uniform(seed) * uniform(seed);
    q.alpha_y = 0.01f + 0.99f * uniform(seed) * uniform(seed);
    q.eta = 1.05f + 1.95f * uniform(seed);
    if (uniform(seed) < 0.3f)
        q.eta = 1.0f / q.eta;
    return q;
}

static struct answer host_answer(const struct query *q)
{
    const struct kiln_interface s = kiln_interface_of(q->alpha_x, fmaxf(q->eta, 1.0f / q->eta));
    const struct kiln_vec3 h = kiln_ggx_sample(q->o, q->alpha_x, q->alpha_y, q->u, q->v);
    const struct kiln_vec3 even = kiln_bsdf_cosine(q->u, q->v), b = kiln_beckmann_sample(q->alpha_x, q->u, q->v);
    const float cosine = vec3_dot(q->o, h), behind = kiln_refracted_cosine(cosine, q->eta);
    return (struct answer){.vectors = {h, kiln_refracted(q->o, h, 1.0f / q->eta, cosine, behind),
                                       kiln_reflected(q->o, h), b, even, kiln_bsdf_spread_draw(q->alpha_x, q->u, q->v)},
                           .numbers = {kiln_fresnel(cosine, q->eta), kiln_ggx(even, q->alpha_x, q->alpha_y),
                                       kiln_ggx_visible(q->o.z, even.z, kiln_ggx_stretch(q->o, q->alpha_x, q->alpha_y),
                                                        kiln_ggx_stretch(even, q->alpha_x, q->alpha_y)),
                                       kiln_interface_lost(s, q->o.z), kiln_interface_albedo(s, q->o.z),
                                       kiln_beckmann(b, q->alpha_x), kiln_grooves(q->o, even, b)}};
}

static void ask(struct gpu *gpu, const struct query *queries, struct answer *answers)
{
    const struct gpu_kernel_params params = {.name = "bsdf", .code = &kiln_code_bsdf};
    struct gpu_kernel *kernel = NULL;
    struct gpu_buffer buffers[2];
    assert_int_equal(gpu_kernel_create(gpu, &kernel, &params, NULL), KILN_OK);
    assert_int_equal(gpu_buffer_of(gpu, &buffers[0], queries, QUERIES * sizeof *queries, "queries", NULL), KILN_OK);
    assert_int_equal(gpu_buffer_create(gpu, &buffers[1], QUERIES * sizeof *answers, GPU_DEVICE, "answers", NULL),
                     KILN_OK);
    const struct push push = {0, buffers[0].address, buffers[1].address, QUERIES};
    const struct gpu_step step = {
        .kernel = kernel, .threads_x = QUERIES, .threads_y = 1, .constants = &push, .constant_bytes = sizeof push};
    assert_int_equal(gpu_run(gpu, &step, 1, NULL, NULL), KILN_OK);
    assert_int_equal(gpu_download(gpu, &buffers[1], 0, answers, QUERIES * sizeof *answers, NULL), KILN_OK);
    for (int i = 0; i < 2; i++)
        gpu_buffer_destroy(gpu, &buffers[i]);
    gpu_kernel_destroy(gpu, &kernel);
}

/* Numbers are held against each other relative to their size, but those below 0.01 absolutely. */
static void same_as_host(void **state)
{
    struct query *queries = calloc(QUERIES, sizeof *queries);
    struct answer *answers = calloc(QUERIES, sizeof *answers);
    uint32_t seed = 1;
    size_t vectors = 0, numbers = 0;
    double worst[VECTORS + NUMBERS] = {0};
    for (size_t k = 0; k < QUERIES; k++)
        queries[k] = any_query(&seed);
    ask(*state, queries, answers);
    for (size_t k = 0; k < QUERIES; k++) {
        const struct answer host = host_answer(&queries[k]), *a = &answers[k];
        for (int c = 0; c < VECTORS; c++) {
            const double off = (double)vec3_length(vec3_sub(a->vectors[c], host.vectors[c]));
            worst[c] = fmax(worst[c], off);
            vectors += !(off < 1e-3);
        }
        for (int c = 0; c < NUMBERS; c++) {
            const double size = fmax(fabs((double)host.numbers[c]), 0.01);
            const double off = fabs((double)a->numbers[c] - (double)host.numbers[c]) / size;
            worst[VECTORS + c] = fmax(worst[VECTORS + c], off);
            numbers += !(off < 1e-3);
        }
    }
    for (int c = 0; c < VECTORS + NUMBERS; c++)
        print_message("%s %d apart by at most %.1e\n", c < VECTORS ? "vectors" : "numbers", c, worst[c]);
    free(answers);
    free(queries);
    assert_true(vectors <= QUERIES / 1000 && numbers <= QUERIES / 500); /* beside critical angles */
}

/* ---- whole materials ---- */

struct lobes_push {
    uint64_t scene, lobes, queries, answers;
    uint32_t count;
};

/* The device, and the kernel that answers. */
struct device_lobes {
    struct gpu *gpu;
    struct gpu_kernel *kernel;
};

static void ask_lobes(void *context, const struct kiln_bsdf_lobes *lobes, size_t lobes_count,
                      const struct lobes_query *queries, size_t count, struct lobes_answer *answers)
{
    struct device_lobes *d = context;
    struct gpu_buffer buffers[3], tables[ALPHAS] = {0};
    struct kiln_bsdf_lobes moved[ALPHAS];
    if (count == 0)
        return;
    memcpy(moved, lobes, lobes_count * sizeof *lobes);
    for (size_t i = 0; i < lobes_count; i++) {
        const struct kiln_brushed_table *table = kiln_brushed_of(&lobes[i]);
        if (table == NULL)
            continue;
        const size_t layers = lobes[i].brushed_part != 0.0f ? 4 : 1;
        assert_int_equal(gpu_buffer_of(d->gpu, &tables[i], table, layers * sizeof *table, "a table", NULL), KILN_OK);
        kiln_brushed_move(&moved[i], tables[i].address);
    }
    assert_int_equal(gpu_buffer_of(d->gpu, &buffers[0], moved, lobes_count * sizeof *lobes, "lobes", NULL), KILN_OK);
    assert_int_equal(gpu_buffer_of(d->gpu, &buffers[1], queries, count * sizeof *queries, "queries", NULL), KILN_OK);
    assert_int_equal(gpu_buffer_create(d->gpu, &buffers[2], count * sizeof *answers, GPU_DEVICE, "answers", NULL),
                     KILN_OK);
    const struct lobes_push push = {0, buffers[0].address, buffers[1].address, buffers[2].address, (uint32_t)count};
    const struct gpu_step step = {.kernel = d->kernel,
                                  .threads_x = (uint32_t)count,
                                  .threads_y = 1,
                                  .constants = &push,
                                  .constant_bytes = sizeof push};
    assert_int_equal(gpu_run(d->gpu, &step, 1, NULL, NULL), KILN_OK);
    assert_int_equal(gpu_download(d->gpu, &buffers[2], 0, answers, count * sizeof *answers, NULL), KILN_OK);
    for (int i = 0; i < 3; i++)
        gpu_buffer_destroy(d->gpu, &buffers[i]);
    for (size_t i = 0; i < lobes_count; i++)
        gpu_buffer_destroy(d->gpu, &tables[i]);
}

static void whole_materials(void **state)
{
    const struct gpu_kernel_params params = {.name = "lobes", .code = &kiln_code_bsdf_lobes};
    struct device_lobes device = {.gpu = *state};
    const struct lobes_source there = {.ask = ask_lobes, .context = &device, .thin = getenv("KILN_TEST_FULL") == NULL};
    assert_int_equal(gpu_kernel_create(device.gpu, &device.kernel, &params, NULL), KILN_OK);
    check_furnaces(&there);
    check_draws(&there);
    check_reciprocities(&there);
    gpu_kernel_destroy(device.gpu, &device.kernel);
}

/* ---- hits of materials with textures ---- */

enum { ROUGHNESSES = 64 };

struct prepare_push {
    uint64_t scene, lobes;
    struct kiln_bsdf_tables tables;
    uint32_t count;
};

/* The tables on the device; `buffer` holds them. */
static struct kiln_bsdf_tables upload_tables(struct gpu *gpu, const struct kiln_bsdf_tables *host,
                                             struct gpu_buffer *buffer)
{
    struct kiln_bsdf_tables there = {0};
    const bool brushed = (host->brushed_low | host->brushed_high) != 0;
    const uint32_t low = brushed ? host->brushed_low : host->trapped_low;
    const uint32_t high = brushed ? host->brushed_high : host->trapped_high;
    const void *table = (const void *)(uintptr_t)((uint64_t)high << 32 | low);
    const size_t bytes =
        brushed ? KILN_BRUSHED_LAYERS * sizeof(struct kiln_brushed_table) : sizeof(struct kiln_bsdf_trapped_table);
    assert_int_equal(gpu_buffer_of(gpu, buffer, table, bytes, "tables", NULL), KILN_OK);
    *(brushed ? &there.brushed_low : &there.trapped_low) = (uint32_t)buffer->address;
    *(brushed ? &there.brushed_high : &there.trapped_high) = (uint32_t)(buffer->address >> 32);
    return there;
}

/* By how much lobes are apart, but for where their tables are: they are numbers of 32 bits, few of them integers. */
static double lobes_apart(struct kiln_bsdf_lobes a, struct kiln_bsdf_lobes b)
{
    double off = 0.0;
    a.brushed_low = b.brushed_low;
    a.brushed_high = b.brushed_high;
    assert_true(a.holds == b.holds && a.base_is_mirror == b.base_is_mirror && a.disperses == b.disperses);
    for (size_t k = 0; k < sizeof a / sizeof(float); k++) {
        float x, y;
        memcpy(&x, (const char *)&a + k * sizeof x, sizeof x);
        memcpy(&y, (const char *)&b + k * sizeof y, sizeof y);
        off = fmax(off, fabs((double)x - (double)y) / fmax(1.0, fabs((double)x)));
    }
    return off;
}

/* Lobes of all roughnesses, before they take anything from tables. */
static void begin_lobes(struct kiln_bsdf_lobes lobes[ROUGHNESSES], const struct material *m)
{
    for (int k = 0; k < ROUGHNESSES; k++) {
        const float roughness = (float)k / (float)(ROUGHNESSES - 1);
        lobes[k] = kiln_bsdf_begin(colored_material(m, roughness * roughness));
        kiln_bsdf_means(&lobes[k]);
    }
}

static double prepared(struct gpu *gpu, struct gpu_kernel *kernel, const struct material *m)
{
    struct kiln_bsdf_lobes lobes[ROUGHNESSES];
    struct gpu_buffer buffers[2];
    begin_lobes(lobes, m);
    const struct kiln_bsdf_tables tables = textured_tables(m, lobes[0].p);
    const struct kiln_bsdf_tables moved = upload_tables(gpu, &tables, &buffers[1]);
    assert_int_equal(gpu_buffer_of(gpu, &buffers[0], lobes, sizeof lobes, "lobes", NULL), KILN_OK);
    const struct prepare_push push = {0, buffers[0].address, moved, ROUGHNESSES};
    const struct gpu_step step = {
        .kernel = kernel, .threads_x = ROUGHNESSES, .threads_y = 1, .constants = &push, .constant_bytes = sizeof push};
    assert_int_equal(gpu_run(gpu, &step, 1, NULL, NULL), KILN_OK);
    assert_int_equal(gpu_download(gpu, &buffers[0], 0, lobes, sizeof lobes, NULL), KILN_OK);
    double off = 0.0;
    const uint64_t first = buffers[1].address, host = (uint64_t)tables.brushed_high << 32 | tables.brushed_low;
    for (int k = 0; k < ROUGHNESSES; k++) {
        const struct kiln_bsdf_lobes l = kiln_bsdf_prepare_hit(lobes[k].p, tables);
        const uint64_t there = (uint64_t)lobes[k].brushed_high << 32 | lobes[k].brushed_low;
        off = fmax(off, lobes_apart(lobes[k], l));
        if (host != 0 && l.base_is_mirror == 0)
            assert_true(there - first == (uint64_t)(uintptr_t)kiln_brushed_of(&l) - host);
    }
    for (int i = 0; i < 2; i++)
        gpu_buffer_destroy(gpu, &buffers[i]);
    return off;
}

static void hits_with_textures(void **state)
{
    const struct gpu_kernel_params params = {.name = "prepare", .code = &kiln_code_bsdf_prepare};
    struct gpu_kernel *kernel = NULL;
    assert_int_equal(gpu_kernel_create(*state, &kernel, &params, NULL), KILN_OK);
    for (size_t i = 0; i < MATERIALS; i++) {
        if (!materials[i].textured)
            continue;
        const double off = prepared(*state, kernel, &materials[i]);
        print_message("%s: lobes apart by at most %.1e\n", materials[i].name, off);
        assert_true(off < 1e-4);
    }
    gpu_kernel_destroy(*state, &kernel);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(same_as_host), cmocka_unit_test(hits_with_textures),
                                       cmocka_unit_test(whole_materials)};
    if (!vulkan_device_is_there())
        return 77;
    return cmocka_run_group_tests(tests, vulkan_device_open, vulkan_device_close);
}
