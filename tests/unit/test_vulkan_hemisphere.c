/* The passes over the hemisphere of points (occlusion, light by direction, guided gathers) on a Vulkan device against
 * Embree: both use the same rays and random numbers, so only rounding differs. Skipped (77) if there is no device. */
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
#include "worker/backend/backend.h"
#include "worker/light/lights.h"
#include "worker/base/memory.h"
#include "worker/pass/caustic.h"
#include "worker/pass/direct.h"
#include "worker/pass/directional.h"
#include "worker/pass/gather.h"
#include "worker/pass/guided.h"
#include "worker/pass/occlusion.h"
#include "worker/pass/validity.h"
#include "worker/scene/gloss.h"
#include "worker/scene/radiosity.h"

/* quarters that are not equally large, slices that are not full; of chains few, which a software device is slow with */
enum { SAMPLES = 150, CHAIN_SAMPLES = 30, POINT_FLOATS = offsetof(struct kiln_point_result, count) / sizeof(float) };

struct world {
    struct fixture *fixture;
    struct kiln_gloss glosses[4];
    struct kiln_light lights_of_scene[2];
    float sky[6 * 3 * 3];
    struct kiln_geometry *geometry;
    struct kiln_lights *lights;
    struct kiln_surface *surface;
    uint64_t *radiosity;
    struct kiln_backend *backends[2];
};

static const char *const names[2] = {"embree", "vulkan"};

static void add_lights(struct world *w)
{
    struct fixture *f = w->fixture;
    f->scene.lights = w->lights_of_scene;
    w->lights_of_scene[f->scene.light_count++] =
        (struct kiln_light){.kind = KILN_LIGHT_POINT, .position = {0.4, 1.5, -0.3}, .intensity = {3, 2, 1}};
    w->lights_of_scene[f->scene.light_count++] =
        (struct kiln_light){.kind = KILN_LIGHT_DIRECTIONAL, .direction = {0.6f, -0.8f, 0}, .intensity = {1, 1, 2}};
    for (size_t i = 0; i < sizeof w->sky / sizeof *w->sky; i++)
        w->sky[i] = (float)fixture_random(f);
    f->environment = (struct kiln_environment){
        .kind = KILN_ENVIRONMENT_LATLONG, .radiance = {1, 1, 1}, .rotation = 0.7f, .width = 6, .height = 3};
    f->scene.environment_texels = w->sky;
}

static struct kiln_backend_params params_of(const struct world *w)
{
    return (struct kiln_backend_params){.scene = &w->fixture->scene,
                                        .geometry = w->geometry,
                                        .lights = w->lights,
                                        .threads = 2,
                                        .seed = 0x123456789abull};
}

/* Opens a backend and runs the validity pass. */
static void open_backend(struct world *w, int b, const struct kiln_backend_params *params)
{
    struct kiln_error error = {""};
    const struct kiln_batch looks = {
        .count = w->surface->tile_run_count, .take = kiln_validity_keep, .context = w->surface};
    uint64_t rays = 0;
    if (kiln_backend_create(&w->backends[b], names[b], params, &error) != KILN_OK ||
        kiln_backend_set_surface(w->backends[b], w->surface, &error) != KILN_OK ||
        kiln_backend_set_radiosity(w->backends[b], w->radiosity, &error) != KILN_OK ||
        kiln_backend_run(w->backends[b], &kiln_pass_validity, NULL, &looks, &rays, &error) != KILN_OK)
        fail_msg("%s: %s", names[b], error.message);
}

static void finish(struct world *w)
{
    struct fixture *f = w->fixture;
    assert_int_equal(kiln_scene_take_gloss(&f->scene, KILN_GLOSS_MODE_AUTO, NULL), KILN_OK);
    assert_int_equal(kiln_geometry_create(&w->geometry, &f->scene, NULL), KILN_OK);
    assert_int_equal(kiln_lights_create(&w->lights, &f->scene, w->geometry, NULL), KILN_OK);
    const struct kiln_surface_params params = {.scene = &f->scene, .geometry = w->geometry, .ranks = 1, .threads = 1};
    assert_int_equal(kiln_surface_build(&w->surface, &params, &(struct kiln_surface_report){0}, NULL), KILN_OK);
    w->radiosity = calloc(w->surface->point_count, sizeof *w->radiosity);
    for (uint64_t i = 0; i < w->surface->point_count; i++) { /* which of two texels a ray meets matters little */
        const float level = 1.0f + 0.2f * (float)fixture_random(f), rgb[3] = {level, 2.0f * level, 0.5f};
        w->radiosity[i] = kiln_radiosity_pack(rgb, kiln_hash1((uint32_t)i));
    }
    const struct kiln_backend_params backend_params = params_of(w);
    for (int b = 0; b < 2; b++)
        open_backend(w, b, &backend_params);
}

