#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <embree3/rtcore.h>

#include "coordinator/surface/surface_build.h"
#include "tests/unit/surface_scene.h"
#include "worker/scene/footprint.h"
#include "worker/scene/texture.h"

struct built {
    struct fixture *fixture;
    struct kiln_geometry *geometry;
    struct kiln_surface *surface;
};

static void build(struct built *b)
{
    struct kiln_error error = {""};
    struct kiln_surface_report report;
    if (kiln_geometry_create(&b->geometry, &b->fixture->scene, &error) != KILN_OK)
        fail_msg("%s", error.message);
    const struct kiln_surface_params params = {
        .scene = &b->fixture->scene, .geometry = b->geometry, .ranks = 1, .threads = 1};
    if (kiln_surface_build(&b->surface, &params, &report, &error) != KILN_OK)
        fail_msg("%s", error.message);
}

static void release(struct built *b)
{
    kiln_surface_destroy(&b->surface);
    kiln_geometry_destroy(&b->geometry);
    fixture_destroy(b->fixture);
}

/* A cube, a mirrored and sheared one, and one of many triangles a texel. */
static struct built cubes(void)
{
    static const double mirrored[12] = {-1, 0.3, 0, 5, 0, 2, 0, -1, 0.1, 0, 0.5, 2};
    static const double far[12] = {0.2, 0, 0, 0, 0, 0.2, 0, 4, 0, 0, 0.2, 0};
    struct built b = {.fixture = fixture_create()};
    struct fixture *f = b.fixture;
    const uint32_t grey = fixture_material(f, 0.5f, 0.5f, 0.5f);
    const uint32_t coarse = fixture_cube(f, 3, 0.5, grey), dense = fixture_cube(f, 8, 0.5, grey);
    fixture_object(f, coarse, NULL, 64, 48);
    fixture_object(f, coarse, mirrored, 37, 61);
    fixture_object(f, dense, far, 12, 7);
    build(&b);
    return b;
}

static bool texel_of(const struct built *b, uint32_t triangle, double b1, double b2, double x, double y, double *s,
                     double *t)
{
    double c[3][2];
    kiln_geometry_texel_corners(&b->fixture->scene, b->geometry, triangle, c);
    *s = c[0][0] + b1 * (c[1][0] - c[0][0]) + b2 * (c[2][0] - c[0][0]) - x;
    *t = c[0][1] + b1 * (c[1][1] - c[0][1]) + b2 * (c[2][1] - c[0][1]) - y;
    return *s >= 0.0 && *s < 1.0 && *t >= 0.0 && *t < 1.0;
}

enum { BINS = 4 };

struct distribution {
    double bin[BINS][BINS], weight, moment[5]; /* moments s, t, ss, st, tt */
    uint32_t count;
};

static void enter(struct distribution *d, double s, double t, double weight)
{
    const int i = (int)fmin(fmax(s, 0.0) * BINS, BINS - 1), j = (int)fmin(fmax(t, 0.0) * BINS, BINS - 1);
    const double m[5] = {s, t, s * s, s * t, t * t};
    d->bin[j][i] += weight;
    d->weight += weight;
    d->count++;
    for (int k = 0; k < 5; k++)
        d->moment[k] += weight * m[k];
}

/* The reference, computed without clipping: a fine raster over the texel's square, in which each point within a piece
 * counts with the square metres per texel of its triangle. */
static struct distribution truth(const struct built *b, const struct kiln_point_cursor *at)
{
    struct distribution d = {0};
    enum { FINE = 128 };
    for (uint32_t i = 0; i < kiln_piece_count(b->surface, at->point); i++) {
        const uint32_t triangle = b->surface->pieces[at->piece + i];
        double c[3][2];
        kiln_geometry_texel_corners(&b->fixture->scene, b->geometry, triangle, c);
        const double ax = c[1][0] - c[0][0], ay = c[1][1] - c[0][1], bx = c[2][0] - c[0][0], by = c[2][1] - c[0][1];
        const double det = ax * by - bx * ay;
        const double weight = kiln_geometry_triangle_area(b->geometry, triangle) / fabs(det);
        for (int y = 0; y < FINE; y++) {
            for (int x = 0; x < FINE; x++) {
                const double s = (x + 0.5) / FINE, t = (y + 0.5) / FINE;
                const double px = at->x + s - c[0][0], py = at->y + t - c[0][1];
                const double b1 = (px * by - bx * py) / det, b2 = (ax * py - px * ay) / det;
                const bool in = b1 >= 0.0 && b2 >= 0.0 && b1 + b2 <= 1.0;
                if (in)
                    enter(&d, s, t, weight);
            }
        }
    }
    return d;
}

