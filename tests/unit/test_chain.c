/* Chains of rays through mirrors, glass and gloss (shaders/shared/chain.h), by the passes that follow them: white
 * materials in a furnace change nothing, a pane lets 12/13 of the light through, and points that are left out change no
 * bit of the others. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/surface/surface_build.h"
#include "shaders/shared/chain.h"
#include "tests/unit/surface_scene.h"
#include "worker/backend/backend.h"
#include "worker/base/memory.h"
#include "worker/light/lights.h"
#include "worker/material/surface_bsdf.h"
#include "worker/pass/caustic.h"
#include "worker/pass/directional.h"
#include "worker/pass/gather.h"
#include "worker/pass/path.h"
#include "worker/pass/probes.h"
#include "worker/pass/radiance.h"
#include "worker/pass/validity.h"
#include "worker/scene/gloss.h"
#include "worker/scene/radiance_probes.h"
#include "worker/scene/radiosity.h"

static const double flat[4] = {0.02, 0.98, 0.02, 0.98};

struct world {
    struct fixture *fixture;
    struct kiln_gloss gloss[FIXTURE_MATERIALS];
    struct kiln_geometry *geometry;
    struct kiln_lights *lights;
    struct kiln_surface *surface;
    struct kiln_backend *backend;
    uint64_t *radiosity;
};

/* A material with gloss, white. */
static uint32_t material(struct world *w, float metallic, float roughness, float transmission, uint32_t flags)
{
    struct fixture *f = w->fixture;
    const uint32_t m = fixture_material(f, 1.0f, 1.0f, 1.0f);
    f->materials[m].metallic = metallic;
    f->materials[m].transmission = transmission;
    struct kiln_gloss *g = &w->gloss[f->scene.gloss_count++];
    *g = kiln_gloss_default(&f->materials[m], m);
    g->roughness = g->mean_roughness = roughness;
    g->flags = flags;
    return m;
}

/* A white one that is only diffuse. */
static uint32_t diffuse_material(struct fixture *f)
{
    const uint32_t m = fixture_material(f, 1.0f, 1.0f, 1.0f);
    f->materials[m].roughness = 1.0f;
    return m;
}

/* A cube of half a side `half` about (x, y, z), turned a little. */
static void cube(struct fixture *f, double x, double y, double z, double half, uint32_t m)
{
    const double c = half * 0.8, s = half * 0.6, place[12] = {c, 0, s, x, 0, half, 0, y, -s, 0, c, z};
    fixture_object(f, fixture_cube(f, 1, 0.0, m), place, 12, 8);
}

/* The radiosity of every point that belongs in a furnace whose radiance is 1 / pi: 1, and on glossy points what of the
 * light there the diffuse part takes up. */
static void fill_radiosity(struct world *w)
{
    const struct kiln_surface *s = w->surface;
    const struct kiln_scene *scene = &w->fixture->scene;
    w->radiosity = calloc(s->point_count, sizeof *w->radiosity);
    for (size_t i = 0; i < s->tile_run_count; i++) {
        const struct kiln_tile_run *run = &s->tile_runs[i];
        const struct kiln_object *object = &scene->objects[kiln_map_object(s, run->map)];
        const struct kiln_mesh *mesh = &scene->meshes[object->mesh];
        const struct kiln_gloss *gloss = kiln_gloss_taken(scene, scene->triangle_materials[mesh->triangle_first]);
        float level = 1.0f;
        if (gloss != NULL) {
            const struct kiln_bsdf_lobes lobes =
                kiln_bsdf_prepare(kiln_surface_bsdf(scene, gloss, mesh, mesh->triangle_first, 0.3f, 0.3f));
            level = lobes.matt > 0.0f ? lobes.matt * lobes.under_front : 0.0f;
        }
        for (uint64_t k = 0; k < run->count; k++) {
            const float rgb[3] = {level, level, level};
            w->radiosity[run->first.at + k] = kiln_radiosity_pack(rgb, 0);
        }
    }
}

