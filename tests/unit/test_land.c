/* Light paths that land (worker/pass/land.h) against closed forms: a mirror's sun on a wall, a pane, a ball, a
 * paraboloid; and that any aims bring the same light, from every kind of lamp. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/surface/surface_build.h"
#include "shaders/shared/random.h"
#include "shaders/shared/streams.h"
#include "tests/unit/surface_scene.h"
#include "worker/backend/extended.h"
#include "worker/light/aims.h"
#include "worker/light/emission.h"
#include "worker/base/memory.h"
#include "worker/pass/land.h"
#include "worker/pass/spheres.h"
#include "worker/pass/weighed.h"
#include "worker/scene/gloss.h"
#include "worker/scene/footprint.h"

static const double whole[4] = {0.0, 1.0, 0.0, 1.0};

struct world {
    struct fixture *f;
    struct kiln_gloss glosses[FIXTURE_MATERIALS];
    struct kiln_light lights[4];
    struct kiln_geometry *geometry;
    struct kiln_lights *made;
    struct kiln_surface *surface;
    struct kiln_aims *aims;
    size_t most_aims; /* objects are cut as long as there are so many */
    struct kiln_emission *emission;
    struct kiln_caustic_techniques techniques;
    bool weighs; /* landings leave a part of their light to gather rays */
    struct kiln_backend *backend;
};

enum { RAYS = 256 }; /* of a point, where gather rays have a part */

static void begin(struct world *w)
{
    *w = (struct world){.f = fixture_create()};
    w->f->scene.glosses = w->glosses;
    w->f->scene.lights = w->lights;
}

/* A material with gloss: a mirror of that reflectance, or clear glass of that index. */
static uint32_t mirror(struct world *w, float red, float green, float blue)
{
    const uint32_t material = fixture_material(w->f, red, green, blue);
    struct kiln_gloss gloss = kiln_gloss_default(&w->f->materials[material], material);
    gloss.metallic = gloss.mean_metallic = 1.0f;
    gloss.roughness = gloss.mean_roughness = 0.0f;
    w->f->materials[material].metallic = 1.0f;
    w->f->materials[material].double_sided = 1;
    w->glosses[w->f->scene.gloss_count++] = gloss;
    return material;
}

static uint32_t glass(struct world *w, float index, float roughness)
{
    const uint32_t material = fixture_material(w->f, 1.0f, 1.0f, 1.0f);
    struct kiln_gloss gloss = kiln_gloss_default(&w->f->materials[material], material);
    gloss.transmission = 1.0f;
    gloss.roughness = gloss.mean_roughness = roughness;
    gloss.ior = index;
    gloss.thickness = 1.0f;
    gloss.flags = KILN_GLOSS_VOLUME;
    w->glosses[w->f->scene.gloss_count++] = gloss;
    return material;
}

static struct kiln_light *light(struct world *w, enum kiln_light_kind kind, struct kiln_vec3 direction, float level)
{
    struct kiln_light *l = &w->lights[w->f->scene.light_count++];
    direction = vec3_normalize(direction);
    *l = (struct kiln_light){.kind = kind,
                             .direction = {direction.x, direction.y, direction.z},
                             .intensity = {level, 0.5f * level, 2.0f * level},
                             .cos_inner = 0.9f,
                             .cos_outer = 0.8f};
    return l;
}

static uint32_t matt(struct world *w)
{
    const uint32_t material = fixture_material(w->f, 0.5f, 0.5f, 0.5f);
    w->f->materials[material].roughness = 1.0f;
    return material;
}

/* A diffuse square in the plane y, about the middle, front up. */
static void floor_at(struct world *w, double y, double half, uint32_t texels)
{
    const uint32_t mesh = fixture_mesh(w->f);
    fixture_sheet(w->f, dvec3(-half, y, half), dvec3(2.0 * half, 0, 0), dvec3(0, 0, -2.0 * half), 1, whole, 0.0,
                  matt(w));
    fixture_object(w->f, mesh, NULL, texels, texels);
}

/* A ball of so many quads from pole to pole, and twice as many around, with smooth normals, in the mesh begun last. */
static void ball_of(struct world *w, uint32_t down, struct kiln_dvec3 centre, double radius, uint32_t material)
{
    const uint32_t around = 2 * down;
    struct fixture *f = w->f;
    struct kiln_mesh *mesh = &f->meshes[f->scene.mesh_count - 1];
    const uint32_t first = (uint32_t)mesh->vertex_count;
    for (uint32_t j = 0; j <= down; j++)
        for (uint32_t i = 0; i <= around; i++) {
            const double theta = 3.14159265358979 * j / down, phi = 2.0 * 3.14159265358979 * i / around;
            const struct kiln_dvec3 n = dvec3(sin(theta) * cos(phi), cos(theta), sin(theta) * sin(phi));
            fixture_vertex(f, centre.x + radius * n.x, centre.y + radius * n.y, centre.z + radius * n.z,
                           (double)i / around, (double)j / down);
            f->normals[f->scene.vertex_count - 1] = vec3_of(n);
        }
    for (uint32_t j = 0; j < down; j++)
        for (uint32_t i = 0; i < around; i++) {
            const uint32_t a = first + j * (around + 1) + i, b = a + around + 1;
            if (j > 0)
                fixture_triangle(f, a, a + 1, b + 1, material);
            if (j + 1 < down)
                fixture_triangle(f, a, b + 1, b, material);
        }
    mesh->flags |= KILN_MESH_SMOOTH;
}

static void ball(struct world *w, struct kiln_dvec3 centre, double radius, uint32_t material)
{
    ball_of(w, 48, centre, radius, material);
}

static void make(struct world *w)
{
    struct fixture *f = w->f;
    struct kiln_error error = {""};
    assert_int_equal(kiln_scene_take_gloss(&f->scene, KILN_GLOSS_MODE_AUTO, &error), KILN_OK);
    assert_int_equal(kiln_geometry_create(&w->geometry, &f->scene, &error), KILN_OK);
    assert_int_equal(kiln_lights_create(&w->made, &f->scene, w->geometry, &error), KILN_OK);
    const struct kiln_surface_params params = {.scene = &f->scene, .geometry = w->geometry, .ranks = 1, .threads = 1};
    assert_int_equal(kiln_surface_build(&w->surface, &params, &(struct kiln_surface_report){0}, &error), KILN_OK);
    assert_int_equal(kiln_aims_create(&w->aims, w->made, w->most_aims, &error), KILN_OK);
    assert_int_equal(kiln_emission_create(&w->emission, w->made, &error), KILN_OK);
    const struct kiln_backend_params backend = {
        .scene = &f->scene, .geometry = w->geometry, .lights = w->made, .threads = 2, .seed = 3};
    assert_int_equal(kiln_backend_create(&w->backend, "embree", &backend, &error), KILN_OK);
    assert_int_equal(kiln_backend_set_surface(w->backend, w->surface, &error), KILN_OK);
}

