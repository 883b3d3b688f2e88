/* Ambient occlusion and light by direction against closed forms, on Embree and, where there is a device, on Vulkan.
 *
 * A small receiver lies about the origin and looks up. Over it stand a disc, or something that closes a wedge of the
 * hemisphere: what lies between the ground on the side of +x and a plane through the z axis, at `angle` to the ground.
 * An endless wall at x = d of height h closes the wedge of angle atan(h / d), and a half-plane at height h that begins
 * at x = d, together with a wall below it, the same.
 *
 * With w = (cos b cos a, cos b sin a, sin b), dw = cos b da db, the open rest of the hemisphere is a from `angle` to pi
 * and b from -pi/2 to pi/2. The integrals below follow. */
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
#include "worker/backend/backend.h"
#include "worker/light/lights.h"
#include "worker/pass/directional.h"
#include "worker/pass/occlusion.h"
#include "worker/sampling/harmonics.h"
#include "worker/scene/radiosity.h"

enum { SIDE = 6, POINTS = SIDE * SIDE, SAMPLES = 1024 };
static const double receiver_half = 1e-3, endless = 2e4; /* m */
static const double flat[4] = {0.0, 1.0, 0.0, 1.0};

/* ---- scenes: object 0 is the receiver ---- */

struct world {
    struct fixture *fixture;
    struct kiln_light lights_of_scene[2];
    struct kiln_geometry *geometry;
    struct kiln_lights *lights;
    struct kiln_surface *surface;
    uint64_t *radiosity;
    struct kiln_backend *backends[2]; /* made when first asked, for all runs: compiling kernels takes long */
    bool repeated;                    /* another world shows the same; on Vulkan only with KILN_TEST_FULL */
};

static const char *const names[2] = {"embree", "vulkan"};

static void begin(struct world *w)
{
    *w = (struct world){.fixture = fixture_create()};
    struct fixture *f = w->fixture;
    const double e = receiver_half;
    const uint32_t grey = fixture_material(f, 0.5f, 0.5f, 0.5f);
    f->scene.lights = w->lights_of_scene;
    fixture_mesh(f);
    fixture_sheet(f, dvec3(-e, 0, e), dvec3(2 * e, 0, 0), dvec3(0, 0, -2 * e), 1, flat, 0.0, grey);
    fixture_object(f, 0, NULL, SIDE, SIDE);
}

/* The receiver lets most light through: it does not hide what lies below it. */
static void thin_receiver(struct world *w)
{
    w->fixture->materials[0].alpha_mode = KILN_ALPHA_BLEND;
    w->fixture->materials[0].base_color[3] = 0.125f;
}

/* A sheet with corner o and sides a and b that looks along a x b. */
static void sheet(struct world *w, struct kiln_dvec3 o, struct kiln_dvec3 a, struct kiln_dvec3 b, uint32_t material)
{
    const uint32_t mesh = fixture_mesh(w->fixture);
    fixture_sheet(w->fixture, o, a, b, 1, flat, 0.0, material);
    fixture_object(w->fixture, mesh, NULL, 8, 8);
}

/* An endless wall at x = d of height h that looks to the receiver. */
static void wall(struct world *w, double d, double h, uint32_t material)
{
    sheet(w, dvec3(d, 0, -endless), dvec3(0, 0, 2 * endless), dvec3(0, h, 0), material);
}

/* A disc of radius r at height h that looks down, or up. */
static void disc(struct world *w, double r, double h, bool up)
{
    enum { CORNERS = 1024 };
    struct fixture *f = w->fixture;
    const uint32_t mesh = fixture_mesh(f), centre = fixture_vertex(f, 0, h, 0, 0.5, 0.5);
    const double tuned = r * sqrt(2.0 * KILN_PI / CORNERS / sin(2.0 * KILN_PI / CORNERS)); /* of the disc's area */
    for (int i = 0; i < CORNERS; i++) {
        const double a = 2.0 * KILN_PI * i / CORNERS;
        fixture_vertex(f, tuned * cos(a), h, tuned * sin(a), 0.5 + 0.49 * cos(a), 0.5 + 0.49 * sin(a));
    }
    for (uint32_t i = 0; i < CORNERS; i++) {
        const uint32_t a = centre + 1 + i, b = centre + 1 + (i + 1) % CORNERS;
        fixture_triangle(f, centre, up ? b : a, up ? a : b, 0);
    }
    fixture_object(f, mesh, NULL, 8, 8);
}