/* Finishes a world of any kind, once its objects and lights are there. */
static void finish(struct world *w)
{
    struct fixture *f = w->fixture;
    struct kiln_error error = {""};
    f->scene.glosses = w->gloss;
    assert_int_equal(kiln_scene_take_gloss(&f->scene, KILN_GLOSS_MODE_AUTO, &error), KILN_OK);
    assert_int_equal(kiln_geometry_create(&w->geometry, &f->scene, &error), KILN_OK);
    assert_int_equal(kiln_lights_create(&w->lights, &f->scene, w->geometry, &error), KILN_OK);
    const struct kiln_surface_params params = {.scene = &f->scene, .geometry = w->geometry, .ranks = 1, .threads = 1};
    assert_int_equal(kiln_surface_build(&w->surface, &params, &(struct kiln_surface_report){0}, &error), KILN_OK);
    fill_radiosity(w);
    const struct kiln_backend_params backend = {
        .scene = &f->scene, .geometry = w->geometry, .lights = w->lights, .threads = 2, .seed = 3};
    if (kiln_backend_create(&w->backend, "embree", &backend, &error) != KILN_OK ||
        kiln_backend_set_surface(w->backend, w->surface, &error) != KILN_OK ||
        kiln_backend_set_radiosity(w->backend, w->radiosity, &error) != KILN_OK)
        fail_msg("%s", error.message);
    const struct kiln_batch points = {
        .count = w->surface->tile_run_count, .take = kiln_validity_keep, .context = w->surface};
    uint64_t ignored = 0;
    assert_int_equal(kiln_backend_run(w->backend, &kiln_pass_validity, NULL, &points, &ignored, &error), KILN_OK);
}

static void release(struct world *w)
{
    struct kiln_scene *scene = &w->fixture->scene;
    kiln_backend_destroy(&w->backend);
    free(w->radiosity);
    kiln_surface_destroy(&w->surface);
    kiln_lights_destroy(&w->lights);
    kiln_geometry_destroy(&w->geometry);
    kiln_free(&scene->taken);
    kiln_free(&scene->panes);
    kiln_free(&scene->own_materials);
    fixture_destroy(w->fixture);
}

/* A mirror, rough metal, clear and frosted glass, a glossy matt cube and one with a clear coat, around the middle. */
static void add_things(struct world *w)
{
    struct fixture *f = w->fixture;
    const uint32_t mirror = material(w, 1, 0, 0, 0), metal = material(w, 1, 0.5f, 0, 0),
                   glass = material(w, 0, 0, 1, KILN_GLOSS_VOLUME),
                   frosted = material(w, 0, 0.4f, 1, KILN_GLOSS_VOLUME), matt = material(w, 0, 0.3f, 0, 0),
                   coated = material(w, 0, 0.4f, 0, 0);
    w->gloss[f->scene.gloss_count - 1].clearcoat = 1.0f;
    cube(f, -1.2, 0.7, -1.0, 0.4, mirror);
    cube(f, 0.0, 0.7, -1.2, 0.4, metal);
    cube(f, 1.2, 0.7, -1.0, 0.4, glass);
    cube(f, -1.1, 0.7, 0.9, 0.4, frosted);
    cube(f, 0.1, 0.7, 1.1, 0.4, matt);
    cube(f, 1.2, 0.7, 0.8, 0.4, coated);
}

/* These over a square floor of side 4 of this material. */
static void build_things(struct world *w, uint32_t floor)
{
    struct fixture *f = w->fixture;
    fixture_object(f, fixture_mesh(f), NULL, 12, 12);
    fixture_sheet(f, dvec3(-2, 0, 2), dvec3(4, 0, 0), dvec3(0, 0, -4), 1, flat, 0.0, floor);
    add_things(w);
}

/* ---- means over the points of the first object ---- */

struct means {
    const struct kiln_surface *surface;
    double irradiance, incident, escaped, blocked, gloss, points;
    double error; /* variance of the mean irradiance */
};

static int add_points(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    (void)error;
    struct means *m = context;
    const struct kiln_point_result *r = results;
    for (size_t i = first; i < first + count; i++)
        for (uint32_t k = 0; k < m->surface->tile_runs[i].count; k++, r++) {
            if (m->surface->tile_runs[i].map != 0 || r->count == 0)
                continue;
            const struct kiln_point_mean mean = kiln_point_mean(r);
            m->irradiance += (double)mean.irradiance[1];
            m->incident += (double)mean.incident[1];
            m->escaped += (double)mean.escaped;
            m->blocked += (double)mean.blocked;
            m->gloss += (double)mean.gloss[1];
            m->error += (double)mean.error * (double)mean.error;
            m->points++;
        }
    return KILN_OK;
}

