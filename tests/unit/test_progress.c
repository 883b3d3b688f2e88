#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/run/progress.h"

static double now;

static double read_clock(void *unused)
{
    (void)unused;
    return now;
}

struct screen {
    char *text;
    size_t size;
    FILE *stream;
    struct kiln_progress *progress;
};

static void begin(struct screen *screen, bool terminal)
{
    now = 1000;
    screen->stream = open_memstream(&screen->text, &screen->size);
    assert_non_null(screen->stream);
    screen->progress = kiln_progress_create_on(screen->stream, terminal, 80, read_clock, NULL);
    assert_non_null(screen->progress);
}

static void end(struct screen *screen)
{
    kiln_progress_destroy(&screen->progress);
    assert_null(screen->progress);
    (void)fclose(screen->stream);
    free(screen->text);
}

static size_t count(const char *text, const char *part)
{
    size_t found = 0;
    for (const char *at = text; (at = strstr(at, part)) != NULL; at++)
        found++;
    return found;
}

/* Two minutes of work in a file: a line every nine seconds, no control characters. */
static void test_lines(void **state)
{
    (void)state;
    struct screen screen;
    begin(&screen, false);
    kiln_progress_phase(screen.progress, "direct light", 1200);
    for (int i = 1; i <= 1200; i++) {
        now = 1000 + 0.1 * i;
        kiln_progress_advance(screen.progress, (uint64_t)i);
    }
    kiln_progress_phase(screen.progress, "bounce 1", 10);
    kiln_progress_finish(screen.progress);
    (void)fflush(screen.stream);
    const size_t lines = count(screen.text, "\n");
    assert_in_range(lines, 13, 15);
    for (size_t i = 0; i < screen.size; i++)
        assert_true(screen.text[i] == '\n' || screen.text[i] >= ' ');
    assert_non_null(strstr(screen.text, "direct light: 45 %, 66.0 s left\n"));
    end(&screen);
}

/* A minute in which nothing is finished: lines come all the same, and after the phase's end no more. */
static void test_lines_without_news(void **state)
{
    (void)state;
    struct screen screen;
    begin(&screen, false);
    kiln_progress_phase(screen.progress, "import", 0);
    for (; now < 1060; now += 1)
        kiln_progress_beat(screen.progress);
    kiln_progress_finish(screen.progress);
    for (; now < 1120; now += 1)
        kiln_progress_beat(screen.progress);
    (void)fflush(screen.stream);
    assert_string_equal(
        screen.text,
        "import\nimport: 9.00 s\nimport: 18.0 s\nimport: 27.0 s\nimport: 36.0 s\nimport: 45.0 s\nimport: 54.0 s\n");
    end(&screen);
}

static void test_bar(void **state)
{
    (void)state;
    struct screen screen;
    begin(&screen, true);
    kiln_progress_phase(screen.progress, "direct light", 100);
    for (int i = 1; i <= 1000; i++) {
        now = 1000 + 0.01 * i;
        kiln_progress_advance(screen.progress, (uint64_t)i / 10);
    }
    (void)fflush(screen.stream);
    assert_in_range(count(screen.text, "\r"), 50, 101); /* ten times a second for ten seconds */
    assert_int_equal(count(screen.text, "\n"), 0);
    assert_non_null(strstr(screen.text, "####"));
    const char *half = strstr(screen.text, " 50 %, ");
    assert_non_null(half);
    assert_true(strtod(half + 7, NULL) > 4 && strtod(half + 7, NULL) < 6);
    kiln_progress_finish(screen.progress);
    (void)fflush(screen.stream);
    const char *last = strrchr(screen.text, '\r');
    assert_string_equal(last, "\r\033[K");
    /* Every redrawn line fits into 79 columns. */
    for (const char *at = screen.text; (at = strchr(at, '\r')) != NULL; at++)
        assert_true(strcspn(at + 4, "\r\n") < 80);
    end(&screen);
}

/* The work becomes ten times slower half-way: the time left follows, and ends near the truth. */
static void test_time_left_follows_a_change(void **state)
{
    (void)state;
    struct screen screen;
    begin(&screen, true);
    kiln_progress_phase(screen.progress, "work", 1000);
    for (int i = 1; i <= 500; i++) {
        now += 0.02;
        kiln_progress_advance(screen.progress, (uint64_t)i);
    }
    for (int i = 501; i <= 750; i++) {
        now += 0.2;
        kiln_progress_advance(screen.progress, (uint64_t)i);
    }
    (void)fflush(screen.stream);
    const char *last = strrchr(screen.text, '%');
    const double left = strtod(last + 2, NULL);
    assert_true(left > 47 && left < 53); /* 250 units at 5 a second */
    end(&screen);
}

