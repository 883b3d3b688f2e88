/* The table of fields: rows that fit each other, what a bake has of them, sizes, values and their ranges. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "coordinator/field/field.h"
#include "coordinator/field/packed_error.h"
#include "coordinator/output/columns.h"
#include "coordinator/output/map/layers.h"
#include "coordinator/run/checkpoint.h"
#include "worker/scene/radiosity.h"

static const struct kiln_job with_errors = {.lightmaps.error_map = true}, without = {.lightmaps.error_map = false};

static void rows_fit(void **state)
{
    (void)state;
    size_t rows;
    const struct kiln_field *table = kiln_fields(&rows);
    for (size_t i = 0; i < rows; i++) {
        const struct kiln_field *f = &table[i];
        assert_true(strlen(f->name) < KILN_ARRAY_NAME && f->components > 0);
        assert_true(f->components <= KILN_FIELD_COMPONENTS_MAX && f->low <= f->high);
        assert_true(f->dataset == NULL || (f->dataset[0] == '/' && strchr(f->dataset + 1, '/') != NULL &&
                                           strchr(f->dataset + 1, '/') == strrchr(f->dataset, '/')));
        assert_true(f->meaning != KILN_FIELD_DIRECTION || f->components >= 3);
        assert_true(f->meaning != KILN_FIELD_FRACTION || (f->low == 0.0 && f->high == 1.0));
        assert_true(f->dataset == NULL || (f->domain == KILN_DOMAIN_POINT && f->description != NULL));
        assert_true(f->channels == NULL || f->dataset != NULL);
        assert_true(
            f->saved == KILN_FIELD_NOT_SAVED ||
            ((f->domain == KILN_DOMAIN_POINT || f->domain == KILN_DOMAIN_TILE_RUN) && f->length == KILN_FIELD_EACH));
        for (size_t j = 0; j < i; j++) {
            assert_string_not_equal(f->name, table[j].name);
            assert_true(f->dataset == NULL || table[j].dataset == NULL || strcmp(f->dataset, table[j].dataset) != 0);
        }
    }
    assert_string_equal(kiln_field_shown("indirect")->name, "sum");
    assert_null(kiln_field_shown("albedo")); /* not in lightmaps */
    assert_null(kiln_field_shown("sum"));
}

static void a_bake_has_what_it_wants(void **state)
{
    (void)state;
    struct kiln_field_set set;
    struct kiln_layers layers;
    struct kiln_columns columns;
    kiln_field_set_choose(&set, &without);
    const size_t error = kiln_field_set_find(&set, "error");
    assert_true(error < set.count && !set.entry[error].in_lightmaps);
    assert_int_equal(kiln_layers_make(&layers, &set, NULL), KILN_OK);
    assert_int_equal(layers.planes.count, KILN_MAP_PLANES);
    assert_memory_equal(&layers.planes, &kiln_map_light, sizeof layers.planes);
    kiln_field_set_choose(&set, &with_errors);
    assert_true(set.entry[error].in_lightmaps);
    kiln_columns_make(&columns, &set, false, false, false);
    assert_int_equal(columns.count, 15); /* the errors of direct and of indirect light, and the parts, too */
    assert_int_equal(kiln_columns_row(&columns), 117 + 16);
    kiln_columns_make(&columns, &set, true, false, false);
    assert_string_equal(columns.column[15].name, "/points/side");
    assert_int_equal(kiln_columns_find(&columns, "/irradiance/total"), 10);
}

static void sets_refuse(void **state)
{
    (void)state;
    static const struct kiln_field half = {
        .name = "half", .components = 3, .life = KILN_FIELD_SUM, .terms = {"direct", "nobody"}};
    static const struct kiln_field wide = {.name = "wide", .components = KILN_FIELD_COMPONENTS_MAX + 1};
    struct kiln_field_set set = {.count = 0}, chosen;
    struct kiln_layers layers;
    struct kiln_error error;
    kiln_field_set_choose(&chosen, &without);
    assert_int_equal(kiln_field_set_add(&chosen, chosen.entry[0].field, false, &error), KILN_BUG);
    assert_int_equal(kiln_field_set_add(&chosen, &half, false, &error), KILN_BUG);
    assert_non_null(strstr(error.message, "nobody"));
    assert_int_equal(kiln_field_set_add(&chosen, &wide, false, &error), KILN_BUG);
    assert_int_equal(kiln_layers_make(&layers, &set, &error), KILN_BUG);
    assert_non_null(strstr(error.message, "direct"));
}

