#include "coordinator/bench/tradeoff.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

#include "coordinator/bench/child.h"
#include "coordinator/bench/tradeoff_private.h"
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

static int check_options(const struct kiln_job *job, struct kiln_error *error)
{
    static const char *const swept[] = {
        "quality", "samples-direct", "samples-bounce", "samples-indirect", "samples-probe",
        "bounces", "tail",           "schedule",       "verify-fraction",  NULL};
    const struct kiln_job_owned *owned = job->strings;
    if (job->scene == NULL)
        return kiln_fail(error, KILN_USAGE,
                         "kiln bench tradeoff takes a scene; for example: kiln bench tradeoff room.glb");
    for (const char *const *name = swept; *name != NULL; name++)
        if (owned->given[kiln_option_find(*name) - kiln_options])
            return kiln_fail(error, KILN_USAGE,
                             "kiln bench tradeoff takes no --%s: its bakes have their own; --list shows them", *name);
    if (job->reference != NULL && access(job->reference, R_OK) != 0)
        return kiln_fail_errno(error, 0, "the reference '%.500s' cannot be read", job->reference);
    return KILN_OK;
}

static int make_paths(struct kiln_tradeoff *sweep, struct kiln_error *error)
{
    struct kiln_job *job = sweep->job;
    int status = job->output != NULL ? KILN_OK : kiln_job_default_output(job, job->scene, "-tradeoff", error);
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

/* ---- a bake ---- */

static void begin_command(const struct kiln_tradeoff *sweep, const char *folder, struct kiln_child *child)
{
    static const char *const always[] = {"--samples-probe", "0", "--no-preview", "--no-export", NULL};
    kiln_child_push(child, sweep->program);
    kiln_child_push(child, "bake");
    kiln_child_push(child, sweep->job->scene);
    kiln_child_push(child, "-o");
    kiln_child_push(child, folder);
    for (size_t i = 0; always[i] != NULL; i++)
        kiln_child_push(child, always[i]);
    kiln_child_push_given(child, sweep->job, own);
}

static void push_words(struct kiln_child *child, char *words)
{
    char *rest = NULL;
    for (char *word = strtok_r(words, " ", &rest); word != NULL; word = strtok_r(NULL, " ", &rest))
        kiln_child_push(child, word);
}

/* Runs the child. A bake that fails has its own message as the reason. */
static int run(const struct kiln_tradeoff *sweep, struct kiln_child *child, const char *name, struct kiln_error *error)
{
    char said[KILN_CHILD_SAID];
    int code = KILN_OK;
    const int status = kiln_child_run_quietly(child, sweep->said, &code, said, error);
    kiln_remove_tree(sweep->said);
    if (status != KILN_OK || code == KILN_OK)
        return status;
    const char *sentence = strstr(said, "kiln: error: ");
    return kiln_fail(error, code >= KILN_USAGE && code <= KILN_SITE ? code : KILN_SYSTEM,
                     "the bake '%s' failed with %d: %.900s", name, code,
                     sentence != NULL ? sentence + strlen("kiln: error: ") : said);
}

/* ---- the reference ---- */

static int bake_reference(struct kiln_tradeoff *sweep, struct kiln_error *error)
{
    const struct kiln_job *job = sweep->job;
    struct kiln_child child = {.error = error};
    const double samples = job->reference_samples;
    if (!job->quiet)
        (void)fprintf(stderr, "kiln: baking the reference, with %.0f rays in the final gather\n", samples);
    begin_command(sweep, sweep->reference, &child);
    kiln_child_push_number(&child, "--samples-direct", "%.0f", fmax(1.0, samples / 4.0));
    kiln_child_push_number(&child, "--samples-bounce", "%.0f", fmax(1.0, samples / 64.0));
    kiln_child_push_number(&child, "--samples-indirect", "%.0f", samples);
    kiln_child_push_number(&child, "--seed", "%.0f", (double)(job->seed + 1));
    kiln_child_push(&child, "--denoise");
    kiln_child_push(&child, "none");
    kiln_child_push(&child, "--error-map");
    if (!job->resume)
        kiln_child_push(&child, "--no-resume");
    const int status = run(sweep, &child, "reference", error);
    kiln_child_clear(&child);
    return status;
}

static int have_reference(struct kiln_tradeoff *sweep, struct kiln_error *error)
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
        status = kiln_tradeoff_keep(sweep, error);
    }
    return status;
}

/* ---- measuring ---- */

/* Seconds of the slowest rank in the phases that compute light. */
static double light_seconds(const json_t *report)
{
    static const char *const names[] = {"direct light", "bounces", "final gather", "exchange", NULL};
    double sum = 0.0;
    size_t i;
    const json_t *phase;
    json_array_foreach(json_object_get(report, "phases"), i, phase)
    {
        const char *name = json_string_value(json_object_get(phase, "name"));
        for (const char *const *light = names; name != NULL && *light != NULL; light++)
            if (strcmp(name, *light) == 0)
                sum += json_number_value(json_object_get(json_object_get(phase, "seconds"), "max"));
    }
    return sum;
}