static void release(struct world *w)
{
    kiln_backend_destroy(&w->backend);
    kiln_emission_destroy(&w->emission);
    kiln_aims_destroy(&w->aims);
    kiln_surface_destroy(&w->surface);
    kiln_lights_destroy(&w->made);
    kiln_geometry_destroy(&w->geometry);
    kiln_free(&w->f->scene.taken);
    kiln_free(&w->f->scene.panes);
    kiln_free(&w->f->scene.own_materials);
    fixture_destroy(w->f);
}

/* Sums over the paths of iterations [first, first + count): green flux by end, of paths with `length` surfaces or, if
 * that is 0, of all; and light that lands on points. */
struct sums {
    double ends[KILN_LAND_ABSORBED + 1], landed[3], squares, *points; /* W; W^2; W of each point, green */
    double left[3]; /* of what lands or escapes: W, W^2, the most of one path, W */
    uint64_t astray, count;
    uint32_t length;
    const struct world *world;
};

static int add(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    (void)first, (void)error;
    struct sums *s = context;
    const struct kiln_land_result *r = results;
    for (size_t i = 0; i < count; i++, r++) {
        s->count++;
        s->astray += r->end == KILN_LAND_ASTRAY;
        if (s->length == 0 || r->length == s->length)
            s->ends[r->end] += (double)r->flux[1];
        if (r->end == KILN_LAND_LANDED || r->end == KILN_LAND_ESCAPED) {
            s->left[0] += (double)r->flux[1];
            s->left[1] += (double)r->flux[1] * (double)r->flux[1];
            s->left[2] = fmax(s->left[2], (double)r->flux[1]);
        }
        if (r->end != KILN_LAND_LANDED || r->point == KILN_NO_POINT)
            continue;
        const struct kiln_surface *surface = s->world->surface;
        assert_true(s->world->weighs || r->others == 0.0f);
        const struct kiln_caustic_techniques *t = &s->world->techniques;
        const double area = kiln_lit_area(surface, (struct kiln_own_point){r->point}, 1.0f),
                     weight = kiln_caustic_weight_landed(t->mis, (double)r->others, RAYS, area);
        for (int c = 0; c < 3; c++)
            s->landed[c] += weight * (double)r->flux[c];
        s->squares += weight * (double)r->flux[1] * weight * (double)r->flux[1];
        if (s->points != NULL && (s->length == 0 || r->length == s->length))
            s->points[r->point] += weight * (double)r->flux[1];
    }
    return KILN_OK;
}

static void trace(struct world *w, uint64_t paths, uint64_t first, uint64_t iterations, struct sums *sums)
{
    struct kiln_error error = {""};
    const struct kiln_land_parameters parameters = {.aims = w->aims, .techniques = w->weighs ? &w->techniques : NULL};
    const struct kiln_batch batch = {.first = first * paths, .count = iterations * paths, .take = add, .context = sums};
    uint64_t rays = 0;
    sums->world = w;
    w->techniques.aims = w->aims;
    w->techniques.emission = w->emission;
    w->techniques.iterations = iterations;
    if (w->aims->paths != paths)
        kiln_aims_share(w->aims, paths, NULL);
    if (kiln_backend_run(w->backend, &kiln_pass_land, &parameters, &batch, &rays, &error) != KILN_OK)
        fail_msg("%s", error.message);
}

/* Where all is mirrors and smooth glass and no ray meets the lamp, nothing is shared: the same light lands. */
static void same_if_weighed(struct world *w, uint64_t paths, uint64_t iterations, const struct sums *sums)
{
    struct sums shared = {.length = sums->length};
    w->weighs = true;
    trace(w, paths, 0, iterations, &shared);
    w->weighs = false;
    assert_true(fabs(shared.landed[1] / sums->landed[1] - 1.0) < 1e-5);
    for (int i = 0; i <= KILN_LAND_ABSORBED; i++)
        assert_true(fabs(shared.ends[i] - sums->ends[i]) <= 1e-5 * sums->ends[i]);
}

/* A sun that shines down on a slanted mirror, from (0, 0) to (2, 2) in x and y: light goes on along -x to a wall of so
 * many texels a side. */
static void make_mirrored_beam(struct world *w, uint32_t side)
{
    const uint32_t silver = mirror(w, 0.8f, 0.8f, 0.8f), grey = matt(w);
    uint32_t mesh = fixture_mesh(w->f);
    fixture_sheet(w->f, dvec3(0, 0, 1), dvec3(2, 2, 0), dvec3(0, 0, -2), 1, whole, 0.0, silver);
    fixture_object(w->f, mesh, NULL, 8, 8);
    mesh = fixture_mesh(w->f);
    fixture_sheet(w->f, dvec3(-2, -1, 2), dvec3(0, 0, -4), dvec3(0, 4, 0), 1, whole, 0.0, grey);
    fixture_object(w->f, mesh, NULL, side, side);
    light(w, KILN_LIGHT_DIRECTIONAL, vec3(0, -1, 0), 3.0f);
    make(w);
}

/* The sun meets a mirror that leans by 45 degrees and lights a wall: E = reflectance x E of the sun. */
static void mirror_and_wall(void **state)
{
    (void)state;
    enum { PATHS = 1 << 16 };
    struct world w;
    begin(&w);
    make_mirrored_beam(&w, 32);
    struct sums sums = {.points = calloc(w.surface->point_count, sizeof(double))};
    trace(&w, PATHS, 0, 4, &sums);
    const double flux = 0.8 * 1.5 * 4.0; /* green */
    same_if_weighed(&w, PATHS, 4, &sums);
    print_message("mirror: %.6f of %.6f W\n", sums.landed[1] / 4.0, flux);
    assert_true(fabs(sums.landed[1] / 4.0 / flux - 1.0) < 1e-3);
    /* texels of the wall within the lit square, half a texel away from its edge: texel 32 x 32, 1/8 m */
    uint32_t inside = 0, lit = 0;
    for (uint32_t y = 0; y < 32; y++)
        for (uint32_t x = 0; x < 32; x++) {
            const uint64_t at = kiln_surface_find(w.surface, 1, x, y).at;
            const double z = 2.0 - (x + 0.5) / 8.0, height = -1.0 + (y + 0.5) / 8.0;
            const double irradiance = sums.points[at] / 4.0 * 64.0;
            if (fabs(z) < 1.0 && height > 0.0 && height < 2.0) {
                inside++;
                assert_true(fabs(irradiance / 1.2 - 1.0) < 0.15);
            }
            lit += irradiance > 0.01; /* a path or two at the very edge may be rounded beyond it */
        }
    assert_true(inside == 256 && lit == inside);
    free(sums.points);
    release(&w);
}

enum { ALONG = 10, SPHERES = ALONG * 9 * 9 };
#define WALL 0.02 /* m: how far the middles of the first spheres along x are from the wall */