static void finish(struct world *w)
{
    struct fixture *f = w->fixture;
    assert_int_equal(kiln_geometry_create(&w->geometry, &f->scene, NULL), KILN_OK);
    assert_int_equal(kiln_lights_create(&w->lights, &f->scene, w->geometry, NULL), KILN_OK);
    const struct kiln_surface_params params = {.scene = &f->scene, .geometry = w->geometry, .ranks = 1, .threads = 1};
    assert_int_equal(kiln_surface_build(&w->surface, &params, &(struct kiln_surface_report){0}, NULL), KILN_OK);
    w->radiosity = calloc(w->surface->point_count, sizeof *w->radiosity);
}

static void release(struct world *w)
{
    for (int i = 0; i < 2; i++)
        kiln_backend_destroy(&w->backends[i]);
    free(w->radiosity);
    kiln_surface_destroy(&w->surface);
    kiln_lights_destroy(&w->lights);
    kiln_geometry_destroy(&w->geometry);
    fixture_destroy(w->fixture);
}

/* ---- runs ---- */

/* Results of the receiver's points. */
struct kept {
    const struct kiln_surface *surface;
    size_t bytes, count;
    char *results;
};

static int keep(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    (void)error;
    struct kept *k = context;
    const struct kiln_tile_run *runs = k->surface->tile_runs;
    for (size_t i = first; i < first + count; i++) {
        if (runs[i].map != 0)
            continue;
        const uint64_t skipped = runs[i].first.at - runs[first].first.at;
        assert_true(k->count + runs[i].count <= POINTS);
        memcpy(k->results + k->count * k->bytes, (const char *)results + skipped * k->bytes, runs[i].count * k->bytes);
        k->count += runs[i].count;
    }
    return KILN_OK;
}

static struct kiln_backend *backend_of(struct world *w, size_t which)
{
    struct kiln_error error = {""};
    struct kiln_backend **backend = &w->backends[which];
    const struct kiln_backend_params params = {
        .scene = &w->fixture->scene, .geometry = w->geometry, .lights = w->lights, .threads = 2, .seed = 11};
    if (*backend == NULL && (kiln_backend_create(backend, names[which], &params, &error) != KILN_OK ||
                             kiln_backend_set_surface(*backend, w->surface, &error) != KILN_OK ||
                             kiln_backend_set_radiosity(*backend, w->radiosity, &error) != KILN_OK))
        fail_msg("%s: %s", names[which], error.message);
    return *backend;
}

/* The pass's results of all points of the receiver. Returns the rays of all points. */
static uint64_t run(struct world *w, size_t which, const struct kiln_pass *pass, const void *parameters,
                    uint32_t samples, void *results)
{
    struct kiln_error error = {""};
    uint64_t rays = 0;
    struct kept k = {.surface = w->surface, .bytes = pass->result_bytes, .results = results};
    const struct kiln_batch batch = {
        .count = w->surface->tile_run_count, .samples = samples, .take = keep, .context = &k};
    if (kiln_backend_run(backend_of(w, which), pass, parameters, &batch, &rays, &error) != KILN_OK)
        fail_msg("%s: %s", names[which], error.message);
    assert_true(k.count == POINTS);
    return rays;
}

static size_t backends(const struct world *w)
{
    return vulkan_device_is_there() && (!w->repeated || getenv("KILN_TEST_FULL") != NULL) ? 2 : 1;
}

static void is_near(double value, double expected, double tolerance, const char *what)
{
    if (!(fabs(value - expected) <= tolerance))
        fail_msg("%s: %.6f instead of %.6f, off by %.1e and not %.1e at most", what, value, expected,
                 fabs(value - expected), tolerance);
}

/* ---- ambient occlusion ---- */

struct open {
    double share, direction[3];
};

static struct open open_beside_wedge(double angle)
{
    return (struct open){.share = (1.0 + cos(angle)) / 2.0,
                         .direction = {-2.0 / (3.0 * KILN_PI) * sin(angle) * sin(angle),
                                       4.0 / (3.0 * KILN_PI) * ((KILN_PI - angle) / 2.0 + sin(2.0 * angle) / 4.0)}};
}

/* All directions more than acos(cosine) off the normal. */
static struct open open_beside_cone(double cosine)
{
    return (struct open){.share = cosine * cosine, .direction = {0, 2.0 / 3.0 * cosine * cosine * cosine}};
}