static void check_point(const struct built *b, const struct kiln_point_cursor *at, uint32_t kinds[3])
{
    struct kiln_footprint f;
    kiln_footprint_prepare(&f, &b->fixture->scene, b->geometry, b->surface, at);
    kinds[f.kind]++;
    struct distribution d = {0}, expected = truth(b, at);
    if (expected.count < 300)
        return;              /* too thin for the raster */
    enum { SAMPLES = 4096 }; /* a Hammersley set */
    for (uint32_t i = 0; i < SAMPLES; i++) {
        uint32_t triangle;
        float b1, b2;
        double s, t;
        uint32_t reversed = 0;
        for (uint32_t bit = 0; bit < 12; bit++)
            reversed |= (i >> bit & 1u) << (11 - bit);
        kiln_footprint_sample(&f, ((float)i + 0.5f) / SAMPLES, ((float)reversed + 0.5f) / SAMPLES, &triangle, &b1, &b2);
        assert_true(b1 >= 0.0f && b2 >= 0.0f && b1 + b2 <= 1.0f + 1e-7f);
        bool member = false;
        for (uint32_t k = 0; k < f.piece_count; k++)
            member = member || f.pieces[k] == triangle;
        assert_true(member);
        texel_of(b, triangle, (double)b1, (double)b2, at->x, at->y, &s, &t);
        assert_true(s > -1e-4 && s < 1.0001 && t > -1e-4 && t < 1.0001);
        enter(&d, s, t, 1.0);
    }
    for (int k = 0; k < 5; k++)
        assert_true(fabs(d.moment[k] / d.weight - expected.moment[k] / expected.weight) < 0.01);
    for (int y = 0; y < BINS; y++) {
        for (int x = 0; x < BINS; x++)
            assert_true(fabs(d.bin[y][x] / d.weight - expected.bin[y][x] / expected.weight) < 0.02);
    }
}

/* A sheet of 3 x 3 squares on 4 x 4 texels, masked or blended by a texture of 32 x 32 texels: columns of 3 texels, or a
 * ramp. */
static struct built sheet_with_alpha(uint32_t mode)
{
    static const double whole[4] = {0.0, 1.0, 0.0, 1.0};
    struct built b = {.fixture = fixture_create()};
    struct fixture *f = b.fixture;
    uint32_t texture;
    uint8_t *texels = fixture_texture(f, 32, 32, &texture);
    for (uint32_t i = 0; i < 32 * 32; i++)
        texels[4 * i + 3] = (uint8_t)(mode == KILN_ALPHA_MASK ? (i % 32 % 5 < 3 ? 255 : 0) : 8 * (i % 32));
    struct kiln_material *m = &f->materials[fixture_material(f, 1, 1, 1)];
    m->alpha_mode = mode;
    m->alpha_cutoff = 0.5f;
    m->base_color_texture = texture;
    (void)fixture_mesh(f);
    fixture_sheet(f, dvec3(0, 0, 0), dvec3(1, 0, 0), dvec3(0, 1, 0), 3, whole, 0.4, 0);
    fixture_object(f, 0, NULL, 4, 4);
    build(&b);
    return b;
}

/* Opacity at a place of a triangle, and that place in the texel. */
static double opacity_of(const struct built *b, const struct kiln_footprint *f, uint32_t triangle, float b1, float b2,
                         double *s, double *t)
{
    texel_of(b, triangle, (double)b1, (double)b2, f->place.x, f->place.y, s, t);
    return (double)kiln_surface_opacity(&b->fixture->scene, &b->fixture->meshes[0],
                                        b->geometry->stored_triangle[triangle], b1, b2);
}

/* Opacity where (u1, u2) leads, and that place in the texel. */
static double look(const struct built *b, const struct kiln_footprint *f, float u1, float u2, double *s, double *t)
{
    uint32_t triangle;
    float b1, b2;
    kiln_footprint_sample(f, u1, u2, &triangle, &b1, &b2);
    return opacity_of(b, f, triangle, b1, b2, s, t);
}