/* Traces light paths and returns their sums in `count` spheres from number `first` on. `known`: their clearances are
 * given. */
static uint64_t *cross(const struct world *w, struct kiln_probe_spheres *all, size_t first, size_t count, bool known,
                       uint64_t paths, uint64_t *rays)
{
    struct kiln_error error = {""};
    struct kiln_probe_spheres s = *all;
    float clear[SPHERES] = {0.0f};
    s.first = first;
    s.count = count;
    s.sphere += first;
    s.clear = known ? all->clear + first : clear;
    s.sums = calloc(count * KILN_SPHERE_SUMS, sizeof *s.sums);
    s.moments = calloc(w->aims->count, sizeof *s.moments);
    s.cells = (struct kiln_sphere_cells){.begin = NULL};
    const struct kiln_land_parameters parameters = {.aims = w->aims, .spheres = &s};
    const struct kiln_batch batch = {.count = paths};
    assert_int_equal(kiln_sphere_cells_make(&s.cells, &s, &error), KILN_OK);
    assert_int_equal(kiln_backend_run(w->backend, &kiln_pass_land, &parameters, &batch, rays, &error), KILN_OK);
    kiln_sphere_cells_release(&s.cells);
    free(s.moments);
    return s.sums;
}

/* Spheres in the light that the mirror sends to the wall, 1.2 W/m2 by green, each off its place in the grid: the mean
 * over what of each lies before the wall is that. What is known to be clear, and other spheres, change no bit. */
static void spheres_in_a_beam(void **state)
{
    (void)state;
    enum { PATHS = 1 << 18, FEW = 1 << 13 };
    struct world w;
    struct kiln_error error = {""};
    struct kiln_sphere sphere[SPHERES];
    float clear[SPHERES];
    uint64_t rays[2] = {0};
    begin(&w);
    make_mirrored_beam(&w, 8);
    const double *middle = w.f->scene.header->centre;
    struct kiln_probe_spheres s = {.origin = {WALL - 2.0 - middle[0], 0.2 - middle[1], -0.8 - middle[2]},
                                   .spacing = {0.2, 0.2, 0.2},
                                   .radius = 0.1,
                                   .leaves = KILN_LEAVES_POINTS,
                                   .size = {ALONG, 9, 9},
                                   .count = SPHERES,
                                   .sphere = sphere,
                                   .clear = clear,
                                   .unit = 0x1p-40};
    for (size_t i = 0; i < SPHERES; i++) {
        const size_t at[3] = {i % ALONG, i / ALONG % 9, i / (9 * ALONG)};
        sphere[i].radius = 0.1f;
        for (int a = 0; a < 3; a++)
            sphere[i].centre[a] = (float)(s.origin[a] + 0.2 * (double)at[a] +
                                          (a == 0 && at[0] == 0 ? 0.0
                                           : i % 3 == 0         ? 0.0
                                                                : 0.18 * (fixture_random(w.f) - 0.5)));
    }
    assert_int_equal(kiln_backend_clearance(w.backend, sphere, SPHERES, clear, &error), KILN_OK);
    kiln_aims_share(w.aims, PATHS, NULL);
    uint64_t *sums = cross(&w, &s, 0, SPHERES, true, PATHS, &rays[0]);
    double mean = 0.0;
    for (size_t i = 0; i < SPHERES; i++) {
        const bool at_wall = i % ALONG == 0;
        const double off = at_wall ? WALL / 0.1 : 1.0,
                     volume = 1e-3 * KILN_PI * (2.0 / 3.0 + off - off * off * off / 3.0),
                     found = (double)(int64_t)sums[KILN_SPHERE_SUMS * i + 27 + 1] * s.unit / volume / 1.2,
                     other = (double)(int64_t)sums[KILN_SPHERE_SUMS * i + 27 + 3 + 1];
        assert_true(at_wall ? clear[i] < (float)WALL && clear[i] > 0.99f * (float)WALL : clear[i] > 0.0f);
        if (fabs(found - 1.0) > 0.1 || other != 0.0)
            fail_msg("sphere %zu has %g of its light", i, found);
        mean += found / SPHERES;
    }
    free(sums);
    print_message("spheres in a beam: %.5f of its light, %" PRIu64 " rays\n", mean, rays[0]);
    assert_true(fabs(mean - 1.0) < 2e-3);
    rays[0] = 0;
    sums = cross(&w, &s, 0, SPHERES, true, FEW, &rays[0]);
    uint64_t *slow = cross(&w, &s, 0, SPHERES, false, FEW, &rays[1]);
    assert_memory_equal(sums, slow, SPHERES * KILN_SPHERE_SUMS * sizeof *sums);
    assert_true(rays[1] > 2 * rays[0]);
    free(slow);
    for (size_t i = 0; i < SPHERES; i += 101) {
        uint64_t *one = cross(&w, &s, i, 1, true, FEW, &rays[1]);
        assert_memory_equal(one, sums + KILN_SPHERE_SUMS * i, KILN_SPHERE_SUMS * sizeof *one);
        free(one);
    }
    free(sums);
    release(&w);
}

/* Light straight through a body of glass: 2 n / (n^2 + 1) of it comes out, with all reflections within. */
static void pane(void **state)
{
    (void)state;
    static const double flat[12] = {2, 0, 0, 0, 0, 0.05, 0, 0.5, 0, 0, 2, 0};
    struct world w;
    begin(&w);
    const uint32_t clear = glass(&w, 1.5f, 0.0f), mesh = fixture_cube(w.f, 1, 0.0, clear);
    fixture_object(w.f, mesh, flat, 8, 8);
    floor_at(&w, 0.0, 4.0, 16);
    light(&w, KILN_LIGHT_DIRECTIONAL, vec3(0, -1, 0), 2.0f);
    make(&w);
    struct sums sums = {0};
    trace(&w, 1 << 17, 0, 1, &sums);
    const double through = sums.landed[1] / 16.0, expected = 2.0 * 1.5 / (1.5 * 1.5 + 1.0);
    same_if_weighed(&w, 1 << 17, 1, &sums);
    print_message("pane: %.5f, %.5f expected\n", through, expected);
    assert_true(fabs(through / expected - 1.0) < 2e-3);
    release(&w);
}

/* A floor within glass: flux is what enters, whatever its index does to radiance. */
static void under_glass(void **state)
{
    (void)state;
    static const double flat[12] = {2, 0, 0, 0, 0, 0.5, 0, 0.3, 0, 0, 2, 0};
    struct world w;
    begin(&w);
    const uint32_t clear = glass(&w, 1.5f, 0.0f), mesh = fixture_cube(w.f, 1, 0.0, clear);
    fixture_object(w.f, mesh, flat, 8, 8);
    floor_at(&w, 0.0, 1.0, 16);
    light(&w, KILN_LIGHT_DIRECTIONAL, vec3(0, -1, 0), 2.0f);
    make(&w);
    struct sums sums = {0};
    trace(&w, 1 << 17, 0, 1, &sums);
    print_message("under glass: %.5f, 0.96 expected\n", sums.landed[1] / 4.0);
    assert_true(fabs(sums.landed[1] / 4.0 / 0.96 - 1.0) < 2e-3);
    release(&w);
}

