/* Light paths that land (worker/pass/land.h) or cross spheres of probes (spheres.h), and gather rays that share the
 * light with them (weighed.h), on a Vulkan device against Embree: both follow the same paths by the same random
 * numbers, so only rounding differs. The bits do not depend on how paths are divided into calls. Skipped (77) if there
 * is no device. */
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
#include "tests/unit/vulkan_device.h"
#include "worker/backend/extended.h"
#include "worker/backend/mirror_images.h"
#include "worker/light/aims.h"
#include "worker/light/emission.h"
#include "worker/pass/land.h"
#include "worker/pass/spheres.h"
#include "worker/base/memory.h"
#include "worker/pass/validity.h"
#include "worker/pass/weighed.h"
#include "worker/scene/gloss.h"

enum { PATHS = 6000, FIRST = 5000, RAYS = 16, SKY_WIDTH = 6, SKY_HEIGHT = 3 }; /* paths of two iterations */

struct world {
    struct fixture *f;
    struct kiln_gloss glosses[FIXTURE_MATERIALS];
    struct kiln_light lights[3];
    float sky[SKY_WIDTH * SKY_HEIGHT * 3];
    struct kiln_geometry *geometry;
    struct kiln_lights *made;
    struct kiln_surface *surface;
    struct kiln_aims *aims;
    struct kiln_emission *emission;
    struct kiln_mirror_images *images;
    struct kiln_caustic_techniques techniques;
};

/* A material with gloss; the caller changes it. */
static struct kiln_gloss *gloss(struct world *w, float red, float green, float blue, float roughness)
{
    const uint32_t material = fixture_material(w->f, red, green, blue);
    struct kiln_gloss *g = &w->glosses[w->f->scene.gloss_count++];
    *g = kiln_gloss_default(&w->f->materials[material], material);
    g->roughness = g->mean_roughness = roughness;
    return g;
}

static uint32_t metal(struct world *w, float roughness)
{
    struct kiln_gloss *g = gloss(w, 0.9f, 0.7f, 0.5f, roughness);
    g->metallic = g->mean_metallic = 1.0f;
    w->f->materials[g->material].metallic = 1.0f;
    w->f->materials[g->material].double_sided = 1;
    return g->material;
}

static uint32_t glass(struct world *w)
{
    struct kiln_gloss *g = gloss(w, 1.0f, 1.0f, 1.0f, 0.0f);
    g->transmission = 1.0f;
    g->ior = 1.5f;
    g->thickness = 1.0f;
    g->flags = KILN_GLOSS_VOLUME;
    g->attenuation_distance = 0.5f;
    memcpy(g->attenuation_color, (const float[3]){0.9f, 0.5f, 0.7f}, sizeof g->attenuation_color);
    return g->material;
}

/* Thin, and coloured: rays pass it by chances that depend on their angle. */
static uint32_t pane(struct world *w)
{
    struct kiln_gloss *g = gloss(w, 0.6f, 0.9f, 0.8f, 0.0f);
    g->transmission = 1.0f;
    g->ior = 1.5f;
    w->f->materials[g->material].transmission = 1.0f;
    w->f->materials[g->material].transmission_texture = KILN_NONE;
    return g->material;
}

static void sheet(struct world *w, struct kiln_dvec3 corner, struct kiln_dvec3 u, struct kiln_dvec3 v, double rough,
                  uint32_t material)
{
    static const double whole[4] = {0.0, 1.0, 0.0, 1.0};
    const uint32_t mesh = fixture_mesh(w->f);
    fixture_sheet(w->f, corner, u, v, 3, whole, rough, material);
    fixture_object(w->f, mesh, NULL, 24, 24);
}

/* Has the normals of the mesh begun last, which is flat and faces along `front`, lean as if it were bent up and down.
 */
static void curve(struct fixture *f, struct kiln_vec3 front)
{
    struct kiln_mesh *mesh = &f->meshes[f->scene.mesh_count - 1];
    mesh->flags |= KILN_MESH_SMOOTH;
    for (uint64_t v = mesh->vertex_first; v < f->scene.vertex_count; v++)
        f->normals[v] = vec3_normalize(vec3_add(front, vec3(0.0f, f->positions[v].y - 0.95f, 0.0f)));
}