/* A material that light transport takes with its gloss. */
static struct kiln_gloss *add_gloss(struct world *w, uint32_t material)
{
    struct kiln_scene *scene = &w->fixture->scene;
    scene->glosses = w->glosses;
    w->glosses[scene->gloss_count] = kiln_gloss_default(&w->fixture->materials[material], material);
    return &w->glosses[scene->gloss_count++];
}

/* Hangs things above the floor that are not diffuse: a smooth, rough, coated and tinted body of glass, a rough metal
 * with shading normals, a mirror and a polished wall. */
static void add_things(struct world *w)
{
    static const double flat[4] = {0.02, 0.98, 0.02, 0.98}, hung[12] = {0.3, 0, 0, 0.9, 0, 0.3, 0, 1.1, 0, 0, 0.3, 0.6};
    struct fixture *f = w->fixture;
    const uint32_t metal = fixture_material(f, 0.9f, 0.7f, 0.4f), glass = fixture_material(f, 1, 1, 1),
                   mirror = fixture_material(f, 0.9f, 0.9f, 0.9f), wall = fixture_material(f, 0.6f, 0.3f, 0.2f);
    struct kiln_gloss *g = add_gloss(w, metal);
    g->metallic = g->mean_metallic = 1.0f;
    g->roughness = g->mean_roughness = 0.6f;
    g = add_gloss(w, glass);
    g->roughness = g->mean_roughness = 0.3f;
    g->transmission = 1.0f;
    g->flags = KILN_GLOSS_VOLUME;
    g->thickness = 1.0f;
    g->attenuation_distance = 0.5f;
    g->attenuation_color[0] = 0.4f;
    g = add_gloss(w, mirror);
    g->metallic = g->mean_metallic = 1.0f;
    g->roughness = g->mean_roughness = 0.0f;
    g = add_gloss(w, wall);
    g->roughness = g->mean_roughness = 0.4f;
    g->clearcoat = 0.5f;
    g->clearcoat_roughness = 0.1f;
    const uint32_t sheet = fixture_mesh(f);
    fixture_sheet(f, dvec3(-1.9, 1.2, 0.9), dvec3(1.2, 0, 0), dvec3(0, 0.4, -0.9), 2, flat, 0.1, metal);
    f->meshes[sheet].flags = KILN_MESH_SMOOTH;
    for (uint64_t i = 0; i < f->meshes[sheet].vertex_count; i++)
        f->normals[f->meshes[sheet].vertex_first + i] =
            vec3_normalize(vec3((float)(0.4 * fixture_random(f) - 0.2), 1.0f, (float)(0.4 * fixture_random(f) + 0.2)));
    const uint32_t body = fixture_cube(f, 1, 0.0, glass), two = fixture_mesh(f);
    fixture_sheet(f, dvec3(-1.9, 0.1, 1.9), dvec3(0, 0, -3.8), dvec3(0, 1, 0), 1, flat, 0.0, mirror);
    fixture_sheet(f, dvec3(-1.8, 0.1, -1.9), dvec3(3.6, 0, 0), dvec3(0, 2, 0), 1, flat, 0.0, wall);
    fixture_object(f, sheet, NULL, 8, 8);
    fixture_object(f, body, hung, 9, 6);
    fixture_object(f, two, NULL, 8, 8);
}

/* A floor, a box sunk into it by a part of a texel, a sheet with shading normals, a coloured curtain that lets light
 * through, and every kind of light but a constant sky; `glossy`: also things that are not diffuse. */
