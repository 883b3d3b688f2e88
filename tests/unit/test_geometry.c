#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "tests/unit/surface_scene.h"
#include "worker/scene/footprint.h"

static struct kiln_geometry *create(struct fixture *f)
{
    struct kiln_geometry *g = NULL;
    struct kiln_error error = {""};
    if (kiln_geometry_create(&g, &f->scene, &error) != KILN_OK)
        fail_msg("%s", error.message);
    return g;
}

static const double mirrored[12] = {-1, 0.3, 0, 5, 0, 2, 0, -1, 0.1, 0, 0.5, 2};

static void fronts_look_out(void **state)
{
    (void)state;
    struct fixture *f = fixture_create();
    const uint32_t grey = fixture_material(f, 0.5f, 0.5f, 0.5f);
    const uint32_t mesh = fixture_cube(f, 3, 0.4, grey);
    fixture_object(f, mesh, NULL, 32, 32);
    fixture_object(f, mesh, mirrored, 48, 32);
    assert_int_equal(f->objects[1].flipped, 1);
    struct kiln_geometry *g = create(f);
    assert_int_equal(g->triangle_count, 2 * 6 * 18);
    assert_int_equal(g->vertex_count, 2 * 6 * 16);
    for (uint32_t t = 0; t < g->triangle_count; t++) {
        struct kiln_vec3 c[3];
        kiln_geometry_corners(g, t, c);
        const uint32_t object = g->records[t].object;
        const double *m = f->objects[object].transform;
        const struct kiln_vec3 out = vec3_sub(c[0], vec3((float)m[3], (float)m[7], (float)m[11]));
        assert_true(vec3_dot(kiln_triangle_normal(g, t), out) > 0.0f);
        assert_true(t >= g->ranges[object].opaque_first &&
                    t < g->ranges[object].opaque_first + g->ranges[object].opaque_count);
    }
    kiln_geometry_destroy(&g);
    fixture_destroy(f);
}

/* The (u, v) of a hit gives the same point from the vertices, from the record and from the stored triangle. */
static void corners_agree(void **state)
{
    (void)state;
    struct fixture *f = fixture_create();
    const uint32_t grey = fixture_material(f, 0.5f, 0.5f, 0.5f);
    const uint32_t mesh = fixture_cube(f, 2, 0.4, grey);
    fixture_object(f, mesh, mirrored, 48, 32);
    fixture_object(f, mesh, NULL, 20, 77);
    struct kiln_geometry *g = create(f);
    for (uint32_t t = 0; t < g->triangle_count; t++) {
        const float u = 0.2f, v = 0.5f;
        const struct kiln_hit_record *r = &g->records[t];
        const struct kiln_object *object = &f->objects[r->object];
        const uint32_t *stored = f->triangles + 3 * (size_t)g->stored_triangle[t];
        float b1, b2;
        kiln_geometry_stored_barycentrics(&f->scene, g, t, u, v, &b1, &b2);
        const float weight[3] = {1.0f - b1 - b2, b1, b2};
        double texel[2] = {0, 0}, place[3] = {0, 0, 0};
        for (int c = 0; c < 3; c++) {
            texel[0] += (double)weight[c] * (double)f->lightmap[stored[c]].x * object->lightmap_width;
            texel[1] += (double)weight[c] * (double)f->lightmap[stored[c]].y * object->lightmap_height;
            const struct kiln_dvec3 p = dvec3_of(f->positions[stored[c]]);
            for (int k = 0; k < 3; k++) {
                const double *m = object->transform + 4 * k;
                place[k] += (double)weight[c] * (m[0] * p.x + m[1] * p.y + m[2] * p.z + m[3]);
            }
        }
        assert_float_equal(r->texel[0] + u * r->texel[2] + v * r->texel[4], texel[0], 1e-4);
        assert_float_equal(r->texel[1] + u * r->texel[3] + v * r->texel[5], texel[1], 1e-4);
        const struct kiln_vec3 p = kiln_triangle_position(g, t, u, v);
        assert_float_equal(p.x, place[0], 1e-5);
        assert_float_equal(p.y, place[1], 1e-5);
        assert_float_equal(p.z, place[2], 1e-5);
    }
    kiln_geometry_destroy(&g);
    fixture_destroy(f);
}