/* A floor, a wall, a block and a pane of glass, a mirror, rough metal, a varnished board; every kind of lamp. */
static void build(struct world *w)
{
    *w = (struct world){.f = fixture_create()};
    struct fixture *f = w->f;
    f->scene.glosses = w->glosses;
    f->scene.lights = w->lights;
    const uint32_t matt = fixture_material(f, 0.5f, 0.6f, 0.7f), lamp = fixture_material(f, 0.0f, 0.0f, 0.0f);
    f->materials[matt].roughness = f->materials[lamp].roughness = 1.0f;
    memcpy(f->materials[lamp].emission, (const float[3]){5.0f, 4.0f, 3.0f}, sizeof f->materials[lamp].emission);
    sheet(w, dvec3(-3, 0, 3), dvec3(6, 0, 0), dvec3(0, 0, -6), 0.0, matt);
    sheet(w, dvec3(-3, 0, -3), dvec3(6, 0, 0), dvec3(0, 3, 0), 0.0, matt);
    sheet(w, dvec3(-2, 0.2, 1.5), dvec3(0, 1.5, 0), dvec3(0.3, 0, -2), 0.0, metal(w, 0.0f));
    sheet(w, dvec3(1.8, 0.2, -1.5), dvec3(0, 1.5, 0), dvec3(0.3, 0, 2), 0.0, metal(w, 0.5f));
    curve(f, vec3_normalize(vec3(3.0f, 0.0f, -0.45f)));
    sheet(w, dvec3(-1, 0.05, 2.5), dvec3(2, 0, 0), dvec3(0, 0, -1), 0.0, gloss(w, 0.6f, 0.3f, 0.2f, 0.2f)->material);
    sheet(w, dvec3(-0.5, 2.9, -0.5), dvec3(1, 0, 0), dvec3(0, 0, 1), 0.0, lamp);
    sheet(w, dvec3(0.9, 0.1, 2.2), dvec3(0.8, 0, 0.2), dvec3(0, 0.9, 0), 0.0, pane(w));
    const uint32_t block = fixture_cube(f, 2, 0.0, glass(w));
    fixture_object(f, block, (const double[12]){0.4, 0, 0, 0, 0, 0.4, 0, 0.7, 0, 0, 0.4, 0}, 24, 24);
    w->lights[f->scene.light_count++] = (struct kiln_light){
        .kind = KILN_LIGHT_POINT, .position = {0.4, 1.9, 0.6}, .intensity = {3, 2, 1}, .range = 20.0f};
    w->lights[f->scene.light_count++] = (struct kiln_light){.kind = KILN_LIGHT_SPOT,
                                                            .position = {-1, 2.5, 2},
                                                            .direction = {0.3f, -0.8f, -0.5f},
                                                            .intensity = {9, 9, 9},
                                                            .cos_inner = 0.95f,
                                                            .cos_outer = 0.7f};
    w->lights[f->scene.light_count++] =
        (struct kiln_light){.kind = KILN_LIGHT_DIRECTIONAL, .direction = {0.6f, -0.8f, 0}, .intensity = {1, 1, 2}};
    for (size_t i = 0; i < sizeof w->sky / sizeof *w->sky; i++)
        w->sky[i] = (float)fixture_random(f);
    f->environment = (struct kiln_environment){
        .kind = KILN_ENVIRONMENT_LATLONG, .radiance = {1, 1, 1}, .width = SKY_WIDTH, .height = SKY_HEIGHT};
    f->scene.environment_texels = w->sky;
    assert_int_equal(kiln_scene_take_gloss(&f->scene, KILN_GLOSS_MODE_AUTO, NULL), KILN_OK);
    assert_int_equal(kiln_geometry_create(&w->geometry, &f->scene, NULL), KILN_OK);
    assert_int_equal(w->geometry->passage, KILN_PASSAGE_PANE);
    assert_int_equal(kiln_lights_create(&w->made, &f->scene, w->geometry, NULL), KILN_OK);
    const struct kiln_surface_params params = {.scene = &f->scene, .geometry = w->geometry, .ranks = 1, .threads = 1};
    assert_int_equal(kiln_surface_build(&w->surface, &params, &(struct kiln_surface_report){0}, NULL), KILN_OK);
    assert_int_equal(kiln_aims_create(&w->aims, w->made, 127, NULL), KILN_OK);
    assert_int_equal(kiln_emission_create(&w->emission, w->made, NULL), KILN_OK);
    assert_int_equal(kiln_mirror_images_create(&w->images, w->made, 0.0, NULL), KILN_OK);
    assert_true(w->aims->count >= 20 && w->aims->count <= PATHS && w->images != NULL);
    kiln_aims_share(w->aims, PATHS, NULL);
    assert_true(w->aims->targets.listed > 0);
    w->techniques = (struct kiln_caustic_techniques){
        .aims = w->aims, .emission = w->emission, .iterations = 2, .images = w->images, .mis = KILN_MIS_BALANCE};
}

