#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/bench/order_private.h"
#include "coordinator/files/json.h"
#include "worker/base/text.h"

enum { SENTENCE = 400, SENTENCES = 40, RUNS_TO_TELL = 4 };

struct sentences {
    char text[SENTENCES][SENTENCE];
    size_t count;
};

static char *next(struct sentences *s) { return s->text[s->count < SENTENCES - 1 ? s->count++ : s->count]; }

/* Bakes that have a result, and those of them whose bits are not the reference's. */
static size_t count_done(const struct kiln_sweep *sweep, size_t *differing)
{
    size_t done = 0;
    *differing = 0;
    for (size_t i = 0; i < sweep->count; i++) {
        done += sweep->results[i].done;
        *differing += sweep->results[i].done && sweep->results[i].differing > 0.0;
    }
    return done;
}

static void say_bits(const struct kiln_sweep *sweep, struct sentences *said)
{
    size_t differing;
    const size_t done = count_done(sweep, &differing);
    if (done > 0 && differing == 0)
        (void)snprintf(next(said), SENTENCE,
                       "in all %zu bakes every bit of the lightmaps is the reference's: the error against the unbiased "
                       "bake is 0",
                       done);
    for (size_t i = 0; i < sweep->count; i++)
        if (sweep->results[i].differing > 0.0)
            (void)snprintf(next(said), SENTENCE,
                           "'%s' differs from the reference in %.0f values of its lightmaps: nrmse %.3g %%",
                           sweep->settings[i].name, sweep->results[i].differing, 100.0 * sweep->results[i].error[0]);
}

/* Whether the runs of two bakes tell their times apart: two sets of RUNS_TO_TELL runs each of the same bake lie wholly
 * beside each other in 3 of 100 cases. */
static const char *say_certainty(const struct kiln_setting_result *a, const struct kiln_setting_result *b)
{
    const struct kiln_spread x = kiln_sweep_spread(a, KILN_TIME_LIGHT), y = kiln_sweep_spread(b, KILN_TIME_LIGHT);
    if (a->runs < RUNS_TO_TELL || b->runs < RUNS_TO_TELL)
        return "these are too few runs to tell them apart";
    return x.least <= y.most && y.least <= x.most ? "their runs overlap, so these repeats cannot tell them apart"
                                                  : "their runs do not overlap";
}

/* How much longer the passes of light of bake i take than those of the usual one. */
static void say_time(const struct kiln_sweep *sweep, const char *which, size_t i, size_t usual, struct sentences *said)
{
    char options[KILN_SETTING_OPTIONS];
    const struct kiln_setting_result *own = &sweep->results[i], *other = &sweep->results[usual];
    const double more = 100.0 * (own->light_seconds / other->light_seconds - 1.0);
    sweep->kind->options(sweep, &sweep->settings[i], options);
    (void)snprintf(next(said), SENTENCE, "light takes %s time with '%s' (%s): %.3g s, %.1f %% %s than with '%s'; %s",
                   which, sweep->settings[i].name, options, own->light_seconds, fabs(more),
                   more < 0.0 ? "less" : "more", sweep->settings[usual].name, say_certainty(own, other));
}

/* For each number of ranks, the bakes of least and of most time against the usual one. */
static void say_times(const struct kiln_sweep *sweep, struct sentences *said)
{
    for (size_t usual = 0; usual < sweep->count; usual++) {
        size_t least = usual, most = usual;
        if (!kiln_order_is_usual(&sweep->settings[usual]) || !sweep->results[usual].done ||
            !(sweep->results[usual].light_seconds > 0.0))
            continue;
        for (size_t i = 0; i < sweep->count; i++) {
            if (sweep->settings[i].ranks != sweep->settings[usual].ranks || !sweep->results[i].done)
                continue;
            least = sweep->results[i].light_seconds < sweep->results[least].light_seconds ? i : least;
            most = sweep->results[i].light_seconds > sweep->results[most].light_seconds ? i : most;
        }
        if (least != usual)
            say_time(sweep, "least", least, usual, said);
        if (most != usual)
            say_time(sweep, "most", most, usual, said);
    }
}

static void say_exchange(const struct kiln_sweep *sweep, struct sentences *said)
{
    bool many = false, sent = false;
    for (size_t i = 0; i < sweep->count; i++) {
        many = many || (sweep->results[i].done && sweep->settings[i].ranks > 1);
        sent = sent || sweep->results[i].received > 0.0;
    }
    if (many && !sent)
        (void)snprintf(next(said), SENTENCE,
                       "no radiosity was sent: these ranks are on one node, and share its memory");
}

static bool has_all_counters(const struct kiln_sweep *sweep)
{
    bool all = true;
    for (size_t i = 0; i < sweep->count; i++)
        for (int c = 0; sweep->results[i].done && c < KILN_COUNTERS; c++)
            all = all && isfinite(kiln_sweep_spread(&sweep->results[i], KILN_TIME_COUNTERS + (unsigned)c).median);
    return all;
}

static void say_counters(const struct kiln_sweep *sweep, struct sentences *said)
{
    struct kiln_counters counters;
    if (has_all_counters(sweep))
        return;
    kiln_counters_open(&counters, kiln_cache_counters, KILN_COUNTERS);
    kiln_counters_close(&counters);
    (void)snprintf(next(said), SENTENCE, "%s",
                   counters.why != 0 ? kiln_counters_remedy(counters.why)
                                     : "cache misses were not counted in all runs, some of which were made where they "
                                       "could not be; --no-resume begins anew");
}