/* A mirror whose normals lean by 20 degrees sends light on about these; as gather rays find it (radiance times the
 * cosine to the shading normal), it is as much as if the mirror's area were seen along the reflected direction. */
static void leaning_normals(void **state)
{
    (void)state;
    struct world w;
    begin(&w);
    const uint32_t silver = mirror(&w, 0.8f, 0.8f, 0.8f);
    uint32_t mesh = fixture_mesh(w.f);
    const double lean = 3.14159265358979 / 9.0;
    fixture_sheet(w.f, dvec3(-1, 0, 1), dvec3(2, 0, 0), dvec3(0, 0, -2), 1, whole, 0.0, silver);
    for (int i = 0; i < 4; i++)
        w.f->normals[i] = vec3((float)sin(lean), (float)cos(lean), 0.0f);
    w.f->meshes[mesh].flags |= KILN_MESH_SMOOTH;
    fixture_object(w.f, mesh, NULL, 8, 8);
    mesh = fixture_mesh(w.f);
    fixture_sheet(w.f, dvec3(3, -1, -5), dvec3(0, 0, 10), dvec3(0, 10, 0), 1, whole, 0.0, matt(&w));
    fixture_object(w.f, mesh, NULL, 16, 16);
    light(&w, KILN_LIGHT_DIRECTIONAL, vec3(0, -1, 0), 2.0f);
    make(&w);
    struct sums sums = {0};
    trace(&w, 1 << 16, 0, 1, &sums);
    const double expected = 4.0 * (0.8 + 0.2 * pow(1.0 - cos(lean), 5.0)) * cos(2.0 * lean);
    print_message("leaning normals: %.5f of %.5f W\n", sums.landed[1], expected);
    assert_true(fabs(sums.landed[1] / expected - 1.0) < 2e-3);
    release(&w);
}

/* A beam on a ball of index 1.5: 0.83554 of it leaves after two refractions. */
static void ball_of_glass(void **state)
{
    (void)state;
    struct world w;
    begin(&w);
    const uint32_t mesh = fixture_mesh(w.f);
    ball(&w, dvec3(0, 1, 0), 1.0, glass(&w, 1.5f, 0.0f));
    fixture_object(w.f, mesh, NULL, 8, 8);
    floor_at(&w, -1.0, 20.0, 16);
    light(&w, KILN_LIGHT_DIRECTIONAL, vec3(0, -1, 0), 2.0f);
    make(&w);
    struct sums twice = {.length = 3}, escaped = {.length = 2};
    trace(&w, 1 << 17, 0, 1, &twice);
    trace(&w, 1 << 17, 0, 1, &escaped);
    const double polygon = 48.0 * sin(3.14159265358979 / 48.0); /* area of the ball's outline, 96 corners */
    const double left = (twice.ends[KILN_LAND_LANDED] + escaped.ends[KILN_LAND_ESCAPED]) / polygon;
    same_if_weighed(&w, 1 << 17, 1, &twice);
    print_message("ball: %.5f leaves after two refractions (landed %.5f, escaped %.5f)\n", left,
                  twice.ends[KILN_LAND_LANDED] / polygon, escaped.ends[KILN_LAND_ESCAPED] / polygon);
    assert_true(fabs(left / 0.83554 - 1.0) < 2e-3);
    release(&w);
}

/* An off-axis part of a paraboloid sends the sun to its focus: all of it lands on a small plate there. */
static void paraboloid(void **state)
{
    (void)state;
    enum { SIDE = 32 };
    struct world w;
    begin(&w);
    const uint32_t silver = mirror(&w, 0.9f, 0.9f, 0.9f);
    uint32_t mesh = fixture_mesh(w.f);
    for (uint32_t j = 0; j <= SIDE; j++)
        for (uint32_t i = 0; i <= SIDE; i++) { /* y = (x^2 + z^2) / 4 */
            const double x = 0.6 + (double)i / SIDE, z = 0.5 - (double)j / SIDE;
            fixture_vertex(w.f, x, 0.25 * (x * x + z * z), z, (double)i / SIDE, (double)j / SIDE);
            w.f->normals[w.f->scene.vertex_count - 1] =
                vec3_normalize(vec3((float)(-0.5 * x), 1.0f, (float)(-0.5 * z)));
        }
    for (uint32_t j = 0; j < SIDE; j++)
        for (uint32_t i = 0; i < SIDE; i++) {
            const uint32_t c = j * (SIDE + 1) + i;
            fixture_triangle(w.f, c, c + 1, c + SIDE + 2, silver);
            fixture_triangle(w.f, c, c + SIDE + 2, c + SIDE + 1, silver);
        }
    w.f->meshes[mesh].flags |= KILN_MESH_SMOOTH;
    fixture_object(w.f, mesh, NULL, 8, 8);
    const double half = 0.02; /* m */
    const struct kiln_dvec3 n = dvec3_of(vec3_normalize(vec3(1.1f, -0.6975f, 0.0f))), a = dvec3(0, 0, 2.0 * half),
                            b = dvec3_cross(n, a), focus = dvec3(0, 1, 0);
    mesh = fixture_mesh(w.f);
    fixture_sheet(w.f, dvec3_sub(focus, dvec3_scale(dvec3_add(a, b), 0.5)), a, b, 1, whole, 0.0, matt(&w));
    fixture_object(w.f, mesh, NULL, 4, 4);
    light(&w, KILN_LIGHT_DIRECTIONAL, vec3(0, -1, 0), 2.0f);
    make(&w);
    struct sums sums = {0};
    trace(&w, 1 << 16, 0, 1, &sums);
    same_if_weighed(&w, 1 << 16, 1, &sums);
    print_message("paraboloid: %.5f of 0.9 W at the focus\n", sums.landed[1]);
    assert_true(fabs(sums.landed[1] / 0.9 - 1.0) < 2e-3 && sums.ends[KILN_LAND_ESCAPED] < 1e-9);
    release(&w);
}

/* A point between two mirrors that face each other, and a floor: E is the sum over the point's images, of which there
 * are as many as one likes. */