static void release(struct world *w)
{
    kiln_mirror_images_destroy(&w->images);
    kiln_emission_destroy(&w->emission);
    kiln_aims_destroy(&w->aims);
    kiln_surface_destroy(&w->surface);
    kiln_lights_destroy(&w->made);
    kiln_geometry_destroy(&w->geometry);
    kiln_free(&w->f->scene.panes);
    fixture_destroy(w->f);
}

static struct kiln_backend *open_backend(const struct world *w, const char *name)
{
    const struct kiln_backend_params params = {.scene = &w->f->scene,
                                               .geometry = w->geometry,
                                               .lights = w->made,
                                               .threads = 2,
                                               .traversal = KILN_TRAVERSE_COMPUTE,
                                               .seed = 0x700000003ull};
    struct kiln_backend *backend = NULL;
    struct kiln_error error = {""};
    if (kiln_backend_create(&backend, name, &params, &error) != KILN_OK ||
        kiln_backend_set_surface(backend, w->surface, &error) != KILN_OK)
        fail_msg("%s", error.message);
    return backend;
}

/* kiln_take_results */
static int keep(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    (void)error;
    memcpy((struct kiln_land_result *)context + (first - FIRST), results, count * sizeof(struct kiln_land_result));
    return KILN_OK;
}

/* Paths FIRST to FIRST + PATHS, `at_once` in a call; how many rays. */
static uint64_t trace(const struct world *w, struct kiln_backend *backend, bool shares, size_t at_once,
                      struct kiln_land_result *results)
{
    const struct kiln_land_parameters parameters = {.aims = w->aims, .techniques = shares ? &w->techniques : NULL};
    struct kiln_error error = {""};
    uint64_t rays = 0;
    assert_true(kiln_backend_takes(backend, &kiln_pass_land, &parameters));
    memset(results, 0, PATHS * sizeof *results);
    for (size_t done = 0; done < PATHS; done += at_once) {
        const struct kiln_batch batch = {.first = FIRST + done,
                                         .count = PATHS - done < at_once ? PATHS - done : at_once,
                                         .take = keep,
                                         .context = results};
        if (kiln_backend_run(backend, &kiln_pass_land, &parameters, &batch, &rays, &error) != KILN_OK)
            fail_msg("%s", error.message);
    }
    return rays;
}

/* Paths are traced by the kernel of those of views, and run code for gloss where they meet it alone. */
static void are_taken_apart(const struct kiln_backend *backend)
{
    vulkan_has_run(backend, "rays of paths with gloss");
    vulkan_has_run(backend, "light paths that land");
    vulkan_has_run(backend, "light paths that land, at first surfaces");
    vulkan_has_run(backend, "light paths that land, at gloss");
}

static bool is_near(float a, float b, float part) { return fabsf(a - b) <= part * fmaxf(fabsf(a), fabsf(b)) + 1e-12f; }

/* Whether two paths went one way, and what they bring is the same but for rounding. */
static bool is_same(const struct kiln_land_result *a, const struct kiln_land_result *b, bool *one_way)
{
    *one_way = a->end == b->end && a->length == b->length && a->point == b->point && a->aim == b->aim;
    if (!*one_way)
        return false;
    const float part = 2e-3f; /* of a path that has met several mirrors */
    for (int c = 0; c < 3; c++)
        if (!is_near(a->flux[c], b->flux[c], part))
            return false;
    return a->end != KILN_LAND_LANDED ||
           (is_near(a->shading, b->shading, part) && is_near(a->taken_up, b->taken_up, part) &&
            is_near(a->others, b->others, 10.0f * part));
}

