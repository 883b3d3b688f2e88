/* Tests of which tables materials with textures get (worker/material/scene_lobes.h): none where none is needed, one for
 * all that it serves, no more layers than a texture comes near to. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "tests/unit/surface_scene.h"
#include "worker/base/memory.h"
#include "worker/material/scene_lobes.h"
#include "worker/scene/gloss.h"

enum { ALL, PART, SAME };

/* Textures of two texels whose channels go from 0 to 255, from 100 to 110, and are 100. */
static void add_textures(struct fixture *f)
{
    static const uint8_t values[3][2] = {{0, 255}, {100, 110}, {100, 100}};
    for (size_t i = 0; i < 3; i++) {
        f->textures[i] = (struct kiln_texture){.first = 8 * i, .width = 2, .height = 1};
        for (size_t k = 0; k < 8; k++)
            f->texels[8 * i + k] = values[i][k / 4];
    }
    f->scene.texture_count = 3;
}

/* Another material; returns what it is taken with. Its roughness has a texture. */
static struct kiln_gloss *add_gloss(struct fixture *f, uint32_t texture)
{
    const uint32_t i = (uint32_t)f->scene.material_count++;
    f->materials[i] = (struct kiln_material){.base_color = {1, 1, 1, 1}};
    f->scene.taken[i] = kiln_gloss_default(&f->materials[i], i);
    struct kiln_gloss *gloss = &f->scene.taken[i];
    gloss->roughness = 1.0f;
    gloss->textures[KILN_GLOSS_ROUGHNESS] =
        (struct kiln_gloss_texture){.texture = texture, .channel = 1, .transform = {1, 0, 0, 0, 1, 0}};
    return gloss;
}

static struct kiln_gloss_lobes *lobes_of(struct fixture *f, struct kiln_scene_table_bytes *bytes)
{
    struct kiln_gloss_lobes *lobes = NULL;
    assert_int_equal(kiln_scene_lobes(&lobes, &f->scene, NULL), KILN_OK);
    *bytes = kiln_scene_table_bytes(lobes, f->scene.material_count);
    return lobes;
}

static struct fixture *begin(struct kiln_gloss taken[FIXTURE_MATERIALS])
{
    struct fixture *f = fixture_create();
    memset(taken, 0, FIXTURE_MATERIALS * sizeof *taken);
    f->scene.taken = taken;
    add_textures(f);
    return f;
}

static void nothing_where_none_is_needed(void **state)
{
    (void)state;
    struct kiln_gloss taken[FIXTURE_MATERIALS];
    struct kiln_scene_table_bytes bytes;
    struct fixture *f = begin(taken);
    add_gloss(f, ALL);
    add_gloss(f, ALL)->metallic = 1.0f;
    add_gloss(f, ALL)->transmission = 1.0f;
    add_gloss(f, ALL)->clearcoat = 1.0f;
    struct kiln_gloss_lobes *lobes = lobes_of(f, &bytes);
    assert_true(bytes.all == 0 && bytes.brushed == 0 && bytes.trapped == 0);
    for (uint32_t i = 0; i < f->scene.material_count; i++)
        assert_true(!lobes[i].ready && (lobes[i].tables.brushed_low | lobes[i].tables.trapped_low) == 0);
    kiln_free(&lobes);
    fixture_destroy(f);
}

static void layers_that_a_texture_needs(void **state)
{
    (void)state;
    static const int layers[3] = {KILN_BRUSHED_LAYERS, 4, 1}; /* 4: for a cubic polynomial */
    for (uint32_t texture = 0; texture < 3; texture++) {
        struct kiln_gloss taken[FIXTURE_MATERIALS];
        struct kiln_scene_table_bytes bytes;
        struct fixture *f = begin(taken);
        add_gloss(f, texture)->anisotropy = 0.4f;
        struct kiln_gloss *gloss = add_gloss(f, texture); /* another colour: the same table */
        gloss->anisotropy = 0.4f;
        gloss->specular_color[0] = 0.5f;
        struct kiln_gloss_lobes *lobes = lobes_of(f, &bytes);
        assert_int_equal(bytes.all, (size_t)layers[texture] * sizeof(struct kiln_brushed_table));
        assert_true(bytes.brushed == bytes.all && bytes.trapped == 0);
        assert_int_equal(lobes[0].tables.brushed_low, lobes[1].tables.brushed_low);
        const struct kiln_brushed_table *first =
            &KILN_BRUSHED_TABLE(lobes[0].tables.brushed_low, lobes[0].tables.brushed_high, 0);
        const float low = kiln_brushed_layer(powf(texture == ALL ? 0.0f : 100.0f / 255.0f, 2.0f));
        const float high = kiln_brushed_layer(powf(texture == ALL    ? 1.0f
                                                   : texture == PART ? 110.0f / 255.0f
                                                                     : 100.0f / 255.0f,
                                                   2.0f));
        assert_true(first->first <= low + 1e-5f && first->last >= high - 1e-5f);
        kiln_free(&lobes);
        fixture_destroy(f);
    }
}

static void coats_over_rough_glass(void **state)
{
    (void)state;
    struct kiln_gloss taken[FIXTURE_MATERIALS];
    struct kiln_scene_table_bytes bytes;
    struct fixture *f = begin(taken);
    for (int i = 0; i < 3; i++) {
        struct kiln_gloss *gloss = add_gloss(f, PART);
        gloss->transmission = 1.0f;
        gloss->flags = KILN_GLOSS_VOLUME;
        gloss->clearcoat = i == 1 ? 0.5f : 1.0f; /* the strength is not in the table */
        gloss->ior = i == 2 ? 1.33f : 1.5f;
    }
    struct kiln_gloss_lobes *lobes = lobes_of(f, &bytes);
    assert_int_equal(bytes.trapped, 2 * sizeof(struct kiln_bsdf_trapped_table));
    assert_int_equal(bytes.brushed, 0);
    assert_true(lobes[0].tables.trapped_low == lobes[1].tables.trapped_low);
    assert_true(lobes[0].tables.trapped_low != lobes[2].tables.trapped_low);
    kiln_free(&lobes);
    fixture_destroy(f);
}

/* Beside a material without textures, whose lobes are ready and have a table of their own. */
static void ready_and_textured(void **state)
{
    (void)state;
    struct kiln_gloss taken[FIXTURE_MATERIALS];
    struct kiln_scene_table_bytes bytes;
    struct fixture *f = begin(taken);
    for (uint32_t i = 0; i < 3; i++) {
        struct kiln_gloss *gloss = add_gloss(f, i == 1 ? (uint32_t)SAME : KILN_NONE);
        gloss->anisotropy = 0.4f;
        gloss->roughness = 0.5f;
    }
    struct kiln_gloss_lobes *lobes = lobes_of(f, &bytes);
    assert_true(lobes[0].ready && !lobes[1].ready && lobes[2].ready);
    assert_int_equal(bytes.all, 2 * sizeof(struct kiln_brushed_table));
    assert_true(lobes[0].lobes.brushed_low == lobes[2].lobes.brushed_low);
    assert_true(lobes[1].tables.brushed_low != lobes[0].lobes.brushed_low);
    kiln_free(&lobes);
    fixture_destroy(f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(nothing_where_none_is_needed),
                                       cmocka_unit_test(layers_that_a_texture_needs),
                                       cmocka_unit_test(coats_over_rough_glass), cmocka_unit_test(ready_and_textured)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
