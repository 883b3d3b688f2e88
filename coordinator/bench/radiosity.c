#include "coordinator/bench/radiosity.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "coordinator/bench/radiosity_private.h"
#include "coordinator/files/json.h"
#include "coordinator/job/job_private.h"
#include "coordinator/job/options.h"
#include "worker/base/text.h"

enum { SIDE_LEAST = 4, SIDE_MOST = 8192, REFERENCE_SAMPLES = 1024, BOUNCES = 2, VIEW_WIDTH = 240 };

/* What is baked at each size, the pure one first. Rows without a method are of radiosity. `share`: of all pairs; above
 * 1, rays of a texel. */
static const struct row {
    const char *group, *name, *words;
    double parameter, share;
} rows[] = {
    {"pure", "pure", "", 1, 1.0},
    {"lamps", "lamps sampled", "--lights sampled", 1, 0.7},
    {"clamped", "clamped", "--clamp --albedo-scale 0.9", 1, 1.0},
    {"stride", "stride 2", "--undersample stride --sampling-window 2", 2, 0.3},
    {"stride", "stride 4", "--undersample stride --sampling-window 4", 4, 0.1},
    {"random", "random 2", "--undersample random --sampling-window 2", 2, 0.3},
    {"random", "random 4", "--undersample random --sampling-window 4", 4, 0.1},
    {"random", "random 8", "--undersample random --sampling-window 8", 8, 0.05},
    {"random", "random 16", "--undersample random --sampling-window 16", 16, 0.03},
    {"mipmap", "mipmap 2", "--undersample mipmap --sampling-window 2", 2, 0.3},
    {"mipmap", "mipmap 4", "--undersample mipmap --sampling-window 4", 4, 0.1},
    {"mipmap", "mipmap 8", "--undersample mipmap --sampling-window 8", 8, 0.05},
    {"subdivide", "subdivide 0.02", "--subdivide 0.02 --node-max 8", 0.02, 0.8},
    {"subdivide", "subdivide 0.05", "--subdivide 0.05 --node-max 8", 0.05, 0.5},
    {"subdivide", "subdivide 0.1", "--subdivide 0.1 --node-max 8", 0.1, 0.3},
    {"subdivide", "subdivide 0.2", "--subdivide 0.2 --node-max 8", 0.2, 0.2},
    {"subdivide", "subdivide 0.5", "--subdivide 0.5 --node-max 8", 0.5, 0.1},
    {"unshot", "unshot", "--order unshot", 1, 1.0},
    {"voxels", "voxels 32", "--visibility voxels --voxels 32", 32, 0.7},
    {"voxels", "voxels 64", "--visibility voxels --voxels 64", 64, 0.8},
    {"voxels", "voxels 128", "--visibility voxels --voxels 128", 128, 0.9},
    {"cache", "cache", "--visibility-cache 4", 1, 0.7},
    {"links", "links 0.06", "--patches links --link-error 0.06", 0.06, 200},
    {"links", "links 0.015", "--patches links --link-error 0.015", 0.015, 1000},
    {"even", "even 64", "--gather even --directions 64", 64, 64},
    {"even", "even 256", "--gather even --directions 256", 256, 256},
    {"even", "even 1024", "--gather even --directions 1024", 1024, 1024},
    {"circles", "circles 256", "--gather circles --directions 256", 256, 256},
    {"cosine", "cosine 256", "--gather cosine --directions 256", 256, 256},
    {"mixed", "mixed 256", "--gather mixed --directions 256", 256, 256},
    {"cells", "cells", "--method cells", 1, 200},
};
enum { ROWS = sizeof rows / sizeof *rows };

/* Other scenes, of which pure radiosity is timed at the largest size: as words of kiln generate, from few triangles to
 * many. His are much like the first five. */
static const char scenes_group[] = "scenes";
static const char *const scenes[] = {"cornell",
                                     "cornell-layers",
                                     "cornell-shapes",
                                     "cornell-statue --triangles 5000",
                                     "cornell-statue --triangles 150000",
                                     "rooms"};

bool kiln_radiosity_is(const struct kiln_setting *s, const char *group) { return strcmp(s->group, group) == 0; }