static void agrees(const struct world *w, struct kiln_backend *const backends[2], bool shares)
{
    struct kiln_land_result *embree = malloc(PATHS * sizeof *embree), *vulkan = malloc(PATHS * sizeof *vulkan),
                            *parts = malloc(PATHS * sizeof *parts);
    const uint64_t rays[2] = {trace(w, backends[0], shares, PATHS, embree),
                              trace(w, backends[1], shares, PATHS, vulkan)};
    size_t landed = 0, others = 0, apart = 0, differ = 0, imaged = 0;
    for (size_t i = 0; i < PATHS; i++) {
        bool one_way;
        const bool same = is_same(&embree[i], &vulkan[i], &one_way);
        apart += !one_way;
        differ += one_way && !same;
        landed += embree[i].end == KILN_LAND_LANDED;
        others += embree[i].others > 0.0f;
        imaged += embree[i].end == KILN_LAND_LANDED && embree[i].point == KILN_NO_POINT;
    }
    print_message("%s: %zu landed, %zu of images, %zu apart, %zu differ; %llu and %llu rays\n",
                  shares ? "shared" : "whole", landed, imaged, apart, differ, (unsigned long long)rays[0],
                  (unsigned long long)rays[1]);
    assert_true(landed > PATHS / 10);
    assert_true(shares == (others > landed / 2) && shares == (imaged > 20));
    assert_true(apart <= PATHS / 200 && differ <= PATHS / 200); /* rounding decides a few */
    assert_true(fabs((double)rays[0] / (double)rays[1] - 1.0) < 0.002);
    assert_true(trace(w, backends[1], shares, 777, parts) == rays[1]);
    assert_memory_equal(parts, vulkan, PATHS * sizeof *parts);
    free(embree);
    free(vulkan);
    free(parts);
}

/* ---- gather rays that share the light with them ---- */

/* The points of tile runs. */
struct kept_points {
    const struct world *w;
    struct kiln_point_result *points;
};

/* kiln_take_results */
static int keep_points(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    (void)error;
    const struct kept_points *k = context;
    const struct kiln_tile_run *runs = k->w->surface->tile_runs + first;
    memcpy(k->points + runs[0].first.at, results,
           (size_t)kiln_tile_runs_points(runs, runs + count - 1) * sizeof *k->points);
    return KILN_OK;
}

static struct kiln_point_result *gather(const struct world *w, struct kiln_backend *backend,
                                        const struct kiln_caustic_techniques *techniques, size_t at_once)
{
    const size_t runs = w->surface->tile_run_count;
    struct kept_points kept = {w, calloc(w->surface->point_count, sizeof *kept.points)};
    struct kiln_error error = {""};
    uint64_t rays = 0;
    assert_true(kiln_backend_takes(backend, &kiln_pass_weighed, techniques));
    for (size_t done = 0; done < runs; done += at_once) {
        const struct kiln_batch batch = {.first = done,
                                         .count = runs - done < at_once ? runs - done : at_once,
                                         .samples = RAYS,
                                         .take = keep_points,
                                         .context = &kept};
        if (kiln_backend_run(backend, &kiln_pass_weighed, techniques, &batch, &rays, &error) != KILN_OK)
            fail_msg("%s", error.message);
    }
    return kept.points;
}

static void rays_agree(const struct world *w, struct kiln_backend *const backends[2], enum kiln_mis mis)
{
    struct kiln_caustic_techniques techniques = w->techniques;
    techniques.images = NULL;
    techniques.mis = mis;
    struct kiln_point_result *embree = gather(w, backends[0], &techniques, SIZE_MAX / 2),
                             *vulkan = gather(w, backends[1], &techniques, SIZE_MAX / 2),
                             *parts = gather(w, backends[1], &techniques, 3);
    const uint64_t count = w->surface->point_count;
    uint64_t lit = 0, differ = 0;
    for (uint64_t i = 0; i < count; i++) {
        bool same = true;
        assert_int_equal(embree[i].count, vulkan[i].count);
        for (int c = 0; c < 3; c++)
            same = same && is_near(embree[i].irradiance[c], vulkan[i].irradiance[c], 2e-3f) &&
                   is_near(embree[i].incident[c], vulkan[i].incident[c], 2e-3f);
        lit += embree[i].irradiance[1] > 0.0f;
        differ += !same;
    }
    print_message("rays, rule %d: %llu of %llu points lit, %llu differ\n", (int)mis, (unsigned long long)lit,
                  (unsigned long long)count, (unsigned long long)differ);
    assert_true(lit > count / 3 && differ <= lit / 50); /* a ray that meets something else changes a point */
    assert_memory_equal(parts, vulkan, count * sizeof *parts);
    free(embree);
    free(vulkan);
    free(parts);
}