static void opaque_come_first(void **state)
{
    (void)state;
    struct fixture *f = fixture_create();
    uint32_t full, holed;
    uint8_t *texels = fixture_texture(f, 2, 2, &full);
    memset(texels, 255, 16);
    texels = fixture_texture(f, 2, 2, &holed);
    memset(texels, 255, 16);
    texels[7] = 0;
    /* material: is it an alpha one? */
    static const int expected[9] = {0, 0, 1, 0, 1, 0, 1, 1, 0};
    for (int i = 0; i < 9; i++)
        fixture_material(f, 1.0f, 1.0f, 1.0f);
    struct kiln_material *m = f->materials;
    m[0].base_color[3] = 0.1f; /* alpha means nothing to OPAQUE */
    m[1].alpha_mode = KILN_ALPHA_BLEND;
    m[2].alpha_mode = KILN_ALPHA_BLEND, m[2].base_color[3] = 0.5f;
    m[3].alpha_mode = KILN_ALPHA_MASK, m[3].alpha_cutoff = 0.5f, m[3].base_color[3] = 0.7f;
    m[4].alpha_mode = KILN_ALPHA_MASK, m[4].alpha_cutoff = 0.5f, m[4].base_color[3] = 0.3f;
    m[5].alpha_mode = KILN_ALPHA_MASK, m[5].alpha_cutoff = 0.5f, m[5].base_color_texture = full;
    m[6].alpha_mode = KILN_ALPHA_MASK, m[6].alpha_cutoff = 0.5f, m[6].base_color_texture = holed;
    m[7].alpha_mode = KILN_ALPHA_BLEND, m[7].base_color_texture = holed;
    m[8].base_color_texture = holed;
    m[4].emission[1] = 2.0f;
    m[7].double_sided = 1;
    const uint32_t mesh = fixture_mesh(f);
    for (uint32_t i = 0; i < 10; i++) {
        for (int c = 0; c < 3; c++)
            fixture_vertex(f, i, c == 1, c == 2, 0.1 * i, 0.1 * c);
        fixture_triangle(f, 3 * i, 3 * i + 1, 3 * i + 2, i < 9 ? i : 3);
    }
    f->colors[4 * (3 * 9 + 1) + 3] = 100; /* the tenth: a vertex alpha takes 0.7 below the cutoff */
    fixture_object(f, mesh, NULL, 16, 16);
    fixture_object(f, mesh, NULL, 16, 16);
    struct kiln_geometry *g = create(f);
    assert_int_equal(g->opaque_count, 10);
    assert_int_equal(g->triangle_count, 20);
    assert_int_equal(g->ranges[1].alpha_first, 15);
    for (uint32_t t = 0; t < 20; t++) {
        const uint32_t stored = g->stored_triangle[t];
        assert_int_equal(t >= g->opaque_count, stored == 9 ? 1 : expected[stored]);
        assert_int_equal(g->records[t].object, t < 10 ? t / 5 : (t - 10) / 5);
        if (t % 5 > 0)
            assert_true(g->stored_triangle[t] > g->stored_triangle[t - 1]);
        assert_int_equal(g->records[t].material & KILN_RECORD_MATERIAL, stored == 9 ? 3 : stored);
        assert_int_equal((g->records[t].material & KILN_RECORD_EMITS) != 0, stored == 4);
        assert_int_equal((g->records[t].material & KILN_RECORD_DOUBLE_SIDED) != 0, stored == 7);
    }
    kiln_geometry_destroy(&g);
    fixture_destroy(f);
}