void kiln_radiosity_picture(const struct kiln_setting *s, const char *ending, char name[KILN_PICTURE_NAME])
{
    (void)snprintf(name, KILN_PICTURE_NAME, "pictures/%s%s.png", s->name, ending);
    for (char *c = name; *c != '\0'; c++)
        *c = *c == ' ' ? '-' : *c;
}

void kiln_radiosity_seen_picture(uint32_t along, char name[KILN_PICTURE_NAME])
{
    if (along > 0)
        (void)snprintf(name, KILN_PICTURE_NAME, "pictures/seen-voxels-%u.png", along);
    else
        (void)snprintf(name, KILN_PICTURE_NAME, "pictures/seen-rays.png");
}

/* ---- settings ---- */

/* Whether the job asks for a group: all, unless some are named; the pure ones, with which others are compared, always.
 */
static bool is_wanted(const struct kiln_job *job, const char *group)
{
    bool named = false;
    for (size_t i = 2; i < job->argument_count; i++) {
        const bool size = job->arguments[i][0] >= '0' && job->arguments[i][0] <= '9';
        if (!size && strcmp(job->arguments[i], group) == 0)
            return true;
        named = named || !size;
    }
    return !named || strcmp(group, rows[0].group) == 0;
}

static void add_size(struct kiln_sweep *sweep, uint32_t side)
{
    for (size_t i = 0; i < ROWS; i++) {
        struct kiln_setting s = {.group = rows[i].group,
                                 .words = rows[i].words,
                                 .side = side,
                                 .parameter = rows[i].parameter,
                                 .share = rows[i].share};
        (void)snprintf(s.name, sizeof s.name, "%u %s", side, rows[i].name);
        if (is_wanted(sweep->job, s.group))
            kiln_sweep_add(sweep, &s);
    }
}

static void add_scenes(struct kiln_sweep *sweep, uint32_t side)
{
    for (size_t i = 0; i < sizeof scenes / sizeof *scenes && is_wanted(sweep->job, scenes_group); i++) {
        struct kiln_setting s = {.group = scenes_group,
                                 .words = rows[0].words,
                                 .generate = scenes[i],
                                 .side = side,
                                 .parameter = rows[0].parameter,
                                 .share = rows[0].share};
        (void)snprintf(s.name, sizeof s.name, "%u %s", side, scenes[i]);
        kiln_sweep_add(sweep, &s);
    }
}

/* KILN_USAGE for an argument that is neither a group nor a size. */
static int refuse_argument(const char *argument, struct kiln_error *error)
{
    char list[256] = "";
    for (size_t i = 0; i < ROWS; i++) {
        const size_t used = strlen(list);
        if (i == 0 || strcmp(rows[i].group, rows[i - 1].group) != 0)
            (void)snprintf(list + used, sizeof list - used, "%s, ", rows[i].group);
    }
    (void)strncat(list, scenes_group, sizeof list - strlen(list) - 1);
    return kiln_fail(error, KILN_USAGE,
                     "kiln bench radiosity takes sizes of a lightmap in texels a side, %d to %d, such as 64, and names "
                     "of what is baked, not '%.100s'; there is: %s",
                     SIDE_LEAST, SIDE_MOST, argument, list);
}

static bool is_group(const char *name)
{
    for (size_t i = 0; i < ROWS; i++)
        if (strcmp(rows[i].group, name) == 0)
            return true;
    return strcmp(name, scenes_group) == 0;
}

static bool read_side(const char *text, uint32_t *side)
{
    char *end = NULL;
    const unsigned long value = *text >= '0' && *text <= '9' ? strtoul(text, &end, 10) : 0;
    *side = (uint32_t)value;
    return end != NULL && *end == '\0' && value >= SIDE_LEAST && value <= SIDE_MOST;
}

static uint32_t largest_side(const struct kiln_sweep *sweep)
{
    uint32_t largest = 0;
    for (size_t i = 0; i < sweep->count; i++)
        largest = sweep->settings[i].side > largest ? sweep->settings[i].side : largest;
    return largest;
}