/* Single points within `tolerance`, their mean within a tenth of it; a standard error that is about as large. */
static void check_open(const struct kiln_occlusion_result *r, const struct open *expected, double tolerance,
                       const char *what)
{
    struct open mean = {0};
    double square = 0.0, error = 0.0;
    for (int i = 0; i < POINTS; i++) {
        const double open = (double)kiln_mean(r[i].open, r[i].count), off = open - expected->share,
                     stated = (double)kiln_mean(r[i].error, r[i].count);
        assert_true(r[i].count == SAMPLES && open >= 0.0 && open <= 1.0 && stated >= 0.0);
        is_near(open, expected->share, tolerance, what);
        mean.share += open / POINTS;
        for (int c = 0; c < 3; c++) {
            const double direction = (double)kiln_mean(r[i].direction[c], r[i].count);
            is_near(direction, expected->direction[c], tolerance, what);
            mean.direction[c] += direction / POINTS;
        }
        square += off * off / POINTS;
        error += stated * stated / POINTS;
    }
    print_message("%s: open %.6f, closed form %.6f; error %.1e, estimated %.1e\n", what, mean.share, expected->share,
                  sqrt(square), sqrt(error));
    is_near(mean.share, expected->share, 0.15 * tolerance, what);
    for (int c = 0; c < 3; c++)
        is_near(mean.direction[c], expected->direction[c], 0.15 * tolerance, what);
    assert_true(sqrt(square) <= 2.0 * sqrt(error) + 1e-6);
    assert_true(sqrt(error) <= tolerance);
}

static void check_occlusion(struct world *w, float distance, struct open expected, double tolerance, const char *what)
{
    const size_t count = backends(w);
    const struct kiln_occlusion_parameters parameters = {.distance = distance};
    for (size_t i = 0; i < count; i++) {
        struct kiln_occlusion_result results[POINTS];
        (void)run(w, i, &kiln_pass_occlusion, &parameters, SAMPLES, results);
        check_open(results, &expected, tolerance, what);
    }
}

/* Surfaces farther away than the distance do not count, to the last bit. */
static void far_plates_close_nothing(struct world *w)
{
    const size_t count = backends(w);
    const struct kiln_occlusion_parameters parameters = {.distance = 0.599f};
    struct kiln_occlusion_result results[POINTS];
    for (size_t k = 0; k < count; k++) {
        const uint64_t rays = run(w, k, &kiln_pass_occlusion, &parameters, SAMPLES, results);
        assert_true(rays % SAMPLES == 0 && rays / SAMPLES > POINTS); /* the disc's points too */
        for (int i = 0; i < POINTS; i++) {
            assert_true(results[i].count == SAMPLES && results[i].open == SAMPLES && results[i].error == 0.0f);
            is_near((double)results[i].direction[1] / SAMPLES, 2.0 / 3.0, 1e-3, "open sky");
        }
    }
}

static void discs_close_a_cone(void **state)
{
    (void)state;
    const double r = 0.8, h = 0.6; /* the edge is 1 m away */
    for (int up = 0; up < 2; up++) {
        struct world w;
        begin(&w);
        w.repeated = up;
        disc(&w, r, h, up);
        finish(&w);
        check_occlusion(&w, INFINITY, open_beside_cone(h / 1.0), 0.02, up ? "disc, its back" : "disc");
        check_occlusion(&w, 0.75f, open_beside_cone(h / 0.75), 0.02, "part of the disc within distance");
        check_occlusion(&w, 1.01f, open_beside_cone(h / 1.0), 0.02, "all of the disc within distance");
        far_plates_close_nothing(&w);
        release(&w);
    }
}

static void walls_and_roofs_close_a_wedge(void **state)
{
    (void)state;
    struct world w;
    begin(&w);
    wall(&w, 1.0, 0.5, 0);
    finish(&w);
    check_occlusion(&w, INFINITY, open_beside_wedge(atan2(0.5, 1.0)), 0.02, "wall");
    release(&w);
    begin(&w);
    w.repeated = true;
    wall(&w, 1.0, 3.0, 0);
    finish(&w);
    check_occlusion(&w, INFINITY, open_beside_wedge(atan2(3.0, 1.0)), 0.02, "high wall");
    release(&w);
    begin(&w); /* a half-plane overhead that goes past the zenith */
    w.repeated = true;
    sheet(&w, dvec3(-1.0, 1.0, -endless), dvec3(endless, 0, 0), dvec3(0, 0, 2 * endless), 0);
    finish(&w);
    check_occlusion(&w, INFINITY, open_beside_wedge(atan2(1.0, -1.0)), 0.02, "half-plane overhead");
    release(&w);
}