static void build(struct world *w, bool glossy)
{
    static const double flat[4] = {0.02, 0.98, 0.02, 0.98}, sunk[12] = {0.5, 0, 0, 0.07, 0, 0.5, 0, 0.43, 0, 0, 0.5, 0};
    *w = (struct world){.fixture = fixture_create()};
    struct fixture *f = w->fixture;
    const uint32_t grey = fixture_material(f, 0.5f, 0.5f, 0.5f), lamp = fixture_material(f, 0, 0, 0),
                   curtain = fixture_material(f, 1, 1, 1);
    uint32_t texture;
    uint8_t *texels = fixture_texture(f, 8, 8, &texture);
    for (int i = 0; i < 256; i++)
        texels[i] = (uint8_t)(256.0 * fixture_random(f));
    memcpy(f->materials[lamp].emission, (const float[3]){5, 4, 3}, sizeof f->materials[lamp].emission);
    f->materials[curtain].double_sided = 1;
    f->materials[curtain].alpha_mode = KILN_ALPHA_BLEND;
    f->materials[curtain].transmission = 0.5f;
    f->materials[curtain].transmission_texture = KILN_NONE;
    f->materials[curtain].base_color_texture = texture;
    fixture_mesh(f);
    fixture_sheet(f, dvec3(-2, 0, 2), dvec3(4, 0, 0), dvec3(0, 0, -4), 3, flat, 0.2, grey);
    fixture_cube(f, 1, 0.0, grey);
    fixture_mesh(f);
    fixture_sheet(f, dvec3(-0.5, 2.9, -0.5), dvec3(1, 0, 0), dvec3(0, 0, 1), 1, flat, 0.0, lamp);
    const uint32_t smooth = fixture_mesh(f);
    fixture_sheet(f, dvec3(-1.8, 0.3, 0), dvec3(0.8, 0, 0), dvec3(0, 0, -0.8), 2, flat, 0.1, grey);
    f->meshes[smooth].flags = KILN_MESH_SMOOTH;
    for (uint64_t i = 0; i < f->meshes[smooth].vertex_count; i++)
        f->normals[f->meshes[smooth].vertex_first + i] =
            vec3_normalize(vec3((float)(fixture_random(f) - 0.5), 1.0f, (float)(fixture_random(f) - 0.5)));
    fixture_mesh(f);
    fixture_sheet(f, dvec3(1.5, 0, -1), dvec3(0, 0, 2), dvec3(0, 2, 0), 2, flat, 0.0, curtain);
    fixture_object(f, 0, NULL, 28, 28);
    fixture_object(f, 1, sunk, 18, 12);
    fixture_object(f, 2, NULL, 4, 4);
    fixture_object(f, 3, NULL, 12, 12);
    fixture_object(f, 4, NULL, 10, 10);
    if (glossy)
        add_things(w);
    add_lights(w);
    finish(w);
}

static void release(struct world *w)
{
    for (int b = 0; b < 2; b++)
        kiln_backend_destroy(&w->backends[b]);
    free(w->radiosity);
    free(w->surface->guide);
    kiln_surface_destroy(&w->surface);
    kiln_lights_destroy(&w->lights);
    kiln_geometry_destroy(&w->geometry);
    kiln_free(&w->fixture->scene.taken);
    kiln_free(&w->fixture->scene.own_materials);
    kiln_free(&w->fixture->scene.panes);
    fixture_destroy(w->fixture);
}

/* Results of a run, in the order of points, all of the pass's type. */
struct kept {
    const struct kiln_surface *surface;
    size_t result_bytes;
    char *results;
};

static int keep(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    (void)error;
    const struct kept *k = context;
    const struct kiln_tile_run *run = &k->surface->tile_runs[first], *last = run + count - 1;
    memcpy(k->results + kiln_own_of_global(k->surface, run->first).at * k->result_bytes, results,
           (size_t)kiln_tile_runs_points(run, last) * k->result_bytes);
    return KILN_OK;
}

/* All results of a pass on backend b. */
static struct kept run(const struct world *w, int b, const struct kiln_pass *pass, const void *parameters,
                       uint32_t samples, uint64_t *rays)
{
    struct kiln_error error = {""};
    struct kept k = {.surface = w->surface,
                     .result_bytes = pass->result_bytes,
                     .results = calloc(w->surface->count, pass->result_bytes)};
    const struct kiln_batch batch = {
        .count = w->surface->tile_run_count, .samples = samples, .take = keep, .context = &k};
    if (kiln_backend_run(w->backends[b], pass, parameters, &batch, rays, &error) != KILN_OK)
        fail_msg("%s on %s: %s", pass->name, names[b], error.message);
    return k;
}