/* The passage is that of the most that any triangle does; glass is never opaque. */
static void passage_is_the_most_of_all(void **state)
{
    (void)state;
    static const struct {
        uint32_t mode;
        float alpha, transmission;
    } materials[] = {{KILN_ALPHA_OPAQUE, 0.5f, 0.0f},
                     {KILN_ALPHA_MASK, 0.2f, 0.0f},
                     {KILN_ALPHA_BLEND, 0.5f, 0.0f},
                     {KILN_ALPHA_OPAQUE, 1.0f, 0.3f}};
    for (uint32_t first = 0; first < 4; first++) {
        struct fixture *f = fixture_create();
        for (uint32_t i = 0; i < 4; i++) {
            struct kiln_material *m = &f->materials[fixture_material(f, 1.0f, 1.0f, 1.0f)];
            m->alpha_mode = materials[i].mode;
            m->alpha_cutoff = 0.5f;
            m->base_color[3] = materials[i].alpha;
            m->transmission = materials[i].transmission;
            m->transmission_texture = KILN_NONE;
        }
        const uint32_t mesh = fixture_mesh(f);
        for (uint32_t i = 0; i <= first; i++) {
            for (int c = 0; c < 3; c++)
                fixture_vertex(f, i, c == 1, c == 2, 0.1 * i, 0.1 * c);
            fixture_triangle(f, 3 * i, 3 * i + 1, 3 * i + 2, first - i);
        }
        fixture_object(f, mesh, NULL, 16, 16);
        struct kiln_geometry *g = create(f);
        assert_int_equal(g->passage, first);
        assert_int_equal(g->opaque_count, 1);
        assert_int_equal(g->triangle_count, first + 1);
        kiln_geometry_destroy(&g);
        fixture_destroy(f);
    }
}

/* More triangles than one thread takes at a time, opaque and alpha mixed: chunks must fit together. */
static void chunks_fit_together(void **state)
{
    (void)state;
    struct fixture *f = fixture_create();
    fixture_material(f, 1.0f, 1.0f, 1.0f);
    fixture_material(f, 1.0f, 1.0f, 1.0f);
    f->materials[1].alpha_mode = KILN_ALPHA_BLEND;
    f->materials[1].base_color[3] = 0.5f;
    const uint32_t mesh = fixture_mesh(f);
    const double uv[4] = {0.0, 1.0, 0.0, 1.0};
    fixture_sheet(f, dvec3(0, 0, 0), dvec3(1, 0, 0), dvec3(0, 1, 0), 300, uv, 0.0, 0);
    for (size_t t = 0; t < f->scene.triangle_count; t++)
        f->triangle_materials[t] = t % 7 == 3;
    fixture_object(f, mesh, NULL, 16, 16);
    fixture_object(f, mesh, NULL, 16, 16);
    struct kiln_geometry *g = create(f);
    uint32_t next[2][2] = {{0, 0}, {0, 0}};
    for (size_t t = 0; t < g->triangle_count; t++) {
        const uint32_t alpha = t >= g->opaque_count, object = g->records[t].object;
        uint32_t *expected = &next[object][alpha];
        while ((*expected % 7 == 3) != (alpha != 0))
            (*expected)++;
        assert_int_equal(g->stored_triangle[t], *expected);
        (*expected)++;
    }
    kiln_geometry_destroy(&g);
    fixture_destroy(f);
}

/* Tests three instances with 4 opaque and 3 alpha triangles, the middle one receiver-only. Its triangles come last in
 * either part. Rays meet those before them, each of the others once. */
