/* Tests of opacity, transmission and emission of surfaces on the device against the host. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "coordinator/import/import.h"
#include "tests/modules.h"
#include "tests/unit/surface_scene.h"
#include "tests/unit/vulkan_device.h"
#include "worker/backend/vulkan/materials.h"
#include "worker/scene/texture.h"

enum { PLACES = 20000, TEXTURES = 12, TEXELS = 1 << 22 };

struct place {
    uint32_t triangle, emission;
    float u, v;
};
struct push {
    uint64_t scene, places, answers;
    uint32_t count;
};

struct device {
    struct gpu *gpu;
    struct gpu_kernel *kernel;
};

static int open_device(void **state)
{
    static struct device device;
    struct kiln_error error = {0};
    const int status = gpu_create(&device.gpu, &(struct gpu_choice){.device = -1}, &error);
    if (status != KILN_OK) {
        print_error("%s\n", error.message);
        return -1;
    }
    const struct gpu_kernel_params params = {.name = "materials", .code = &kiln_code_materials};
    *state = &device;
    return gpu_kernel_create(device.gpu, &device.kernel, &params, NULL);
}

static int close_device(void **state)
{
    struct device *device = *state;
    gpu_kernel_destroy(device->gpu, &device->kernel);
    gpu_destroy(&device->gpu);
    return 0;
}

/* The answers of all places, four floats each. */
static void evaluate(struct device *d, const struct kiln_gpu_materials *layout, const struct place *places,
                     float *answers)
{
    const struct kiln_gpu_scene scene = {.materials = *layout};
    struct gpu_buffer buffers[3];
    assert_int_equal(gpu_buffer_of(d->gpu, &buffers[0], &scene, sizeof scene, "a scene", NULL), KILN_OK);
    assert_int_equal(gpu_buffer_of(d->gpu, &buffers[1], places, PLACES * sizeof *places, "places", NULL), KILN_OK);
    assert_int_equal(gpu_buffer_create(d->gpu, &buffers[2], PLACES * 4 * sizeof(float), GPU_DEVICE, "answers", NULL),
                     KILN_OK);
    const struct push push = {buffers[0].address, buffers[1].address, buffers[2].address, PLACES};
    const struct gpu_step step = {
        .kernel = d->kernel, .threads_x = PLACES, .threads_y = 1, .constants = &push, .constant_bytes = sizeof push};
    assert_int_equal(gpu_run(d->gpu, &step, 1, NULL, NULL), KILN_OK);
    assert_int_equal(gpu_download(d->gpu, &buffers[2], 0, answers, PLACES * 4 * sizeof(float), NULL), KILN_OK);
    for (int i = 0; i < 3; i++)
        gpu_buffer_destroy(d->gpu, &buffers[i]);
}

static void expected(const struct kiln_scene *scene, const struct kiln_geometry *g, const struct place *p,
                     float rgba[4])
{
    const struct kiln_mesh *mesh = &scene->meshes[scene->objects[g->records[p->triangle].object].mesh];
    float b1, b2;
    kiln_geometry_stored_barycentrics(scene, g, p->triangle, p->u, p->v, &b1, &b2);
    rgba[3] = 0.0f;
    if (p->emission) {
        kiln_surface_emission(scene, mesh, g->stored_triangle[p->triangle], b1, b2, rgba);
        return;
    }
    struct kiln_passage passage;
    kiln_surface_passage(scene, mesh, g->stored_triangle[p->triangle], b1, b2, 1.0f, &passage);
    memcpy(rgba, passage.through, sizeof passage.through);
    rgba[3] = passage.opacity;
}

static double uniform(uint64_t *seed)
{
    *seed = *seed * 6364136223846793005u + 1442695040888963407u;
    return (double)(*seed >> 11) * 0x1p-53;
}

/* Random places on triangles that the device has, of both kinds where there are both. */
static void choose_places(const struct kiln_backend_params *params, struct place *places)
{
    const struct kiln_geometry *g = params->geometry;
    uint64_t seed = 1;
    for (size_t i = 0; i < PLACES;) {
        const uint32_t triangle = (uint32_t)(uniform(&seed) * (double)g->triangle_count);
        if (!vulkan_materials_holds(params, triangle))
            continue;
        const bool emission = triangle < g->opaque_count ||
                              ((g->records[triangle].material & KILN_RECORD_EMITS) != 0 && uniform(&seed) < 0.5);
        double u = uniform(&seed), v = uniform(&seed);
        if (u + v > 1.0)
            u = 1.0 - u, v = 1.0 - v;
        places[i++] = (struct place){triangle, emission, (float)u, (float)v};
    }
}