static void sizes_are_sums(void **state)
{
    (void)state;
    struct kiln_field_set set;
    kiln_field_set_choose(&set, &without);
    assert_int_equal(kiln_field_set_point_bytes(&set, KILN_FIELD_RESULT), 26);
    assert_int_equal(kiln_field_set_saved_bytes(&set), 44);
    assert_int_equal(kiln_field_set_channels(&set), 9);
    assert_int_equal(kiln_field_set_plane_bytes(&set), KILN_MAP_PLANES * sizeof(float));
    assert_int_equal(kiln_field_set_column_bytes(&set), 56);
    assert_int_equal(kiln_field_set_light_bytes(&set, 10, 100), 10 * 34 + 100 * 8);
    /* 2 tile runs, 5 points, 7 pieces, 2 shares of area */
    const uint64_t items[KILN_DOMAINS] = {2, 5, 7, 2};
    assert_int_equal(kiln_field_set_bytes(&set, KILN_FIELD_SURFACE, items),
                     2 * sizeof(struct kiln_tile_run) + 2 * 3 * 8 + 5 * (2 + 6 + 4 + 2) + 7 * 4 + 2 * 4);
}

static const struct kiln_field *row(const char *name)
{
    size_t rows;
    const struct kiln_field *table = kiln_fields(&rows);
    for (size_t i = 0; i < rows; i++)
        if (strcmp(table[i].name, name) == 0)
            return &table[i];
    return NULL;
}

static void values_become_floats(void **state)
{
    (void)state;
    const uint16_t albedo[6] = {0, 0, 0, 65535, 32768, 0}, error = kiln_error_pack(0.5f);
    const float light[3] = {1.0f, 2.0f, 4.0f};
    const uint64_t packed = kiln_radiosity_pack(light, 0);
    float floats[KILN_FIELD_COMPONENTS_MAX];
    kiln_field_floats(row("albedo"), albedo, 1, 1, floats);
    assert_true(floats[0] == 1.0f && floats[1] == 32768 / 65535.0f && floats[2] == 0.0f);
    kiln_field_floats(row("error"), &error, 0, 1, floats);
    assert_true(floats[0] == 0.5f);
    kiln_field_floats(row("next"), &packed, 0, 1, floats);
    assert_memory_equal(floats, light, sizeof light);
}

static void lies_are_seen(void **state)
{
    (void)state;
    const float bad[] = {NAN, INFINITY, -INFINITY, -1.0f, 2e36f};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        const float light[6] = {0.0f, -0.0f, 1e30f, 1.0f, bad[i], 1.0f};
        assert_true(kiln_field_is_sane(row("direct"), light, 1));
        assert_false(kiln_field_is_sane(row("direct"), light, 2));
    }
    const uint16_t errors[2] = {kiln_error_pack(3e38f), kiln_error_pack(INFINITY)};
    assert_true(kiln_field_is_sane(row("error"), errors, 1));
    assert_false(kiln_field_is_sane(row("error"), errors, 2));
    const uint64_t radiosity[2] = {0, UINT64_MAX};
    assert_true(kiln_field_is_sane(row("source"), radiosity, 1));
    assert_false(kiln_field_is_sane(row("source"), radiosity, 2));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rows_fit),       cmocka_unit_test(a_bake_has_what_it_wants), cmocka_unit_test(sets_refuse),
        cmocka_unit_test(sizes_are_sums), cmocka_unit_test(values_become_floats),     cmocka_unit_test(lies_are_seen)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