static int choose(struct kiln_sweep *sweep, struct kiln_error *error)
{
    static const uint32_t usual[] = {16, 32, 64};
    const struct kiln_job *job = sweep->job;
    for (size_t i = 2; i < job->argument_count; i++) {
        uint32_t side;
        if (is_group(job->arguments[i]))
            continue;
        if (!read_side(job->arguments[i], &side))
            return refuse_argument(job->arguments[i], error);
        for (size_t k = 0; k < sweep->count; k++)
            if (sweep->settings[k].side == side)
                return kiln_fail(error, KILN_USAGE, "kiln bench radiosity: the size %u is given twice", side);
        add_size(sweep, side);
    }
    const bool given = sweep->count > 0;
    for (size_t i = 0; !given && i < sizeof usual / sizeof *usual; i++)
        add_size(sweep, usual[i]);
    add_scenes(sweep, largest_side(sweep));
    if (sweep->count == KILN_SETTINGS_MOST)
        return kiln_fail(error, KILN_USAGE, "there are too many bakes in one sweep: give fewer sizes");
    return KILN_OK;
}

/* Of a bake's, texels per metre; 0: it is not known yet. */
static double density_of(const struct kiln_sweep *sweep, const struct kiln_setting *s)
{
    if (s->generate != NULL)
        return s->density > 0.0 ? s->density : sweep->results[s - sweep->settings].texels_per_metre;
    /* the reference is of the largest size */
    return sweep->reference_scene != NULL ? sweep->density * s->side / largest_side(sweep) : 0.0;
}

static void options(const struct kiln_sweep *sweep, const struct kiln_setting *s, char text[KILN_SETTING_OPTIONS])
{
    const int64_t bounces = sweep->job->bounces >= 0 ? sweep->job->bounces : BOUNCES;
    const bool own_method = strstr(s->words, "--method") != NULL, own_lights = strstr(s->words, "--lights") != NULL;
    const int used =
        snprintf(text, KILN_SETTING_OPTIONS, "%s%s%s%s--bounces %lld --denoise none --materials diffuse",
                 own_method ? "" : "--method radiosity ", own_method || own_lights ? "" : "--lights patches ", s->words,
                 s->words[0] != '\0' ? " " : "", (long long)bounces);
    if (density_of(sweep, s) > 0.0)
        (void)snprintf(text + used, KILN_SETTING_OPTIONS - (size_t)used, " --texels-per-metre %.9g",
                       density_of(sweep, s));
}

static void key(const struct kiln_setting *s, char text[KILN_SETTING_OPTIONS])
{
    (void)snprintf(text, KILN_SETTING_OPTIONS, "%s: %s", s->name, s->words);
}

static double rays(const struct kiln_setting *s)
{
    const double points = (double)s->side * s->side;
    return points * (s->share > 1.0 ? s->share : s->share * points);
}

/* ---- children ---- */

/* Runs a command of kiln that prints JSON. */
static int run_for_json(const struct kiln_sweep *sweep, struct kiln_child *child, json_t **printed,
                        struct kiln_error *error)
{
    char answer[KILN_PATH_SIZE], said[KILN_CHILD_SAID], what[64];
    int code = KILN_OK;
    int status = kiln_path_join(answer, sweep->job->output, "answer", error);
    if (status == KILN_OK)
        status = kiln_child_run_for_json(child, answer, sweep->said, &code, said, printed, error);
    kiln_remove_tree(answer);
    kiln_remove_tree(sweep->said);
    (void)snprintf(what, sizeof what, "kiln %.32s", child->count > 1 ? child->text[1] : "");
    return status == KILN_OK ? kiln_child_failure(what, code, said, error) : status;
}

/* Surface of a scene, m2. */
static int find_area(const struct kiln_sweep *sweep, const char *scene, double *area, struct kiln_error *error)
{
    static const char *const own[] = {"output", "json", "quiet", "verbose", "resume", NULL};
    struct kiln_child child = {.error = error};
    json_t *info = NULL;
    kiln_child_push(&child, sweep->program);
    kiln_child_push(&child, "info");
    kiln_child_push(&child, scene);
    kiln_child_push(&child, "--json");
    kiln_child_push_given(&child, sweep->job, KILN_FOR_INFO, own);
    int status = run_for_json(sweep, &child, &info, error);
    *area = json_number_value(json_object_get(json_object_get(info, "surface"), "area"));
    if (status == KILN_OK && !(*area > 0.0))
        status = kiln_fail(error, KILN_BAD_INPUT, "'%.300s' has no surface to put texels on", scene);
    json_decref(info);
    kiln_child_clear(&child);
    return status;
}

