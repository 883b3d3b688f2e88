#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/bake/report/reached.h"

/* A bake of 100 s, 80 of which are light, at 4 texels a metre, denoised. */
static json_t *report_of(json_t *error)
{
    (void)json_object_set_new(error, "mean_irradiance", json_real(1.0));
    return json_pack("{s:f, s:[{s:s, s:{s:f}}, {s:s, s:{s:f}}], s:o, s:{s:s}, s:{s:s}, s:{s:f}, s:{s:s}}", "seconds",
                     100.0, "phases", "name", "bounces", "seconds", "max", 80.0, "name", "lightmaps", "seconds", "max",
                     20.0, "error", error, "denoise", "method", "regression", "store", "kind", "lightmap", "scene",
                     "texels_per_metre", 4.0, "job", "method", "cells");
}

static json_t *published(double asked, double reached, bool late)
{
    return json_pack("{s:f, s:f, s:b, s:i, s:{s:s, s:f}}", "asked", asked, "published", reached, "out_of_time", late,
                     "rounds", 3, "worst", "object", "wall", "published", 2.0 * reached);
}

/* Takes the report over. */
static void assert_option(json_t *report, const char *option, const char *because)
{
    json_t *best = kiln_best_option(report);
    if (option == NULL) {
        assert_null(best);
    } else {
        assert_string_equal(json_string_value(json_object_get(best, "option")), option);
        assert_non_null(strstr(json_string_value(json_object_get(best, "because")), because));
    }
    json_decref(best);
    json_decref(report);
}

static void add_density(json_t *report, double moves)
{
    (void)json_object_set_new(
        report, "density",
        json_pack("{s:[{s:s, s:f}]}", "objects", "name", "blinds", "moves_at_double_density", moves));
}

static void test_option(void **state)
{
    (void)state;
    /* half the noise takes four times the light: 20 + 4 x 80 s */
    assert_option(report_of(published(0.08, 0.06, false)), "--quality 3%", "in about 5 min 40 s");
    /* stopped at twice the error that was asked for */
    assert_option(report_of(published(0.08, 0.16, true)), "--time 340", "reach what was asked for");
    assert_option(report_of(published(0.08, 0.16, false)), "--guide auto", "rare ways");
    assert_option(report_of(published(0.001, 0.001, false)), NULL, NULL);
    json_t *report = report_of(published(0.08, 0.06, false));
    add_density(report, 0.1);
    assert_option(report, "--texels-per-metre 8", "'blinds' by about 10 %, more than its noise");
    report = report_of(published(0.2, 0.16, false));
    add_density(report, 0.1);
    assert_option(report, "--quality 8%", "half the noise");
    report = report_of(published(0.08, 0.06, false));
    (void)json_object_set_new(json_object_get(report, "denoise"), "method", json_string("none"));
    assert_option(report, "--denoise auto", "all the noise");
    assert_option(report_of(json_pack("{s:f}", "mean_relative", 0.3)), "--quality 8%", "goes on until");
    assert_option(report_of(json_pack("{s:f, s:f}", "target", 0.05, "above_target", 0.01)), NULL, NULL);
    assert_option(json_object(), NULL, NULL);
}

/* Takes the report over. */
static void assert_printed(json_t *report, const char *wanted)
{
    char *text = NULL;
    size_t size = 0;
    FILE *stream = open_memstream(&text, &size);
    json_t *best = kiln_best_option(report);
    if (best != NULL)
        (void)json_object_set_new(report, "improve", best);
    kiln_reached_print(stream, report);
    (void)fclose(stream);
    assert_string_equal(text, wanted);
    free(text);
    json_decref(report);
}

/* No figure of raw samples without that word. */
static void test_printed(void **state)
{
    (void)state;
    assert_printed(report_of(published(0.08, 0.06, false)),
                   "error        6 %: 95 % of the texels are less than that off (asked: 8 %; 3 rounds)\n"
                   "worst in     'wall', 12 %\n"
                   "improve it   --quality 3%: half the noise, in about 5 min 40 s\n");
    assert_printed(report_of(json_pack("{s:f}", "mean_relative", 0.3)),
                   "error        30 % of the mean in raw samples; less in the lightmaps, which are denoised\n"
                   "improve it   --quality 8%: it says what error the published light has, and goes on until that is "
                   "reached\n");
    assert_printed(report_of(json_pack("{s:f, s:f, s:i}", "target", 0.05, "above_target", 0.01, "rounds", 2)),
                   "error        above 5 % in raw samples where 1.00 % of the surface points lie; 2 rounds\n");
    assert_printed(json_object(), "");
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_option), cmocka_unit_test(test_printed)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
