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
#include "worker/pass/probes.h"
#include "worker/pass/radiance.h"
#include "worker/pass/validity.h"
#include "worker/scene/gloss.h"
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

/* What is common to all worlds, once their objects and lights are there. */
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
    kiln_free(&scene->own_materials);
    fixture_destroy(w->fixture);
}

/* A square floor of side 4 of this material, and over it a mirror, rough metal, clear and frosted glass, a glossy matt
 * cube and one with a clear coat. */
static void build_things(struct world *w, uint32_t floor)
{
    struct fixture *f = w->fixture;
    fixture_object(f, fixture_mesh(f), NULL, 12, 12);
    fixture_sheet(f, dvec3(-2, 0, 2), dvec3(4, 0, 0), dvec3(0, 0, -4), 1, flat, 0.0, floor);
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

/* ---- means over the points of the first object ---- */

struct means {
    const struct kiln_surface *surface;
    double irradiance, incident, escaped, blocked, gloss, points;
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
    m.blocked /= m.points, m.gloss /= m.points;
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
    static const double corner[5][9] = {{-2, 2, 2, 0, 0, -4, 4, 0, 0},
                                        {-2, 0, 2, 0, 0, -4, 0, 2, 0},
                                        {2, 0, -2, 0, 0, 4, 0, 2, 0},
                                        {-2, 0, -2, 4, 0, 0, 0, 2, 0},
                                        {2, 0, 2, -4, 0, 0, 0, 2, 0}};
    for (int i = 0; i < 5; i++) {
        const double *c = corner[i];
        fixture_object(f, fixture_mesh(f), NULL, 8, 8);
        fixture_sheet(f, dvec3(c[0], c[1], c[2]), dvec3(c[3], c[4], c[5]), dvec3(c[6], c[7], c[8]), 1, flat, 0.0, lamp);
    }
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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(white_things_under_a_sky),
        cmocka_unit_test(white_things_in_a_room_of_lamps),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