static struct means run_points(const struct world *w, const struct kiln_pass *pass, uint32_t samples)
{
    struct kiln_error error = {""};
    struct means m = {.surface = w->surface};
    const struct kiln_batch batch = {
        .count = w->surface->tile_run_count, .stream = 1, .samples = samples, .take = add_points, .context = &m};
    uint64_t rays = 0;
    if (kiln_backend_run(w->backend, pass, NULL, &batch, &rays, &error) != KILN_OK)
        fail_msg("%s: %s", pass->name, error.message);
    assert_true(m.points > 40.0);
    m.irradiance /= m.points, m.incident /= m.points, m.escaped /= m.points;
    m.blocked /= m.points, m.gloss /= m.points, m.error /= m.points * m.points;
    return m;
}

/* ---- furnaces ---- */

/* All that arrives at the floor is 1 W/m2, whatever stands on it: straight, by caustics, and from surfaces. `sky`: the
 * part of the radiance that lights send; the rest is radiosity. */
static void check_floor(const struct world *w, const char *name, double light, double taken_up)
{
    const struct means direct = run_points(w, &kiln_pass_direct, 256), caustic = run_points(w, &kiln_pass_caustic, 256),
                       gather = run_points(w, &kiln_pass_gather, 256);
    const double irradiance = direct.irradiance + caustic.irradiance + gather.irradiance,
                 incident = direct.incident + caustic.incident + gather.incident;
    print_message("%s: direct %.4f, caustic %.4f, gathered %.4f: %.4f (incident %.4f of %.4f); escaped %.4f, blocked "
                  "%.2g, gloss %.2g\n",
                  name, direct.irradiance, caustic.irradiance, gather.irradiance, irradiance, incident, taken_up,
                  gather.escaped, gather.blocked, gather.gloss);
    assert_true(caustic.irradiance > 0.05 * light);
    assert_true(fabs(irradiance - 1.0) < 0.004 && fabs(incident / taken_up - 1.0) < 0.004);
    assert_true(gather.blocked < 0.001 && fabs(gather.gloss) < 0.004);
    assert_true(caustic.escaped == 0.0 && caustic.gloss == 0.0);
}

static void white_things_under_a_sky(void **state)
{
    (void)state;
    struct world w = {.fixture = fixture_create()};
    const float radiance = (float)(1.0 / 3.14159265358979);
    w.fixture->environment =
        (struct kiln_environment){.kind = KILN_ENVIRONMENT_CONSTANT, .radiance = {radiance, radiance, radiance}};
    build_things(&w, diffuse_material(w.fixture));
    finish(&w);
    check_floor(&w, "sky", 1.0, 1.0);
    release(&w);
}

/* Walls and ceiling above the floor. */
static void add_room(struct world *w, uint32_t material_of_walls)
{
    static const double corner[5][9] = {{-2, 2, 2, 0, 0, -4, 4, 0, 0},
                                        {-2, 0, 2, 0, 0, -4, 0, 2, 0},
                                        {2, 0, -2, 0, 0, 4, 0, 2, 0},
                                        {-2, 0, -2, 4, 0, 0, 0, 2, 0},
                                        {2, 0, 2, -4, 0, 0, 0, 2, 0}};
    struct fixture *f = w->fixture;
    for (int i = 0; i < 5; i++) {
        const double *c = corner[i];
        fixture_object(f, fixture_mesh(f), NULL, 8, 8);
        fixture_sheet(f, dvec3(c[0], c[1], c[2]), dvec3(c[3], c[4], c[5]), dvec3(c[6], c[7], c[8]), 1, flat, 0.0,
                      material_of_walls);
    }
}

