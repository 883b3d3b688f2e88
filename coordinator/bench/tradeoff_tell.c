#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/bench/tradeoff_private.h"
#include "coordinator/files/json.h"
#include "worker/base/text.h"

enum { SENTENCE = 400, SENTENCES = 16 };

struct sentences {
    char text[SENTENCES][SENTENCE];
    size_t count;
};

void kiln_tradeoff_list(const struct kiln_sweep *sweep)
{
    for (size_t i = 0; i < sweep->count; i++) {
        const struct kiln_setting *s = &sweep->settings[i];
        char options[KILN_SETTING_OPTIONS];
        kiln_setting_options(s, sweep->density, options);
        (void)printf("%-10s%-28s%s\n", s->group, s->name, options);
    }
    (void)printf("%zu bakes, and the reference before them%s\n", sweep->count,
                 sweep->job->texels_per_metre > 0.0 ? "" : "; densities are relative to that of the reference");
}

static char *next(struct sentences *s) { return s->text[s->count < SENTENCES - 1 ? s->count++ : s->count]; }

/* For each round error that the front reaches, the quickest bake that has it. */
static void say_choices(const struct kiln_sweep *sweep, struct sentences *said)
{
    static const double errors[] = {0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001};
    size_t front[KILN_SETTINGS_MOST], last = SIZE_MAX;
    const size_t count = kiln_front_list(sweep, front);
    for (size_t e = sizeof errors / sizeof *errors; e-- > 0;) {
        size_t i = 0;
        while (i < count && sweep->results[front[i]].error[0] > errors[e])
            i++;
        if (i == count || front[i] == last)
            continue;
        char options[KILN_SETTING_OPTIONS];
        last = front[i];
        kiln_setting_options(&sweep->settings[last], sweep->density, options);
        (void)snprintf(next(said), SENTENCE, "for an nrmse below %g %% choose '%s' (%s), which takes %.3g s",
                       100.0 * errors[e], sweep->settings[last].name, options, sweep->results[last].seconds);
    }
}

/* A bake of the front that is as quick as this one and has no more error. One off the front has one. */
static const char *better_name(const struct kiln_sweep *sweep, const struct kiln_setting_result *than)
{
    size_t front[KILN_SETTINGS_MOST];
    const size_t count = kiln_front_list(sweep, front);
    for (size_t i = 0; i < count; i++) {
        const struct kiln_setting_result *r = &sweep->results[front[i]];
        if (r->seconds <= than->seconds && r->error[0] <= than->error[0])
            return sweep->settings[front[i]].name;
    }
    return "";
}

static void say_presets(const struct kiln_sweep *sweep, struct sentences *said)
{
    for (size_t i = 0; i < sweep->count; i++) {
        const struct kiln_setting_result *r = &sweep->results[i];
        if (!sweep->settings[i].preset || !r->done)
            continue;
        const double front = kiln_front_seconds(sweep, r->error[0]), over = r->seconds / front;
        if (r->front)
            (void)snprintf(next(said), SENTENCE, "the preset %s is on the front", sweep->settings[i].name);
        else if (isfinite(over))
            (void)snprintf(next(said), SENTENCE,
                           "the preset %s takes %.0f %% more time than the front at its error (%.3g s, %.3g s)",
                           sweep->settings[i].name, 100.0 * (over - 1.0), r->seconds, front);
        else
            (void)snprintf(next(said), SENTENCE,
                           "the preset %s is off the front: '%s' takes no more time and has no more error",
                           sweep->settings[i].name, better_name(sweep, r));
    }
}

static void say_reference(const struct kiln_sweep *sweep, struct sentences *said)
{
    double least = INFINITY;
    for (size_t i = 0; i < sweep->count; i++)
        if (sweep->results[i].done)
            least = fmin(least, sweep->results[i].error[0]);
    if (least < 3.0 * sweep->reference_error)
        (void)snprintf(next(said), SENTENCE,
                       "the reference states an error of %.3g %% of its own: what is measured below %.3g %% is partly "
                       "that; more --reference-samples make it less",
                       100.0 * sweep->reference_error, 300.0 * sweep->reference_error);
}

static void print_text(const struct kiln_sweep *sweep, const struct sentences *said)
{
    size_t front[KILN_SETTINGS_MOST];
    const size_t count = kiln_front_list(sweep, front);
    (void)printf("%-28s%9s%9s%10s%11s%11s%10s\n", "front, by time", "nrmse %", "direct %", "indirect %", "seconds",
                 "light s", "MiB");
    for (size_t i = 0; i < count; i++) {
        const struct kiln_setting_result *r = &sweep->results[front[i]];
        (void)printf("%-28s%9.3f%9.3f%10.3f%11.3f%11.3f%10.1f\n", sweep->settings[front[i]].name, 100.0 * r->error[0],
                     100.0 * r->error[1], 100.0 * r->error[2], r->seconds, r->light_seconds, r->bytes / 0x1p20);
    }
    for (size_t i = 0; i < said->count; i++)
        kiln_print(stdout, "%s\n", said->text[i]);
    kiln_print(stdout, "%s/tradeoff.csv, %s/tradeoff.svg\n", sweep->job->output, sweep->job->output);
}

static json_t *rows_json(const struct kiln_sweep *sweep)
{
    json_t *rows = json_array();
    for (size_t i = 0; i < sweep->count; i++) {
        const struct kiln_setting *s = &sweep->settings[i];
        const struct kiln_setting_result *r = &sweep->results[i];
        char options[KILN_SETTING_OPTIONS];
        kiln_setting_options(s, sweep->density, options);
        if (r->done)
            (void)json_array_append_new(rows, json_pack("{s:s, s:s, s:s, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:b}",
                                                        "group", s->group, "name", s->name, "options", options, "nrmse",
                                                        r->error[0], "nrmse_direct", r->error[1], "nrmse_indirect",
                                                        r->error[2], "seconds", r->seconds, "light_seconds",
                                                        r->light_seconds, "processor_seconds", r->processor_seconds,
                                                        "peak_bytes", r->bytes, "front", (int)r->front));
    }
    return rows;
}

int kiln_tradeoff_tell(const struct kiln_sweep *sweep, size_t left, struct kiln_error *error)
{
    struct sentences said = {.count = 0};
    if (left > 0)
        (void)snprintf(
            next(&said), SENTENCE,
            "%zu of %zu bakes are left, for the budget of %.4g s is used up; the same command goes on with them", left,
            sweep->count, sweep->job->budget);
    say_choices(sweep, &said);
    say_presets(sweep, &said);
    say_reference(sweep, &said);
    if (!sweep->job->json) {
        print_text(sweep, &said);
        return KILN_OK;
    }
    json_t *sentences = json_array();
    for (size_t i = 0; i < said.count; i++)
        (void)json_array_append_new(sentences, kiln_json_string(said.text[i]));
    sweep->job->answered = true;
    return kiln_json_print(json_pack("{s:s, s:s, s:f, s:i, s:o, s:o}", "status", "done", "output", sweep->job->output,
                                     "reference_error", sweep->reference_error, "left", (int)left, "bakes",
                                     rows_json(sweep), "sentences", sentences),
                           error);
}