/* Worst difference, in units of the material's factor. A nearest filter may take the neighbour where a place lies on
 * its border within rounding: such places are counted, and must be few. */
static void compare(struct device *device, const struct kiln_scene *scene, const char *name)
{
    struct kiln_geometry *g = NULL;
    assert_int_equal(kiln_geometry_create(&g, scene, NULL), KILN_OK);
    const struct kiln_backend_params params = {.scene = scene, .geometry = g};
    struct vulkan_materials materials;
    struct kiln_gpu_materials layout;
    assert_int_equal(vulkan_materials_create(device->gpu, &params, false, &materials, &layout, NULL), KILN_OK);
    struct place *places = malloc(PLACES * sizeof *places);
    float *answers = malloc(PLACES * 4 * sizeof *answers);
    choose_places(&params, places);
    evaluate(device, &layout, places, answers);
    double worst = 0.0, largest = 0.0;
    size_t off = 0;
    for (size_t i = 0; i < PLACES; i++) {
        float want[4];
        double difference = 0.0;
        expected(scene, g, &places[i], want);
        for (int c = 0; c < 4; c++) {
            const double scale = fmax(1.0, places[i].emission ? fabs((double)want[c]) : 1.0);
            difference = fmax(difference, fabs((double)answers[4 * i + (size_t)c] - (double)want[c]) / scale);
            largest = fmax(largest, (double)want[c]);
        }
        if (!(difference <= 1e-6))
            off++;
        else
            worst = fmax(worst, difference);
    }
    print_message("%s: %zu of %d places differ, the others by at most %.1e\n", name, off, PLACES, worst);
    assert_true(largest > 0.0 && off <= PLACES / 1000);
    free(places);
    free(answers);
    vulkan_materials_destroy(device->gpu, &materials);
    kiln_geometry_destroy(&g);
}

/* Textures of odd sizes with every filter, wrap and coding; coordinates far outside of 0..1, some very far. */
static void textures_of_all_kinds(void **state)
{
    static const uint32_t sizes[TEXTURES][2] = {{1, 1},    {7, 3},   {64, 64}, {1024, 512}, {2, 333},   {65536, 2},
                                                {1, 8192}, {31, 31}, {256, 1}, {3, 5},      {500, 500}, {16, 16}};
    struct fixture *f = fixture_create();
    struct kiln_texture textures[TEXTURES];
    uint8_t *texels = malloc(TEXELS);
    uint64_t used = 1; /* textures need not begin at whole words */
    for (size_t i = 0; i < TEXELS; i++)
        texels[i] = (uint8_t)(256.0 * fixture_random(f));
    for (uint32_t i = 0; i < TEXTURES; i++) {
        textures[i] = (struct kiln_texture){.first = used,
                                            .width = sizes[i][0],
                                            .height = sizes[i][1],
                                            .srgb = i % 2,
                                            .nearest = i % 4 == 3,
                                            .wrap_u = i % 3,
                                            .wrap_v = i / 3 % 3};
        used += 4 * (uint64_t)sizes[i][0] * sizes[i][1];
    }
    assert_true(used <= TEXELS);
    f->scene.textures = textures;
    f->scene.texture_count = TEXTURES;
    f->scene.texels = texels;
    const uint32_t plain = fixture_material(f, 1, 1, 1);
    for (uint32_t i = 0; i < TEXTURES; i++) {
        struct kiln_material *m =
            &f->materials[fixture_material(f, (float)fixture_random(f), (float)fixture_random(f), 1.0f)];
        m->base_color[3] = 0.9f;
        m->base_color_texture = i;
        m->alpha_mode = i % 3; /* one in three is opaque */
        m->alpha_cutoff = 0.5f;
        m->metallic = (float)(i % 5) / 5.0f;
        m->transmission = i % 5 < 2 ? 0.0f : (float)i / TEXTURES;
        m->transmission_texture = i % 2 == 0 ? KILN_NONE : (i + 3) % TEXTURES;
        m->emission_texture = i % 4 == 0 ? KILN_NONE : TEXTURES - 1 - i;
        m->emission[1] = i % 2 == 0 ? 0.0f : 1000.0f;
        m->emission[2] = i % 2 == 0 ? 0.0f : 0.25f;
    }
    static const double flat[4] = {0.01, 0.99, 0.01, 0.99};
    for (uint32_t m = 0; m < 2; m++) {
        fixture_mesh(f);
        for (uint32_t i = 0; i <= TEXTURES; i++)
            fixture_sheet(f, dvec3(i, 0, 0), dvec3(1, 0, 0), dvec3(0, 1, 0), 3, flat, 0.1,
                          (i * 5 + m) % (TEXTURES + 1) == 0 ? plain : 1 + (i * 5 + m) % TEXTURES);
    }
    for (size_t i = 0; i < f->scene.vertex_count; i++) {
        const double reach = i % 7 == 0 ? 3000.0 : 3.0;
        f->base[i] =
            (struct kiln_vec2){(float)(reach * (fixture_random(f) - 0.5)), (float)(reach * (fixture_random(f) - 0.5))};
        f->emission[i] =
            (struct kiln_vec2){(float)(reach * (fixture_random(f) - 0.5)), (float)(reach * (fixture_random(f) - 0.5))};
        for (size_t c = 0; c < 4; c++)
            f->colors[4 * i + c] = (uint8_t)(256.0 * fixture_random(f));
    }
    static const double mirrored[12] = {-1, 0, 0, 0, 0, 1, 0, 3, 0, 0, 1, 0};
    fixture_object(f, 0, NULL, 8, 8);
    fixture_object(f, 1, mirrored, 8, 8);
    fixture_object(f, 1, NULL, 8, 8);
    compare(*state, &f->scene, "textures of all kinds");
    free(texels);
    fixture_destroy(f);
}

