#include "coordinator/cli/scaling.h"

#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "coordinator/cli/child.h"
#include "coordinator/run/phases.h"
#include "coordinator/bake/prepare/prepare.h"
#include "coordinator/job/job_private.h"
#include "coordinator/job/options.h"
#include "coordinator/files/json.h"
#include "coordinator/view/curve.h"
#include "coordinator/files/html.h"
#include "coordinator/files/publish.h"
#include "worker/base/memory.h"
#include "worker/base/text.h"

enum { RUNS_MOST = 32, TEXT = 64 };

/* One bake of the bench. */
struct run {
    bool weak;
    uint32_t ranks;
    double points, density; /* density: texels per metre */
    double seconds, efficiency, light_efficiency;
    size_t phase_count;
    char phase[KILN_PHASES_MAX][TEXT];
    double slowest[KILN_PHASES_MAX]; /* seconds of the slowest rank */
};

struct bench {
    struct kiln_job *job;
    struct kiln_output_folder *folder;
    char program[KILN_PATH_SIZE];
    uint32_t ranks[RUNS_MOST];
    size_t rank_count;
    uint32_t threads;
    struct run runs[2 * RUNS_MOST]; /* strong scaling, then weak scaling */
};

/* ---- what to run ---- */

static int read_ranks(struct bench *b, struct kiln_error *error)
{
    const char *text = b->job->bench.rank_counts;
    for (const char *at = text; at != NULL && *at != '\0';) {
        char *end = NULL;
        const unsigned long value = strtoul(at, &end, 10);
        const bool ascends = b->rank_count == 0 || value > b->ranks[b->rank_count - 1];
        if (end == at || (*end != ',' && *end != '\0') || value < 1 || value > 65536 || !ascends ||
            b->rank_count == RUNS_MOST)
            return kiln_fail(error, KILN_USAGE,
                             "--ranks takes ascending numbers such as 1,2,4 (%d at most), not '%.100s'", RUNS_MOST,
                             text);
        b->ranks[b->rank_count++] = (uint32_t)value;
        at = *end == ',' ? end + 1 : end;
    }
    return b->rank_count > 0
               ? KILN_OK
               : kiln_fail(error, KILN_USAGE, "--ranks is empty; it takes ascending numbers such as 1,2,4");
}

/* ---- a bake ---- */

/* Makes the command line of one bake under mpirun. With density 0 no texel density is passed on; the scene and the
 * options then choose it. */
static void make_command(const struct bench *b, const struct run *run, const char *folder, struct kiln_child *a)
{
    static const char *const own[] = {"output", "threads", "texels-per-metre", "resume",
                                      "json",   "quiet",   "verbose",          NULL};
    kiln_child_push(a, "mpirun");
    kiln_child_push_number(a, "-n", "%.0f", run->ranks);
    kiln_child_push(a, b->program);
    kiln_child_push(a, "bake");
    kiln_child_push(a, b->job->scene.file);
    kiln_child_push(a, "-o");
    kiln_child_push(a, folder);
    kiln_child_push(a, "--quiet");
    kiln_child_push(a, "--no-resume");
    kiln_child_push_number(a, "--threads", "%.0f", b->threads);
    if (run->density > 0.0)
        kiln_child_push_number(a, "--texels-per-metre", "%.17g", run->density);
    kiln_child_push_given(a, b->job, KILN_FOR_BAKE, own);
}

/* Runs a bake. Its stdout goes to this process's stderr, since stdout is for the bench's result. */
static int run_command(struct kiln_child *child, struct kiln_error *error)
{
    struct kiln_child_end end;
    const int status = kiln_child_run(child, STDERR_FILENO, STDERR_FILENO, &end, error);
    if (status != KILN_OK)
        return status;
    if (end.asked != 0)
        return kiln_fail(error, KILN_STOPPED,
                         "stopped by %s, in the bake with %s rank(s); the same command starts again",
                         strsignal(end.asked), child->text[2]);
    if (end.code == KILN_OK)
        return KILN_OK;
    return kiln_fail(error, end.code >= KILN_USAGE && end.code <= KILN_SITE ? end.code : KILN_SYSTEM,
                     "the bake with %s rank(s) failed with %d: its own message is above", child->text[2], end.code);
}

/* ---- results ---- */