/* A closed room whose walls send half of the radiance as lamps, half as radiosity; the floor is glossy itself. */
static void white_things_in_a_room_of_lamps(void **state)
{
    (void)state;
    struct world w = {.fixture = fixture_create()};
    struct fixture *f = w.fixture;
    build_things(&w, material(&w, 0, 0.4f, 0, 0));
    const uint32_t lamp = diffuse_material(f);
    const float half = (float)(0.5 / 3.14159265358979);
    memcpy(f->materials[lamp].emission, (const float[3]){half, half, half}, sizeof f->materials[lamp].emission);
    add_room(&w, lamp);
    finish(&w);
    for (uint64_t i = 0; i < w.surface->point_count; i++) { /* lamps: half of the light is emission */
        const float rgb[3] = {0.5f, 0.5f, 0.5f};
        if (w.radiosity[i] == kiln_radiosity_pack((const float[3]){1, 1, 1}, 0))
            w.radiosity[i] = kiln_radiosity_pack(rgb, 0);
    }
    const struct kiln_scene *scene = &f->scene;
    const struct kiln_bsdf_lobes lobes =
        kiln_bsdf_prepare(kiln_surface_bsdf(scene, kiln_gloss_taken(scene, 0), &scene->meshes[0], 0, 0.3f, 0.3f));
    check_floor(&w, "lamps", 0.5, (double)lobes.under_front);
    release(&w);
}

/* ---- other passes, in a room of radiosity alone ---- */

/* Results of a pass with or without masks, in the order of points or positions. */
struct kept {
    char *results;
    size_t bytes, next;
};

static int keep(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    (void)first, (void)error;
    struct kept *k = context;
    memcpy(k->results + k->next, results, count * k->bytes);
    k->next += count * k->bytes;
    return KILN_OK;
}

static void run_positions(const struct world *w, const struct kiln_pass *pass, const void *parameters,
                          const struct kiln_vec3 *positions, size_t count, uint32_t samples, void *results)
{
    struct kiln_error error = {""};
    struct kept k = {results, pass->result_bytes, 0};
    const struct kiln_batch batch = {
        .count = count, .positions = positions, .samples = samples, .take = keep, .context = &k};
    uint64_t rays = 0;
    if (kiln_backend_run(w->backend, pass, parameters, &batch, &rays, &error) != KILN_OK)
        fail_msg("%s: %s", pass->name, error.message);
}

static void other_passes_see_the_same_furnace(void **state)
{
    (void)state;
    enum { ELEMENTS = 24 };
    static const struct kiln_radiance_parameters map = {.basis = KILN_PROBE_CUBE, .side = 2};
    const struct kiln_vec3 middle = vec3(0.0f, 1.0f, 0.0f);
    struct world w = {.fixture = fixture_create()};
    struct kiln_vec3 positions[ELEMENTS];
    struct kiln_probe_result probe;
    struct kiln_radiance_result radiance[ELEMENTS];
    build_things(&w, diffuse_material(w.fixture));
    add_room(&w, diffuse_material(w.fixture));
    finish(&w);
    for (int i = 0; i < ELEMENTS; i++)
        positions[i] = middle;
    const struct means caustic = run_points(&w, &kiln_pass_caustic, 16), gather = run_points(&w, &kiln_pass_gather, 64);
    assert_true(caustic.irradiance == 0.0 && fabs(gather.irradiance - 1.0) < 0.004 && gather.escaped == 0.0);
    run_positions(&w, &kiln_pass_probes, &(struct kiln_probe_parameters){0}, &middle, 1, 4096, &probe);
    run_positions(&w, &kiln_pass_radiance, &map, positions, ELEMENTS, 256, radiance);
    double mean = 0.0;
    for (int i = 0; i < ELEMENTS; i++)
        mean += (double)radiance[i].radiance[1] / ELEMENTS;
    print_message("probe %.4f of %.4f, radiance %.4f of %.4f\n", (double)probe.radiance[0][1], 4.0 * 0.28209479, mean,
                  1.0 / KILN_PI);
    assert_true(fabs((double)probe.radiance[0][1] / (4.0 * 0.28209479) - 1.0) < 0.006);
    assert_true(fabs(mean * KILN_PI - 1.0) < 0.006);
    release(&w);
}

/* ---- points that are left out ---- */

static void run_masked(const struct world *w, const struct kiln_pass *pass, const void *parameters,
                       const uint64_t *masks, char *results)
{
    struct kiln_error error = {""};
    struct kept k = {results, pass->result_bytes, 0};
    size_t points = 0;
    uint64_t rays = 0;
    for (size_t i = 0; i < w->surface->tile_run_count; i++, points = 0) { /* run by run: `keep` counts items */
        struct kept all = {malloc(KILN_TILE_TEXELS * pass->result_bytes), 0, 0};
        points = w->surface->tile_runs[i].count;
        all.bytes = points * pass->result_bytes;
        const struct kiln_selection chosen = {.computed = masks != NULL ? masks[i] : UINT64_MAX};
        const struct kiln_batch batch = {.first = i,
                                         .count = 1,
                                         .stream = pass->has_streams ? 1 : 0,
                                         .samples = 12,
                                         .selections = masks != NULL ? &chosen : NULL,
                                         .take = keep,
                                         .context = &all};
        assert_int_equal(kiln_backend_run(w->backend, pass, parameters, &batch, &rays, &error), KILN_OK);
        memcpy(k.results + k.next, all.results, all.bytes);
        k.next += all.bytes;
        free(all.results);
    }
}