/* The mean opacity is that of many places; with the mask, places are drawn by their opacity. */
static void check_mask(const struct built *b, const struct kiln_point_cursor *at, double *off, double *there,
                       double *opaque)
{
    enum { FINE = 128, SAMPLES = 4096 };
    struct kiln_footprint f;
    struct kiln_mask mask;
    kiln_footprint_prepare(&f, &b->fixture->scene, b->geometry, b->surface, at);
    const double presence = (double)kiln_footprint_opacity(&f, (uint32_t)at->point.at + 7u, &mask);
    double sum = 0.0, square = 0.0, moment[2] = {0}, drawn[2] = {0}, s, t;
    for (int i = 0; i < FINE * FINE; i++) {
        const double opacity =
            look(b, &f, ((float)(i % FINE) + 0.5f) / FINE, ((float)(i / FINE) + 0.5f) / FINE, &s, &t);
        sum += opacity;
        square += opacity * opacity;
        moment[0] += opacity * s;
        moment[1] += opacity * t;
    }
    assert_true(fabs(presence - sum / (FINE * FINE)) < 0.05);
    assert_true(mask.count > 0);
    for (uint32_t i = 0; i < SAMPLES; i++) {
        const float u1 = ((float)i + 0.5f) / SAMPLES, u2 = ((float)(kiln_reverse_bits(i) >> 20) + 0.5f) / SAMPLES;
        uint32_t triangle;
        float b1, b2;
        kiln_footprint_sample_present(&f, &mask, (uint32_t)at->point.at + 7u, u1, u2, &triangle, &b1, &b2);
        *there += opacity_of(b, &f, triangle, b1, b2, &s, &t) / (SAMPLES * 16.0);
        drawn[0] += s / SAMPLES;
        drawn[1] += t / SAMPLES;
    }
    off[0] += (presence - sum / (FINE * FINE)) / 16.0;
    *opaque += square / sum / 16.0;
    assert_true(fabs(drawn[0] - moment[0] / sum) < 0.02 && fabs(drawn[1] - moment[1] / sum) < 0.02);
}

static void positions_lie_where_something_is(void **state)
{
    (void)state;
    for (uint32_t mode = KILN_ALPHA_MASK; mode <= KILN_ALPHA_BLEND; mode++) {
        struct built b = sheet_with_alpha(mode);
        double off[1] = {0}, there = 0.0, opaque = 0.0;
        for (size_t f = 0; f < b.surface->tile_run_count; f++) {
            struct kiln_point_cursor at = kiln_point_first(b.surface, f);
            for (uint32_t k = 0; k < b.surface->tile_runs[f].count; k++, kiln_point_next(b.surface, &at))
                check_mask(&b, &at, off, &there, &opaque);
        }
        print_message("%s: mean opacity off by %.1e; where places are it is %.4f, of %.4f\n",
                      mode == KILN_ALPHA_MASK ? "mask" : "blend", off[0], there, opaque);
        assert_true(fabs(off[0]) < 0.012);
        assert_true(fabs(there - opaque) < 0.002); /* places by their opacity: mean of its square over its mean */
        release(&b);
    }
}

static void samples_are_uniform(void **state)
{
    (void)state;
    struct built b = cubes();
    uint32_t kinds[3] = {0};
    uint64_t number = 0;
    for (size_t i = 0; i < b.surface->tile_run_count; i++) {
        struct kiln_point_cursor at = kiln_point_first(b.surface, i);
        for (uint32_t k = 0; k < b.surface->tile_runs[i].count; k++, kiln_point_next(b.surface, &at), number++) {
            if (number % 31 == 0 || (at.object == 2 && number % 3 == 0))
                check_point(&b, &at, kinds);
        }
    }
    for (int kind = 0; kind < 3; kind++)
        assert_true(kinds[kind] >= 3);
    release(&b);
}

