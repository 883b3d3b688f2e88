/* Tests of the identity of a bake: every option of bake is on one of its lists, and differences are printed as a table.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <string.h>

#include "coordinator/bake/identity/identity.h"
#include "coordinator/job/gone.h"
#include "coordinator/job/options.h"
#include "worker/base/version.h"

static void every_option_is_known(void **state)
{
    (void)state;
    for (size_t i = 0; i < kiln_option_count; i++) {
        bool known;
        (void)kiln_identity_counts(kiln_options[i].name, &known);
        if ((kiln_options[i].commands & KILN_FOR_BAKE) != 0 && !known)
            fail_msg("--%s of bake is on no list of coordinator/bake/identity/identity.c or of a companion",
                     kiln_options[i].name);
    }
}

static json_t *identity(const char *seed, const char *backend)
{
    return json_pack("{s:{s:s, s:s}, s:{s:s}, s:{s:s, s:s}}", "fields", "seed", seed, "bounces", "all", "sources",
                     "a.glb", "00ff", "machine", "backend", backend, "instruction set", "avx2");
}

static void differences_are_a_table(void **state)
{
    (void)state;
    struct kiln_error error = {{0}};
    char note[400];
    json_t *then = identity("1", "embree"), *now = identity("2", "embree"), *elsewhere = identity("1", "vulkan");
    assert_int_equal(kiln_identity_compare(then, then, "out", note, sizeof note, &error), KILN_OK);
    assert_string_equal(note, "");
    assert_int_equal(kiln_identity_compare(then, now, "out", note, sizeof note, &error), KILN_BAD_INPUT);
    assert_non_null(strstr(error.message, "in the checkpoint"));
    assert_non_null(strstr(error.message, "\n  seed                   1                                  2"));
    assert_null(strstr(error.message, "bounces"));
    assert_int_equal(kiln_identity_compare(then, elsewhere, "out", note, sizeof note, &error), KILN_OK);
    assert_non_null(strstr(note, "vulkan"));
    json_object_del(json_object_get(now, "fields"), "bounces");
    assert_int_equal(kiln_identity_compare(then, now, "out", note, sizeof note, &error), KILN_BAD_INPUT);
    assert_non_null(strstr(error.message, "bounces"));
    json_decref(then);
    json_decref(now);
    json_decref(elsewhere);
}

static json_t *identity_of(const char *version, const char *seed)
{
    json_t *made = identity(seed, "embree");
    (void)json_object_set_new(json_object_get(made, "fields"), "kiln", json_string(version));
    return made;
}

/* The version counts by its results' bits, and is named where it is another one. */
static void versions_count_by_their_bits(void **state)
{
    (void)state;
    struct kiln_error error = {{0}};
    char note[400];
    json_t *first = identity_of(KILN_SAME_BITS_SINCE, "1"), *now = identity_of(KILN_VERSION, "1");
    json_t *before = identity_of("0.0.9", "1"), *later = identity_of("99.0.0", "1"), *other = identity_of("0.1.0", "2");
    assert_true(kiln_version_has_same_bits(KILN_SAME_BITS_SINCE) && kiln_version_has_same_bits(KILN_VERSION));
    assert_false(kiln_version_has_same_bits("0.0.9") || kiln_version_has_same_bits("99.0.0"));
    assert_false(kiln_version_has_same_bits(NULL));
    assert_int_equal(kiln_identity_compare(first, now, "out", note, sizeof note, &error), KILN_OK);
    assert_int_equal(kiln_identity_compare(later, now, "out", note, sizeof note, &error), KILN_BAD_INPUT);
    assert_non_null(strstr(error.message, "finish it with kiln 99.0.0"));
    assert_int_equal(kiln_identity_compare(before, now, "out", note, sizeof note, &error), KILN_BAD_INPUT);
    assert_non_null(strstr(error.message, "is of kiln 0.0.9"));
    assert_non_null(strstr(error.message, "--no-resume"));
    assert_int_equal(kiln_identity_compare(other, now, "out", note, sizeof note, &error), KILN_BAD_INPUT);
    assert_non_null(strstr(error.message, "It is of kiln 0.1.0, which can finish it\n"));
    json_decref(first);
    json_decref(now);
    json_decref(before);
    json_decref(later);
    json_decref(other);
}

/* An option that is no more and was not given keeps no checkpoint from going on; one that was given does. */
static void options_that_are_gone_count_where_given(void **state)
{
    (void)state;
    struct kiln_error error = {{0}};
    char note[400];
    const struct kiln_gone_option *gone = kiln_gone_option_find("connections");
    json_t *now = identity("1", "embree"), *by_default = identity("1", "embree"), *given = identity("1", "embree");
    json_t *unknown = identity("1", "embree");
    (void)json_object_set_new(json_object_get(by_default, "fields"), "connections", json_string("0"));
    (void)json_object_set_new(json_object_get(given, "fields"), "connections", json_string("0.5"));
    (void)json_object_set_new(json_object_get(unknown, "fields"), "wishes", json_string("0"));
    assert_true((gone == NULL) == (kiln_option_find("connections") != NULL));
    assert_null(kiln_gone_option_find("seed"));
    assert_null(kiln_gone_option_find("wishes"));
    assert_int_equal(kiln_identity_compare(by_default, now, "out", note, sizeof note, &error),
                     gone != NULL ? KILN_OK : KILN_BAD_INPUT);
    assert_int_equal(kiln_identity_compare(given, now, "out", note, sizeof note, &error), KILN_BAD_INPUT);
    assert_int_equal(kiln_identity_compare(unknown, now, "out", note, sizeof note, &error), KILN_BAD_INPUT);
    json_decref(now);
    json_decref(by_default);
    json_decref(given);
    json_decref(unknown);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_option_is_known), cmocka_unit_test(differences_are_a_table),
        cmocka_unit_test(versions_count_by_their_bits), cmocka_unit_test(options_that_are_gone_count_where_given)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