static void read_report(const json_t *report, struct kiln_setting_result *result)
{
    const json_t *rays = json_object_get(report, "rays");
    const char *name;
    json_t *value;
    result->light_seconds = light_seconds(report);
    result->bytes = json_number_value(json_object_get(json_object_get(report, "memory"), "peak_rank"));
    result->points = json_number_value(json_object_get(json_object_get(report, "points"), "count"));
    result->texels_per_metre = json_number_value(json_object_get(json_object_get(report, "scene"), "texels_per_metre"));
    json_object_foreach((json_t *)rays, name, value) result->rays += json_number_value(value);
}

static int measure(struct kiln_tradeoff *sweep, size_t i, struct kiln_error *error)
{
    char options[KILN_SETTING_OPTIONS];
    struct kiln_child child = {.error = error};
    struct kiln_setting_result result = {.done = true};
    json_t *report = NULL;
    kiln_remove_tree(sweep->trial);
    kiln_setting_options(&sweep->settings[i], sweep->density, options);
    begin_command(sweep, sweep->trial, &child);
    push_words(&child, options);
    kiln_child_push(&child, "--no-resume");
    const double begin = now(), before = processor_time();
    int status = run(sweep, &child, sweep->settings[i].name, error);
    result.seconds = now() - begin;
    result.processor_seconds = processor_time() - before;
    if (status == KILN_OK)
        status = kiln_child_report(sweep->trial, &report, error);
    if (status == KILN_OK)
        status = kiln_reference_compare(sweep, report, result.error, error);
    if (status == KILN_OK) {
        read_report(report, &result);
        sweep->results[i] = result;
        status = kiln_tradeoff_keep(sweep, error);
    }
    json_decref(report);
    kiln_remove_tree(sweep->trial);
    kiln_child_clear(&child);
    return status;
}

/* ---- the sweep ---- */

/* How long a bake is likely to take: seconds = a + b rays, fitted to those that were run. */
static double predict(const struct kiln_tradeoff *sweep, size_t i)
{
    double n = 0.0, x = 0.0, y = 0.0, xx = 0.0, xy = 0.0;
    for (size_t k = 0; k < sweep->count; k++) {
        const double rays = kiln_setting_rays(&sweep->settings[k]), seconds = sweep->results[k].seconds;
        if (!sweep->results[k].done)
            continue;
        n += 1.0;
        x += rays;
        y += seconds;
        xx += rays * rays;
        xy += rays * seconds;
    }
    const double spread = n * xx - x * x, slope = spread > 0.0 ? fmax(0.0, (n * xy - x * y) / spread) : 0.0;
    return n > 0.0 ? fmax(0.0, (y - slope * x) / n + slope * kiln_setting_rays(&sweep->settings[i])) : 0.0;
}

static void tell_progress(const struct kiln_tradeoff *sweep, size_t i, double budget_left)
{
    double left = 0.0;
    for (size_t k = i; k < sweep->count; k++)
        left += sweep->results[k].done ? 0.0 : predict(sweep, k);
    left = fmin(left, budget_left);
    if (!sweep->job->quiet)
        kiln_print(stderr, "kiln: bake %zu of %zu: %s; about %.0f:%02.0f left\n", i + 1, sweep->count,
                   sweep->settings[i].name, floor(left / 60.0), floor(fmod(left, 60.0)));
}

/* *left receives how many bakes the budget has no room for. */
static int run_all(struct kiln_tradeoff *sweep, double begin, size_t *left, struct kiln_error *error)
{
    int status = KILN_OK;
    *left = 0;
    for (size_t i = 0; status == KILN_OK && i < sweep->count; i++) {
        const double budget = sweep->job->budget > 0.0 ? sweep->job->budget - (now() - begin) : INFINITY;
        if (sweep->results[i].done)
            continue;
        if (*left > 0 || budget <= 0.0 || predict(sweep, i) > budget) {
            ++*left;
            continue;
        }
        tell_progress(sweep, i, budget);
        status = measure(sweep, i, error);
    }
    return status;
}

static int sweep_all(struct kiln_tradeoff *sweep, struct kiln_error *error)
{
    const double begin = now();
    size_t left = 0;
    int status = make_paths(sweep, error);
    if (status == KILN_OK)
        status = kiln_tradeoff_take_up(sweep, error);
    if (status == KILN_OK)
        status = have_reference(sweep, error);
    if (status == KILN_OK)
        status = run_all(sweep, begin, &left, error);
    if (status == KILN_OK)
        status = kiln_tradeoff_tell(sweep, left, error);
    return status;
}

int kiln_tradeoff_bench(struct kiln_job *job, struct kiln_error *error)
{
    struct kiln_tradeoff *sweep = NULL;
    int status = kiln_allocate(&sweep, 1, sizeof *sweep, "the sweep", error);
    if (status != KILN_OK)
        return status;
    sweep->job = job;
    sweep->density = job->texels_per_metre > 0.0 ? job->texels_per_metre : 1.0;
    status = check_options(job, error);
    if (status == KILN_OK)
        status = kiln_settings_choose(sweep, error);
    if (status == KILN_OK && job->list)
        kiln_tradeoff_list(sweep);
    else if (status == KILN_OK)
        status = sweep_all(sweep, error);
    kiln_reference_close(sweep);
    json_decref(sweep->kept);
    kiln_free(&sweep);
    return status;
}