static void room_of_mirrors(void **state)
{
    (void)state;
    enum { PATHS = 1 << 19, TEXELS = 8, IMAGES = 400 };
    struct world w;
    begin(&w);
    const uint32_t silver = mirror(&w, 1.0f, 1.0f, 1.0f);
    for (int side = -1; side <= 1; side += 2) {
        const uint32_t mesh = fixture_mesh(w.f);
        fixture_sheet(w.f, dvec3(side, 0, -1.01 * side), dvec3(0, 0, 2.02 * side), dvec3(0, 2, 0), 1, whole, 0.0,
                      silver);
        fixture_object(w.f, mesh, NULL, 8, 8);
    }
    floor_at(&w, 0.0, 1.0, TEXELS);
    struct kiln_light *lamp = light(&w, KILN_LIGHT_POINT, vec3(0, -1, 0), 2.0f); /* green: 1 W/sr */
    memcpy(lamp->position, (const double[3]){0.3, 1.5, 0.0}, sizeof lamp->position);
    make(&w);
    struct sums sums = {.points = calloc(w.surface->point_count, sizeof(double))};
    trace(&w, PATHS, 0, 1, &sums);
    double total = 0.0, landed = 0.0, worst = 0.0;
    for (uint32_t y = 0; y < TEXELS; y++)
        for (uint32_t x = 0; x < TEXELS; x++) {
            double flux = 0.0; /* W: over 4 x 4 places of the texel */
            for (int place = 0; place < 16; place++) {
                const double px = -1.0 + 2.0 * (x + (place % 4 + 0.5) / 4.0) / TEXELS,
                             pz = 1.0 - 2.0 * (y + (place / 4 + 0.5) / 4.0) / TEXELS;
                for (int n = -IMAGES; n <= IMAGES; n++) {
                    const double dx = 2.0 * n + (n % 2 == 0 ? 0.3 : -0.3) - px, d2 = dx * dx + 1.5 * 1.5 + pz * pz;
                    flux += n == 0 ? 0.0 : 1.5 / (d2 * sqrt(d2)) * 4.0 / (TEXELS * TEXELS) / 16.0;
                }
            }
            const double here = sums.points[kiln_surface_find(w.surface, 2, x, y).at];
            total += flux;
            landed += here; /* light that lands on mirrors is none that they take up */
            worst = fmax(worst, fabs(here / flux - 1.0));
        }
    print_message("room of mirrors: %.6f of %.6f W, the worst texel %.3f off\n", landed, total, worst);
    assert_true(fabs(landed / total - 1.0) < 2e-3 && worst < 0.12);
    free(sums.points);
    release(&w);
}

/* A prism of 60 degrees and index 1.5 turns the sun by 37.18 degrees, the least that it can: light goes level through
 * it, and lands on a wall as far below as that says. */
static void prism(void **state)
{
    (void)state;
    enum { TEXELS = 64 };
    struct world w;
    begin(&w);
    const double high = sqrt(0.75), outside = asin(0.75), turn = outside - asin(0.5), wall = 4.0, low = -1.8;
    const uint32_t clear = glass(&w, 1.5f, 0.0f);
    uint32_t mesh = fixture_mesh(w.f);
    fixture_sheet(w.f, dvec3(-0.5, 0, -1), dvec3(0, 0, 2), dvec3(0.5, high, 0), 1, whole, 0.0, clear);
    fixture_sheet(w.f, dvec3(0.5, 0, 1), dvec3(0, 0, -2), dvec3(-0.5, high, 0), 1, whole, 0.0, clear);
    fixture_sheet(w.f, dvec3(-0.5, 0, -1), dvec3(1, 0, 0), dvec3(0, 0, 2), 1, whole, 0.0, clear);
    fixture_object(w.f, mesh, NULL, 8, 8);
    mesh = fixture_mesh(w.f);
    fixture_sheet(w.f, dvec3(wall, low, -2), dvec3(0, 0, 4), dvec3(0, 2, 0), 1, whole, 0.0, matt(&w));
    fixture_object(w.f, mesh, NULL, TEXELS, TEXELS);
    light(&w, KILN_LIGHT_DIRECTIONAL, vec3((float)cos(turn), (float)sin(turn), 0.0f), 2.0f);
    make(&w);
    struct sums sums = {.length = 3, .points = calloc(w.surface->point_count, sizeof(double))};
    trace(&w, 1 << 17, 0, 1, &sums);
    double flux = 0.0, moment = 0.0;
    for (uint32_t y = 0; y < TEXELS; y++)
        for (uint32_t x = 0; x < TEXELS; x++) {
            const double here = sums.points[kiln_surface_find(w.surface, 1, x, y).at];
            flux += here;
            moment += here * (low + 2.0 * (y + 0.5) / TEXELS);
        }
    const double ci = cos(outside), ct = cos(asin(0.5)), s = (ci - 1.5 * ct) / (ci + 1.5 * ct),
                 p = (1.5 * ci - ct) / (1.5 * ci + ct), through = 1.0 - 0.5 * (s * s + p * p),
                 sent = 2.0 * ci * through * through,
                 place = 0.5 * high - (wall - 0.25) * tan(turn); /* of the light through the middle */
    print_message("prism: %.5f of %.5f W, %.4f m above the floor, %.4f expected\n", flux, sent, moment / flux, place);
    assert_true(fabs(sums.ends[KILN_LAND_LANDED] / sent - 1.0) < 2e-3);
    assert_true(fabs(flux / sent - 1.0) < 2e-3 && fabs(moment / flux - place) < 2e-3);
    free(sums.points);
    release(&w);
}

/* ---- aims ---- */

enum lamp { AREA, TWO_SIDED, POINT, SPOT, SUN, SKY, LAMPS, IMAGE };

/* Bodies that bend light: two balls of one object or of two, also of few triangles, or the four rails of a frame, of
 * one object. */
enum bodies { TOGETHER, APART, COARSE, FRAME };

static void balls(struct world *w, bool apart, uint32_t down)
{
    const uint32_t frosted = glass(w, 1.5f, down < 48 ? 0.0f : 0.4f), silver = mirror(w, 0.9f, 0.6f, 0.3f);
    fixture_mesh(w->f);
    ball_of(w, down, dvec3(-0.7, 1.0, 0.1), 0.4, frosted);
    if (apart) {
        fixture_object(w->f, 0, NULL, 8, 8);
        fixture_mesh(w->f);
    }
    ball_of(w, down, dvec3(0.6, 0.8, 0), 0.5, silver);
    fixture_object(w->f, apart ? 1 : 0, NULL, 8, 8);
}

enum { SKY_WIDTH = 8, SKY_HEIGHT = 6 };

/* From the zenith down, with a sun. */
static const float a_sky[3 * SKY_WIDTH * SKY_HEIGHT] = {
    [0] = 2.0f,   [1] = 2.0f,  [2] = 2.0f,  [9] = 1.0f,  [10] = 1.0f,  [11] = 1.0f,  [30] = 1.0f,
    [31] = 1.0f,  [32] = 1.0f, [36] = 0.5f, [37] = 0.5f, [38] = 0.5f,  [51] = 90.0f, [52] = 90.0f,
    [53] = 90.0f, [60] = 3.0f, [61] = 3.0f, [62] = 3.0f, [120] = 1.0f, [121] = 1.0f, [122] = 1.0f};

