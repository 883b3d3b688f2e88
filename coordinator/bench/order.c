#include "coordinator/bench/order.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/bench/order_private.h"
#include "coordinator/job/job_private.h"
#include "coordinator/job/options.h"

enum { RANKS_MOST = 16 };

bool kiln_order_is_usual(const struct kiln_setting *s)
{
    return !s->objects && !(s->cell_factor > 1.0) && !(s->cell_factor < 1.0);
}

void kiln_order_factor(double factor, char text[KILN_ORDER_NAME])
{
    const bool less = factor < 1.0;
    if (less || factor > 1.0)
        (void)snprintf(text, KILN_ORDER_NAME, "auto %c %g", less ? '/' : 'x', less ? 1.0 / factor : factor);
    else
        (void)snprintf(text, KILN_ORDER_NAME, "auto");
}

/* ---- numbers of ranks ---- */

struct rank_counts {
    uint32_t of[RANKS_MOST];
    size_t count;
};

static bool are_ranks_given(const struct kiln_job *job)
{
    const struct kiln_job_owned *owned = job->strings;
    for (size_t i = 0; i < kiln_option_count; i++)
        if (strcmp(kiln_options[i].name, "ranks") == 0 && (kiln_options[i].commands & KILN_FOR_BENCH) != 0)
            return owned->given[i];
    return false;
}

/* Those of --ranks; a single 0, which is no mpirun, if it is not given. */
static int read_ranks(const struct kiln_job *job, struct rank_counts *ranks, struct kiln_error *error)
{
    *ranks = (struct rank_counts){.count = 1};
    if (!are_ranks_given(job))
        return KILN_OK;
    ranks->count = 0;
    for (const char *at = job->rank_counts; *at != '\0' || ranks->count == 0;) {
        char *end = NULL;
        const unsigned long value = *at >= '0' && *at <= '9' ? strtoul(at, &end, 10) : 0;
        if (value < 1 || value > 65536 || (*end != ',' && *end != '\0') || ranks->count == RANKS_MOST ||
            (ranks->count > 0 && value <= ranks->of[ranks->count - 1]))
            return kiln_fail(error, KILN_USAGE,
                             "--ranks takes ascending numbers such as 1,2,4 (%d at most), not '%.100s'", RANKS_MOST,
                             job->rank_counts);
        ranks->of[ranks->count++] = (uint32_t)value;
        at = *end == ',' ? end + 1 : end;
    }
    return KILN_OK;
}

static void add_for_all(struct kiln_sweep *sweep, const struct rank_counts *ranks, const char *name,
                        struct kiln_setting s)
{
    for (size_t i = 0; i < ranks->count; i++) {
        s.ranks = ranks->of[i];
        if (s.ranks == 0)
            (void)snprintf(s.name, sizeof s.name, "%.24s", name);
        else
            (void)snprintf(s.name, sizeof s.name, "%.24s, %u rank%s", name, s.ranks, s.ranks == 1 ? "" : "s");
        kiln_sweep_add(sweep, &s);
    }
}

/* ---- settings ---- */

/* A side in metres. */
static bool read_side(const char *text, double *side)
{
    char *end = NULL;
    *side = *text >= '0' && *text <= '9' ? strtod(text, &end) : 0.0;
    return end != NULL && *end == '\0' && isfinite(*side) && *side > 0.0;
}

static int check_sides(const struct kiln_job *job, bool *automatic, struct kiln_error *error)
{
    *automatic = job->argument_count <= 2;
    for (size_t i = 2; i < job->argument_count; i++) {
        double side;
        if (strcmp(job->arguments[i], "auto") == 0)
            *automatic = true;
        else if (!read_side(job->arguments[i], &side))
            return kiln_fail(error, KILN_USAGE,
                             "kiln bench cell-size takes sides of a cell in metres, such as 0.5, and 'auto', which is "
                             "1/8 to 8 times the automatic one; not '%.100s'",
                             job->arguments[i]);
    }
    return KILN_OK;
}

