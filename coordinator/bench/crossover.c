#include "coordinator/bench/crossover.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>
#include <time.h>

#include "coordinator/bench/crossover_private.h"
#include "coordinator/job/job_private.h"
#include "coordinator/job/options.h"
#include "coordinator/output/exr.h"

enum { FEW = 8, MANY = 64, REFERENCE = 1024, ROUNDS = 50 };

/* ---- children ---- */

static struct kiln_cost spent(void)
{
    struct rusage used = {0};
    struct timespec t;
    (void)getrusage(RUSAGE_CHILDREN, &used);
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return (struct kiln_cost){(double)(used.ru_utime.tv_sec + used.ru_stime.tv_sec) +
                                  1e-6 * (double)(used.ru_utime.tv_usec + used.ru_stime.tv_usec),
                              (double)t.tv_sec + 1e-9 * (double)t.tv_nsec};
}

static void tell(const struct kiln_crossover *c, const char *what)
{
    if (!c->job->quiet)
        (void)fprintf(stderr, "kiln: %s\n", what);
}

/* Runs the child and says what it took. A command that fails has its own message as the reason. */
static int run(const struct kiln_crossover *c, struct kiln_child *child, const char *what, struct kiln_cost *cost,
               struct kiln_error *error)
{
    char said[KILN_CHILD_SAID];
    int code = KILN_OK;
    tell(c, what);
    const struct kiln_cost before = spent();
    const int status = kiln_child_run_quietly(child, c->said, &code, said, error);
    const struct kiln_cost after = spent();
    *cost = (struct kiln_cost){after.processor - before.processor, after.clock - before.clock};
    kiln_child_clear(child);
    kiln_remove_tree(c->said);
    return status == KILN_OK ? kiln_child_failure(what, code, said, error) : status;
}

static int bake(struct kiln_crossover *c, struct kiln_error *error)
{
    static const char *const own[] = {"output",        "json",    "quiet",  "verbose", "resume",
                                      "samples-probe", "preview", "export", NULL};
    static const char *const always[] = {"--samples-probe", "0", "--no-preview", "--no-export", "--no-resume",
                                         "--quiet",         NULL};
    struct kiln_child child = {.error = error};
    kiln_child_push(&child, c->program);
    kiln_child_push(&child, "bake");
    kiln_child_push(&child, c->job->scene);
    kiln_child_push(&child, "-o");
    kiln_child_push(&child, c->bake);
    for (size_t i = 0; always[i] != NULL; i++)
        kiln_child_push(&child, always[i]);
    kiln_child_push_given(&child, c->job, KILN_FOR_BAKE, own);
    return run(c, &child, "the bake", &c->bake_cost, error);
}

/* Whether the bake was computed by a GPU. */
static int learn_device(struct kiln_crossover *c, struct kiln_error *error)
{
    json_t *report = NULL;
    const int status = kiln_child_report(c->bake, &report, error);
    const char *name = json_string_value(json_object_get(json_object_get(report, "backend"), "name"));
    c->device = name != NULL && strcmp(name, "embree") != 0;
    json_decref(report);
    return status;
}

/* The path of a way's views, before -0001.exr. */
static int views_path(const struct kiln_crossover *c, uint32_t samples, bool large, char path[KILN_PATH_SIZE],
                      struct kiln_error *error)
{
    char name[64];
    if (samples == 0)
        (void)snprintf(name, sizeof name, large ? "large.exr" : "lightmaps.exr");
    else
        (void)snprintf(name, sizeof name, "paths%u.exr", samples);
    return kiln_path_join(path, c->job->output, name, error);
}

static void push_device(const struct kiln_crossover *c, struct kiln_child *child)
{
    kiln_child_push(child, "--backend");
    kiln_child_push(child, c->job->backend);
    if (c->job->threads != 0)
        kiln_child_push_number(child, "--threads", "%.0f", c->job->threads);
}

/* Draws the views: with so many paths a pixel, or 0: from the lightmaps. */
static int draw(struct kiln_crossover *c, uint32_t samples, uint64_t seed, bool large, struct kiln_cost *cost,
                struct kiln_error *error)
{
    char path[KILN_PATH_SIZE], what[80] = "the views from lightmaps";
    struct kiln_child child = {.error = error};
    const int status = views_path(c, samples, large, path, error);
    if (status != KILN_OK)
        return status;
    kiln_child_push(&child, c->program);
    kiln_child_push(&child, "view");
    kiln_child_push(&child, c->bake);
    kiln_child_push(&child, "-o");
    kiln_child_push(&child, path);
    kiln_child_push(&child, "--quiet");
    kiln_child_push(&child, "--path");
    kiln_child_push(&child, c->keys);
    kiln_child_push_number(&child, "--frames", "%.0f", KILN_CROSSOVER_VIEWS);
    kiln_child_push_number(&child, "--width", "%.0f", large ? KILN_LARGE_WIDTH : KILN_CROSSOVER_WIDTH);
    kiln_child_push_number(&child, "--height", "%.0f", large ? KILN_LARGE_HEIGHT : KILN_CROSSOVER_HEIGHT);
    push_device(c, &child);
    if (samples > 0) {
        (void)snprintf(what, sizeof what, "the views, with %u paths a pixel", samples);
        kiln_child_push(&child, "--method");
        kiln_child_push(&child, "path");
        kiln_child_push_number(&child, "--samples-pixel", "%.0f", samples);
        kiln_child_push_number(&child, "--seed", "%.0f", (double)seed);
        if (c->job->bounces >= 0)
            kiln_child_push_number(&child, "--bounces", "%.0f", (double)c->job->bounces);
    }
    return run(c, &child, what, cost, error);
}