static void frame(struct world *w)
{
    const uint32_t silver = mirror(w, 0.9f, 0.6f, 0.3f);
    fixture_mesh(w->f);
    for (int rail = 0; rail < 4; rail++) {
        const double side = rail % 2 == 0 ? -1.0 : 1.0;
        const struct kiln_dvec3 corner = rail < 2 ? dvec3(-1.0, 0.3, 0.9 * side) : dvec3(0.9 * side, 0.3, -1.0);
        fixture_sheet(w->f, corner, rail < 2 ? dvec3(2.0, 0, 0) : dvec3(0, 0, 2.0),
                      rail < 2 ? dvec3(0, 0.4, 0.1) : dvec3(0.1, 0.4, 0), 4, whole, 0.0, silver);
    }
    fixture_object(w->f, 0, NULL, 8, 8);
}

/* Bodies over a floor, by one kind of lamp. Objects are cut as long as there are at most `most` aims. */
static void bodies(struct world *w, enum lamp lamp, enum bodies which, size_t most)
{
    begin(w);
    w->most_aims = most;
    if (which == FRAME)
        frame(w);
    else
        balls(w, which != TOGETHER, which == COARSE ? 6 : 48);
    floor_at(w, 0.0, 3.0, 16);
    if (lamp == AREA || lamp == TWO_SIDED) { /* near the balls, with one of them to its side */
        const uint32_t shining = matt(w), mesh = fixture_mesh(w->f);
        memcpy(w->f->materials[shining].emission, (const float[3]){5, 4, 3}, 3 * sizeof(float));
        w->f->materials[shining].double_sided = lamp == TWO_SIDED;
        fixture_sheet(w->f, dvec3(-1, 1.6, -1), dvec3(2, 0, 0), dvec3(0, 0.4, 2), 1, whole, 0.0, shining);
        fixture_object(w->f, mesh, NULL, 4, 4);
    } else if (lamp == SKY) {
        w->f->environment = (struct kiln_environment){.kind = KILN_ENVIRONMENT_CONSTANT, .radiance = {1, 2, 3}};
    } else if (lamp == IMAGE) {
        w->f->environment = (struct kiln_environment){
            .kind = KILN_ENVIRONMENT_LATLONG, .radiance = {1, 2, 3}, .width = SKY_WIDTH, .height = SKY_HEIGHT};
        w->f->scene.environment_texels = a_sky;
    } else {
        struct kiln_light *l =
            light(w,
                  lamp == SUN    ? KILN_LIGHT_DIRECTIONAL
                  : lamp == SPOT ? KILN_LIGHT_SPOT
                                 : KILN_LIGHT_POINT,
                  lamp == SUN ? vec3(-1.3f, 0.2f, 0.1f) : vec3(-0.3f, -1.0f, 0.2f), 2.0f); /* one behind the other */
        memcpy(l->position, (const double[3]){0.9, 2.2, -0.4}, sizeof l->position);
        l->range = lamp == POINT ? 3.0f : 0.0f;
    }
    make(w);
}

/* The same light lands by any aims: at two balls as one object, as two or cut in pieces, with paths shared out in any
 * way. */
static void any_aims_bring_the_same(void **state)
{
    (void)state;
    static const char *const names[] = {"area", "two-sided", "point", "spot", "sun", "sky"};
    enum { PATHS = 1 << 15, WAYS = 4 };
    for (enum lamp lamp = 0; lamp < LAMPS; lamp++) {
        struct sums sums[WAYS] = {{.count = 0}};
        for (int way = 0; way < WAYS; way++) {
            struct world w;
            bodies(&w, lamp, way == 1 || way == 2 ? APART : TOGETHER, way == 3 ? 16 : 0);
            if (way < 3)
                assert_int_equal(w.aims->count, w.aims->lamp_count * (way > 0 ? 2 : 1));
            else
                assert_true(w.aims->count > w.aims->lamp_count && w.aims->count <= 16);
            const double weights[4] = {3.0, 1.0, 1.0, 3.0};
            kiln_aims_share(w.aims, PATHS, way == 2 ? weights : NULL);
            trace(&w, PATHS, 0, 1, &sums[way]);
            release(&w);
        }
        print_message("%s: %.5f, %.5f, %.5f, %.5f W; astray %.2f, %.2f, cut %.2f\n", names[lamp], sums[0].landed[1],
                      sums[1].landed[1], sums[2].landed[1], sums[3].landed[1], (double)sums[0].astray / PATHS,
                      (double)sums[1].astray / PATHS, (double)sums[3].astray / PATHS);
        for (int way = 1; way < WAYS; way++) {
            const double error = sqrt(sums[way].squares + sums[0].squares);
            print_message("  %.2f standard errors\n", (sums[way].landed[1] - sums[0].landed[1]) / error);
            assert_true(fabs(sums[way].landed[1] - sums[0].landed[1]) < 5.0 * error);
        }
        assert_true(sums[0].landed[1] > 20.0 * sqrt(sums[0].squares));
    }
}

/* A frame that is cut in its rails, within boxes, has the same light, and most paths meet it. */
static void a_frame_is_cut(void **state)
{
    (void)state;
    enum { PATHS = 1 << 15 };
    for (enum lamp lamp = 0; lamp < LAMPS; lamp++) {
        struct sums sums[2] = {{.count = 0}};
        for (int way = 0; way < 2; way++) {
            struct world w;
            bodies(&w, lamp, FRAME, way == 0 ? 0 : 16);
            assert_true(way == 0 ? w.aims->count == w.aims->lamp_count
                                 : w.aims->count >= 4 * w.aims->lamp_count && w.aims->count <= 16);
            for (size_t i = 0; i < w.geometry->triangle_count; i++) {
                const bool bends = w.geometry->records[i].object == 0;
                assert_true((kiln_aims_target(w.aims, (uint32_t)i) != KILN_NONE) == bends);
            }
            trace(&w, PATHS, 0, 2, &sums[way]);
            release(&w);
        }
        const double error = sqrt(sums[0].squares + sums[1].squares), astray = (double)sums[1].astray / PATHS / 2.0;
        print_message("lamp %d: %.5f and %.5f W, %.2f standard errors; astray %.2f and %.2f\n", (int)lamp,
                      sums[0].landed[1] / 2.0, sums[1].landed[1] / 2.0, (sums[1].landed[1] - sums[0].landed[1]) / error,
                      (double)sums[0].astray / PATHS / 2.0, astray);
        assert_true(fabs(sums[1].landed[1] - sums[0].landed[1]) < 5.0 * error && error < 0.1 * sums[0].landed[1]);
        if (lamp < SUN) /* suns and skies see rail behind rail */
            assert_true(astray < 0.7 * (double)sums[0].astray / PATHS / 2.0 && sums[1].squares < 0.9 * sums[0].squares);
    }
}