static int choose_sides(struct kiln_sweep *sweep, struct kiln_error *error)
{
    const struct kiln_job *job = sweep->job;
    struct rank_counts ranks;
    bool automatic;
    int status = check_sides(job, &automatic, error);
    if (status == KILN_OK)
        status = read_ranks(job, &ranks, error);
    for (int power = -3; status == KILN_OK && power <= 3; power++) {
        char name[KILN_ORDER_NAME];
        const double factor = ldexp(1.0, power);
        kiln_order_factor(factor, name);
        if (power == 0 || automatic)
            add_for_all(sweep, &ranks, name, (struct kiln_setting){.group = "auto", .cell_factor = factor});
    }
    for (size_t i = 2; status == KILN_OK && i < job->argument_count; i++) {
        char name[KILN_ORDER_NAME];
        struct kiln_setting s = {.group = "given"};
        if (!read_side(job->arguments[i], &s.cell_size))
            continue;
        (void)snprintf(name, sizeof name, "%g m", s.cell_size);
        add_for_all(sweep, &ranks, name, s);
    }
    if (status == KILN_OK && sweep->count == KILN_SETTINGS_MOST)
        return kiln_fail(error, KILN_USAGE, "there are too many bakes in one sweep: give fewer sides");
    return status;
}

static int choose_orders(struct kiln_sweep *sweep, struct kiln_error *error)
{
    struct rank_counts ranks;
    if (sweep->job->argument_count > 2)
        return kiln_fail(error, KILN_USAGE, "kiln bench per-object takes a scene and nothing else, not '%.100s'",
                         sweep->job->arguments[2]);
    const int status = read_ranks(sweep->job, &ranks, error);
    for (int objects = 0; status == KILN_OK && objects < 2; objects++)
        add_for_all(sweep, &ranks, objects ? "objects" : "cells",
                    (struct kiln_setting){.group = "order", .cell_factor = 1.0, .objects = objects != 0});
    return status;
}

static void side_options(const struct kiln_sweep *sweep, const struct kiln_setting *s, char text[KILN_SETTING_OPTIONS])
{
    const double side = s->cell_factor > 0.0 ? s->cell_factor * sweep->cell_size : s->cell_size;
    if (kiln_order_is_usual(s))
        (void)snprintf(text, KILN_SETTING_OPTIONS, "--cell-size auto");
    else if (side > 0.0)
        (void)snprintf(text, KILN_SETTING_OPTIONS, "--cell-size %.9g", side);
    else
        (void)snprintf(text, KILN_SETTING_OPTIONS, "--cell-size (%g times the automatic side)", s->cell_factor);
}

static void order_options(const struct kiln_sweep *sweep, const struct kiln_setting *s, char text[KILN_SETTING_OPTIONS])
{
    (void)sweep;
    (void)snprintf(text, KILN_SETTING_OPTIONS, "--partition %s", s->objects ? "objects" : "cells");
}

static void key(const struct kiln_setting *s, char text[KILN_SETTING_OPTIONS])
{
    (void)snprintf(text, KILN_SETTING_OPTIONS, "%s (%.17g m)", s->name, s->cell_size);
}

/* All trace the same rays. */
static double rays(const struct kiln_setting *s)
{
    (void)s;
    return 1.0;
}

static void push_reference(const struct kiln_sweep *sweep, struct kiln_child *child)
{
    (void)child; /* nothing but the options of all bakes */
    if (!sweep->job->quiet)
        (void)fprintf(stderr, "kiln: baking the reference, which all bakes must equal\n");
}

/* ---- files ---- */

static void add_number(struct kiln_html *page, double value)
{
    if (isfinite(value))
        kiln_html_add(page, ",%.9g", value);
    else
        kiln_html_add(page, ",");
}

