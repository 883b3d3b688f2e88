/* Tests of solids: which double-sided triangles belong to closed meshes, whose backs are invisible. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "surface_scene.h"
#include "worker/scene/solids.h"

/* Returns the number of the object's triangles that still have two sides. */
static uint64_t two_sided(struct fixture *f, size_t object)
{
    struct kiln_geometry *g = NULL;
    struct kiln_error error;
    assert_int_equal(kiln_geometry_create(&g, &f->scene, &error), KILN_OK);
    const uint64_t count = g->ranges[object].two_sided;
    kiln_geometry_destroy(&g);
    return count;
}

static struct fixture *cube(uint32_t *mesh)
{
    struct fixture *f = fixture_create();
    const uint32_t grey = fixture_material(f, 0.5f, 0.5f, 0.5f);
    f->materials[grey].double_sided = 1;
    *mesh = fixture_cube(f, 2, 0.0, grey);
    (void)fixture_object(f, *mesh, NULL, 16, 16);
    return f;
}

static void closed_and_outwards(void **state)
{
    (void)state;
    uint32_t mesh;
    struct fixture *f = cube(&mesh);
    const double mirrored[12] = {-2, 0, 0, 5, 0, 1, 0, 0, 0, 0, 3, 0};
    (void)fixture_object(f, mesh, mirrored, 16, 16); /* fronts stay outside */
    assert_int_equal(two_sided(f, 0), 0);
    assert_int_equal(two_sided(f, 1), 0);
    fixture_destroy(f);
}

static void open_or_inside_out(void **state)
{
    (void)state;
    uint32_t mesh;
    struct fixture *f = cube(&mesh);
    const uint64_t all = f->meshes[mesh].triangle_count;
    for (uint64_t t = 0; t < all; t++) { /* all turned round: a room seen from inside */
        const uint32_t swap = f->triangles[3 * t + 1];
        f->triangles[3 * t + 1] = f->triangles[3 * t + 2];
        f->triangles[3 * t + 2] = swap;
    }
    assert_int_equal(two_sided(f, 0), all);
    fixture_destroy(f);
    f = cube(&mesh);
    const uint32_t swap = f->triangles[1]; /* one turned round */
    f->triangles[1] = f->triangles[2];
    f->triangles[2] = swap;
    assert_int_equal(two_sided(f, 0), all);
    fixture_destroy(f);
    f = cube(&mesh);
    f->meshes[mesh].triangle_count--; /* a hole */
    f->scene.triangle_count--;
    assert_int_equal(two_sided(f, 0), all - 1);
    fixture_destroy(f);
    f = cube(&mesh);
    f->materials[0].alpha_mode = KILN_ALPHA_BLEND; /* light gets in */
    f->materials[0].base_color[3] = 0.5f;
    assert_int_equal(two_sided(f, 0), all);
    fixture_destroy(f);
}

static void lit_inside(void **state)
{
    (void)state;
    static const double scale[3] = {0.1, 0.1, 0.1};
    const double places[3] = {0.3, 1.3, 0.0}; /* in the cube, beside it; the cube itself */
    for (int i = 0; i < 3; i++) {
        uint32_t mesh;
        struct fixture *f = cube(&mesh);
        const uint32_t lamp = fixture_material(f, 0.0f, 0.0f, 0.0f);
        f->materials[lamp].emission[1] = 5.0f;
        const double small[12] = {scale[0], 0, 0, places[i], 0, scale[1], 0, 0.2, 0, 0, scale[2], 0.1};
        if (i < 2)
            (void)fixture_object(f, fixture_cube(f, 1, 0.0, lamp), small, 8, 8);
        else {
            f->materials[lamp].double_sided = 1;
            f->triangle_materials[3] = lamp; /* a part of it shines inwards too */
        }
        assert_int_equal(two_sided(f, 0) == 0, i == 1);
        fixture_destroy(f);
    }
    uint32_t mesh;
    struct fixture *f = cube(&mesh);
    struct kiln_light light = {.kind = KILN_LIGHT_POINT, .position = {0.9, -0.9, 0.9}};
    f->scene.lights = &light;
    f->scene.light_count = 1;
    assert_true(two_sided(f, 0) > 0);
    light.position[0] = 1.1;
    assert_int_equal(two_sided(f, 0), 0);
    fixture_destroy(f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(closed_and_outwards), cmocka_unit_test(open_or_inside_out),
                                       cmocka_unit_test(lit_inside)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