static void receivers_come_last(void **state)
{
    (void)state;
    struct fixture *f = fixture_create();
    fixture_material(f, 1.0f, 1.0f, 1.0f);
    fixture_material(f, 1.0f, 1.0f, 1.0f);
    f->materials[1].alpha_mode = KILN_ALPHA_BLEND;
    f->materials[1].base_color[3] = 0.5f;
    const uint32_t mesh = fixture_mesh(f);
    for (uint32_t i = 0; i < 7; i++) {
        for (int c = 0; c < 3; c++)
            fixture_vertex(f, i, c == 1, c == 2, 0.1 * i, 0.1 * c);
        fixture_triangle(f, 3 * i, 3 * i + 1, 3 * i + 2, i % 2);
    }
    for (int i = 0; i < 3; i++)
        fixture_object(f, mesh, NULL, 16, 16);
    f->objects[1].flags = KILN_OBJECT_RECEIVER_ONLY;
    struct kiln_geometry *g = create(f);
    assert_int_equal(g->triangle_count, 21);
    assert_int_equal(g->opaque_count, 12);
    assert_int_equal(g->opaque_receivers, 4);
    assert_int_equal(g->alpha_receivers, 3);
    assert_int_equal(kiln_geometry_hittable_count(g), 14);
    bool met[21] = {false};
    for (size_t i = 0; i < 14; i++) {
        const size_t t = kiln_geometry_hittable(g, i);
        assert_true(t < 21 && !met[t] && g->records[t].object != 1);
        met[t] = true;
    }
    for (uint32_t t = 0; t < 21; t++) {
        const struct kiln_object_range *r = &g->ranges[g->records[t].object];
        const bool alpha = t >= g->opaque_count;
        assert_int_equal(alpha, g->stored_triangle[t] % 2);
        assert_true(alpha ? t >= r->alpha_first && t < r->alpha_first + r->alpha_count
                          : t >= r->opaque_first && t < r->opaque_first + r->opaque_count);
    }
    kiln_geometry_make_all_hittable(g);
    assert_int_equal(kiln_geometry_hittable_count(g), 21);
    kiln_geometry_destroy(&g);
    fixture_destroy(f);
}

static void positions_keep_their_digits(void **state)
{
    (void)state;
    struct fixture *f = fixture_create();
    const uint32_t grey = fixture_material(f, 0.5f, 0.5f, 0.5f);
    const double far[12] = {1e-3, 0, 0, 1e6, 0, 1e-3, 0, -1e6, 0, 0, 1e-3, 1e6};
    fixture_object(f, fixture_cube(f, 1, 0.0, grey), far, 8, 8);
    f->header.centre[0] = f->header.centre[2] = 1e6;
    f->header.centre[1] = -1e6;
    struct kiln_geometry *g = create(f);
    assert_true(fabsf(g->extent - 1e-3f) < 1e-9f);
    assert_true(fabsf(g->bounds_min.x + 1e-3f) < 1e-9f && fabsf(g->bounds_max.z - 1e-3f) < 1e-9f);
    kiln_geometry_destroy(&g);
    fixture_destroy(f);
}

static void empty_and_impossible(void **state)
{
    (void)state;
    struct fixture *f = fixture_create();
    const uint32_t grey = fixture_material(f, 0.5f, 0.5f, 0.5f);
    struct kiln_geometry *g = create(f);
    assert_int_equal(g->triangle_count, 0);
    assert_true(g->extent == 0.0f && g->bounds_max.x == 0.0f);
    kiln_geometry_destroy(&g);
    const double nowhere[12] = {1, 0, 0, 3e20, 0, 1, 0, 0, 0, 0, 1, 0};
    fixture_object(f, fixture_cube(f, 1, 0.0, grey), nowhere, 8, 8);
    struct kiln_error error = {""};
    assert_int_equal(kiln_geometry_create(&g, &f->scene, &error), KILN_BAD_INPUT);
    assert_null(g);
    assert_non_null(strstr(error.message, "thing"));
    fixture_destroy(f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(passage_is_the_most_of_all),
        cmocka_unit_test(fronts_look_out),
        cmocka_unit_test(corners_agree),
        cmocka_unit_test(opaque_come_first),
        cmocka_unit_test(chunks_fit_together),
        cmocka_unit_test(positions_keep_their_digits),
        cmocka_unit_test(receivers_come_last),
        cmocka_unit_test(empty_and_impossible),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