/* An image of the sky that is cut into cells brings the same light, also where gather rays have a part of it. */
static void a_sky_is_cut(void **state)
{
    (void)state;
    enum { PATHS = 1 << 15 };
    for (int weighed = 0; weighed < 2; weighed++) {
        struct sums sums[2] = {{.count = 0}};
        for (int way = 0; way < 2; way++) {
            struct world w;
            bodies(&w, IMAGE, APART, way == 0 ? 0 : 1024);
            assert_true(way == 0 ? w.aims->lamp_count == 1 : w.aims->lamp_count > 5 && w.aims->lamp_count <= 16);
            assert_true(w.aims->count == w.aims->lamp_count * w.aims->targets.count && w.aims->count <= 1024);
            w.weighs = weighed != 0;
            trace(&w, PATHS, 0, 1, &sums[way]);
            release(&w);
        }
        const double error = sqrt(sums[0].squares + sums[1].squares);
        print_message("%.5f and %.5f W, %.2f standard errors, variance %.2f; astray %.2f and %.2f\n", sums[0].landed[1],
                      sums[1].landed[1], (sums[1].landed[1] - sums[0].landed[1]) / error,
                      sums[1].squares / sums[0].squares, (double)sums[0].astray / PATHS,
                      (double)sums[1].astray / PATHS);
        assert_true(fabs(sums[1].landed[1] - sums[0].landed[1]) < 5.0 * error && error < 0.05 * sums[0].landed[1]);
    }
}

/* Adds the part of the shared light that gather rays find, W green, and its variance. */
static int add_gathered(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    (void)error;
    struct sums *s = context;
    const struct kiln_surface *surface = s->world->surface;
    const struct kiln_point_result *r = results;
    for (size_t f = first; f < first + count; f++) {
        struct kiln_point_cursor at = kiln_point_first(surface, f);
        for (uint32_t k = 0; k < surface->tile_runs[f].count; k++, kiln_point_next(surface, &at), r++) {
            const struct kiln_point_mean mean = kiln_point_mean(r);
            const double area = kiln_lit_area(surface, at.point, mean.present),
                         share = (double)mean.irradiance[1] / fmax(1e-9, kiln_luminance_of_floats(mean.irradiance));
            s->landed[1] += area * (double)mean.irradiance[1];
            s->squares += pow(area * (double)mean.error * share, 2.0);
        }
    }
    return KILN_OK;
}

/* Light paths and gather rays together: the power that lands, the power that is gathered, and the error, W. */
struct shared {
    double landed, found, error;
};

static struct shared share(struct world *w, enum kiln_mis mis, uint64_t paths)
{
    struct sums landed = {.count = 0}, found = {.world = w};
    const struct kiln_batch batch = {
        .count = w->surface->tile_run_count, .samples = RAYS, .take = add_gathered, .context = &found};
    uint64_t rays = 0;
    w->techniques.mis = mis;
    w->weighs = true;
    trace(w, paths, 0, 2, &landed);
    w->weighs = false;
    assert_int_equal(kiln_backend_run(w->backend, &kiln_pass_weighed, &w->techniques, &batch, &rays, NULL), KILN_OK);
    return (struct shared){landed.landed[1] / 2.0, found.landed[1], sqrt(landed.squares / 4.0 + found.squares)};
}

/* Light paths and gather rays that share what both find bring, together, what light paths bring alone: by every kind of
 * lamp, and by every heuristic. */
static void shared_light_is_the_same(void **state)
{
    (void)state;
    enum { PATHS = 1 << 15, FEW = 1 << 11 };
    for (int scene = 0; scene < 3 * LAMPS; scene++) {
        const enum lamp lamp = (enum lamp)(scene % LAMPS);
        const bool cut = scene >= LAMPS, coarse = scene >= 2 * LAMPS;
        struct world w;
        struct sums alone = {.count = 0};
        bodies(&w, lamp, coarse ? COARSE : cut ? FRAME : APART, cut ? 16 : 0);
        trace(&w, PATHS, 0, 2, &alone);
        for (enum kiln_mis mis = KILN_MIS_BALANCE; mis <= (cut ? KILN_MIS_BALANCE : KILN_MIS_UNIFORM); mis++) {
            const struct shared s = share(&w, mis, FEW);
            const double sum = s.landed + s.found, all = alone.landed[1] / 2.0,
                         error = hypot(s.error, sqrt(alone.squares) / 2.0);
            print_message("lamp %d, rule %d: %.4f W land, %.4f are gathered: %.5f of %.5f, %.2f standard errors\n",
                          (int)lamp, (int)mis, s.landed, s.found, sum, all, (sum - all) / error);
            assert_true(fabs(sum - all) < 5.0 * error && error < 0.1 * all);
            if (lamp != SUN && !cut) /* which light paths find so much better that hardly anything is left */
                assert_true(s.found > 1e-3 * all);
        }
        release(&w);
    }
}

/* A lamp within a target's sphere is aimed at it with all its light. */
static void a_lamp_within_a_sphere(void **state)
{
    (void)state;
    struct world w;
    begin(&w);
    const uint32_t silver = mirror(&w, 0.9f, 0.9f, 0.9f), shining = matt(&w);
    uint32_t mesh = fixture_mesh(w.f);
    fixture_sheet(w.f, dvec3(-4, 0, 4), dvec3(8, 0, 0), dvec3(0, 0, -8), 1, whole, 0.0, silver);
    fixture_object(w.f, mesh, NULL, 8, 8);
    memcpy(w.f->materials[shining].emission, (const float[3]){5, 4, 3}, 3 * sizeof(float));
    mesh = fixture_mesh(w.f);
    fixture_sheet(w.f, dvec3(-0.5, 1, -0.5), dvec3(1, 0, 0), dvec3(0, 0, 1), 1, whole, 0.0, shining);
    fixture_object(w.f, mesh, NULL, 4, 4);
    make(&w);
    assert_int_equal(w.aims->count, 1);
    print_message("%.4f W of %.4f are aimed at the mirror\n", w.aims->aims[0].flux, w.aims->lamps[0].flux);
    assert_true(w.aims->aims[0].flux == w.aims->lamps[0].flux && w.aims->lamps[0].flux > 0.0);
    release(&w);
}

/* Where triangles are few, paths that go evenly over them leave the light as it is, and single ones count for less.
 * None do from points and spots, nor at finer balls. */