static int read_report(struct run *run, const char *folder, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE];
    json_error_t where;
    int status = kiln_path_join(path, folder, "run.json", error);
    json_t *json = status == KILN_OK ? json_load_file(path, 0, &where) : NULL;
    if (status == KILN_OK && json == NULL)
        status = kiln_fail(error, KILN_BAD_INPUT, "'%s' cannot be read: %s", path, where.text);
    if (status == KILN_OK) {
        run->seconds = json_number_value(json_object_get(json, "seconds"));
        run->points = (double)json_integer_value(json_object_get(json_object_get(json, "points"), "count"));
        run->density = json_number_value(json_object_get(json_object_get(json, "scene"), "texels_per_metre"));
        size_t index;
        json_t *phase;
        json_array_foreach(json_object_get(json, "phases"), index, phase)
        {
            if (run->phase_count == KILN_PHASES_MAX)
                break;
            const char *name = json_string_value(json_object_get(phase, "name"));
            (void)snprintf(run->phase[run->phase_count], TEXT, "%s", name != NULL ? name : "");
            run->slowest[run->phase_count++] =
                json_number_value(json_object_get(json_object_get(phase, "seconds"), "max"));
        }
    }
    json_decref(json);
    return status;
}

static int bake(struct bench *b, struct run *run, struct kiln_error *error)
{
    char name[TEXT], folder[KILN_PATH_SIZE];
    struct kiln_child a = {.error = error};
    (void)snprintf(name, sizeof name, "%s-%u", run->weak ? "weak" : "strong", run->ranks);
    int status;
    KILN_TRY(kiln_path_join(folder, b->job->output, name, error));
    make_command(b, run, folder, &a);
    KILN_TRY(a.status);
    if (!b->job->quiet)
        (void)fprintf(stderr, "kiln: %s scaling, %u rank%s of %u thread%s\n", run->weak ? "weak" : "strong", run->ranks,
                      run->ranks == 1 ? "" : "s", b->threads, b->threads == 1 ? "" : "s");
    KILN_TRY(run_command(&a, error));
    KILN_TRY(read_report(run, folder, error));
end:
    kiln_child_clear(&a);
    return status;
}

static double phase_of(const struct run *run, const char *name)
{
    for (size_t i = 0; i < run->phase_count; i++)
        if (strcmp(run->phase[i], name) == 0)
            return run->slowest[i];
    return 0.0;
}

static double light_of(const struct run *run)
{
    return phase_of(run, "direct light") + phase_of(run, "bounces") + phase_of(run, "final gather") +
           phase_of(run, "exchange") + phase_of(run, "probes");
}

/* Returns the ideal time of a run, without any loss by more ranks, from the time of the first run. */
static double ideal(const struct run *first, const struct run *run, double seconds)
{
    const double work = first->points > 0.0 ? run->points / first->points : 1.0;
    return seconds * work * first->ranks / run->ranks;
}

static void rate(const struct run *first, struct run *run)
{
    const double light = light_of(run);
    run->efficiency = run->seconds > 0.0 ? ideal(first, run, first->seconds) / run->seconds : 0.0;
    run->light_efficiency = light > 0.0 ? ideal(first, run, light_of(first)) / light : 1.0;
}

/* Runs the bakes of strong scaling first; the first bake also counts for weak scaling. */
static int bake_all(struct bench *b, struct kiln_error *error)
{
    const size_t n = b->rank_count;
    int status = KILN_OK;
    for (size_t i = 0; i < 2 * n && status == KILN_OK; i++) {
        struct run *run = &b->runs[i];
        *run = (struct run){.weak = i >= n, .ranks = b->ranks[i % n], .density = b->job->lightmaps.texels_per_metre};
        if (i == n) {
            *run = b->runs[0];
            run->weak = true;
        } else {
            if (i > n)
                run->density = b->runs[0].density * sqrt((double)run->ranks / b->ranks[0]);
            status = bake(b, run, error);
        }
        rate(&b->runs[0], run);
    }
    return status;
}

/* ---- telling ---- */

static int write_csv(const struct bench *b, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE];
    struct kiln_html page = {.error = error};
    const struct run *first = &b->runs[0];
    kiln_html_add(&page, "kind,ranks,threads,points,seconds,efficiency,light_efficiency");
    for (size_t p = 0; p < first->phase_count; p++)
        kiln_html_add(&page, ",%s", first->phase[p]);
    for (size_t i = 0; i < 2 * b->rank_count; i++) {
        const struct run *run = &b->runs[i];
        kiln_html_add(&page, "\n%s,%u,%u,%.0f,%.6g,%.6g,%.6g", run->weak ? "weak" : "strong", run->ranks, b->threads,
                      run->points, run->seconds, run->efficiency, run->light_efficiency);
        for (size_t p = 0; p < first->phase_count; p++)
            kiln_html_add(&page, ",%.6g", phase_of(run, first->phase[p]));
    }
    kiln_html_add(&page, "\n");
    const int status = kiln_path_join(path, b->job->output, "scaling.csv", error);
    if (status == KILN_OK)
        return kiln_html_publish(&page, path);
    kiln_html_free(&page);
    return status;
}