/* The parallelogram of a whole texel and its weights lead to the same places. */
static void whole_texels_are_parallelograms(void **state)
{
    (void)state;
    struct built b = cubes();
    uint32_t count = 0;
    for (size_t i = 0; i < b.surface->tile_run_count; i++) {
        struct kiln_point_cursor at = kiln_point_first(b.surface, i);
        for (uint32_t k = 0; k < b.surface->tile_runs[i].count; k++, kiln_point_next(b.surface, &at)) {
            if (!kiln_point_whole(b.surface, at.point))
                continue;
            struct kiln_footprint f;
            kiln_footprint_prepare(&f, &b.fixture->scene, b.geometry, b.surface, &at);
            assert_int_equal(f.kind, KILN_FOOTPRINT_WHOLE);
            uint32_t triangle;
            float b1, b2;
            kiln_footprint_sample(&f, 0.3f, 0.8f, &triangle, &b1, &b2);
            const struct kiln_vec3 p = kiln_triangle_position(b.geometry, triangle, b1, b2);
            const struct kiln_vec3 q = vec3_madd(vec3_madd(f.whole.origin, f.whole.du, 0.3f), f.whole.dv, 0.8f);
            assert_true(vec3_length(vec3_sub(p, q)) < 1e-5f);
            /* but for the room that rounding has at its sides: 8 units of half the last place of a coordinate each */
            const double area = (double)vec3_length(vec3_cross(f.whole.du, f.whole.dv)),
                         far = (double)fmaxf(fabsf(p.x), fmaxf(fabsf(p.y), fabsf(p.z))) + 2.0,
                         room = 4.0 * 8.0 * 0x1p-24 * far / sqrt(area);
            assert_true(fabs(area / (double)b.surface->area[at.point.at] - 1.0) < 1e-4 + room);
            count++;
        }
    }
    assert_true(count > 500);
    release(&b);
}

/* A ball of unit normals, squeezed and mirrored: the world's shading normals are those of the ellipsoid. */
static void normals_follow_the_transform(void **state)
{
    (void)state;
    static const double squeezed[2][12] = {{2, 0, 0, 1, 0, 0.5, 0, 0, 0, 0, 1, 0},
                                           {-2, 0, 0, 1, 0, 0.5, 0, 0, 0, 0, 1, 0}};
    struct built b = {.fixture = fixture_create()};
    struct fixture *f = b.fixture;
    const uint32_t mesh = fixture_cube(f, 12, 0.0, fixture_material(f, 0.5f, 0.5f, 0.5f));
    for (size_t v = 0; v < f->scene.vertex_count; v++)
        f->positions[v] = f->normals[v] = vec3_normalize(f->positions[v]);
    f->meshes[mesh].flags = KILN_MESH_SMOOTH;
    fixture_object(f, mesh, squeezed[0], 96, 96);
    fixture_object(f, mesh, squeezed[1], 96, 96);
    build(&b);
    uint32_t bent = 0;
    for (size_t i = 0; i < b.surface->tile_run_count; i++) {
        struct kiln_point_cursor at = kiln_point_first(b.surface, i);
        for (uint32_t k = 0; k < b.surface->tile_runs[i].count; k++, kiln_point_next(b.surface, &at)) {
            struct kiln_footprint footprint;
            struct kiln_vec3 geometric, shading;
            uint32_t triangle;
            float b1, b2;
            kiln_footprint_prepare(&footprint, &f->scene, b.geometry, b.surface, &at);
            kiln_footprint_normals(&footprint, &geometric, &shading);
            kiln_footprint_sample(&footprint, 0.5f, 0.5f, &triangle, &b1, &b2);
            const struct kiln_vec3 p = kiln_triangle_position(b.geometry, triangle, b1, b2);
            const struct kiln_vec3 ideal = vec3_normalize(vec3((p.x - 1.0f) / 4.0f, p.y / 0.25f, p.z));
            assert_true(fabsf(vec3_length(shading) - 1.0f) < 1e-5f && fabsf(vec3_length(geometric) - 1.0f) < 1e-5f);
            assert_true(vec3_dot(shading, ideal) > 0.99f); /* the texel has an extent of its own */
            assert_true(vec3_dot(geometric, ideal) > 0.9f);
            const struct kiln_vec3 here = kiln_triangle_shading_normal(&f->scene, b.geometry, triangle, b1, b2);
            assert_true(vec3_dot(here, ideal) > 0.9995f);
            bent += vec3_dot(shading, geometric) < 0.9999f;
        }
    }
    assert_true(bent > 1000);
    release(&b);
}