/* Nothing is uploaded for a scene that asks for nothing. */
static void plain_scenes_cost_nothing(void **state)
{
    struct device *device = *state;
    struct fixture *f = fixture_create();
    f->materials[fixture_material(f, 1, 1, 1)].emission[0] = 5.0f;
    fixture_cube(f, 2, 0.0, 0);
    fixture_object(f, 0, NULL, 8, 8);
    struct kiln_geometry *g = NULL;
    assert_int_equal(kiln_geometry_create(&g, &f->scene, NULL), KILN_OK);
    struct vulkan_materials materials;
    struct kiln_gpu_materials layout;
    const uint64_t before = gpu_memory_used(device->gpu);
    assert_int_equal(vulkan_materials_create(device->gpu,
                                             &(struct kiln_backend_params){.scene = &f->scene, .geometry = g}, false,
                                             &materials, &layout, NULL),
                     KILN_OK);
    assert_int_equal(gpu_memory_used(device->gpu), before);
    assert_true(layout.coatings == 0 && layout.slots == 0);
    vulkan_materials_destroy(device->gpu, &materials);
    kiln_geometry_destroy(&g);
    fixture_destroy(f);
}

static void imported_scene(struct device *device, const char *path)
{
    char output[] = "/tmp/kiln-materials-XXXXXX", file[64];
    const int descriptor = mkstemp(output);
    assert_true(descriptor >= 0);
    (void)close(descriptor);
    struct kiln_import_params params = {
        .path = path, .output = output, .environment_scale = 1.0, .program = getenv("KILN")};
    struct kiln_import_report report = {0};
    struct kiln_error error = {0};
    struct kiln_scene *scene = NULL;
    (void)snprintf(file, sizeof file, "%s", output);
    assert_int_equal(unlink(output), 0);
    if (kiln_import(&params, &report, &error) != KILN_OK || kiln_scene_open(&scene, file, &error) != KILN_OK)
        fail_msg("%s: %s", path, error.message);
    compare(device, scene, path);
    kiln_scene_close(&scene);
    (void)unlink(file);
}

static void scenes_from_files(void **state)
{
    if (getenv("KILN") == NULL)
        skip();
    imported_scene(*state, "tests/data/analytic/penumbra_alphamask.glb");
    imported_scene(*state, "tests/data/analytic/textured_emitter.glb");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(textures_of_all_kinds),
        cmocka_unit_test(plain_scenes_cost_nothing),
        cmocka_unit_test(scenes_from_files),
    };
    if (!vulkan_device_is_there())
        return 77;
    return cmocka_run_group_tests(tests, open_device, close_device);
}
