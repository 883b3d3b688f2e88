#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/bake/report/run_table.h"

static json_t *phase(const char *name, double low, double mean, double high)
{
    return json_pack("{s:s, s:{s:f, s:f, s:f}, s:f}", "name", name, "seconds", "min", low, "avg", mean, "max", high,
                     "imbalance", high / mean - 1.0);
}

/* A bake of 100 s. */
static json_t *report_of(json_t *phases)
{
    return json_pack("{s:f, s:f, s:i, s:i, s:i, s:o, s:s, s:{s:I, s:I}}", "seconds", 60.0, "seconds_before", 40.0,
                     "restarts", 1, "ranks", 4, "threads", 1, "phases", phases, "output", "out", "memory", "peak_rank",
                     (json_int_t)1 << 30, "asked_node", (json_int_t)1 << 34);
}

static size_t note_count(json_t *phases, const char *first)
{
    json_t *report = report_of(phases), *notes = kiln_run_notes(report);
    const size_t count = json_array_size(notes);
    if (count > 0)
        assert_non_null(strstr(json_string_value(json_array_get(notes, 0)), first));
    json_decref(notes);
    json_decref(report);
    return count;
}

static void test_notes(void **state)
{
    (void)state;
    /* 4.4 %, 9 % */
    assert_int_equal(
        note_count(json_pack("[o,o]", phase("bounces", 88.0, 90.0, 94.0), phase("kiln.h5", 9.0, 9.0, 9.0)), ""), 0);
    assert_int_equal(
        note_count(json_pack("[o,o]", phase("bounces", 70.0, 75.0, 82.5), phase("final gather", 9.0, 10.0, 12.0)),
                   "bounces: the slowest rank took 10 % longer than the mean, which costs 7.5 s a rank; try a smaller "
                   "--cell-size"),
        1);
    assert_int_equal(
        note_count(json_pack("[o,o]", phase("emission", 10.0, 11.0, 14.0), phase("waiting", 1.0, 20.0, 40.0)),
                   "--trace FILE.json"),
        1);
    assert_int_equal(
        note_count(json_pack("[o,o]", phase("lightmaps", 4.0, 4.0, 4.0), phase("checkpoints", 7.0, 7.0, 7.0)),
                   "files took 11 % of the time (11.0 s), most of it checkpoints (7.0 s); a longer --checkpoint-every"),
        1);
    /* taking noise out is no writing of files */
    assert_int_equal(
        note_count(json_pack("[o,o]", phase("denoising", 29.0, 29.0, 29.0), phase("lightmaps", 4.0, 4.0, 4.0)), ""), 0);
    assert_int_equal(note_count(json_pack("[o]", phase("bounces", 0.1, 1.0, 1.9)), ""), 0); /* less than a second */
    assert_int_equal(note_count(json_array(), ""), 0);
}

/* The note on borders of charts, of which a tenth or a two hundredth reads other charts; NULL: there is none. */
static json_t *border_note(double disturbed, double factor, double density)
{
    json_t *report = report_of(json_array());
    (void)json_object_set_new(report, "borders",
                              json_pack("{s:f, s:f, s:i, s:f, s:f}", "texels", 1000.0, "disturbed_texels", disturbed,
                                        "disturbed_lightmaps", 3, "padding_factor", factor, "texels_per_metre",
                                        density));
    json_t *notes = kiln_run_notes(report), *note = json_incref(json_array_get(notes, 0));
    json_decref(notes);
    json_decref(report);
    return note;
}

static void assert_border_note(double factor, double density, const char *part)
{
    json_t *note = border_note(100.0, factor, density);
    assert_non_null(strstr(json_string_value(note), "along 10 % of the borders of charts, in 3 lightmaps"));
    assert_non_null(strstr(json_string_value(note), part));
    json_decref(note);
}

static void test_borders(void **state)
{
    (void)state;
    assert_null(border_note(5.0, 2.0, 4.0));
    assert_border_note(1.55, 4.0, "--texels-per-metre 6.2 would leave");
    assert_border_note(1.5, 0.0, "lightmaps 1.5 times as large a side");
    assert_border_note(-1.0, 4.0, "no density would do");
}

static void test_table(void **state)
{
    (void)state;
    char *text = NULL;
    size_t size = 0;
    FILE *stream = open_memstream(&text, &size);
    json_t *report =
        report_of(json_pack("[o,o]", phase("bounces", 70.0, 80.0, 90.0), phase("waiting", 10.0, 20.0, 30.0)));
    (void)json_object_set_new(report, "notes", kiln_run_notes(report));
    kiln_run_table(stream, report);
    kiln_run_table(stream, NULL); /* says nothing of value, and does not fall over */
    (void)fclose(stream);
    assert_non_null(strstr(text, "bounces   70.000  80.000     90.000     12.5 %  80.0 %\n"));
    assert_non_null(strstr(text, "waiting   10.000  20.000     30.000             20.0 %\n"));
    assert_non_null(strstr(text, "1 min 40 s on 4 ranks of 1 thread, in 2 runs"));
    assert_non_null(strstr(text, "peak memory of a rank 1024.0 MiB; Slurm gives 16384.0 MiB a node\n"));
    assert_non_null(strstr(text, "NOTE bounces: "));
    json_decref(report);
    free(text);
}

/* The table of one rank has seconds without imbalance, and no phases that took none. */
static void test_table_of_one_rank(void **state)
{
    (void)state;
    char *text = NULL;
    size_t size = 0;
    FILE *stream = open_memstream(&text, &size);
    json_t *report = report_of(json_pack("[o,o,o]", phase("bounces", 80.0, 80.0, 80.0),
                                         phase("waiting", 1e-4, 1e-4, 1e-4), phase("other", 20.0, 20.0, 20.0)));
    (void)json_object_set_new(report, "ranks", json_integer(1));
    kiln_run_table(stream, report);
    (void)fclose(stream);
    assert_non_null(strstr(text, "phase    seconds  of all\nbounces   80.000  80.0 %\nother     20.000  20.0 %\n\n"));
    json_decref(report);
    free(text);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_notes), cmocka_unit_test(test_borders),
                                       cmocka_unit_test(test_table), cmocka_unit_test(test_table_of_one_rank)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