/* Normals that face the other way than the winding, or are missing, give way to the geometric one. */
static void bad_normals_give_way(void **state)
{
    (void)state;
    struct built b = {.fixture = fixture_create()};
    struct fixture *f = b.fixture;
    const uint32_t mesh = fixture_cube(f, 2, 0.0, fixture_material(f, 0.5f, 0.5f, 0.5f));
    for (size_t v = 0; v < f->scene.vertex_count; v++)
        f->normals[v] = v % 2 == 0 ? vec3_scale(f->positions[v], -1.0f) : vec3(0.0f, 0.0f, 0.0f);
    f->meshes[mesh].flags = KILN_MESH_SMOOTH;
    fixture_object(f, mesh, NULL, 32, 32);
    build(&b);
    for (size_t i = 0; i < b.surface->tile_run_count; i++) {
        struct kiln_point_cursor at = kiln_point_first(b.surface, i);
        for (uint32_t k = 0; k < b.surface->tile_runs[i].count; k++, kiln_point_next(b.surface, &at)) {
            struct kiln_footprint footprint;
            struct kiln_vec3 geometric, shading;
            kiln_footprint_prepare(&footprint, &f->scene, b.geometry, b.surface, &at);
            kiln_footprint_normals(&footprint, &geometric, &shading);
            assert_memory_equal(&geometric, &shading, sizeof geometric);
            struct kiln_vec3 c[3];
            kiln_geometry_corners(b.geometry, footprint.pieces[0], c);
            assert_true(vec3_dot(geometric, c[0]) > 0.999f); /* a side of the cube -1..1 */
        }
    }
    release(&b);
}

enum { LONE = 300 };

/* Random triangles, from squat to needle, of size `size` about places up to `away` from the centre. */
static struct built scattered(double size, double away)
{
    struct built b = {.fixture = fixture_create()};
    struct fixture *f = b.fixture;
    const uint32_t mesh = fixture_mesh(f);
    fixture_material(f, 0.5f, 0.5f, 0.5f);
    for (uint32_t t = 0; t < LONE; t++) {
        double o[3], e[2][3];
        for (int k = 0; k < 3; k++) {
            o[k] = away * (2.0 * fixture_random(f) - 1.0);
            e[0][k] = size * (2.0 * fixture_random(f) - 1.0);
            e[1][k] = size * (2.0 * fixture_random(f) - 1.0);
            if (t % 4 == 1) /* a needle */
                e[1][k] = 0.7 * e[0][k] + 0.01 * e[1][k];
            if (t % 4 == 2 && k == 1) /* level */
                o[k] = e[0][k] = e[1][k] = t % 8 == 2 ? 0.0 : o[k] * 0.5;
        }
        if (t % 4 == 2)
            e[0][1] = e[1][1] = 0.0;
        fixture_vertex(f, o[0], o[1], o[2], 0.0, 0.0);
        fixture_vertex(f, o[0] + e[0][0], o[1] + e[0][1], o[2] + e[0][2], 1.0, 0.0);
        fixture_vertex(f, o[0] + e[1][0], o[1] + e[1][1], o[2] + e[1][2], 0.0, 1.0);
        fixture_triangle(f, 3 * t, 3 * t + 1, 3 * t + 2, 0);
    }
    fixture_object(f, mesh, NULL, 8, 8);
    struct kiln_error error = {""};
    if (kiln_geometry_create(&b.geometry, &f->scene, &error) != KILN_OK)
        fail_msg("%s", error.message);
    return b;
}

static RTCScene embree_scene(RTCDevice device, const struct kiln_geometry *g, enum RTCSceneFlags flags)
{
    RTCScene scene = rtcNewScene(device);
    rtcSetSceneFlags(scene, flags);
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, g->vertices, 0, 12,
                               g->vertex_count);
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, g->indices, 0, 12,
                               g->triangle_count);
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(scene);
    return scene;
}

