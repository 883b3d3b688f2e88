#include "coordinator/bench/converge.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/bench/converge_private.h"
#include "coordinator/files/output_name.h"
#include "coordinator/job/choices.h"
#include "coordinator/job/job_private.h"
#include "coordinator/job/options.h"
#include "coordinator/output/exr.h"
#include "coordinator/output/read/reader.h"
#include "coordinator/view/compare.h"
#include "worker/base/memory.h"
#include "worker/base/text.h"

/* Paths a pixel of the reference, relative to the most of a path-traced view: its error adds 1/64 to that view's mean
 * square, 0.07 dB. */
enum { REFERENCE_FACTOR = 64, MOST_REFERENCE = 1 << 20 };

/* ---- options ---- */

static bool was_given(const struct kiln_job *job, const struct kiln_option *option)
{
    const struct kiln_job_owned *owned = job->strings;
    return owned->given[option - kiln_options];
}

static bool was_named(const struct kiln_job *job, const char *name)
{
    return was_given(job, kiln_option_find_for(name, KILN_FOR_BENCH));
}

int kiln_converge_refuse_elsewhere(const struct kiln_job *job, struct kiln_error *error)
{
    static const uint32_t all = KILN_FOR_BENCH | KILN_FOR_VIEW | KILN_FOR_BAKE, own = KILN_FOR_BENCH | KILN_FOR_VIEW;
    for (size_t i = 0; i < kiln_option_count; i++)
        if (((kiln_options[i].commands & all) == own ||
             kiln_options[i].offset == offsetof(struct kiln_job, materials)) &&
            was_given(job, &kiln_options[i]))
            return kiln_fail(error, KILN_USAGE,
                             "--%s: of all benches only converge has it, which draws a view; leave it out",
                             kiln_options[i].name);
    return KILN_OK;
}

/* Refuses options of bakes, which views do not have. */
static int check_options(const struct kiln_job *job, struct kiln_error *error)
{
    static const char *const own[] = {"reference", "reference-samples", "max-time", "doublings"};
    for (size_t i = 0; i < kiln_option_count; i++) {
        const struct kiln_option *option = &kiln_options[i];
        bool mine = (option->commands & KILN_FOR_BENCH) == 0 || (option->commands & KILN_FOR_VIEW) != 0 ||
                    option->commands == KILN_FOR_ALL || strcmp(option->name, "output") == 0;
        for (size_t k = 0; k < sizeof own / sizeof *own; k++)
            mine = mine || strcmp(option->name, own[k]) == 0;
        if (!mine && was_given(job, option))
            return kiln_fail(error, KILN_USAGE, "--%s: kiln bench converge draws views, which have no such option",
                             option->name);
    }
    return KILN_OK;
}

static int check_numbers(const struct kiln_job *job, struct kiln_error *error)
{
    const uint32_t most = 1U << job->doublings;
    const bool samples = was_named(job, "reference-samples");
    if (job->camera != NULL && (strchr(job->camera, ',') != NULL || strcmp(job->camera, "all") == 0))
        return kiln_fail(error, KILN_USAGE, "--camera %.200s: the bench draws one view; name one camera", job->camera);
    if (samples && job->reference != NULL)
        return kiln_fail(error, KILN_USAGE,
                         "--reference-samples %u: the reference is given by --reference; leave one of the two out",
                         job->reference_samples);
    if (samples && job->reference_samples <= most)
        return kiln_fail(error, KILN_USAGE,
                         "--reference-samples %u: the reference needs more than the %u paths a pixel of the views "
                         "that it judges (--doublings %u)",
                         job->reference_samples, most, job->doublings);
    return KILN_OK;
}

/* ---- methods ---- */

/* The names for --method of kiln view; lightmaps, the first, computes no light. */
static const char *const *method_names(void)
{
    return kiln_options[kiln_option_find_for("method", KILN_FOR_VIEW) - kiln_options].choices + 1;
}

static bool is_wanted(const struct kiln_job *job, const char *name)
{
    bool wanted = job->argument_count == 2;
    for (size_t i = 2; i < job->argument_count; i++)
        wanted = wanted || strcmp(job->arguments[i], name) == 0;
    return wanted;
}

/* Refuses a method that there is not. */
static int check_method(const char *asked, struct kiln_error *error)
{
    char list[256] = "";
    for (const char *const *name = method_names(); *name != NULL; name++) {
        const size_t used = strlen(list);
        if (strcmp(*name, asked) == 0)
            return KILN_OK;
        (void)snprintf(list + used, sizeof list - used, "%s%s", used > 0 ? ", " : "", *name);
    }
    return kiln_fail(error, KILN_USAGE, "kiln view computes light by no method '%.100s'; there is: %s", asked, list);
}