/* ---- spheres of probes ---- */

enum { ALONG = 7, LAYERS = 4, SPHERES = ALONG * LAYERS * ALONG };

/* Light that paths have left in spheres. */
struct crossed {
    uint64_t sums[SPHERES * KILN_SPHERE_SUMS], *moments, rays;
};

/* Spheres about a grid, a third of them off their places, and some that get nothing. */
static struct kiln_probe_spheres make_spheres(const struct world *w, struct kiln_backend *embree,
                                              struct kiln_sphere sphere[SPHERES], float clear[SPHERES])
{
    const double *middle = w->f->scene.header->centre;
    struct kiln_probe_spheres s = {.origin = {-2.4 - middle[0], 0.3 - middle[1], -2.4 - middle[2]},
                                   .spacing = {0.8, 0.7, 0.8},
                                   .radius = 0.35,
                                   .leaves = KILN_LEAVES_POINTS | KILN_LEAVES_AREAS | KILN_LEAVES_IMAGE,
                                   .size = {ALONG, LAYERS, ALONG},
                                   .count = SPHERES,
                                   .sphere = sphere,
                                   .clear = clear,
                                   .unit = 0x1p-40};
    for (size_t i = 0; i < SPHERES; i++) {
        const size_t at[3] = {i % ALONG, i / ALONG % LAYERS, i / (ALONG * LAYERS)};
        sphere[i].radius = i % 31 == 5 ? 0.0f : 0.35f;
        for (int a = 0; a < 3; a++)
            sphere[i].centre[a] = (float)(s.origin[a] + s.spacing[a] * (double)at[a] +
                                          (i % 3 == 0 ? 0.6 * (fixture_random(w->f) - 0.5) : 0.0));
    }
    assert_int_equal(kiln_backend_clearance(embree, sphere, SPHERES, clear, NULL), KILN_OK);
    return s;
}

/* The same of the spheres from number `first` on. */
static struct crossed *cross(const struct world *w, struct kiln_backend *backend, const struct kiln_probe_spheres *all,
                             size_t first, size_t at_once)
{
    struct crossed *c = calloc(1, sizeof *c);
    struct kiln_probe_spheres s = *all;
    struct kiln_error error = {""};
    const struct kiln_land_parameters parameters = {.aims = w->aims, .spheres = &s};
    c->moments = calloc(w->aims->count, sizeof *c->moments);
    s.first = first;
    s.count -= first;
    s.sphere += first;
    s.clear += first;
    s.sums = c->sums + KILN_SPHERE_SUMS * first;
    s.moments = c->moments;
    s.cells = (struct kiln_sphere_cells){.begin = NULL};
    assert_int_equal(kiln_sphere_cells_make(&s.cells, &s, &error), KILN_OK);
    assert_true(kiln_backend_takes(backend, &kiln_pass_land, &parameters));
    for (size_t done = 0; done < PATHS; done += at_once) {
        const struct kiln_batch batch = {.first = FIRST + done,
                                         .count = PATHS - done < at_once ? PATHS - done : at_once};
        if (kiln_backend_run(backend, &kiln_pass_land, &parameters, &batch, &c->rays, &error) != KILN_OK)
            fail_msg("%s", error.message);
    }
    kiln_sphere_cells_release(&s.cells);
    return c;
}

static void forget(struct crossed *c)
{
    free(c->moments);
    free(c);
}

static void same_bits(const struct world *w, const struct crossed *a, const struct crossed *b, size_t first)
{
    assert_memory_equal(a->sums + KILN_SPHERE_SUMS * first, b->sums + KILN_SPHERE_SUMS * first,
                        (SPHERES - first) * KILN_SPHERE_SUMS * sizeof *a->sums);
    if (first == 0)
        assert_memory_equal(a->moments, b->moments, w->aims->count * sizeof *a->moments);
}