static void coarse_balls(void **state)
{
    (void)state;
    enum { PATHS = 1 << 17 };
    for (enum lamp lamp = 0; lamp < LAMPS; lamp++) {
        struct sums sums[2] = {{.count = 0}};
        double most[2], square[2];
        for (int way = 0; way < 2; way++) {
            struct world w;
            bodies(&w, lamp, COARSE, 0);
            for (size_t i = 0; i < w.aims->count; i++) {
                const double even = w.aims->aims[i].even;
                assert_true(lamp == POINT || lamp == SPOT ? even == 0.0 : even > 0.1 && even <= 0.2);
                w.aims->aims[i].even *= way;
            }
            trace(&w, PATHS, 0, 1, &sums[way]);
            most[way] = sums[way].left[2] / sums[way].left[0] * PATHS;
            square[way] = sums[way].left[1] / pow(sums[way].left[0], 2.0) * PATHS;
            release(&w);
        }
        const double error = sqrt(sums[0].left[1] + sums[1].left[1]);
        print_message("lamp %d: %.5f and %.5f W, %.2f standard errors; largest %.1f and %.1f, square %.3f and %.3f\n",
                      (int)lamp, sums[0].left[0], sums[1].left[0], (sums[1].left[0] - sums[0].left[0]) / error, most[0],
                      most[1], square[0], square[1]);
        assert_true(fabs(sums[1].left[0] - sums[0].left[0]) < 5.0 * error && error < 0.02 * sums[0].left[0]);
        if (lamp == POINT || lamp == SPOT)
            assert_true(memcmp(sums[0].left, sums[1].left, sizeof sums[0].left) == 0);
        else
            assert_true(square[1] < 0.99 * square[0]);
        if (lamp == AREA || lamp == TWO_SIDED || lamp == SUN)
            assert_true(most[1] < 0.5 * most[0] && most[1] < (lamp == SUN ? 25.0 : 60.0));
    }
}

/* A triangle of an aim's target. */
static uint32_t a_triangle_of(const struct world *w, size_t aim)
{
    uint32_t triangle = 0;
    while (kiln_aims_target(w->aims, triangle) != w->aims->aims[aim].target)
        triangle++;
    return triangle;
}

/* The density of a ray of an aim is what its flux has been divided by. */
static void densities_are_those_of_draws(void **state)
{
    (void)state;
    enum { PATHS = 1000 };
    for (int scene = 0; scene < 3 * LAMPS; scene++) {
        const enum lamp lamp = (enum lamp)(scene % LAMPS);
        const bool boxes = scene >= LAMPS, coarse = scene >= 2 * LAMPS;
        struct world w;
        uint32_t random = 7, found = 0, spread = 0;
        double worst = 0.0;
        bodies(&w, lamp, coarse ? COARSE : boxes ? FRAME : APART, boxes ? 16 : 0);
        assert_true((w.aims->targets.listed > 0) == coarse);
        kiln_aims_share(w.aims, PATHS, NULL);
        for (uint64_t i = 0; i < PATHS; i++) {
            double numbers[KILN_AIM_NUMBERS];
            struct kiln_aimed_ray ray;
            for (int k = 0; k < KILN_AIM_NUMBERS; k++)
                numbers[k] = ((double)(random = kiln_hash1(random)) + 0.5) / 4294967296.0;
            const size_t aim = kiln_aims_find(w.aims, i);
            if (!kiln_aims_draw(w.aims, aim, i - w.aims->first[aim], numbers, &ray))
                continue;
            const struct kiln_dvec3 direction = dvec3_of(ray.direction);
            const uint32_t met = ray.triangle != KILN_NONE ? ray.triangle : a_triangle_of(&w, aim);
            const double sent = lamp == AREA || lamp == TWO_SIDED ? 4.0 * ray.cosine
                                : lamp == SKY                     ? 2.0
                                : lamp == SPOT ? 1.0 * kiln_punctual_profile(&w.made->points[0], direction)
                                               : 1.0;
            const double paths = (double)(w.aims->first[aim + 1] - w.aims->first[aim]),
                         density = kiln_aims_density(w.aims, ray.light, met, ray.place, direction),
                         expected = paths * sent / (ray.flux[1] * kiln_aims_met(w.aims, aim, &ray, met));
            spread += ray.triangle != KILN_NONE;
            found += sent > 0.0;
            worst = sent > 0.0 ? fmax(worst, fabs(density / expected - 1.0)) : worst;
            if (lamp < SUN && !boxes) /* away from the target */
                assert_true(kiln_aims_density(w.aims, ray.light, met, ray.place, dvec3_scale(direction, -1.0)) <=
                            (lamp == TWO_SIDED ? density : 0.0));
        }
        print_message("lamp %d: %u rays, densities off by %.2g at most\n", (int)lamp, found, worst);
        assert_true(found > PATHS / 4 && worst < 1e-4 &&
                    (spread > PATHS / 40) == (coarse && lamp != POINT && lamp != SPOT));
        const uint32_t floor = (uint32_t)w.geometry->triangle_count - 1; /* or the lamp */
        assert_true(kiln_aims_density(w.aims, 0, floor, dvec3(0, 0, 0), dvec3(0, 1, 0)) == 0.0);
        release(&w);
    }
}

/* A path is a function of its number: batches of any length have the same bits, and iterations differ. */
static void paths_have_numbers(void **state)
{
    (void)state;
    struct world w;
    struct sums all = {0}, cut = {.world = &w}, other = {0};
    bodies(&w, AREA, APART, 0);
    trace(&w, 1000, 3, 2, &all);
    const struct kiln_land_parameters parameters = {.aims = w.aims};
    uint64_t rays = 0;
    for (uint64_t i = 3000; i < 5000; i += 125) {
        const struct kiln_batch batch = {.first = i, .count = 125, .take = add, .context = &cut};
        assert_int_equal(kiln_backend_run(w.backend, &kiln_pass_land, &parameters, &batch, &rays, NULL), KILN_OK);
    }
    trace(&w, 1000, 5, 2, &other);
    assert_true(memcmp(all.landed, cut.landed, sizeof all.landed) == 0 && all.landed[1] > 0.0 && rays > 2000);
    assert_true(other.landed[1] != all.landed[1]);
    for (size_t i = 0; i < w.aims->count; i++) /* each aim has a path, in order */
        assert_true(w.aims->first[i] < w.aims->first[i + 1] && kiln_aims_find(w.aims, w.aims->first[i]) == i);
    assert_true(w.aims->first[w.aims->count] == 1000);
    release(&w);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(mirror_and_wall),
                                       cmocka_unit_test(spheres_in_a_beam),
                                       cmocka_unit_test(pane),
                                       cmocka_unit_test(under_glass),
                                       cmocka_unit_test(leaning_normals),
                                       cmocka_unit_test(ball_of_glass),
                                       cmocka_unit_test(paraboloid),
                                       cmocka_unit_test(room_of_mirrors),
                                       cmocka_unit_test(prism),
                                       cmocka_unit_test(any_aims_bring_the_same),
                                       cmocka_unit_test(a_frame_is_cut),
                                       cmocka_unit_test(a_sky_is_cut),
                                       cmocka_unit_test(shared_light_is_the_same),
                                       cmocka_unit_test(a_lamp_within_a_sphere),
                                       cmocka_unit_test(coarse_balls),
                                       cmocka_unit_test(densities_are_those_of_draws),
                                       cmocka_unit_test(paths_have_numbers)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