static int choose_methods(struct kiln_converge *c, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 2; i < c->job->argument_count && status == KILN_OK; i++)
        status = check_method(c->job->arguments[i], error);
    for (const char *const *name = method_names(); *name != NULL && status == KILN_OK; name++) {
        if (is_wanted(c->job, *name) && c->count == KILN_CONVERGE_METHODS)
            return kiln_fail(error, KILN_BUG, "kiln bench converge has room for %d methods", KILN_CONVERGE_METHODS);
        if (is_wanted(c->job, *name))
            c->methods[c->count++].name = *name;
    }
    return status;
}

/* ---- views ---- */

static int view_path(const struct kiln_converge *c, const char *method, uint32_t samples, char path[KILN_PATH_SIZE],
                     struct kiln_error *error)
{
    char name[64];
    (void)snprintf(name, sizeof name, "%.40s-%u.exr", method, samples);
    return kiln_path_join(path, c->job->output, name, error);
}

static void push_view(const struct kiln_converge *c, struct kiln_child *child, const char *method, uint32_t samples,
                      uint64_t seed, const char *path)
{
    static const char *const own[] = {"output", "json", "quiet", "verbose", "seed", "width", "height", NULL};
    char number[32];
    kiln_child_push(child, c->program);
    kiln_child_push(child, "view");
    kiln_child_push(child, c->job->scene);
    kiln_child_push(child, "-o");
    kiln_child_push(child, path);
    kiln_child_push(child, "--json");
    kiln_child_push(child, "--method");
    kiln_child_push(child, method);
    kiln_child_push_number(child, "--samples-pixel", "%.0f", samples);
    (void)snprintf(number, sizeof number, "%" PRIu64, seed);
    kiln_child_push(child, "--seed");
    kiln_child_push(child, number);
    if (c->job->width > 0)
        kiln_child_push_number(child, "--width", "%.0f", c->job->width);
    if (c->job->height > 0)
        kiln_child_push_number(child, "--height", "%.0f", c->job->height);
    kiln_child_push_given(child, c->job, KILN_FOR_VIEW, own);
}

static bool is_refusal(int code) { return code == KILN_USAGE || code == KILN_BAD_INPUT || code == KILN_NO_DEVICE; }

/* Draws a view. Fills `trial` with its time, or `said` with the reason and *code with the status of a command that
 * failed. */
static int draw(struct kiln_converge *c, const char *method, uint32_t samples, uint64_t seed, const char *path,
                struct kiln_converge_trial *trial, int *code, char said[KILN_CHILD_SAID], struct kiln_error *error)
{
    struct kiln_child child = {.error = error};
    json_t *printed = NULL;
    if (!c->job->quiet)
        (void)fprintf(stderr, "kiln: %s, %u paths a pixel\n", method, samples);
    push_view(c, &child, method, samples, seed, path);
    const int status = kiln_child_run_for_json(&child, c->answer, c->said, code, said, &printed, error);
    *trial = (struct kiln_converge_trial){
        .samples = samples,
        .seconds = fmax(1e-9, json_number_value(json_object_get(printed, "seconds"))),
        .rays = (uint64_t)fmax(0.0, json_number_value(json_object_get(printed, "rays"))),
    };
    json_decref(printed);
    kiln_child_clear(&child);
    kiln_remove_tree(c->said);
    kiln_remove_tree(c->answer);
    return status;
}

/* Draws the next view of a method, unless it refuses. */
static int draw_next(struct kiln_converge *c, struct kiln_converge_method *m, struct kiln_error *error)
{
    const uint32_t samples = 1U << m->count;
    char path[KILN_PATH_SIZE], said[KILN_CHILD_SAID];
    int code = KILN_OK;
    int status = view_path(c, m->name, samples, path, error);
    const struct kiln_output_name name = {.option = "--output", .path = path, .inputs = {c->job->reference}};
    if (status == KILN_OK)
        status = kiln_output_name_check(&name, error);
    if (status == KILN_OK)
        status = draw(c, m->name, samples, c->job->seed, path, &m->trials[m->count], &code, said, error);
    if (status != KILN_OK)
        return status;
    if (m->count == 0 && is_refusal(code)) {
        m->refusal_code = code;
        kiln_text_copy(m->refusal, sizeof m->refusal, kiln_child_sentence(said));
        m->refusal[strcspn(m->refusal, "\n")] = '\0';
        return KILN_OK;
    }
    m->count += code == KILN_OK ? 1 : 0;
    return kiln_child_failure(m->name, code, said, error);
}