/* Compares the sums of two backends. The level is that of the sphere's mean radiance, the first of its sums. */
static void compare_sums(const struct crossed *a, const struct crossed *b, size_t *lit, size_t *differ)
{
    double all[2] = {0.0, 0.0};
    for (size_t i = 0; i < SPHERES; i++) {
        const int64_t *of[2] = {(const int64_t *)a->sums + KILN_SPHERE_SUMS * i,
                                (const int64_t *)b->sums + KILN_SPHERE_SUMS * i};
        bool same = true;
        for (size_t k = 0; k < KILN_SPHERE_SUMS; k++)
            same = same && fabs((double)(of[0][k] - of[1][k])) <= 2e-3 * (double)of[0][k % 3];
        *lit += of[0][1] > 0;
        *differ += !same;
        all[0] += (double)of[0][1];
        all[1] += (double)of[1][1];
        assert_true(i % 31 != 5 || (of[0][1] == 0 && of[1][1] == 0));
    }
    print_message("spheres: %zu lit, %zu differ, all of them %.6f\n", *lit, *differ, all[1] / all[0]);
    assert_true(fabs(all[1] / all[0] - 1.0) < 1e-3);
}

static void spheres_agree(const struct world *w, struct kiln_backend *const backends[2])
{
    struct kiln_sphere sphere[SPHERES];
    float clear[SPHERES], unknown[SPHERES] = {0.0f};
    struct kiln_probe_spheres s = make_spheres(w, backends[0], sphere, clear);
    struct crossed *embree = cross(w, backends[0], &s, 0, PATHS), *vulkan = cross(w, backends[1], &s, 0, PATHS),
                   *parts = cross(w, backends[1], &s, 0, 777), *some = cross(w, backends[1], &s, 50, PATHS);
    size_t lit = 0, differ = 0;
    compare_sums(embree, vulkan, &lit, &differ);
    assert_true(lit > SPHERES / 2 && differ <= lit / 10); /* a path that goes another way is in several */
    for (size_t i = 0; i < w->aims->count; i++)
        assert_true(fabs((double)embree->moments[i] - (double)vulkan->moments[i]) <=
                    0.02 * (double)embree->moments[i] + 1000.0);
    assert_true(fabs((double)embree->rays / (double)vulkan->rays - 1.0) < 0.002);
    assert_true(parts->rays == vulkan->rays);
    same_bits(w, parts, vulkan, 0);
    same_bits(w, some, vulkan, 50);
    s.clear = unknown;
    struct crossed *asked = cross(w, backends[1], &s, 0, PATHS);
    same_bits(w, asked, vulkan, 0);
    assert_true(asked->rays > vulkan->rays);
    vulkan_has_run(backends[1], "light paths at probes");
    forget(embree);
    forget(vulkan);
    forget(parts);
    forget(some);
    forget(asked);
}

static void paths_and_rays_agree_with_embree(void **state)
{
    (void)state;
    struct world w;
    build(&w);
    struct kiln_backend *backends[2] = {open_backend(&w, "embree"), open_backend(&w, "vulkan")};
    const struct kiln_batch all = {
        .count = w.surface->tile_run_count, .take = kiln_validity_keep, .context = w.surface};
    uint64_t rays = 0;
    agrees(&w, backends, false);
    agrees(&w, backends, true);
    spheres_agree(&w, backends);
    agrees(&w, backends, false); /* kernels are those of landings again */
    are_taken_apart(backends[1]);
    assert_int_equal(kiln_backend_run(backends[0], &kiln_pass_validity, NULL, &all, &rays, NULL), KILN_OK);
    rays_agree(&w, backends, KILN_MIS_BALANCE);
    rays_agree(&w, backends, KILN_MIS_POWER);
    kiln_backend_destroy(&backends[0]);
    kiln_backend_destroy(&backends[1]);
    release(&w);
}

/* A device says what it leaves to the host, and refuses it. */
static void what_is_not_there_is_refused(void **state)
{
    (void)state;
    struct world w;
    build(&w);
    struct kiln_backend *backend = open_backend(&w, "vulkan");
    struct kiln_caustic_techniques alone = w.techniques;
    alone.images = NULL;
    assert_false(kiln_backend_takes(backend, &kiln_pass_weighed, &w.techniques));
    assert_true(kiln_backend_takes(backend, &kiln_pass_weighed, &alone));
    const struct kiln_batch batch = {.count = 1, .samples = RAYS};
    uint64_t rays = 0;
    assert_int_equal(kiln_backend_run(backend, &kiln_pass_weighed, &w.techniques, &batch, &rays, NULL), KILN_USAGE);
    kiln_backend_destroy(&backend);
    release(&w);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(what_is_not_there_is_refused),
                                       cmocka_unit_test(paths_and_rays_agree_with_embree)};
    if (!vulkan_device_is_there())
        return 77;
    return cmocka_run_group_tests(tests, NULL, NULL);
}
