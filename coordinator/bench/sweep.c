#include "coordinator/bench/sweep.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

#include "coordinator/job/job_private.h"
#include "coordinator/job/options.h"
#include "worker/base/memory.h"
#include "worker/base/text.h"

/* Options that the bench decides. */
static const char *const own[] = {"output", "json", "quiet", "verbose", "resume", NULL};

static double now(void)
{
    struct timespec time;
    (void)clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

/* Seconds of processor time of all children that have ended. */
static double processor_time(void)
{
    struct rusage used = {0};
    (void)getrusage(RUSAGE_CHILDREN, &used);
    return (double)(used.ru_utime.tv_sec + used.ru_stime.tv_sec) +
           1e-6 * (double)(used.ru_utime.tv_usec + used.ru_stime.tv_usec);
}

/* ---- before the sweep ---- */

static int check_options(const struct kiln_sweep *sweep, struct kiln_error *error)
{
    const struct kiln_job *job = sweep->job;
    const struct kiln_job_owned *owned = job->strings;
    const char *bench = sweep->kind->name;
    if (job->scene == NULL)
        return kiln_fail(error, KILN_USAGE, "kiln bench %s takes a scene; for example: kiln bench %s room.glb", bench,
                         bench);
    for (const char *const *name = sweep->kind->refused; *name != NULL; name++)
        if (owned->given[kiln_option_find(*name) - kiln_options])
            return kiln_fail(error, KILN_USAGE,
                             "kiln bench %s takes no --%s: its bakes have their own; --list shows them", bench, *name);
    if (sweep->repeats > KILN_REPEATS_MOST)
        return kiln_fail(error, KILN_USAGE, "kiln bench %s takes at most %d --repeats, not %zu", bench,
                         KILN_REPEATS_MOST, sweep->repeats);
    if (job->reference != NULL && access(job->reference, R_OK) != 0)
        return kiln_fail_errno(error, 0, "the reference '%.500s' cannot be read", job->reference);
    return KILN_OK;
}

void kiln_sweep_add(struct kiln_sweep *sweep, const struct kiln_setting *setting)
{
    if (sweep->count < KILN_SETTINGS_MOST)
        sweep->settings[sweep->count++] = *setting;
}

static int make_paths(struct kiln_sweep *sweep, struct kiln_error *error)
{
    struct kiln_job *job = sweep->job;
    int status = job->output != NULL ? KILN_OK : kiln_job_default_output(job, job->scene, sweep->kind->suffix, error);
    if (status == KILN_OK)
        status = kiln_child_program(sweep->program, error);
    if (status == KILN_OK && job->reference != NULL)
        kiln_text_copy(sweep->reference, sizeof sweep->reference, job->reference);
    else if (status == KILN_OK)
        status = kiln_path_join(sweep->reference, job->output, "reference", error);
    if (status == KILN_OK)
        status = kiln_path_join(sweep->trial, job->output, "trial", error);
    if (status == KILN_OK)
        status = kiln_path_join(sweep->said, job->output, "said", error);
    if (status == KILN_OK)
        status = kiln_make_directories(job->output, error);
    return status;
}

int kiln_sweep_scene(const struct kiln_sweep *sweep, const struct kiln_setting *s, char path[KILN_PATH_SIZE],
                     struct kiln_error *error)
{
    char name[KILN_SETTING_NAME + 16];
    if (s->generate == NULL) {
        kiln_text_copy(path, KILN_PATH_SIZE, sweep->job->scene);
        return KILN_OK;
    }
    (void)snprintf(name, sizeof name, "scenes/%.*s.glb", KILN_SETTING_NAME, s->generate);
    for (char *c = name; *c != '\0'; c++)
        *c = *c == ' ' ? '-' : *c;
    return kiln_path_join(path, sweep->job->output, name, error);
}

/* ---- a bake ---- */

/* `ranks`: started by mpirun; 0: by itself. */
static void begin_command(const struct kiln_sweep *sweep, uint32_t ranks, const char *scene, const char *folder,
                          struct kiln_child *child)
{
    static const char *const always[] = {"--samples-probe", "0", "--no-preview", "--no-export", NULL};
    if (ranks > 0) {
        kiln_child_push(child, "mpirun");
        kiln_child_push_number(child, "-n", "%.0f", ranks);
    }
    kiln_child_push(child, sweep->program);
    kiln_child_push(child, "bake");
    kiln_child_push(child, scene);
    kiln_child_push(child, "-o");
    kiln_child_push(child, folder);
    for (size_t i = 0; always[i] != NULL; i++)
        kiln_child_push(child, always[i]);
    kiln_child_push_given(child, sweep->job, KILN_FOR_BAKE, own);
}

static void push_words(struct kiln_child *child, char *words)
{
    char *rest = NULL;
    for (char *word = strtok_r(words, " ", &rest); word != NULL; word = strtok_r(NULL, " ", &rest))
        kiln_child_push(child, word);
}

/* Runs the child. A bake that fails has its own message as the reason. */
static int run(const struct kiln_sweep *sweep, struct kiln_child *child, const char *name, struct kiln_error *error)
{
    char said[KILN_CHILD_SAID], what[KILN_SETTING_NAME + 32];
    int code = KILN_OK;
    const int status = kiln_child_run_quietly(child, sweep->said, &code, said, error);
    kiln_remove_tree(sweep->said);
    (void)snprintf(what, sizeof what, "the bake '%.*s'", KILN_SETTING_NAME, name);
    return status == KILN_OK ? kiln_child_failure(what, code, said, error) : status;
}

/* ---- the reference ---- */

static int bake_reference(struct kiln_sweep *sweep, struct kiln_error *error)
{
    const struct kiln_job *job = sweep->job;
    struct kiln_child child = {.error = error};
    begin_command(sweep, 0, job->scene, sweep->reference, &child);
    sweep->kind->push_reference(sweep, &child);
    if (!job->resume)
        kiln_child_push(&child, "--no-resume");
    const int status = run(sweep, &child, "reference", error);
    kiln_child_clear(&child);
    return status;
}

static int have_reference(struct kiln_sweep *sweep, struct kiln_error *error)
{
    int status = KILN_OK;
    const bool made = sweep->job->reference == NULL,
               done = json_is_true(json_object_get(sweep->kept, "reference_done"));
    if (made && !done)
        status = bake_reference(sweep, error);
    if (status == KILN_OK)
        status = kiln_reference_open(sweep, error);
    if (status == KILN_OK) {
        (void)json_object_set_new(sweep->kept, "reference_done", json_true());
        status = kiln_sweep_keep(sweep, error);
    }
    return status;
}

/* ---- measuring ---- */

/* Seconds of the slowest rank in the phases of these names, which end with NULL. */
static double phase_seconds(const json_t *report, const char *const *names)
{
    double sum = 0.0;
    size_t i;
    const json_t *phase;
    json_array_foreach(json_object_get(report, "phases"), i, phase)
    {
        const char *name = json_string_value(json_object_get(phase, "name"));
        for (const char *const *one = names; name != NULL && *one != NULL; one++)
            if (strcmp(name, *one) == 0)
                sum += json_number_value(json_object_get(json_object_get(phase, "seconds"), "max"));
    }
    return sum;
}

static double number_in(const json_t *report, const char *group, const char *name)
{
    return json_number_value(json_object_get(json_object_get(report, group), name));
}

/* What the report says of this run, and of all runs. */
static void read_report(const json_t *report, double times[KILN_TIMES], struct kiln_setting_result *result)
{
    static const char *const light[] = {"direct light", "bounces", "final gather", "radiance probes", "exchange", NULL};
    static const char *const indirect[] = {"bounces", "final gather", NULL};
    static const char *const exchange[] = {"exchange", NULL};
    const char *name;
    json_t *value;
    times[KILN_TIME_LIGHT] = phase_seconds(report, light);
    times[KILN_TIME_INDIRECT] = phase_seconds(report, indirect);
    times[KILN_TIME_EXCHANGE] = phase_seconds(report, exchange);
    result->bytes = fmax(result->bytes, number_in(report, "memory", "peak_rank"));
    result->points = number_in(report, "points", "count");
    result->texels_per_metre = number_in(report, "scene", "texels_per_metre");
    result->cells = number_in(report, "balance", "cells_occupied");
    result->cell_size = number_in(report, "balance", "cell_size");
    result->imbalance = number_in(report, "balance", "point_imbalance");
    result->received = number_in(report, "mpi", "received_between_nodes");
    result->probes = number_in(report, "radiance_probes", "probes");
    result->triangles = number_in(report, "scene", "triangles");
    result->probe_bytes = number_in(report, "radiance_probes", "bytes");
    result->probe_rays = number_in(report, "radiance_probes", "rays");
    result->points_alone = number_in(report, "radiance_probes", "points_without");
    result->rays = 0.0;
    json_object_foreach(json_object_get(report, "rays"), name, value) result->rays += json_number_value(value);
}

static int compare_numbers(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return x < y ? -1 : x > y;
}

struct kiln_spread kiln_sweep_spread(const struct kiln_setting_result *result, enum kiln_sweep_time time)
{
    double sorted[KILN_REPEATS_MOST];
    const size_t n = result->runs;
    bool known = n > 0;
    for (size_t i = 0; i < n; i++) {
        sorted[i] = result->run[i][time];
        known = known && isfinite(sorted[i]);
    }
    if (!known)
        return (struct kiln_spread){(double)NAN, (double)NAN, (double)NAN};
    qsort(sorted, n, sizeof *sorted, compare_numbers);
    return (struct kiln_spread){0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]), sorted[0], sorted[n - 1]};
}