/* The next view takes about twice the last one's time. */
static bool goes_on(const struct kiln_converge *c, const struct kiln_converge_method *m)
{
    return m->refusal[0] == '\0' && m->count <= c->job->doublings &&
           (m->count == 0 || 2.0 * m->trials[m->count - 1].seconds <= c->job->view_time);
}

static int draw_all(struct kiln_converge *c, struct kiln_error *error)
{
    size_t drawn = 0;
    int status = KILN_OK;
    for (size_t i = 0; i < c->count; i++) {
        struct kiln_converge_method *m = &c->methods[i];
        while (goes_on(c, m) && status == KILN_OK)
            status = draw_next(c, m, error);
        drawn += m->count;
    }
    if (status == KILN_OK && drawn == 0)
        status = kiln_fail(error, c->methods[0].refusal_code, "no method draws this view; %s: %.380s",
                           c->methods[0].name, c->methods[0].refusal);
    return status;
}

/* ---- the reference ---- */

/* Reads the reference that is given. Views get its size. */
static int read_reference(struct kiln_converge *c, struct kiln_error *error)
{
    struct kiln_reader *reader = NULL;
    struct kiln_job *job = c->job;
    int status = kiln_reader_create(&reader, 0, error);
    if (status == KILN_OK)
        status = kiln_reader_image_at(reader, job->reference, &c->reference_image, error);
    kiln_reader_destroy(&reader);
    if (status != KILN_OK)
        return status;
    const struct kiln_image *image = c->reference_image;
    float *planes[3];
    if (!kiln_image_rgb(image, "", planes))
        return kiln_fail(error, KILN_BAD_INPUT, "--reference %.300s: it has no layers R, G and B", job->reference);
    if ((job->width != 0 && job->width != image->width) || (job->height != 0 && job->height != image->height))
        return kiln_fail(error, KILN_BAD_INPUT,
                         "--reference %.300s: it has %u x %u pixels; leave --width and --height out", job->reference,
                         image->width, image->height);
    job->width = image->width;
    job->height = image->height;
    kiln_text_copy(c->reference, sizeof c->reference, job->reference);
    return KILN_OK;
}

/* The most paths a pixel of any view. */
static uint32_t most_samples(const struct kiln_converge *c)
{
    uint32_t most = 1;
    for (size_t i = 0; i < c->count; i++)
        for (size_t k = 0; k < c->methods[i].count; k++)
            most = c->methods[i].trials[k].samples > most ? c->methods[i].trials[k].samples : most;
    return most;
}

static int draw_half(struct kiln_converge *c, int half, struct kiln_image **image, struct kiln_error *error)
{
    static const char *const wanted[] = {"R", "G", "B"};
    char said[KILN_CHILD_SAID];
    struct kiln_converge_trial unused;
    int code = KILN_OK;
    int status = draw(c, "path", (c->reference_samples + 1) / 2, c->job->seed + 1 + (uint64_t)half, c->halves[half],
                      &unused, &code, said, error);
    if (status == KILN_OK)
        status = kiln_child_failure("the reference", code, said, error);
    return status == KILN_OK ? kiln_exr_read(c->halves[half], wanted, 3, image, error) : status;
}

/* Adds the second half to the first one, and says what they tell of their mean's error. */
static int join_halves(struct kiln_converge *c, struct kiln_image *a, const struct kiln_image *b,
                       struct kiln_error *error)
{
    struct kiln_difference difference;
    float *to[3], *from[3];
    const int status = kiln_compare_images(b, a, &difference, error);
    if (status != KILN_OK)
        return status;
    if (!kiln_image_rgb(a, "", to) || !kiln_image_rgb(b, "", from))
        return kiln_fail(error, KILN_BUG, "a view has no layers R, G and B");
    c->reference_psnr = difference.picture_psnr + 20.0 * log10(2.0);
    for (int k = 0; k < 3; k++)
        for (size_t i = 0; i < (size_t)a->width * a->height; i++)
            to[k][i] = 0.5F * to[k][i] + 0.5F * from[k][i];
    return KILN_OK;
}