/* Signed height of p over a triangle's plane, in double. */
static double height(const struct kiln_geometry *g, uint32_t t, struct kiln_vec3 p)
{
    struct kiln_vec3 c[3];
    kiln_geometry_corners(g, t, c);
    const struct kiln_dvec3 o = dvec3_of(c[0]);
    const struct kiln_dvec3 n = dvec3_cross(dvec3_sub(dvec3_of(c[1]), o), dvec3_sub(dvec3_of(c[2]), o));
    return dvec3_dot(dvec3_sub(dvec3_of(p), o), n) / dvec3_length(n);
}

/* Rays from offset origins never hit the triangle that they start from, at any scale, and the offset stays small. */
static void offset_rays_leave(void **state)
{
    (void)state;
    static const double scales[][2] = {{1e-6, 1e-6},  {1e-6, 1e-3}, {1.0, 0.0}, {1.0, 1.0},
                                       {0.01, 100.0}, {1e3, 1.0},   {1e6, 1e6}};
    RTCDevice device = rtcNewDevice("threads=1");
    for (size_t i = 0; i < sizeof scales / sizeof *scales; i++) {
        struct built b = scattered(scales[i][0], scales[i][1]);
        RTCScene plain = embree_scene(device, b.geometry, RTC_SCENE_FLAG_NONE);
        RTCScene robust = embree_scene(device, b.geometry, RTC_SCENE_FLAG_ROBUST);
        for (uint32_t k = 0; k < LONE * 60; k++) {
            const uint32_t t = k % LONE;
            const float root = sqrtf((float)fixture_random(b.fixture)), b1 = root * (float)fixture_random(b.fixture),
                        b2 = root - b1;
            const struct kiln_vec3 up = kiln_triangle_normal(b.geometry, t);
            if (vec3_length(up) < 0.5f)
                continue;
            const struct kiln_vec3 n = k / LONE % 2 == 0 ? up : vec3_scale(up, -1.0f);
            const struct kiln_vec3 p = kiln_triangle_position(b.geometry, t, b1, b2);
            const struct kiln_vec3 o = kiln_offset_origin(p, n, b.geometry, t);
            const double above = height(b.geometry, t, o) * (k / LONE % 2 == 0 ? 1.0 : -1.0);
            const double distance = (double)kiln_offset_distance(b.geometry, t, n);
            assert_true(above >= 0.0);
            assert_true(above <= 2.0 * distance + 1e-30);
            assert_true(distance <=
                        2e-6 * (scales[i][1] + 2.0 * scales[i][0]) + 3e-3 * scales[i][0] * (t % 4 == 1 ? 1.0 : 0.05));
            /* a direction of the hemisphere, often a grazing one */
            struct kiln_vec3 d;
            do
                d = vec3((float)fixture_random(b.fixture) - 0.5f, (float)fixture_random(b.fixture) - 0.5f,
                         (float)fixture_random(b.fixture) - 0.5f);
            while (vec3_length(d) < 0.1f);
            d = vec3_normalize(d);
            const float toward = vec3_dot(d, n);
            if (toward < 0.0f || k % 3 == 0)
                d = vec3_normalize(vec3_madd(d, n, k % 3 == 0 ? 1e-3f - toward : -2.0f * toward));
            if (!(vec3_dot(d, n) > 1e-5f))
                continue;
            for (int r = 0; r < 2; r++) {
                struct RTCIntersectContext context;
                rtcInitIntersectContext(&context);
                struct RTCRayHit ray = {.ray = {.org_x = o.x,
                                                .org_y = o.y,
                                                .org_z = o.z,
                                                .dir_x = d.x,
                                                .dir_y = d.y,
                                                .dir_z = d.z,
                                                .tfar = INFINITY,
                                                .mask = ~0u},
                                        .hit = {.geomID = RTC_INVALID_GEOMETRY_ID}};
                rtcIntersect1(r == 0 ? plain : robust, &context, &ray);
                assert_true(ray.hit.geomID == RTC_INVALID_GEOMETRY_ID || ray.hit.primID != t);
            }
        }
        rtcReleaseScene(plain);
        rtcReleaseScene(robust);
        release(&b);
    }
    rtcReleaseDevice(device);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(positions_lie_where_something_is),
        cmocka_unit_test(samples_are_uniform),
        cmocka_unit_test(whole_texels_are_parallelograms),
        cmocka_unit_test(normals_follow_the_transform),
        cmocka_unit_test(bad_normals_give_way),
        cmocka_unit_test(offset_rays_leave),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
