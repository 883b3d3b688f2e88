/* Tests of the identity of a bake: every option of bake is on one of its lists, and differences are printed as a table.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <string.h>

#include "coordinator/bake/identity.h"
#include "coordinator/job/options.h"

static void every_option_is_known(void **state)
{
    (void)state;
    for (size_t i = 0; i < kiln_option_count; i++) {
        bool known;
        (void)kiln_identity_counts(kiln_options[i].name, &known);
        if ((kiln_options[i].commands & KILN_FOR_BAKE) != 0 && !known)
            fail_msg("--%s of bake is on neither list of coordinator/bake/identity.c", kiln_options[i].name);
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

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(every_option_is_known),
                                       cmocka_unit_test(differences_are_a_table)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