/* Both backends' results of a pass, each `floats` floats, the number of samples, and perhaps more: nearly all agree to
 * rounding; a ray that passes an edge on the other side changes a point by about a sample. The caller frees the results
 * that k gets. */
static void agree(const struct world *w, const struct kiln_pass *pass, const void *parameters, size_t floats,
                  struct kept k[2])
{
    uint64_t rays[2] = {0, 0}, same = 0, valid = 0;
    for (int b = 0; b < 2; b++)
        k[b] = run(w, b, pass, parameters, SAMPLES, &rays[b]);
    const size_t words = pass->result_bytes / sizeof(float);
    double worst = 0.0;
    for (uint64_t i = 0; i < w->surface->count; i++) {
        double scale = 1e-3 * SAMPLES, off = 0.0;
        const uint32_t *counts[2] = {(const uint32_t *)(const void *)k[0].results + i * words + floats,
                                     (const uint32_t *)(const void *)k[1].results + i * words + floats};
        const bool is_valid = kiln_point_valid(w->surface, (struct kiln_own_point){i});
        assert_true(*counts[0] == (is_valid ? SAMPLES : 0) && *counts[1] == *counts[0]);
        for (size_t c = 0; c < floats; c++) {
            const double x = (double)((const float *)(const void *)k[0].results)[i * words + c],
                         y = (double)((const float *)(const void *)k[1].results)[i * words + c];
            assert_true(is_valid || (x == 0.0 && y == 0.0));
            scale = fmax(scale, fabs(x));
            off = fmax(off, fabs(x - y));
        }
        valid += is_valid;
        same += is_valid && off < 1e-4 * scale;
        worst = fmax(worst, off / scale);
    }
    print_message("%s: %llu of %llu points agree within 1e-4, the worst within %.1e; %llu and %llu rays\n", pass->name,
                  (unsigned long long)same, (unsigned long long)valid, worst, (unsigned long long)rays[0],
                  (unsigned long long)rays[1]);
    assert_true(valid > 500 && same >= valid * 9 / 10 && worst < 0.1);
    assert_true(rays[0] > 0 && fabs((double)rays[1] / (double)rays[0] - 1.0) < 1e-3);
}

static void forget(struct kept k[2])
{
    free(k[0].results);
    free(k[1].results);
}

static void both_passes_agree(void **state)
{
    (void)state;
    struct world w;
    uint64_t partly = 0;
    build(&w, false);
    for (uint64_t i = 0; i < w.surface->count; i++)
        partly += w.surface->visible[i] != 0 && w.surface->visible[i] != 0xffff;
    assert_true(partly > 4);
    struct kept k[2];
    agree(&w, &kiln_pass_occlusion, &(struct kiln_occlusion_parameters){.distance = 0.7f}, 5, k);
    forget(k);
    agree(&w, &kiln_pass_directional, NULL, 12, k);
    forget(k);
    release(&w);
}

static const struct kiln_guided_result *guided(const struct kept *k) { return (const void *)k->results; }

/* Compares what both backends have learnt. Nearly all cells agree to the bits that a ray's luminance keeps; those of a
 * few tile runs have a ray more. Adds Embree's values to the surface's guide. */