/* With masks a step's lanes are those of more samples of fewer points: sums must not hang on that. */
static void check_masks(const struct world *w, const struct kiln_pass *pass, const void *parameters)
{
    const size_t bytes = w->surface->count * pass->result_bytes;
    char *every = calloc(bytes, 1), *some = calloc(bytes, 1), *at = every;
    uint64_t *masks = calloc(w->surface->tile_run_count, sizeof *masks), asked = 0;
    for (size_t i = 0; i < w->surface->tile_run_count; i++)
        masks[i] = i % 2 == 0 ? 0x8102040810204081ull : 0x00000f0f00010000ull;
    run_masked(w, pass, parameters, NULL, every);
    run_masked(w, pass, parameters, masks, some);
    for (size_t i = 0; i < w->surface->tile_run_count; i++)
        for (uint32_t k = 0; k < w->surface->tile_runs[i].count; k++, at += pass->result_bytes)
            if ((masks[i] >> k & 1u) != 0) {
                assert_memory_equal(at, some + (at - every), pass->result_bytes);
                asked++;
            }
    assert_true(asked > 50);
    free(masks);
    free(some);
    free(every);
}

static void points_that_are_left_out_change_no_bit(void **state)
{
    (void)state;
    struct world w = {.fixture = fixture_create()};
    w.fixture->environment = (struct kiln_environment){.kind = KILN_ENVIRONMENT_CONSTANT, .radiance = {1, 2, 3}};
    build_things(&w, material(&w, 0.3f, 0.4f, 0, 0));
    finish(&w);
    check_masks(&w, &kiln_pass_gather, NULL);
    check_masks(&w, &kiln_pass_caustic, NULL);
    check_masks(&w, &kiln_pass_directional, NULL);
    release(&w);
}

/* ---- against paths ---- */

/* A grey square among things that reflect and refract and have no diffuse light of their own, under a lamp and a point
 * light: what it sends is what paths with one diffuse surface find. */
static void caustics_are_what_paths_find(void **state)
{
    (void)state;
    enum { SIDE = 8, SAMPLES = 4096 };
    struct world w = {.fixture = fixture_create()};
    struct fixture *f = w.fixture;
    struct kiln_light point = {.kind = KILN_LIGHT_POINT, .position = {-0.2, 1.9, 0.3}, .intensity = {1, 1, 1}};
    const uint32_t grey = diffuse_material(f);
    memcpy(f->materials[grey].base_color, (const float[3]){0.5f, 0.5f, 0.5f}, 3 * sizeof(float));
    fixture_object(f, fixture_mesh(f), NULL, 8, 8);
    fixture_sheet(f, dvec3(-0.5, 0, 0.5), dvec3(1, 0, 0), dvec3(0, 0, -1), 1, flat, 0.0, grey);
    f->scene.lights = &point;
    f->scene.light_count = 1;
    add_things(&w);
    for (size_t m = 1; m < f->scene.material_count; m++) /* no radiosity */
        if (!(w.gloss[m - 1].metallic > 0.0f) && !(w.gloss[m - 1].transmission > 0.0f))
            memset(f->materials[m].base_color, 0, 3 * sizeof(float));
    const uint32_t lamp = diffuse_material(f);
    f->materials[lamp] = (struct kiln_material){.base_color = {0, 0, 0, 1},
                                                .roughness = 1.0f,
                                                .emission = {5, 5, 5},
                                                .base_color_texture = KILN_NONE,
                                                .emission_texture = KILN_NONE};
    fixture_object(f, fixture_mesh(f), NULL, 4, 4);
    fixture_sheet(f, dvec3(0.2, 2.2, -0.3), dvec3(0.6, 0, 0), dvec3(0, 0, 0.6), 1, flat, 0.0, lamp);
    finish(&w);
    const struct kiln_path_parameters camera = {.position = {0.0f, 2.0f, 0.0f},
                                                .forward = {0.0f, -1.0f, 0.0f},
                                                .right = {0.5f, 0.0f, 0.0f},
                                                .up = {0.0f, 0.0f, -0.5f},
                                                .orthographic = true,
                                                .width = SIDE,
                                                .height = SIDE,
                                                .bounces = 1};
    struct kiln_path_result pixels[SIDE * SIDE];
    run_positions(&w, &kiln_pass_path, &camera, NULL, SIDE * SIDE, SAMPLES, pixels);
    double paths = 0.0, error = 0.0;
    for (int i = 0; i < SIDE * SIDE; i++) {
        paths += (double)pixels[i].radiance[1] / SAMPLES / (SIDE * SIDE);
        error += kiln_path_error(&pixels[i]) * kiln_path_error(&pixels[i]);
    }
    error = sqrt(error) / (SIDE * SIDE);
    const struct means direct = run_points(&w, &kiln_pass_direct, SAMPLES),
                       caustic = run_points(&w, &kiln_pass_caustic, SAMPLES);
    const double sent = 0.5 / KILN_PI, light = sent * (direct.irradiance + caustic.irradiance),
                 deviation = sqrt(error * error + sent * sent * (direct.error + caustic.error));
    print_message("paths %.5f, direct %.5f and caustic light %.5f: %.5f; standard error of the difference %.5f\n",
                  paths, sent * direct.irradiance, sent * caustic.irradiance, light, deviation);
    assert_true(caustic.irradiance > 0.05 * direct.irradiance && deviation < 0.05 * sent * caustic.irradiance);
    assert_true(fabs(paths - light) < 5.0 * deviation);
    release(&w);
}