static int make_reference(struct kiln_converge *c, struct kiln_error *error)
{
    const uint64_t samples = was_named(c->job, "reference-samples") ? c->job->reference_samples
                                                                    : REFERENCE_FACTOR * (uint64_t)most_samples(c);
    const struct kiln_exr_attribute attributes[] = {
        {.name = "kiln:quantity", .kind = KILN_EXR_STRING, .text = "radiance"}};
    struct kiln_image *second = NULL;
    c->reference_samples = samples < MOST_REFERENCE ? (uint32_t)samples : MOST_REFERENCE;
    int status = draw_half(c, 0, &c->reference_image, error);
    if (status == KILN_OK)
        status = draw_half(c, 1, &second, error);
    if (status == KILN_OK)
        status = join_halves(c, c->reference_image, second, error);
    if (status == KILN_OK)
        status = kiln_exr_write(c->reference, c->reference_image, attributes, 1, error);
    kiln_image_destroy(&second);
    kiln_remove_tree(c->halves[0]);
    kiln_remove_tree(c->halves[1]);
    return status;
}

/* ---- errors ---- */

static int measure(struct kiln_converge *c, const struct kiln_converge_method *m, struct kiln_converge_trial *trial,
                   struct kiln_error *error)
{
    static const char *const wanted[] = {"R", "G", "B"};
    char path[KILN_PATH_SIZE];
    struct kiln_image *image = NULL;
    struct kiln_difference d;
    int status = view_path(c, m->name, trial->samples, path, error);
    if (status == KILN_OK)
        status = kiln_exr_read(path, wanted, 3, &image, error);
    if (status == KILN_OK)
        status = kiln_compare_images(image, c->reference_image, &d, error);
    kiln_image_destroy(&image);
    if (status != KILN_OK)
        return status;
    trial->rmse = d.rmse;
    trial->nrmse = d.nrmse;
    trial->rel_rmse = d.rel_rmse;
    trial->picture_psnr = d.picture_psnr;
    trial->picture_dissimilarity = d.picture_dissimilarity;
    if (trial != &m->trials[m->count - 1])
        kiln_remove_tree(path);
    return KILN_OK;
}

static int measure_all(struct kiln_converge *c, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; i < c->count; i++)
        for (size_t k = 0; k < c->methods[i].count && status == KILN_OK; k++)
            status = measure(c, &c->methods[i], &c->methods[i].trials[k], error);
    return status;
}

/* ---- the bench ---- */

static int make_paths(struct kiln_converge *c, struct kiln_error *error)
{
    struct kiln_job *job = c->job;
    const struct {
        const char *name;
        char *path;
    } files[] = {{"said", c->said},
                 {"answer", c->answer},
                 {"reference.exr", c->reference},
                 {"half-1.exr", c->halves[0]},
                 {"half-2.exr", c->halves[1]}};
    int status = job->output != NULL ? KILN_OK : kiln_job_default_output(job, job->scene, "-converge", error);
    if (status == KILN_OK)
        status = kiln_child_program(c->program, error);
    for (size_t i = 0; i < sizeof files / sizeof *files && status == KILN_OK; i++)
        status = kiln_path_join(files[i].path, job->output, files[i].name, error);
    return status == KILN_OK ? kiln_make_directories(job->output, error) : status;
}

static int run(struct kiln_converge *c, struct kiln_error *error)
{
    int status = make_paths(c, error);
    if (status == KILN_OK && c->job->reference != NULL)
        status = read_reference(c, error);
    if (status == KILN_OK)
        status = draw_all(c, error);
    if (status == KILN_OK && c->job->reference == NULL)
        status = make_reference(c, error);
    if (status == KILN_OK)
        status = measure_all(c, error);
    if (status != KILN_OK)
        return status;
    kiln_converge_judge(c);
    return kiln_converge_tell(c, error);
}

int kiln_converge_bench(struct kiln_job *job, struct kiln_error *error)
{
    struct kiln_converge *c = NULL;
    if (job->scene == NULL)
        return kiln_fail(error, KILN_USAGE,
                         "kiln bench converge takes a scene, and methods of kiln view; for example: kiln bench "
                         "converge room.glb path");
    int status = check_options(job, error);
    if (status == KILN_OK)
        status = check_numbers(job, error);
    if (status == KILN_OK)
        status = kiln_allocate(&c, 1, sizeof *c, "a bench", error);
    if (status != KILN_OK)
        return status;
    c->job = job;
    c->reference_psnr = NAN;
    status = choose_methods(c, error);
    if (status == KILN_OK)
        status = run(c, error);
    kiln_image_destroy(&c->reference_image);
    kiln_free(&c);
    return status;
}