static void add_csv(const struct kiln_sweep *sweep, struct kiln_html *page)
{
    kiln_html_add(page, "name,options,ranks,cell_size,cells,points,rays,nrmse,values_that_differ,runs,light_seconds,"
                        "light_seconds_least,light_seconds_most,indirect_seconds,exchange_seconds,seconds,"
                        "processor_seconds,peak_bytes,received_bytes,point_imbalance");
    for (int c = 0; c < KILN_COUNTERS; c++)
        kiln_html_add(page, ",%s", kiln_cache_counters[c].name);
    kiln_html_add(page, "\n");
    for (size_t i = 0; i < sweep->count; i++) {
        char text[KILN_SETTING_OPTIONS];
        const struct kiln_setting *s = &sweep->settings[i];
        const struct kiln_setting_result *r = &sweep->results[i];
        const struct kiln_spread light = kiln_sweep_spread(r, KILN_TIME_LIGHT);
        if (!r->done)
            continue;
        sweep->kind->options(sweep, s, text);
        kiln_html_add(page, "\"%s\",%s,%u,%.9g,%.0f,%.0f,%.0f,%.6g,%.0f,%zu,%.6g,%.6g,%.6g", s->name, text,
                      s->ranks > 0 ? s->ranks : 1, r->cell_size, r->cells, r->points, r->rays, r->error[0],
                      r->differing, r->runs, light.median, light.least, light.most);
        add_number(page, kiln_sweep_spread(r, KILN_TIME_INDIRECT).median);
        add_number(page, kiln_sweep_spread(r, KILN_TIME_EXCHANGE).median);
        kiln_html_add(page, ",%.6g,%.6g,%.0f,%.0f,%.6g", r->seconds, r->processor_seconds, r->bytes, r->received,
                      r->imbalance);
        for (int c = 0; c < KILN_COUNTERS; c++)
            add_number(page, kiln_sweep_spread(r, (enum kiln_sweep_time)(KILN_TIME_COUNTERS + c)).median);
        kiln_html_add(page, "\n");
    }
}

static void list(const struct kiln_sweep *sweep)
{
    for (size_t i = 0; i < sweep->count; i++) {
        char text[KILN_SETTING_OPTIONS];
        sweep->kind->options(sweep, &sweep->settings[i], text);
        (void)printf("%-24s%s\n", sweep->settings[i].name, text);
    }
    (void)printf("%zu bakes, %zu times each, and the reference before them\n", sweep->count, sweep->repeats);
}

/* ---- the benches ---- */

/* Runs a bench whose name, suffix, refused options, settings and their options `kind` has. */
static int run_order(struct kiln_sweep_kind kind, struct kiln_job *job, struct kiln_error *error)
{
    kind.exact = true;
    kind.key = key;
    kind.push_reference = push_reference;
    kind.rays = rays;
    kind.csv = add_csv;
    kind.plot = kiln_order_plot;
    kind.list = list;
    kind.tell = kiln_order_tell;
    return kiln_sweep_run(&kind, job, error);
}

int kiln_cell_size_bench(struct kiln_job *job, struct kiln_error *error)
{
    static const char *const refused[] = {"cell-size",         "samples-probe",   "reference",
                                          "reference-samples", "verify-fraction", NULL};
    const struct kiln_sweep_kind own = {.name = "cell-size",
                                        .suffix = "-cell-size",
                                        .refused = refused,
                                        .choose = choose_sides,
                                        .options = side_options};
    return run_order(own, job, error);
}

int kiln_per_object_bench(struct kiln_job *job, struct kiln_error *error)
{
    static const char *const refused[] = {"partition",         "samples-probe",   "reference",
                                          "reference-samples", "verify-fraction", NULL};
    const struct kiln_sweep_kind own = {.name = "per-object",
                                        .suffix = "-per-object",
                                        .refused = refused,
                                        .choose = choose_orders,
                                        .options = order_options};
    return run_order(own, job, error);
}