static void test_unknown_total_and_nonsense(void **state)
{
    (void)state;
    struct screen screen;
    begin(&screen, true);
    kiln_progress_advance(screen.progress, 5); /* before any phase */
    kiln_progress_finish(screen.progress);
    kiln_progress_phase(screen.progress, "reading a scene whose name is far too long for the line that is to show it",
                        0);
    now += 3;
    kiln_progress_advance(screen.progress, 77);
    kiln_progress_phase(screen.progress, "too far", 10);
    now += 3;
    kiln_progress_advance(screen.progress, 11);
    (void)fflush(screen.stream);
    assert_non_null(strstr(screen.text, "100 %"));
    assert_null(strstr(screen.text, "110 %"));
    end(&screen);
    struct kiln_progress *none = kiln_progress_create(true, 0);
    assert_null(none);
    assert_null(kiln_progress_create(false, 1));
    kiln_progress_phase(none, "x", 1);
    kiln_progress_advance(none, 1);
    kiln_progress_finish(none);
    kiln_progress_destroy(&none);
}

/* ---- the whole ---- */

/* A command that takes 100 s: 10 s, then light for 80 s that tells its own time left, then two files. */
static const struct kiln_stage stages[] = {
    {"import", 1, false}, {"points", 5, false}, {"light", 40, true}, {"maps", 5, false}, {"last", 1, false}};
enum { STAGES = sizeof stages / sizeof *stages, WHOLE = 100 };

static void begin_whole(struct screen *screen, bool terminal)
{
    begin(screen, terminal);
    kiln_progress_phase(screen->progress, "import", 0);
    kiln_progress_expect(screen->progress, stages, STAGES);
}

/* The light's own word: a fifth too much at first, and true at the end. */
static double reckon(void *began, double share)
{
    const double left = *(double *)began + 80 - now;
    (void)share;
    return left + 0.2 * left;
}

struct shown {
    double share, left, least, most; /* least and most: time left over the true one, between 10 and 90 s */
    size_t falls, below_zero;
};

static void watch(void *data, const struct kiln_progress_state *state)
{
    struct shown *shown = data;
    const double truth = 1000 + WHOLE - now, factor = state->left / truth;
    shown->falls += state->share < shown->share;
    shown->below_zero += state->left < 0;
    shown->share = state->share;
    shown->left = state->left;
    if (now >= 1010 && now <= 1090) {
        shown->least = factor < shown->least ? factor : shown->least;
        shown->most = factor > shown->most ? factor : shown->most;
    }
}

/* Runs phase `name` for so many seconds; with a total of 100, or 0. */
static void run_phase(struct kiln_progress *progress, const char *name, uint64_t total, double seconds)
{
    const double start = now;
    kiln_progress_phase(progress, name, total);
    for (int i = 1; i <= 100; i++) {
        now = start + seconds * i / 100;
        kiln_progress_advance(progress, total > 0 ? (uint64_t)i : 0);
    }
}

static void run_whole(struct kiln_progress *progress, double factor_of_maps)
{
    run_phase(progress, "import", 0, 2);
    run_phase(progress, "points", 100, 8);
    double began = now;
    kiln_progress_phase(progress, "light", 0);
    kiln_progress_reckon(progress, reckon, &began);
    for (int i = 0; i < 8; i++) {
        char name[16];
        (void)snprintf(name, sizeof name, "bounce %d", i);
        run_phase(progress, name, 100, 10);
    }
    kiln_progress_reckon(progress, NULL, NULL);
    run_phase(progress, "maps", 0, 8 * factor_of_maps);
    run_phase(progress, "last", 0, 2);
    kiln_progress_finish(progress);
}

/* Stages take up to twice what is expected: the time left of the whole is 0.6 to 1.6 times the true one all the way,
 * the share never falls, and comes to about what it is. */
static void test_time_left_of_the_whole(void **state)
{
    (void)state;
    struct screen screen;
    struct shown shown = {.least = 1e9};
    begin_whole(&screen, false);
    kiln_progress_observe(screen.progress, watch, &shown);
    run_whole(screen.progress, 1);
    (void)fflush(screen.stream);
    assert_int_equal(shown.falls, 0);
    assert_int_equal(shown.below_zero, 0);
    assert_true(shown.least > 0.6 && shown.most < 1.6);
    assert_true(shown.share > 0.95);
    assert_non_null(strstr(screen.text, "bounce 4: "));
    const char *half = strstr(screen.text, "bounce 4: ");
    assert_in_range(strtol(half + strlen("bounce 4: "), NULL, 10), 40, 65);
    end(&screen);
}