/* ---- errors ---- */

static int read_view(const struct kiln_crossover *c, uint32_t samples, int view, struct kiln_image **image,
                     float *planes[3], struct kiln_error *error)
{
    static const char *const wanted[] = {"R", "G", "B"};
    char path[KILN_PATH_SIZE], name[KILN_PATH_SIZE];
    int status = views_path(c, samples, false, path, error);
    if (status != KILN_OK)
        return status;
    (void)snprintf(name, sizeof name, "%.*s-%04d.exr", (int)(strlen(path) - strlen(".exr")), path, view + 1);
    status = kiln_exr_read(name, wanted, 3, image, error);
    if (status == KILN_OK && (!kiln_image_rgb(*image, "", planes) || (*image)->width != KILN_CROSSOVER_WIDTH ||
                              (*image)->height != KILN_CROSSOVER_HEIGHT))
        status = kiln_fail(error, KILN_BAD_INPUT, "'%.500s' is not the view that was just written there", name);
    return status;
}

/* Sums over all views. */
struct differences {
    double shown, pixels;         /* squares of t; number of pixels */
    double squares, mean, values; /* of radiance */
};

static double luminance_at(float *const planes[3], size_t i)
{
    return (double)kiln_rgb_luminance(planes[0][i], planes[1][i], planes[2][i]);
}

static void compare(float *const a[3], float *const b[3], struct differences *d)
{
    const size_t pixels = (size_t)KILN_CROSSOVER_WIDTH * KILN_CROSSOVER_HEIGHT;
    double log_sum = 0.0, lit = 0.0;
    for (size_t i = 0; i < pixels; i++) {
        const double l = luminance_at(b, i);
        log_sum += l > 0.0 ? log(l) : 0.0;
        lit += l > 0.0 ? 1.0 : 0.0;
    }
    const double exposure = lit > 0.0 ? 0.18 / exp(log_sum / lit) : 1.0;
    for (size_t i = 0; i < pixels; i++) {
        const double x = exposure * luminance_at(a, i), y = exposure * luminance_at(b, i),
                     off = x / (1.0 + x) - y / (1.0 + y);
        d->shown += off * off;
        for (int k = 0; k < 3; k++) {
            d->squares += ((double)a[k][i] - (double)b[k][i]) * ((double)a[k][i] - (double)b[k][i]);
            d->mean += (double)b[k][i];
        }
    }
    d->pixels += (double)pixels;
    d->values += 3.0 * (double)pixels;
}

/* How far a way's views are from those of the reference. */
static int measure(struct kiln_crossover *c, struct kiln_crossover_way *way, struct kiln_error *error)
{
    struct differences d = {0};
    int status = KILN_OK;
    for (int view = 0; view < KILN_CROSSOVER_VIEWS && status == KILN_OK; view++) {
        struct kiln_image *one = NULL, *reference = NULL;
        float *a[3], *b[3];
        status = read_view(c, way->samples, view, &one, a, error);
        if (status == KILN_OK)
            status = read_view(c, c->reference_samples, view, &reference, b, error);
        if (status == KILN_OK)
            compare(a, b, &d);
        kiln_image_destroy(&one);
        kiln_image_destroy(&reference);
    }
    way->distance = sqrt(d.shown / d.pixels);
    way->nrmse = d.mean > 0.0 ? sqrt(d.squares / d.values) / (d.mean / d.values) : 0.0;
    return status;
}

static double without(double distance, double own) { return sqrt(fmax(0.0, distance * distance - own * own)); }

/* Fits the error of n paths, and takes the reference's own out of all. */
static int fit(struct kiln_crossover *c, struct kiln_error *error)
{
    for (int round = 0; round < ROUNDS; round++) {
        c->few.error = without(c->few.distance, c->reference_error);
        c->many.error = without(c->many.distance, c->reference_error);
        if (!(c->few.error > 0.0) || !(c->many.error > 0.0))
            break;
        c->exponent = log(c->few.error / c->many.error) / log((double)MANY / FEW);
        c->factor = c->few.error * pow(FEW, c->exponent);
        c->reference_error = c->factor * pow(c->reference_samples, -c->exponent);
    }
    if (!(c->many.error > 0.0) || !(c->exponent > 0.0))
        return kiln_fail(error, KILN_BAD_INPUT,
                         "the error of path tracing does not fall from %d to %d paths a pixel, as if there were no "
                         "noise in the views; more --reference-samples may help",
                         FEW, MANY);
    /* below the reference's own error it is not known how good the bake is */
    c->lightmaps.error = fmax(without(c->lightmaps.distance, c->reference_error), c->reference_error);
    c->paths = fmax(1.0, pow(c->factor / c->lightmaps.error, 1.0 / c->exponent));
    return KILN_OK;
}