static int write_plot(const struct bench *b, struct kiln_error *error)
{
    double ranks[RUNS_MOST], values[KILN_CURVES][RUNS_MOST];
    const size_t n = b->rank_count;
    for (size_t i = 0; i < n; i++) {
        ranks[i] = b->ranks[i];
        for (size_t weak = 0; weak < 2; weak++) {
            values[2 * weak][i] = b->runs[weak * n + i].efficiency;
            values[2 * weak + 1][i] = b->runs[weak * n + i].light_efficiency;
        }
    }
    return kiln_curve_write(b->job->output, "Measured efficiency over ranks", ranks,
                            (const double *const[]){values[0], values[1], values[2], values[3]}, n, error);
}

/* The phase that loses most time relative to the first run; *lost receives the seconds. */
static const char *worst_phase(const struct run *first, const struct run *run, double *lost)
{
    const char *name = "nothing";
    *lost = 0.0;
    for (size_t p = 0; p < run->phase_count; p++) {
        const double more = run->slowest[p] - ideal(first, run, phase_of(first, run->phase[p]));
        if (more > *lost) {
            *lost = more;
            name = run->phase[p];
        }
    }
    return name;
}

static void sentence(const struct bench *b, bool weak, char *text, size_t size)
{
    const struct run *first = &b->runs[0], *last = &b->runs[(weak ? 2 : 1) * b->rank_count - 1];
    double lost;
    const char *phase = worst_phase(first, last, &lost);
    const double all = last->seconds - ideal(first, last, first->seconds);
    (void)snprintf(text, size,
                   "%s scaling to %u ranks: %.1f %% efficient (light and exchange %.1f %%); of %.2f s in all %.2f s "
                   "are lost, most of it in '%s' (%.2f s)",
                   weak ? "weak" : "strong", last->ranks, 100.0 * last->efficiency, 100.0 * last->light_efficiency,
                   last->seconds, all > 0.0 ? all : 0.0, phase, lost);
}

static void print_text(const struct bench *b)
{
    char text[400];
    (void)printf("%-8s%8s%9s%14s%10s%12s%12s\n", "kind", "ranks", "threads", "points", "seconds", "efficiency",
                 "light only");
    for (size_t i = 0; i < 2 * b->rank_count; i++) {
        const struct run *r = &b->runs[i];
        (void)printf("%-8s%8u%9u%14.0f%10.2f%10.1f %%%10.1f %%\n", r->weak ? "weak" : "strong", r->ranks, b->threads,
                     r->points, r->seconds, 100.0 * r->efficiency, 100.0 * r->light_efficiency);
    }
    for (int weak = 0; weak < 2; weak++) {
        sentence(b, weak != 0, text, sizeof text);
        kiln_print(stdout, "%s\n", text);
    }
    kiln_print(stdout, "%s/scaling.csv, %s/scaling.svg\n", b->job->output, b->job->output);
}

static int print_json(const struct bench *b, struct kiln_error *error)
{
    json_t *runs = json_array();
    char strong[400], weak[400];
    for (size_t i = 0; i < 2 * b->rank_count; i++) {
        const struct run *r = &b->runs[i];
        (void)json_array_append_new(runs,
                                    json_pack("{s:s, s:i, s:f, s:f, s:f, s:f}", "kind", r->weak ? "weak" : "strong",
                                              "ranks", (int)r->ranks, "points", r->points, "seconds", r->seconds,
                                              "efficiency", r->efficiency, "light_efficiency", r->light_efficiency));
    }
    sentence(b, false, strong, sizeof strong);
    sentence(b, true, weak, sizeof weak);
    return kiln_json_print(json_pack("{s:s, s:i, s:o, s:s, s:s}", "status", "done", "threads", (int)b->threads, "runs",
                                     runs, "strong", strong, "weak", weak),
                           error);
}

static int prepare(struct bench *b, struct kiln_error *error)
{
    int status;
    KILN_TRY(read_ranks(b, error));
    if (b->job->output == NULL)
        KILN_TRY(kiln_job_default_output(b->job, b->job->scene.file, "-scaling", error));
    KILN_TRY(kiln_child_program(b->program, error));
    KILN_TRY(kiln_bench_folder_begin(&b->folder, b->job, "scaling", error));
    b->threads =
        b->job->machine.threads != 0 ? b->job->machine.threads : kiln_own_cores((int)b->ranks[b->rank_count - 1]);
end:
    return status;
}

int kiln_scaling_bench(struct kiln_job *job, struct kiln_error *error)
{
    struct bench *b = NULL;
    int status = kiln_allocate(&b, 1, sizeof *b, "the bench", error);
    if (status != KILN_OK)
        return status;
    b->job = job;
    KILN_TRY(prepare(b, error));
    KILN_TRY(bake_all(b, error));
    KILN_TRY(write_csv(b, error));
    KILN_TRY(write_plot(b, error));
    if (job->json)
        KILN_TRY(print_json(b, error));
    else
        print_text(b);
end:
    kiln_output_folder_end(&b->folder, status == KILN_OK);
    kiln_free(&b);
    return status;
}