static void learn(const struct world *w, const struct kept k[2], bool learns)
{
    uint64_t cells = 0, same = 0;
    for (size_t f = 0; f < w->surface->tile_run_count; f++) {
        const struct kiln_tile_run *tile_run = &w->surface->tile_runs[f];
        const uint64_t first = kiln_own_of_global(w->surface, tile_run->first).at;
        const uint32_t side = learns ? kiln_guide_side(tile_run->count) : 0;
        double most = 0.0;
        for (uint32_t c = 0; c < KILN_GUIDE_FLOATS * tile_run->count; c++) {
            const float x = guided(&k[0])[first + c / KILN_GUIDE_FLOATS].learnt[c % KILN_GUIDE_FLOATS];
            most = fmax(most, (double)x);
        }
        for (uint32_t c = 0; c < KILN_GUIDE_FLOATS * tile_run->count; c++) {
            const float x = guided(&k[0])[first + c / KILN_GUIDE_FLOATS].learnt[c % KILN_GUIDE_FLOATS],
                        y = guided(&k[1])[first + c / KILN_GUIDE_FLOATS].learnt[c % KILN_GUIDE_FLOATS];
            assert_true(isfinite(y) && y >= 0.0f && (c < side * side || (x == 0.0f && y == 0.0f)));
            cells += most > 0.0 && c < side * side;
            same += most > 0.0 && c < side * side && fabs((double)x - (double)y) < 1e-4 * most;
            w->surface->guide[KILN_GUIDE_FLOATS * first + c] += x;
        }
    }
    print_message("learnt: %llu of %llu cells agree\n", (unsigned long long)same, (unsigned long long)cells);
    assert_true(learns ? cells > 4000 && same >= cells * 98 / 100 : cells == 0);
}

/* Light of any unit is learnt alike. */
static void learn_at_scales(const struct world *w)
{
    static const int exponents[] = {-1, -1, -1, -40, 80}; /* one after the other */
    const struct kiln_guided_parameters parameters = {.learns = true};
    for (size_t e = 0; e < sizeof exponents / sizeof *exponents; e++) {
        struct kept k[2];
        for (uint64_t i = 0; i < w->surface->point_count; i++) {
            float rgb[3];
            kiln_radiosity_unpack(w->radiosity[i], rgb);
            for (int c = 0; c < 3; c++)
                rgb[c] = ldexpf(rgb[c], exponents[e]);
            w->radiosity[i] = kiln_radiosity_pack(rgb, 0);
        }
        for (int b = 0; b < 2; b++)
            assert_int_equal(kiln_backend_set_radiosity(w->backends[b], w->radiosity, NULL), KILN_OK);
        agree(w, &kiln_pass_guided, &parameters, POINT_FLOATS, k);
        learn(w, k, true);
        forget(k);
    }
}

/* A device that is lost for good while it gathers: Embree goes on, with the same guide. */
static void fall_back(struct world *w)
{
    enum { CALLS = 600, MOST_RUNS = 1000 };
    const struct kiln_guided_parameters both = {.learns = true, .follows = true};
    struct kiln_backend_params params = params_of(w);
    const struct kiln_device_faults lost = {.kind = KILN_DEVICE_FAULT_LOST, .at = CALLS, .every = 1};
    struct kiln_backend_info info = {.fell_back = false};
    params.goes_on = true;
    params.faults = lost;
    kiln_backend_destroy(&w->backends[1]);
    open_backend(w, 1, &params);
    int runs = 0;
    for (; runs < MOST_RUNS && !info.fell_back; runs++) {
        struct kept k[2];
        agree(w, &kiln_pass_guided, &both, POINT_FLOATS, k);
        kiln_backend_info(w->backends[1], &info);
        if (info.fell_back)
            for (uint64_t p = 0; p < w->surface->count; p++)
                assert_memory_equal(&guided(&k[0])[p], &guided(&k[1])[p], sizeof(struct kiln_guided_result));
        forget(k);
    }
    print_message("lost in run %d\n", runs);
    assert_true(info.fell_back && runs > 1);
}