/* ---- a pane ---- */

/* Far above a floor a small lamp, right above it a thick pane of glass: 12/13 of the light comes through, with all that
 * goes to and fro between its faces. */
static void a_pane_lets_its_share_through(void **state)
{
    (void)state;
    struct world w = {.fixture = fixture_create()};
    struct fixture *f = w.fixture;
    fixture_object(f, fixture_mesh(f), NULL, 8, 8);
    fixture_sheet(f, dvec3(-0.5, 0, 0.5), dvec3(1, 0, 0), dvec3(0, 0, -1), 1, flat, 0.0, diffuse_material(f));
    const uint32_t glass = material(&w, 0, 0, 1, KILN_GLOSS_VOLUME);
    static const double pane[12] = {60, 0, 0, 0, 0, 0.02, 0, 0.5, 0, 0, 60, 0};
    fixture_object(f, fixture_cube(f, 1, 0.0, glass), pane, 12, 8);
    const uint32_t lamp = diffuse_material(f);
    memcpy(f->materials[lamp].emission, (const float[3]){1, 1, 1}, sizeof f->materials[lamp].emission);
    fixture_object(f, fixture_mesh(f), NULL, 4, 4);
    fixture_sheet(f, dvec3(-10, 50, -10), dvec3(20, 0, 0), dvec3(0, 0, 20), 1, flat, 0.0, lamp);
    finish(&w);
    /* the lamp from the middle, straight: the solid angle's projection of a square */
    const double edge = 10.0 / 50.0, arm = sqrt(1.0 + edge * edge),
                 expected = 4.0 * 2.0 * (edge / arm) * atan(edge / arm) / 2.0;
    const struct means direct = run_points(&w, &kiln_pass_direct, 16),
                       caustic = run_points(&w, &kiln_pass_caustic, 8192);
    const double share = caustic.irradiance / expected;
    print_message("a pane lets %.4f through (12/13 = %.4f), standard error %.4f\n", share, 12.0 / 13.0,
                  sqrt(caustic.error) / expected);
    assert_true(direct.irradiance == 0.0 && fabs(share - 12.0 / 13.0) < 5.0 * sqrt(caustic.error) / expected + 0.002);
    assert_true(sqrt(caustic.error) / expected < 0.006);
    release(&w);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(white_things_under_a_sky),          cmocka_unit_test(white_things_in_a_room_of_lamps),
        cmocka_unit_test(other_passes_see_the_same_furnace), cmocka_unit_test(points_that_are_left_out_change_no_bit),
        cmocka_unit_test(caustics_are_what_paths_find),      cmocka_unit_test(a_pane_lets_its_share_through),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