/* Makes a scene, and finds how wide texels are that it has as many as the size says. */
static int make_scene(struct kiln_sweep *sweep, struct kiln_setting *s, struct kiln_error *error)
{
    char folder[KILN_PATH_SIZE], path[KILN_PATH_SIZE], words[KILN_SETTING_NAME], *rest = NULL;
    struct kiln_child child = {.error = error};
    json_t *said = NULL;
    double area = 0.0;
    int status = kiln_path_join(folder, sweep->job->output, "scenes", error);
    if (status == KILN_OK)
        status = kiln_make_directories(folder, error);
    if (status == KILN_OK)
        status = kiln_sweep_scene(sweep, s, path, error);
    if (status != KILN_OK)
        return status;
    kiln_child_push(&child, sweep->program);
    kiln_child_push(&child, "generate");
    kiln_text_copy(words, sizeof words, s->generate);
    for (char *word = strtok_r(words, " ", &rest); word != NULL; word = strtok_r(NULL, " ", &rest))
        kiln_child_push(&child, word);
    kiln_child_push(&child, "--json");
    kiln_child_push(&child, "-o");
    kiln_child_push(&child, path);
    status = run_for_json(sweep, &child, &said, error);
    if (status == KILN_OK)
        status = find_area(sweep, path, &area, error);
    if (status == KILN_OK)
        s->density = s->side / sqrt(area);
    json_decref(said);
    kiln_child_clear(&child);
    return status;
}

static int prepare(struct kiln_sweep *sweep, size_t i, struct kiln_error *error)
{
    struct kiln_setting *s = &sweep->settings[i];
    return s->generate != NULL ? make_scene(sweep, s, error) : KILN_OK;
}

static void push_reference(const struct kiln_sweep *sweep, struct kiln_child *child)
{
    const struct kiln_job_owned *owned = sweep->job->strings;
    const bool given = owned->given[kiln_option_find("reference-samples") - kiln_options];
    const double samples = given ? sweep->job->reference_samples : REFERENCE_SAMPLES;
    double area = 0.0;
    if (child->status == KILN_OK)
        child->status = find_area(sweep, sweep->job->scene, &area, child->error);
    if (child->status != KILN_OK)
        return;
    if (!sweep->job->quiet)
        (void)fprintf(stderr, "kiln: baking the reference, with %.0f paths a texel\n", samples);
    kiln_child_push(child, "--method");
    kiln_child_push(child, "path");
    kiln_child_push(child, "--materials");
    kiln_child_push(child, "diffuse");
    kiln_child_push(child, "--denoise");
    kiln_child_push(child, "none");
    kiln_child_push_number(child, "--samples-direct", "%.0f", samples);
    kiln_child_push_number(child, "--samples-indirect", "%.0f", samples);
    kiln_child_push_number(child, "--bounces", "%.0f",
                           sweep->job->bounces >= 0 ? (double)sweep->job->bounces : BOUNCES);
    kiln_child_push_number(child, "--seed", "%.0f", (double)(sweep->job->seed + 1));
    kiln_child_push_number(child, "--texels-per-metre", "%.9g", largest_side(sweep) / sqrt(area));
}

/* ---- measuring ---- */

static void read_passes(const json_t *report, struct kiln_setting_result *result)
{
    size_t i, later = 0;
    const json_t *pass;
    result->first_pass = result->later_pass = 0.0;
    json_array_foreach(json_object_get(report, "bounces"), i, pass)
    {
        const char *kind = json_string_value(json_object_get(pass, "kind"));
        const double seconds = json_number_value(json_object_get(pass, "seconds"));
        if (kind == NULL || strcmp(kind, "direct") == 0 || strcmp(kind, "pilot") == 0)
            continue;
        if (!(result->first_pass > 0.0))
            result->first_pass = seconds;
        else {
            result->later_pass += seconds;
            later++;
        }
    }
    result->later_pass = later > 0 ? result->later_pass / (double)later : 0.0;
}