/* The last stage takes ten times as long as it is expected to: the bar waits, but does not go back, and is not full. */
static void test_bar_of_the_whole_never_goes_back(void **state)
{
    (void)state;
    struct screen screen;
    struct shown shown = {.least = 1e9};
    begin_whole(&screen, true);
    kiln_progress_observe(screen.progress, watch, &shown);
    run_whole(screen.progress, 10);
    (void)fflush(screen.stream);
    assert_int_equal(shown.falls, 0);
    assert_int_equal(shown.below_zero, 0);
    assert_int_equal(count(screen.text, "\n"), 0);
    size_t most = 0;
    for (const char *at = screen.text; (at = strchr(at, '[')) != NULL; at++) {
        const size_t filled = strspn(at + 1, "#");
        if (at > screen.text && at[-1] == ' ') {
            assert_true(filled >= most);
            most = filled;
        }
    }
    assert_in_range(most, 10, 40);
    assert_string_equal(strrchr(screen.text, '\r'), "\r\033[K");
    end(&screen);
}

/* Before anything is expected the time left is unknown, and no bar is drawn. */
static void test_unknown_at_first(void **state)
{
    (void)state;
    struct screen screen;
    begin(&screen, true);
    kiln_progress_phase(screen.progress, "import", 0);
    now += 2;
    kiln_progress_beat(screen.progress);
    (void)fflush(screen.stream);
    assert_null(strstr(screen.text, "left"));
    assert_null(strchr(screen.text, '#'));
    end(&screen);
}

/* Nothing is known of a stage until it tells. Afterwards bar and time left go on between its words. */
static void test_a_stage_that_tells_seldom(void **state)
{
    (void)state;
    struct screen screen;
    const struct kiln_stage stage = {"picture", KILN_STAGE_UNKNOWN, true};
    struct shown shown = {.least = 1e9};
    begin(&screen, true);
    kiln_progress_observe(screen.progress, watch, &shown);
    kiln_progress_expect(screen.progress, &stage, 1);
    kiln_progress_phase(screen.progress, "picture", 100);
    now += 20;
    kiln_progress_beat(screen.progress);
    assert_true(shown.left < 0 && shown.share == 0);
    kiln_progress_advance(screen.progress, 20);
    assert_true(shown.left > 75 && shown.left < 85 && shown.share > 0.18 && shown.share < 0.22);
    for (int i = 0; i < 40; i++, now += 1)
        kiln_progress_beat(screen.progress);
    assert_true(shown.left > 35 && shown.left < 46 && shown.share > 0.55 && shown.share < 0.65);
    end(&screen);
}

static void test_table(void **state)
{
    (void)state;
    char *text = NULL;
    size_t size = 0;
    FILE *stream = open_memstream(&text, &size);
    static const char *const cells[] = {"phase", "time", "note", "direct", "12.5 s", NULL, "Größe", "1 s", "x"};
    kiln_table_print(stream, cells, 3, 3, 1u << 1);
    (void)fclose(stream);
    assert_string_equal(text, "phase     time  note\ndirect  12.5 s\nGröße      1 s  x\n");
    free(text);
}

static void test_durations(void **state)
{
    (void)state;
    static const struct {
        double seconds;
        const char *text;
    } cases[] = {{0, "0.00 s"},           {-1, "0.00 s"},
                 {9.994, "9.99 s"},       {9.996, "10.0 s"},
                 {99.94, "99.9 s"},       {99.96, "1 min 40 s"},
                 {3599.4, "59 min 59 s"}, {3599.6, "1 h 00 min"},
                 {7620, "2 h 07 min"},    {1e300, "more than 30 years"}};
    char text[48];
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        assert_string_equal(kiln_duration_text(cases[i].seconds, text, sizeof text), cases[i].text);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_lines),
        cmocka_unit_test(test_lines_without_news),
        cmocka_unit_test(test_bar),
        cmocka_unit_test(test_time_left_follows_a_change),
        cmocka_unit_test(test_time_left_of_the_whole),
        cmocka_unit_test(test_bar_of_the_whole_never_goes_back),
        cmocka_unit_test(test_unknown_at_first),
        cmocka_unit_test(test_a_stage_that_tells_seldom),
        cmocka_unit_test(test_table),
        cmocka_unit_test(test_durations),
        cmocka_unit_test(test_unknown_total_and_nonsense),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