/* The hemisphere is that of the shading normal; what of it lies below the surface is closed. */
static void shading_normals_turn_the_hemisphere(void **state)
{
    (void)state;
    for (int i = 0; i < 2; i++) {
        const double tilt = i == 0 ? 0.3 : 1.2;
        const struct open leant = open_beside_wedge(tilt); /* seen along the shading normal, leant towards +x */
        const struct kiln_dvec3 s = dvec3(sin(tilt), cos(tilt), 0.0);
        struct world w;
        begin(&w);
        w.repeated = i == 0;
        thin_receiver(&w);
        w.fixture->meshes[0].flags |= KILN_MESH_SMOOTH;
        for (int v = 0; v < 4; v++)
            w.fixture->normals[v] = vec3_of(s);
        finish(&w);
        const struct open expected = {.share = leant.share,
                                      .direction = {leant.direction[0] * s.y + leant.direction[1] * s.x,
                                                    leant.direction[1] * s.y - leant.direction[0] * s.x}};
        check_occlusion(&w, INFINITY, expected, 0.02, "shading normal");
        release(&w);
    }
}

/* A surface that lets light through closes by its opacity. */
static void thin_surfaces_close_in_part(void **state)
{
    (void)state;
    struct world w;
    begin(&w);
    const uint32_t thin = fixture_material(w.fixture, 1, 1, 1);
    w.fixture->materials[thin].alpha_mode = KILN_ALPHA_BLEND;
    w.fixture->materials[thin].base_color[3] = 0.25f;
    wall(&w, 1.0, 3.0, thin);
    finish(&w);
    const struct open all = open_beside_wedge(0.0), beside = open_beside_wedge(atan2(3.0, 1.0));
    struct open expected = {.share = 0.75 * all.share + 0.25 * beside.share};
    for (int c = 0; c < 3; c++)
        expected.direction[c] = 0.75 * all.direction[c] + 0.25 * beside.direction[c];
    check_occlusion(&w, INFINITY, expected, 0.05, "wall of opacity 1/4");
    release(&w);
}

/* ---- light by direction ---- */

struct light {
    double harmonics[KILN_DIRECTIONAL_HARMONICS][3];
};

/* Adds light whose coefficients are `rgb` times these. */
static void add_light(struct light *light, const double harmonics[KILN_DIRECTIONAL_HARMONICS], double r, double g,
                      double b)
{
    for (int i = 0; i < KILN_DIRECTIONAL_HARMONICS; i++) {
        light->harmonics[i][0] += r * harmonics[i];
        light->harmonics[i][1] += g * harmonics[i];
        light->harmonics[i][2] += b * harmonics[i];
    }
}

/* Radiance 1 within the wedge. */
static void light_of_wedge(double angle, double harmonics[KILN_DIRECTIONAL_HARMONICS])
{
    const double y0 = sqrt(0.25 / KILN_PI), y1 = sqrt(0.75 / KILN_PI);
    harmonics[0] = y0 * 2.0 * angle;
    harmonics[1] = y1 * KILN_PI / 2.0 * (1.0 - cos(angle));
    harmonics[2] = 0.0;
    harmonics[3] = y1 * KILN_PI / 2.0 * sin(angle);
}

static void whole_hemisphere(double harmonics[KILN_DIRECTIONAL_HARMONICS]) { light_of_wedge(KILN_PI, harmonics); }

