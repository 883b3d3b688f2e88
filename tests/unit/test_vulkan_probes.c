/* Tests of probes and emission on a Vulkan device against Embree: both use the same rays and random numbers, so only
 * rounding differs. The bits do not depend on how probes are divided into calls. Skipped (77) if there is no device. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/surface/surface_build.h"
#include "shaders/shared/random.h"
#include "tests/unit/surface_scene.h"
#include "tests/unit/vulkan_device.h"
#include "worker/backend/emission.h"
#include "worker/backend/vulkan/vulkan.h"
#include "worker/light/lights.h"
#include "worker/pass/probes.h"
#include "worker/scene/radiosity.h"

enum { PROBES = 150, SAMPLES = 400 }; /* a slice of samples that is not full, more probes than a workgroup */

#define FIRST_NUMBER 0xfffffff0ull /* of the probes: numbers pass 2^32 */

struct world {
    struct fixture *fixture;
    struct kiln_light punctual[3];
    float sky[6 * 3 * 3];
    struct kiln_geometry *geometry;
    struct kiln_lights *lights;
    struct kiln_surface *surface;
    uint64_t *radiosity;
    struct kiln_vec3 positions[PROBES];
};

enum { AREA = 1, PUNCTUAL = 2, SUN = 4, SKY = 8, IMAGE = 16, ALPHA = 32, TEXTURE = 64 };

static void add_lights(struct world *w, unsigned wish)
{
    struct fixture *f = w->fixture;
    f->scene.lights = w->punctual;
    if (wish & PUNCTUAL) {
        w->punctual[f->scene.light_count++] = (struct kiln_light){
            .kind = KILN_LIGHT_POINT, .position = {0.4, 1.5, -0.3}, .intensity = {3, 2, 1}, .range = 20.0f};
        w->punctual[f->scene.light_count++] = (struct kiln_light){.kind = KILN_LIGHT_SPOT,
                                                                  .position = {-2, 2, 2},
                                                                  .direction = {0.577350f, -0.577350f, -0.577350f},
                                                                  .intensity = {9, 9, 9},
                                                                  .cos_inner = 0.95f,
                                                                  .cos_outer = 0.7f};
    }
    if (wish & SUN)
        w->punctual[f->scene.light_count++] =
            (struct kiln_light){.kind = KILN_LIGHT_DIRECTIONAL, .direction = {0.6f, -0.8f, 0}, .intensity = {1, 1, 2}};
    if (wish & SKY)
        f->environment = (struct kiln_environment){.kind = KILN_ENVIRONMENT_CONSTANT, .radiance = {0.5f, 1, 2}};
    if (wish & IMAGE) {
        for (size_t i = 0; i < sizeof w->sky / sizeof *w->sky; i++)
            w->sky[i] = (float)fixture_random(f);
        f->environment = (struct kiln_environment){
            .kind = KILN_ENVIRONMENT_LATLONG, .radiance = {1, 1, 1}, .rotation = 0.7f, .width = 6, .height = 3};
        f->scene.environment_texels = w->sky;
    }
}

/* Which of a triangle's points are lit is noise; how much light they send is not. */
static void invent_radiosity(struct world *w)
{
    w->radiosity = calloc(w->surface->point_count + 1, sizeof *w->radiosity);
    for (uint64_t i = 0; i < w->surface->point_count; i++) {
        const float level = 1.0f + 0.2f * (float)fixture_random(w->fixture), rgb[3] = {level, 2.0f * level, 0.5f};
        w->radiosity[i] = kiln_radiosity_pack(rgb, kiln_hash1((uint32_t)i));
    }
}