static void guided_gathers_agree(void **state)
{
    (void)state;
    struct world w;
    struct kept k[2], plain[2];
    uint64_t same[2] = {0, 0}, rays = 0;
    if (getenv("KILN_TEST_FULL") == NULL)
        skip(); /* software devices take long to make these kernels, which analytic.guide_vulkan has too */
    build(&w, false);
    w.surface->guide = calloc(w.surface->count, KILN_GUIDE_FLOATS * sizeof *w.surface->guide);
    for (int b = 0; b < 2; b++)
        plain[b] = run(&w, b, &kiln_pass_gather, NULL, SAMPLES, &rays);
    for (int bounce = 1; bounce <= 3; bounce++) {
        const struct kiln_guided_parameters parameters = {.learns = bounce<3, .follows = bounce> 1};
        agree(&w, &kiln_pass_guided, &parameters, POINT_FLOATS, k);
        for (int b = 0; b < 2; b++) /* the first bounce has nothing to follow; later some tile runs have */
            for (uint64_t i = 0; i < w.surface->count; i++) {
                const struct kiln_point_result *r = (const struct kiln_point_result *)(const void *)plain[b].results;
                const bool is_same = memcmp(&guided(&k[b])[i].point, &r[i], sizeof *r) == 0;
                assert_true(bounce > 1 || is_same);
                same[b] += bounce == 3 && is_same;
            }
        learn(&w, k, parameters.learns);
        forget(k);
    }
    print_message("%llu and %llu of %llu points were not guided\n", (unsigned long long)same[0],
                  (unsigned long long)same[1], (unsigned long long)w.surface->count);
    assert_true(same[0] > 100 && same[0] < w.surface->count * 9 / 10);
    assert_true(fabs((double)same[0] - (double)same[1]) < 0.01 * (double)w.surface->count);
    forget(plain);
    learn_at_scales(&w);
    fall_back(&w);
    release(&w);
}

/* ---- chains ---- */

enum { FIGURES = 12 };

static void figures_of(const struct kept *k, uint64_t i, double figures[FIGURES])
{
    const void *result = k->results + i * k->result_bytes;
    const struct kiln_point_result *r = result;
    const struct kiln_directional_result *directional = result;
    for (int c = 0; c < FIGURES && k->result_bytes == sizeof *directional; c++)
        figures[c] = (double)directional->radiance[c / 3][c % 3];
    for (int c = 0; c < 3 && k->result_bytes == sizeof *r; c++) {
        figures[c] = (double)r->incident[c];
        figures[3 + c] = (double)r->irradiance[c];
        figures[6 + c] = (double)r->gloss[c];
        figures[9 + c] = (double)(c == 0 ? r->escaped : c == 1 ? r->blocked : r->glass[1]);
    }
}

/* Point by point: chains end where rounding has them end, but few of them are near to that. */
static void chains_are_close(const struct world *w, const struct kiln_pass *pass, const struct kept k[2])
{
    double level[FIGURES] = {0.0}, apart[FIGURES] = {0.0}, most = 0.0;
    for (uint64_t i = 0; i < w->surface->count; i++) {
        double figures[2][FIGURES] = {{0.0}};
        for (int b = 0; b < 2; b++)
            figures_of(&k[b], i, figures[b]);
        for (int c = 0; c < FIGURES; c++) {
            level[c] += fabs(figures[0][c]);
            apart[c] += fabs(figures[0][c] - figures[1][c]);
        }
    }
    const bool all = pass == &kiln_pass_gather || pass == &kiln_pass_directional; /* the others have light alone */
    for (int c = 0; c < FIGURES; c++) {
        assert_true(c < 6 || all ? level[c] > 0.0 : level[c] == 0.0 && apart[c] == 0.0);
        most = fmax(most, level[c] > 0.0 ? apart[c] / level[c] : 0.0);
    }
    print_message("%s with chains: points are %.1e apart\n", pass->name, most);
    assert_true(most < 1e-3);
}

static void chains_agree(void **state)
{
    const struct kiln_pass *const passes[] = {&kiln_pass_direct, &kiln_pass_gather, &kiln_pass_caustic,
                                              &kiln_pass_directional};
    struct world w;
    (void)state;
    if (getenv("KILN_TEST_FULL") == NULL)
        skip(); /* software devices take long to make these kernels */
    build(&w, true);
    for (size_t p = 0; p < sizeof passes / sizeof *passes; p++) {
        struct kept k[2];
        uint64_t rays[2] = {0, 0};
        for (int b = 0; b < 2; b++)
            k[b] = run(&w, b, passes[p], NULL, CHAIN_SAMPLES, &rays[b]);
        assert_true(rays[0] > 0 && fabs((double)rays[1] / (double)rays[0] - 1.0) < 1e-3);
        chains_are_close(&w, passes[p], k);
        forget(k);
    }
    vulkan_has_run(w.backends[1], "gather: chains");
    release(&w);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(both_passes_agree), cmocka_unit_test(guided_gathers_agree),
                                       cmocka_unit_test(chains_agree)};
    return vulkan_device_is_there() ? cmocka_run_group_tests(tests, NULL, NULL) : 77;
}