/* Single points within `tolerance` of band 0, their mean within 0.15 of that. */
static void check_light(struct world *w, const struct light *expected, double tolerance, const char *what)
{
    const size_t count = backends(w);
    for (size_t k = 0; k < count; k++) {
        struct kiln_directional_result results[POINTS];
        const uint64_t rays = run(w, k, &kiln_pass_directional, NULL, SAMPLES, results);
        double worst = 0.0;
        assert_true(rays >= (uint64_t)SAMPLES * POINTS);
        for (int h = 0; h < KILN_DIRECTIONAL_HARMONICS; h++)
            for (int c = 0; c < 3; c++) {
                const double scale = expected->harmonics[0][c] > 0.0 ? expected->harmonics[0][c] : 1.0;
                double mean = 0.0;
                for (int i = 0; i < POINTS; i++) {
                    const double value = (double)kiln_mean(results[i].radiance[h][c], results[i].count);
                    assert_true(results[i].count == SAMPLES);
                    is_near(value / scale, expected->harmonics[h][c] / scale, tolerance, what);
                    mean += value / POINTS;
                }
                worst = fmax(worst, fabs(mean - expected->harmonics[h][c]) / scale);
            }
        print_message("%s: mean within %.1e\n", what, worst);
        is_near(worst, 0.0, 0.15 * tolerance, what);
    }
}

/* E(n) of worker/pass/directional.h. */
static double irradiance(const double harmonics[KILN_DIRECTIONAL_HARMONICS], struct kiln_dvec3 n)
{
    double y[KILN_HARMONICS], sum = 0.0;
    kiln_harmonics(n, y);
    for (int i = 0; i < KILN_DIRECTIONAL_HARMONICS; i++)
        sum += kiln_harmonics_cosine(i) * y[i] * harmonics[i];
    return sum;
}

static void skies_light_the_hemisphere(void **state)
{
    (void)state;
    struct world w;
    double whole[KILN_DIRECTIONAL_HARMONICS];
    float image[6 * 3 * 3];
    struct light constant = {0}, sampled = {0};
    whole_hemisphere(whole);
    is_near(irradiance(whole, dvec3(0, 1, 0)), KILN_PI, 1e-12, "irradiance under a sky");
    begin(&w);
    w.repeated = true; /* by panes_tint_the_sky */
    w.fixture->environment = (struct kiln_environment){.kind = KILN_ENVIRONMENT_CONSTANT, .radiance = {0.5f, 1, 2}};
    finish(&w);
    add_light(&constant, whole, 0.5, 1, 2);
    check_light(&w, &constant, 2e-3, "constant sky");
    release(&w);
    for (size_t i = 0; i < sizeof image / sizeof *image; i++)
        image[i] = (float)(1 << i % 3); /* the same all over, but shadow rays go to it */
    begin(&w);
    w.fixture->environment = (struct kiln_environment){
        .kind = KILN_ENVIRONMENT_LATLONG, .radiance = {1, 1, 1}, .rotation = 0.7f, .width = 6, .height = 3};
    w.fixture->scene.environment_texels = image;
    finish(&w);
    add_light(&sampled, whole, 1, 2, 4);
    check_light(&w, &sampled, 0.05, "image of a sky");
    release(&w);
}

/* A pane of coloured glass before a constant sky. */
static void panes_tint_the_sky(void **state)
{
    (void)state;
    struct world w;
    double whole[KILN_DIRECTIONAL_HARMONICS], wedge[KILN_DIRECTIONAL_HARMONICS];
    struct light expected = {0};
    whole_hemisphere(whole);
    light_of_wedge(atan2(2.0, 1.0), wedge);
    begin(&w);
    const uint32_t glass = fixture_material(w.fixture, 1.0f, 0.5f, 0.25f);
    w.fixture->materials[glass].transmission = 1.0f;
    w.fixture->materials[glass].transmission_texture = KILN_NONE;
    w.fixture->environment = (struct kiln_environment){.kind = KILN_ENVIRONMENT_CONSTANT, .radiance = {1, 1, 1}};
    wall(&w, 1.0, 2.0, glass);
    finish(&w);
    add_light(&expected, whole, 1, 1, 1);
    add_light(&expected, wedge, 0, -0.5, -0.75);
    check_light(&w, &expected, 0.02, "pane");
    release(&w);
}