/* A floor, a box, a lamp and a curtain; probes all over, some within the box. */
static void build(struct world *w, unsigned wish)
{
    static const double flat[4] = {0.02, 0.98, 0.02, 0.98}, lifted[12] = {0.5, 0, 0, 0, 0, 0.5, 0, 0.6, 0, 0, 0.5, 0};
    static const double mirrored[12] = {-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    *w = (struct world){.fixture = fixture_create()};
    struct fixture *f = w->fixture;
    const uint32_t grey = fixture_material(f, 0.5f, 0.5f, 0.5f), lamp = fixture_material(f, 0, 0, 0),
                   curtain = fixture_material(f, 1, 1, 1);
    uint32_t texture;
    uint8_t *texels = fixture_texture(f, 8, 8, &texture);
    for (int i = 0; i < 256; i++)
        texels[i] = (uint8_t)(256.0 * fixture_random(f));
    f->textures[texture].nearest = 0;
    if (wish & AREA)
        memcpy(f->materials[lamp].emission, (const float[3]){5, 4, 3}, sizeof f->materials[lamp].emission);
    if (wish & TEXTURE)
        f->materials[lamp].emission_texture = texture;
    f->materials[curtain].double_sided = 1;
    if (wish & ALPHA) {
        f->materials[curtain].alpha_mode = KILN_ALPHA_MASK;
        f->materials[curtain].alpha_cutoff = 0.5f;
        f->materials[curtain].base_color_texture = texture;
    }
    fixture_mesh(f);
    fixture_sheet(f, dvec3(-3, 0, 3), dvec3(6, 0, 0), dvec3(0, 0, -6), 4, flat, 0.2, grey);
    fixture_cube(f, 2, 0.0, grey);
    fixture_mesh(f);
    fixture_sheet(f, dvec3(-0.5, 2.9, -0.5), dvec3(1, 0, 0), dvec3(0, 0, 1), 1, flat, 0.0, lamp);
    memcpy(f->emission, f->base, f->scene.vertex_count * sizeof *f->emission);
    fixture_mesh(f);
    fixture_sheet(f, dvec3(1.5, 0, -1), dvec3(0, 0, 2), dvec3(0, 2, 0), 2, flat, 0.0, curtain);
    fixture_object(f, 0, NULL, 24, 24);
    fixture_object(f, 1, lifted, 24, 24);
    fixture_object(f, 2, NULL, 4, 4);
    fixture_object(f, 3, NULL, 16, 16);
    fixture_object(f, 3, mirrored, 16, 16);
    add_lights(w, wish);
    struct kiln_surface_report report;
    assert_int_equal(kiln_geometry_create(&w->geometry, &f->scene, NULL), KILN_OK);
    assert_int_equal(kiln_lights_create(&w->lights, &f->scene, w->geometry, NULL), KILN_OK);
    assert_int_equal(kiln_surface_build(&w->surface,
                                        &(struct kiln_surface_params){
                                            .scene = &f->scene, .geometry = w->geometry, .ranks = 1, .threads = 1},
                                        &report, NULL),
                     KILN_OK);
    invent_radiosity(w);
    for (int i = 0; i < PROBES; i++)
        w->positions[i] = vec3((float)(6.0 * fixture_random(f) - 3.0), (float)(3.0 * fixture_random(f) + 0.01),
                               (float)(6.0 * fixture_random(f) - 3.0));
}

static void release(struct world *w)
{
    free(w->radiosity);
    kiln_surface_destroy(&w->surface);
    kiln_lights_destroy(&w->lights);
    kiln_geometry_destroy(&w->geometry);
    fixture_destroy(w->fixture);
}

static const struct kiln_device_faults no_faults = {0};

static struct kiln_backend *open_backend(const struct world *w, const char *name, double slice_seconds,
                                         struct kiln_device_faults faults)
{
    struct kiln_error error = {0};
    struct kiln_backend *backend = NULL;
    const struct kiln_backend_params params = {.scene = &w->fixture->scene,
                                               .geometry = w->geometry,
                                               .lights = w->lights,
                                               .seed = 0x123456789abull,
                                               .slice_seconds = slice_seconds,
                                               .faults = faults};
    if (kiln_backend_create(&backend, name, &params, &error) != KILN_OK ||
        kiln_backend_set_surface(backend, w->surface, &error) != KILN_OK ||
        kiln_backend_set_radiosity(backend, w->radiosity, &error) != KILN_OK)
        fail_msg("%s: %s", name, error.message);
    return backend;
}

/* kiln_take_results; the context is the array's entry of the probe with number FIRST_NUMBER. */
static int keep_probes(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    (void)error;
    memcpy((struct kiln_probe_result *)context + (first - FIRST_NUMBER), results,
           count * sizeof(struct kiln_probe_result));
    return KILN_OK;
}

static uint64_t probes(struct kiln_backend *backend, const struct world *w, size_t first, size_t count,
                       struct kiln_probe_result *results)
{
    struct kiln_error error = {0};
    uint64_t rays = 0;
    const struct kiln_batch batch = {.first = FIRST_NUMBER + first,
                                     .count = count,
                                     .positions = w->positions + first,
                                     .samples = SAMPLES,
                                     .take = keep_probes,
                                     .context = results};
    if (kiln_backend_run(backend, &kiln_pass_probes, &(struct kiln_probe_parameters){0}, &batch, &rays, &error) !=
        KILN_OK)
        fail_msg("%s", error.message);
    return rays;
}

/* Worst difference over all probes, as a share of the strongest coefficient of the probe. A ray that meets another
 * texel or another side of an edge changes a probe by about 1 / SAMPLES; few may. */
static void compare(const struct kiln_probe_result *a, const struct kiln_probe_result *b, const char *what)
{
    double worst = 0.0;
    int rounding = 0;
    for (int i = 0; i < PROBES; i++) {
        const float *x = (const float *)&a[i], *y = (const float *)&b[i];
        double scale = 1e-3, off = 0.0;
        for (int k = 0; k < 45; k++) {
            scale = fmax(scale, fabs((double)x[k]));
            off = fmax(off, fabs((double)x[k] - (double)y[k]));
        }
        off = fmax(off / scale, fmax(fabs((double)x[45] / (double)y[45] - 1.0), fabs((double)x[46] - (double)y[46])));
        worst = fmax(worst, off);
        rounding += off < 2e-5;
    }
    print_message("%s: %d of %d probes agree within 2e-5, the worst within %.1e\n", what, rounding, PROBES, worst);
    assert_true(rounding >= PROBES * 9 / 10 && worst < 0.02);
}

static void agree_in(unsigned wish, const char *what)
{
    struct world w;
    struct kiln_probe_result *results[2];
    uint64_t rays[2];
    build(&w, wish);
    for (int i = 0; i < 2; i++) {
        struct kiln_backend *backend = open_backend(&w, i == 0 ? "embree" : "vulkan", 0.0, no_faults);
        results[i] = calloc(PROBES, sizeof *results[i]);
        rays[i] = probes(backend, &w, 0, PROBES, results[i]);
        kiln_backend_destroy(&backend);
    }
    compare(results[0], results[1], what);
    assert_true(rays[0] > 0 && fabs((double)rays[1] / (double)rays[0] - 1.0) < 1e-3);
    free(results[0]);
    free(results[1]);
    release(&w);
}

static void surfaces_alone(void **state)
{
    (void)state;
    agree_in(0, "surfaces alone");
}

static void each_kind_of_light(void **state)
{
    (void)state;
    agree_in(SKY, "constant sky");
    if (getenv("KILN_TEST_FULL") == NULL)
        return; /* the others are in what has everything at once */
    agree_in(AREA, "area light");
    agree_in(PUNCTUAL, "point and spot light");
    agree_in(SUN, "directional light");
    agree_in(IMAGE, "image of the sky");
}

static void everything_at_once(void **state)
{
    (void)state;
    agree_in(AREA | PUNCTUAL | SUN | IMAGE | ALPHA | TEXTURE, "all lights, a mask, a textured light");
}

/* Particles are made on the host, by one code; only what they hit comes from the device. */
static void emission_lands_alike(void **state)
{
    (void)state;
    struct world w;
    struct kiln_emission_result results[2];
    build(&w, AREA | PUNCTUAL | SUN | IMAGE | ALPHA | TEXTURE);
    for (int i = 0; i < 2; i++) {
        struct kiln_backend *backend = open_backend(&w, i == 0 ? "embree" : "vulkan", 0.0, no_faults);
        assert_int_equal(kiln_backend_emission(backend, 1 << 16, &results[i], NULL), KILN_OK);
        kiln_backend_destroy(&backend);
    }
    for (int c = 0; c < 3; c++) {
        assert_true(results[0].emitted[c] > 0.0 && results[0].emitted[c] == results[1].emitted[c]);
        const double most = 1e-4 * results[0].emitted[c];
        assert_true(fabs(results[0].received[c] - results[1].received[c]) <= most &&
                    fabs(results[0].blocked[c] - results[1].blocked[c]) <= most);
        assert_true(fabs(results[0].escaped[c] - results[1].escaped[c]) <= most);
        assert_true(fabs(results[0].ranged[c] - results[1].ranged[c]) <= most && results[0].ranged[c] > 0.0);
    }
    release(&w);
}

static void any_chunks_give_the_same_bits(void **state)
{
    (void)state;
    struct world w;
    struct kiln_probe_result *whole = calloc(PROBES, sizeof *whole), *parts = calloc(PROBES, sizeof *parts);
    build(&w, AREA | PUNCTUAL | SUN | IMAGE);
    struct kiln_backend *backend = open_backend(&w, "vulkan", 0.0, no_faults);
    const uint64_t rays = probes(backend, &w, 0, PROBES, whole);
    uint64_t again = 0;
    static const size_t cuts[] = {0, 1, 4, 67, 68, PROBES};
    for (size_t i = 0; i + 1 < sizeof cuts / sizeof *cuts; i++)
        again += probes(backend, &w, cuts[i], cuts[i + 1] - cuts[i], parts);
    assert_true(again == rays);
    assert_memory_equal(whole, parts, PROBES * sizeof *whole);
    kiln_backend_destroy(&backend);
    free(whole);
    free(parts);
    release(&w);
}

/* Opens a device whose `call`-th Vulkan call fails, and asks for all probes; gives how many calls there were. */
static uint64_t with_fault(const struct world *w, enum kiln_device_fault kind, uint64_t call,
                           struct kiln_probe_result *results, uint32_t *recoveries)
{
    /* the least there is in each: as many calls each time */
    struct kiln_backend *backend =
        open_backend(w, "vulkan", 1e-9, (struct kiln_device_faults){.kind = kind, .at = call});
    assert_true(probes(backend, w, 0, PROBES, results) > 0);
    const struct vulkan_backend *b = (const struct vulkan_backend *)backend;
    const uint64_t calls = b->faults.calls;
    *recoveries = b->recoveries;
    kiln_backend_destroy(&backend);
    return calls;
}

/* Wherever the device is lost, or says once that memory is short, the answers are the same in the end. */
static void failing_devices_change_nothing(void **state)
{
    const uint64_t tries = getenv("KILN_TEST_FULL") != NULL ? 8 : 4;
    (void)state;
    struct world w;
    struct kiln_probe_result *whole = calloc(PROBES, sizeof *whole), *again = calloc(PROBES, sizeof *again);
    uint32_t recoveries;
    build(&w, AREA);
    const uint64_t calls = with_fault(&w, KILN_DEVICE_FAULT_LOST, 1000000, whole, &recoveries);
    for (uint64_t i = 1; i <= tries; i++) { /* the later half, where the probes are */
        memset(again, 0, PROBES * sizeof *again);
        (void)with_fault(&w, i % 2 == 0 ? KILN_DEVICE_FAULT_LOST : KILN_DEVICE_FAULT_MEMORY,
                         calls / 2 + calls / 2 * i / (tries + 1), again, &recoveries);
        assert_true(recoveries == 1);
        assert_memory_equal(whole, again, PROBES * sizeof *whole);
    }
    free(whole);
    free(again);
    release(&w);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(surfaces_alone),
        cmocka_unit_test(each_kind_of_light),
        cmocka_unit_test(everything_at_once),
        cmocka_unit_test(emission_lands_alike),
        cmocka_unit_test(any_chunks_give_the_same_bits),
        cmocka_unit_test(failing_devices_change_nothing),
    };
    if (!vulkan_device_is_there())
        return 77;
    return cmocka_run_group_tests(tests, NULL, NULL);
}