/* ---- costs ---- */

static double users_of(double bake, double view, double path)
{
    return path > view ? fmax(1.0, ceil(bake / (path - view))) : (double)INFINITY;
}

static double difference(double large, double small, double by) { return fmax(0.0, large - small) / by; }

static void reckon(struct kiln_crossover *c)
{
    const double small = (double)KILN_CROSSOVER_WIDTH * KILN_CROSSOVER_HEIGHT * KILN_CROSSOVER_VIEWS,
                 full = (double)KILN_FULL_WIDTH * KILN_FULL_HEIGHT,
                 large = (double)KILN_LARGE_WIDTH * KILN_LARGE_HEIGHT * KILN_CROSSOVER_VIEWS;
    const double paths = small * (MANY - FEW);
    c->path_cost.processor = difference(c->many.views.processor, c->few.views.processor, paths) * full * c->paths;
    c->path_cost.clock = difference(c->many.views.clock, c->few.views.clock, paths) * full * c->paths;
    c->view_cost.processor = difference(c->large.processor, c->lightmaps.views.processor, large - small) * full;
    c->view_cost.clock = difference(c->large.clock, c->lightmaps.views.clock, large - small) * full;
    c->users = users_of(c->bake_cost.processor, c->view_cost.processor, c->path_cost.processor);
    c->users_clock = users_of(c->bake_cost.clock, c->view_cost.clock, c->path_cost.clock);
}

/* ---- the bench ---- */

static bool was_given(const struct kiln_job *job, const char *name)
{
    const struct kiln_job_owned *owned = job->strings;
    return owned->given[kiln_option_find_for(name, KILN_FOR_BENCH) - kiln_options];
}

static int make_paths(struct kiln_crossover *c, struct kiln_error *error)
{
    struct kiln_job *job = c->job;
    int status = job->output != NULL ? KILN_OK : kiln_job_default_output(job, job->scene, "-crossover", error);
    if (status == KILN_OK)
        status = kiln_child_program(c->program, error);
    if (status == KILN_OK)
        status = kiln_path_join(c->bake, job->output, "bake", error);
    if (status == KILN_OK)
        status = kiln_path_join(c->said, job->output, "said", error);
    if (status == KILN_OK)
        status = kiln_path_join(c->keys, job->output, "views.csv", error);
    return status == KILN_OK ? kiln_make_directories(job->output, error) : status;
}

static int draw_and_measure(struct kiln_crossover *c, struct kiln_crossover_way *way, struct kiln_error *error)
{
    const int status = draw(c, way->samples, c->job->seed, false, &way->views, error);
    return status == KILN_OK ? measure(c, way, error) : status;
}

static int draw_all(struct kiln_crossover *c, struct kiln_error *error)
{
    struct kiln_cost unused;
    int status = draw(c, c->reference_samples, c->job->seed + 1, false, &unused, error);
    if (status == KILN_OK)
        status = draw_and_measure(c, &c->few, error);
    if (status == KILN_OK)
        status = draw_and_measure(c, &c->many, error);
    if (status == KILN_OK)
        status = draw_and_measure(c, &c->lightmaps, error);
    return status == KILN_OK ? draw(c, 0, 0, true, &c->large, error) : status;
}

int kiln_crossover_bench(struct kiln_job *job, struct kiln_error *error)
{
    struct kiln_crossover c = {.job = job,
                               .reference_samples =
                                   was_given(job, "reference-samples") ? job->reference_samples : REFERENCE,
                               .few = {.samples = FEW},
                               .many = {.samples = MANY}};
    if (job->scene == NULL || job->argument_count != 2)
        return kiln_fail(error, KILN_USAGE,
                         "kiln bench crossover takes one scene; for example: kiln bench crossover room.glb");
    if (c.reference_samples <= MANY)
        return kiln_fail(error, KILN_USAGE,
                         "--reference-samples %u: the reference needs more than the %d paths a "
                         "pixel of the views that it judges",
                         c.reference_samples, MANY);
    int status = make_paths(&c, error);
    if (status == KILN_OK)
        status = bake(&c, error);
    if (status == KILN_OK)
        status = learn_device(&c, error);
    if (status == KILN_OK)
        status = kiln_crossover_views(c.bake, c.keys, error);
    if (status == KILN_OK)
        status = draw_all(&c, error);
    if (status == KILN_OK)
        status = fit(&c, error);
    if (status != KILN_OK)
        return status;
    reckon(&c);
    return kiln_crossover_tell(&c, error);
}