/* Runs the child and takes its times. */
static int time_run(const struct kiln_sweep *sweep, struct kiln_child *child, const char *name,
                    double times[KILN_TIMES], struct kiln_error *error)
{
    struct kiln_counters counters;
    kiln_counters_open(&counters, kiln_cache_counters, KILN_COUNTERS);
    const double begin = now(), before = processor_time();
    const int status = run(sweep, child, name, error);
    times[KILN_TIME_WHOLE] = now() - begin;
    times[KILN_TIME_PROCESSOR] = processor_time() - before;
    kiln_counters_read(&counters, times + KILN_TIME_COUNTERS);
    kiln_counters_close(&counters);
    return status;
}

void kiln_sweep_note_run(struct kiln_setting_result *result)
{
    result->done = true;
    result->runs++;
    result->seconds = kiln_sweep_spread(result, KILN_TIME_WHOLE).median;
    result->light_seconds = kiln_sweep_spread(result, KILN_TIME_LIGHT).median;
    result->processor_seconds = kiln_sweep_spread(result, KILN_TIME_PROCESSOR).median;
}

/* One run of a setting. */
static int measure(struct kiln_sweep *sweep, size_t i, struct kiln_error *error)
{
    char options[KILN_SETTING_OPTIONS], scene[KILN_PATH_SIZE];
    const struct kiln_setting *setting = &sweep->settings[i];
    struct kiln_setting_result *result = &sweep->results[i];
    double *times = result->run[result->runs];
    struct kiln_child child = {.error = error};
    json_t *report = NULL;
    kiln_remove_tree(sweep->trial);
    int status = sweep->kind->prepare != NULL ? sweep->kind->prepare(sweep, i, error) : KILN_OK;
    if (status == KILN_OK)
        status = kiln_sweep_scene(sweep, setting, scene, error);
    if (status != KILN_OK)
        return status;
    sweep->kind->options(sweep, setting, options);
    begin_command(sweep, setting->ranks, scene, sweep->trial, &child);
    push_words(&child, options);
    kiln_child_push(&child, "--no-resume");
    status = time_run(sweep, &child, setting->name, times, error);
    if (status == KILN_OK)
        status = kiln_child_report(sweep->trial, &report, error);
    if (status == KILN_OK && setting->generate == NULL)
        status = kiln_reference_compare(sweep, report, result, error);
    if (status == KILN_OK && sweep->kind->more != NULL)
        status = sweep->kind->more(sweep, i, report, error);
    if (status == KILN_OK) {
        read_report(report, times, result);
        kiln_sweep_note_run(result);
        status = kiln_sweep_keep(sweep, error);
    }
    kiln_remove_tree(sweep->trial);
    json_decref(report);
    kiln_child_clear(&child);
    return status;
}