static int pure_path(const struct kiln_sweep *sweep, uint32_t side, char path[KILN_PATH_SIZE], struct kiln_error *error)
{
    char name[32];
    (void)snprintf(name, sizeof name, "pure-%u", side);
    return kiln_path_join(path, sweep->job->output, name, error);
}

/* Compares the bake with the pure one of its size, and draws the difference; that one is kept. */
static int find_dfpr(const struct kiln_sweep *sweep, const struct kiln_setting *s, struct kiln_setting_result *result,
                     struct kiln_error *error)
{
    char pure[KILN_PATH_SIZE], picture[KILN_PATH_SIZE], name[KILN_PICTURE_NAME];
    struct kiln_child child = {.error = error};
    json_t *compared = NULL;
    int status = pure_path(sweep, s->side, pure, error);
    if (status != KILN_OK || kiln_radiosity_is(s, "pure"))
        return status;
    kiln_radiosity_picture(s, "-difference", name);
    status = kiln_path_join(picture, sweep->job->output, name, error);
    if (status != KILN_OK)
        return status;
    const char *const words[] = {sweep->program, "compare", sweep->trial, pure, "--json", "-o", picture};
    for (size_t i = 0; i < sizeof words / sizeof *words; i++)
        kiln_child_push(&child, words[i]);
    status = run_for_json(sweep, &child, &compared, error);
    result->dfpr = json_number_value(json_object_get(compared, "dfpr_unit"));
    result->dfpr_8bit = json_number_value(json_object_get(compared, "dfpr_8bit"));
    json_decref(compared);
    kiln_child_clear(&child);
    return status;
}

/* The exposure of all pictures, stops: that of the reference's. */
static int find_exposure(struct kiln_sweep *sweep, double *stops, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE];
    struct kiln_child child = {.error = error};
    json_t *said = NULL;
    const json_t *kept = json_object_get(sweep->kept, "exposure");
    *stops = json_number_value(kept);
    if (kept != NULL)
        return KILN_OK;
    int status = kiln_path_join(path, sweep->job->output, "pictures", error);
    if (status == KILN_OK)
        status = kiln_make_directories(path, error);
    if (status == KILN_OK)
        status = kiln_path_join(path, sweep->job->output, "pictures/reference.png", error);
    const char *const words[] = {sweep->program, "view", sweep->reference, "--json", "-o", path};
    for (size_t i = 0; status == KILN_OK && i < sizeof words / sizeof *words; i++)
        kiln_child_push(&child, words[i]);
    kiln_child_push_number(&child, "--width", "%.0f", VIEW_WIDTH);
    if (status == KILN_OK)
        status = run_for_json(sweep, &child, &said, error);
    *stops = json_number_value(json_object_get(json_object_get(said, "exposure"), "automatic"));
    if (status == KILN_OK)
        (void)json_object_set_new(sweep->kept, "exposure", json_real(*stops));
    json_decref(said);
    kiln_child_clear(&child);
    return status;
}

static int draw(struct kiln_sweep *sweep, const struct kiln_setting *s, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE], name[KILN_PICTURE_NAME];
    struct kiln_child child = {.error = error};
    json_t *said = NULL;
    double stops = 0.0;
    int status = find_exposure(sweep, &stops, error);
    kiln_radiosity_picture(s, "", name);
    if (status == KILN_OK)
        status = kiln_path_join(path, sweep->job->output, name, error);
    const char *const words[] = {sweep->program, "view", sweep->trial, "--json", "-o", path, "--no-auto-exposure"};
    for (size_t i = 0; status == KILN_OK && i < sizeof words / sizeof *words; i++)
        kiln_child_push(&child, words[i]);
    kiln_child_push_number(&child, "--width", "%.0f", VIEW_WIDTH);
    kiln_child_push_number(&child, "--exposure", "%.9g", stops);
    if (status == KILN_OK)
        status = run_for_json(sweep, &child, &said, error);
    json_decref(said);
    kiln_child_clear(&child);
    return status;
}