/* Misses of a cache in percent of its uses; NaN: not known. */
static double miss_rate(const struct kiln_setting_result *r, int uses)
{
    const double used = kiln_sweep_spread(r, KILN_TIME_COUNTERS + (unsigned)uses).median,
                 missed = kiln_sweep_spread(r, KILN_TIME_COUNTERS + (unsigned)uses + 1).median;
    return used > 0.0 ? 100.0 * missed / used : (double)NAN;
}

static void print_rate(double rate)
{
    if (isfinite(rate))
        (void)printf("%9.2f", rate);
    else
        (void)printf("%9s", "-");
}

static void print_text(const struct kiln_sweep *sweep, const struct sentences *said)
{
    (void)printf("%-22s%10s%9s%9s%19s%11s%11s%9s%9s%11s%9s%9s\n", "bake", "side m", "cells", "light s", "least to most",
                 "indirect s", "processor", "MiB", "sent MiB", "imbalance%", "miss %", "L1 miss %");
    for (size_t i = 0; i < sweep->count; i++) {
        const struct kiln_setting_result *r = &sweep->results[i];
        const struct kiln_spread light = kiln_sweep_spread(r, KILN_TIME_LIGHT);
        if (!r->done)
            continue;
        (void)printf("%-22s%10.4g%9.0f%9.3f%10.3f%9.3f%11.3f%11.3f%9.1f%9.1f%11.1f", sweep->settings[i].name,
                     r->cell_size, r->cells, light.median, light.least, light.most,
                     kiln_sweep_spread(r, KILN_TIME_INDIRECT).median, r->processor_seconds, r->bytes / 0x1p20,
                     r->received / 0x1p20, 100.0 * r->imbalance);
        print_rate(miss_rate(r, 0));
        print_rate(miss_rate(r, 2));
        (void)printf("\n");
    }
    for (size_t i = 0; i < said->count; i++)
        kiln_print(stdout, "%s\n", said->text[i]);
    kiln_print(stdout, "%s/%s.csv, %s/%s.svg\n", sweep->job->output, sweep->kind->name, sweep->job->output,
               sweep->kind->name);
}

static json_t *row_json(const struct kiln_sweep *sweep, size_t i)
{
    char options[KILN_SETTING_OPTIONS];
    const struct kiln_setting *s = &sweep->settings[i];
    const struct kiln_setting_result *r = &sweep->results[i];
    const struct kiln_spread light = kiln_sweep_spread(r, KILN_TIME_LIGHT);
    sweep->kind->options(sweep, s, options);
    json_t *row = json_pack(
        "{s:s, s:s, s:i, s:f, s:f, s:f, s:f, s:i, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f}", "name", s->name,
        "options", options, "ranks", s->ranks > 0 ? (int)s->ranks : 1, "cell_size", r->cell_size, "cells", r->cells,
        "nrmse", r->error[0], "values_that_differ", r->differing, "runs", (int)r->runs, "light_seconds", light.median,
        "light_seconds_least", light.least, "light_seconds_most", light.most, "indirect_seconds",
        kiln_sweep_spread(r, KILN_TIME_INDIRECT).median, "exchange_seconds",
        kiln_sweep_spread(r, KILN_TIME_EXCHANGE).median, "seconds", r->seconds, "processor_seconds",
        r->processor_seconds, "peak_bytes", r->bytes, "received_bytes", r->received, "point_imbalance", r->imbalance);
    for (unsigned c = 0; c < KILN_COUNTERS; c++)
        (void)json_object_set_new(row, kiln_cache_counters[c].name,
                                  kiln_sweep_number(kiln_sweep_spread(r, KILN_TIME_COUNTERS + c).median));
    return row;
}

static int print_json(const struct kiln_sweep *sweep, size_t left, const struct sentences *said,
                      struct kiln_error *error)
{
    json_t *sentences = json_array(), *rows = json_array();
    for (size_t i = 0; i < said->count; i++)
        (void)json_array_append_new(sentences, kiln_json_string(said->text[i]));
    for (size_t i = 0; i < sweep->count; i++)
        if (sweep->results[i].done)
            (void)json_array_append_new(rows, row_json(sweep, i));
    sweep->job->answered = true;
    return kiln_json_print(json_pack("{s:s, s:s, s:i, s:o, s:o}", "status", "done", "output", sweep->job->output,
                                     "left", (int)left, "bakes", rows, "sentences", sentences),
                           error);
}

int kiln_order_tell(const struct kiln_sweep *sweep, size_t left, struct kiln_error *error)
{
    struct sentences said = {.count = 0};
    size_t differing;
    if (left > 0)
        (void)snprintf(
            next(&said), SENTENCE,
            "%zu of %zu runs are left, for the budget of %.4g s is used up; the same command goes on with them", left,
            sweep->repeats * sweep->count, sweep->job->budget);
    say_bits(sweep, &said);
    say_times(sweep, &said);
    say_exchange(sweep, &said);
    say_counters(sweep, &said);
    const size_t done = count_done(sweep, &differing);
    int status = KILN_OK;
    if (sweep->job->json)
        status = print_json(sweep, left, &said, error);
    else
        print_text(sweep, &said);
    if (status != KILN_OK || differing == 0)
        return status;
    return kiln_fail(error, KILN_BUG, "%zu of %zu bakes differ from the reference, which must have the same bits",
                     differing, done);
}