/* How long a bake is likely to take: seconds = a + b rays, fitted to those that were run. */
static double predict(const struct kiln_sweep *sweep, size_t i)
{
    double n = 0.0, x = 0.0, y = 0.0, xx = 0.0, xy = 0.0;
    for (size_t k = 0; k < sweep->count; k++) {
        const double rays = sweep->kind->rays(&sweep->settings[k]), seconds = sweep->results[k].seconds;
        if (!sweep->results[k].done)
            continue;
        n += 1.0;
        x += rays;
        y += seconds;
        xx += rays * rays;
        xy += rays * seconds;
    }
    const double spread = n * xx - x * x, slope = spread > 0.0 ? fmax(0.0, (n * xy - x * y) / spread) : 0.0;
    return n > 0.0 ? fmax(0.0, (y - slope * x) / n + slope * sweep->kind->rays(&sweep->settings[i])) : 0.0;
}

/* `run`: its number among all runs, from 0. */
static void tell_progress(const struct kiln_sweep *sweep, size_t run, size_t i, double budget_left)
{
    double left = 0.0;
    for (size_t k = 0; k < sweep->count; k++)
        left += fmax(0.0, (double)sweep->repeats - (double)sweep->results[k].runs) * predict(sweep, k);
    left = fmin(left, budget_left);
    if (!sweep->job->quiet)
        kiln_print(stderr, "kiln: bake %zu of %zu: %s; about %.0f:%02.0f left\n", run + 1,
                   sweep->repeats * sweep->count, sweep->settings[i].name, floor(left / 60.0), floor(fmod(left, 60.0)));
}