/* Draws what a texel sees, by rays and by grids of voxels, and keeps how many texels these are: of the pure bake of the
 * largest size. */
static int find_seen(struct kiln_sweep *sweep, const struct kiln_setting *s, struct kiln_error *error)
{
    static const uint32_t along[] = {0, 128, 64, 32, 16};
    json_t *rows_seen = json_array();
    int status = KILN_OK;
    if (!kiln_radiosity_is(s, "pure") || s->side != largest_side(sweep)) {
        json_decref(rows_seen);
        return KILN_OK;
    }
    for (size_t i = 0; status == KILN_OK && i < sizeof along / sizeof *along; i++) {
        char path[KILN_PATH_SIZE], name[KILN_PICTURE_NAME];
        struct kiln_child child = {.error = error};
        json_t *said = NULL;
        kiln_radiosity_seen_picture(along[i], name);
        status = kiln_path_join(path, sweep->job->output, name, error);
        const char *const words[] = {sweep->program, "view",     sweep->trial, "--show", "seen",
                                     "--json",       "--filter", "nearest",    "-o",     path};
        for (size_t k = 0; status == KILN_OK && k < sizeof words / sizeof *words; k++)
            kiln_child_push(&child, words[k]);
        kiln_child_push_number(&child, "--width", "%.0f", VIEW_WIDTH);
        if (along[i] > 0)
            kiln_child_push_number(&child, "--voxels", "%.0f", along[i]);
        if (status == KILN_OK)
            status = run_for_json(sweep, &child, &said, error);
        json_t *row = json_pack("{s:i}", "along", (int)along[i]);
        (void)json_object_update(row, json_object_get(said, "seen"));
        (void)json_array_append_new(rows_seen, row);
        json_decref(said);
        kiln_child_clear(&child);
    }
    (void)json_object_set_new(sweep->kept, "seen", rows_seen);
    return status;
}

/* Keeps the bake as the pure one of its size. */
static int keep_pure(const struct kiln_sweep *sweep, const struct kiln_setting *s, struct kiln_error *error)
{
    char pure[KILN_PATH_SIZE];
    int status = kiln_radiosity_is(s, "pure") ? pure_path(sweep, s->side, pure, error) : KILN_STOPPED;
    if (status != KILN_OK)
        return status == KILN_STOPPED ? KILN_OK : status;
    kiln_remove_tree(pure);
    if (rename(sweep->trial, pure) != 0)
        status = kiln_fail_errno(error, KILN_CANNOT_CREATE, "the bake cannot be kept as %.500s", pure);
    return status;
}

static int more(struct kiln_sweep *sweep, size_t i, const json_t *report, struct kiln_error *error)
{
    const struct kiln_setting *s = &sweep->settings[i];
    read_passes(report, &sweep->results[i]);
    if (s->generate != NULL)
        return KILN_OK;
    int status = find_dfpr(sweep, s, &sweep->results[i], error);
    if (status == KILN_OK)
        status = draw(sweep, s, error);
    if (status == KILN_OK)
        status = find_seen(sweep, s, error);
    return status == KILN_OK ? keep_pure(sweep, s, error) : status;
}

/* ---- the result ---- */

static void add_csv(const struct kiln_sweep *sweep, struct kiln_html *page)
{
    kiln_html_add(
        page,
        "side,method,name,options,triangles,points,rays,first_pass_seconds,later_pass_seconds,light_seconds,seconds,"
        "processor_seconds,peak_bytes,dfpr,dfpr_8bit,nrmse,nrmse_direct,nrmse_indirect\n");
    for (size_t i = 0; i < sweep->count; i++) {
        char text[KILN_SETTING_OPTIONS];
        const struct kiln_setting *s = &sweep->settings[i];
        const struct kiln_setting_result *r = &sweep->results[i];
        options(sweep, s, text);
        if (!r->done)
            continue;
        kiln_html_add(page, "%u,%s,%s,%s,%.0f,%.0f,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.0f,", s->side, s->group, s->name,
                      text, r->triangles, r->points, r->rays, r->first_pass, r->later_pass, r->light_seconds,
                      r->seconds, r->processor_seconds, r->bytes);
        if (s->generate == NULL)
            kiln_html_add(page, "%.6g,%.6g,%.6g,%.6g,%.6g\n", r->dfpr, r->dfpr_8bit, r->error[0], r->error[1],
                          r->error[2]);
        else /* of another scene than the reference */
            kiln_html_add(page, ",,,,\n");
    }
}