static void lamps_send_their_intensity(void **state)
{
    (void)state;
    const struct kiln_dvec3 to = dvec3(1.0, 2.0, -2.0); /* 3 m */
    double y[KILN_HARMONICS];
    struct light lamp = {0}, sun = {0};
    struct world w;
    kiln_harmonics(dvec3_scale(to, 1.0 / 3.0), y);
    add_light(&lamp, y, 1 / 9.0, 2 / 9.0, 3 / 9.0);
    add_light(&sun, y, 1, 2, 3);
    begin(&w);
    w.fixture->scene.light_count = 1;
    w.lights_of_scene[0] =
        (struct kiln_light){.kind = KILN_LIGHT_POINT, .position = {to.x, to.y, to.z}, .intensity = {1, 2, 3}};
    finish(&w);
    check_light(&w, &lamp, 1e-3, "point lamp");
    release(&w);
    begin(&w); /* in that direction, and a second one below the ground */
    w.fixture->scene.light_count = 2;
    w.lights_of_scene[0] = (struct kiln_light){
        .kind = KILN_LIGHT_DIRECTIONAL, .direction = {-1.0f / 3.0f, -2.0f / 3.0f, 2.0f / 3.0f}, .intensity = {1, 2, 3}};
    w.lights_of_scene[1] =
        (struct kiln_light){.kind = KILN_LIGHT_DIRECTIONAL, .direction = {0.6f, 0.8f, 0}, .intensity = {5, 5, 5}};
    finish(&w);
    check_light(&w, &sun, 1e-4, "sun");
    release(&w);
}

/* A wall whose surface has this radiosity; opacity 1: an opaque one. */
static void check_wall_of_radiosity(bool double_sided, bool turned, double opacity, double tolerance, const char *what)
{
    const double h = 2.0, seen = turned && !double_sided ? 0.0 : opacity / KILN_PI;
    static const float radiosity[3] = {4, 2, 1};
    struct world w;
    double wedge[KILN_DIRECTIONAL_HARMONICS];
    struct light expected = {0};
    light_of_wedge(atan2(h, 1.0), wedge);
    add_light(&expected, wedge, 4 * seen, 2 * seen, seen);
    begin(&w);
    w.repeated = !double_sided && !turned && opacity == 1.0; /* by opacity 1/2 */
    const uint32_t material = fixture_material(w.fixture, 1, 1, 1);
    w.fixture->materials[material].double_sided = double_sided;
    w.fixture->materials[material].alpha_mode = opacity < 1.0 ? KILN_ALPHA_BLEND : KILN_ALPHA_OPAQUE;
    w.fixture->materials[material].base_color[3] = (float)opacity;
    if (turned)
        sheet(&w, dvec3(1, 0, endless), dvec3(0, 0, -2 * endless), dvec3(0, h, 0), material);
    else
        wall(&w, 1.0, h, material);
    finish(&w);
    for (uint64_t i = 0; i < w.surface->point_count; i++)
        w.radiosity[i] = kiln_radiosity_pack(radiosity, 0);
    check_light(&w, &expected, tolerance, what);
    release(&w);
}

static void surfaces_send_their_radiosity(void **state)
{
    (void)state;
    check_wall_of_radiosity(false, false, 1.0, 0.03, "wall with radiosity");
    check_wall_of_radiosity(true, true, 1.0, 0.03, "back of a double-sided wall");
    check_wall_of_radiosity(false, true, 1.0, 0.0, "back of a single-sided wall");
    check_wall_of_radiosity(false, false, 0.5, 0.25, "wall of opacity 1/2");
}

/* The same wall as a lamp: what shadow rays find. It reaches below the ground of the receiver, too. */
static void area_lamps_send_their_radiance(void **state)
{
    (void)state;
    struct world w;
    double wedge[KILN_DIRECTIONAL_HARMONICS];
    struct light expected = {0};
    light_of_wedge(atan2(2.0, 1.0), wedge);
    add_light(&expected, wedge, 5, 4, 3);
    begin(&w);
    thin_receiver(&w);
    const uint32_t lamp = fixture_material(w.fixture, 0, 0, 0);
    memcpy(w.fixture->materials[lamp].emission, (const float[3]){5, 4, 3}, sizeof(float[3]));
    sheet(&w, dvec3(1, -1, -500), dvec3(0, 0, 1000), dvec3(0, 3, 0), lamp);
    finish(&w);
    check_light(&w, &expected, 0.05, "wall as a lamp");
    release(&w);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(discs_close_a_cone),
        cmocka_unit_test(walls_and_roofs_close_a_wedge),
        cmocka_unit_test(shading_normals_turn_the_hemisphere),
        cmocka_unit_test(thin_surfaces_close_in_part),
        cmocka_unit_test(skies_light_the_hemisphere),
        cmocka_unit_test(panes_tint_the_sky),
        cmocka_unit_test(lamps_send_their_intensity),
        cmocka_unit_test(surfaces_send_their_radiosity),
        cmocka_unit_test(area_lamps_send_their_radiance),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