/* Repeats in turn, so that a machine that slows down does so for all settings. *left receives how many runs the budget
 * has no room for. */
static int run_all(struct kiln_sweep *sweep, double begin, size_t *left, struct kiln_error *error)
{
    int status = KILN_OK;
    *left = 0;
    for (size_t run = 0; status == KILN_OK && run < sweep->repeats * sweep->count; run++) {
        const size_t i = run % sweep->count;
        const double budget = sweep->job->budget > 0.0 ? sweep->job->budget - (now() - begin) : INFINITY;
        if (sweep->results[i].runs > run / sweep->count)
            continue;
        if (*left > 0 || budget <= 0.0 || predict(sweep, i) > budget) {
            ++*left;
            continue;
        }
        tell_progress(sweep, run, i, budget);
        status = measure(sweep, i, error);
    }
    return status;
}

static int sweep_all(struct kiln_sweep *sweep, struct kiln_error *error)
{
    const double begin = now();
    size_t left = 0;
    int status = make_paths(sweep, error);
    if (status == KILN_OK)
        status = kiln_sweep_take_up(sweep, error);
    if (status == KILN_OK)
        status = have_reference(sweep, error);
    if (status == KILN_OK)
        status = run_all(sweep, begin, &left, error);
    if (status == KILN_OK)
        status = sweep->kind->tell(sweep, left, error);
    return status;
}

int kiln_sweep_run(const struct kiln_sweep_kind *kind, struct kiln_job *job, struct kiln_error *error)
{
    struct kiln_sweep *sweep = NULL;
    int status = kiln_allocate(&sweep, 1, sizeof *sweep, "the sweep", error);
    if (status != KILN_OK)
        return status;
    sweep->kind = kind;
    sweep->job = job;
    sweep->repeats = kind->exact ? job->repeats : 1;
    sweep->density = job->texels_per_metre > 0.0 ? job->texels_per_metre : 1.0;
    status = check_options(sweep, error);
    if (status == KILN_OK)
        status = kind->choose(sweep, error);
    if (status == KILN_OK && job->list)
        kind->list(sweep);
    else if (status == KILN_OK)
        status = sweep_all(sweep, error);
    kiln_reference_close(sweep);
    json_decref(sweep->kept);
    kiln_free(&sweep);
    return status;
}