static void list(const struct kiln_sweep *sweep)
{
    for (size_t i = 0; i < sweep->count; i++) {
        char text[KILN_SETTING_OPTIONS];
        options(sweep, &sweep->settings[i], text);
        (void)printf("%-36s %s\n", sweep->settings[i].name, text);
    }
    (void)printf("%zu bakes, and the reference before them\n", sweep->count);
}

static void print_text(const struct kiln_sweep *sweep, size_t left)
{
    (void)printf("%-36s%9s%12s%11s%11s%12s%11s%9s%12s\n", "size, method", "texels", "rays", "first s", "later s",
                 "processor s", "DFPR", "error", "indirect");
    for (size_t i = 0; i < sweep->count; i++) {
        const struct kiln_setting_result *r = &sweep->results[i];
        if (r->done)
            (void)printf("%-36s%9.0f%12.3g%11.3g%11.3g%12.3g", sweep->settings[i].name, r->points, r->rays,
                         r->first_pass, r->later_pass, r->processor_seconds);
        if (r->done && sweep->settings[i].generate == NULL)
            (void)printf("%11.4f%8.2f%%%11.2f%%", r->dfpr_8bit, 100.0 * r->error[0], 100.0 * r->error[2]);
        if (r->done)
            (void)putchar('\n');
    }
    if (left > 0)
        (void)printf("%zu of %zu bakes are left, for the budget of %.4g s is used up; the same command goes on with "
                     "them\n",
                     left, sweep->count, sweep->job->budget);
    (void)printf(
        "DFPR: against pure radiosity of the same size; error: root mean square against paths at size %u, over "
        "the mean\n",
        largest_side(sweep));
    kiln_print(stdout, "%s/radiosity.html has tables, figures and pictures\n", sweep->job->output);
}

static json_t *row_json(const struct kiln_sweep *sweep, size_t i)
{
    char text[KILN_SETTING_OPTIONS];
    const struct kiln_setting_result *r = &sweep->results[i];
    options(sweep, &sweep->settings[i], text);
    json_t *row = json_pack("{s:s, s:i, s:s, s:f, s:f, s:f, s:f, s:f, s:f}", "name", sweep->settings[i].name, "side",
                            (int)sweep->settings[i].side, "options", text, "triangles", r->triangles, "points",
                            r->points, "rays", r->rays, "first_pass_seconds", r->first_pass, "later_pass_seconds",
                            r->later_pass, "processor_seconds", r->processor_seconds);
    if (sweep->settings[i].generate == NULL)
        (void)json_object_update_new(row, json_pack("{s:f, s:f, s:f, s:f}", "dfpr", r->dfpr, "dfpr_8bit", r->dfpr_8bit,
                                                    "nrmse", r->error[0], "nrmse_indirect", r->error[2]));
    return row;
}

static int tell(const struct kiln_sweep *sweep, size_t left, struct kiln_error *error)
{
    if (sweep->job->json)
        return kiln_sweep_tell_rows(sweep, left, row_json, error);
    print_text(sweep, left);
    return KILN_OK;
}

int kiln_radiosity_bench(struct kiln_job *job, struct kiln_error *error)
{
    static const char *const refused[] = {"method",    "materials",     "texels-per-metre", "lightmap-size",
                                          "reference", "samples-probe", "verify-fraction",  NULL};
    const struct kiln_sweep_kind kind = {.name = "radiosity",
                                         .suffix = "-radiosity",
                                         .refused = refused,
                                         .choose = choose,
                                         .options = options,
                                         .key = key,
                                         .push_reference = push_reference,
                                         .rays = rays,
                                         .prepare = prepare,
                                         .more = more,
                                         .files = kiln_radiosity_files,
                                         .csv = add_csv,
                                         .plot = kiln_radiosity_plot,
                                         .list = list,
                                         .tell = tell};
    return kiln_sweep_run(&kind, job, error);
}
