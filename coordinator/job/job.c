#include "coordinator/job/job.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "coordinator/job/changes.h"
#include "coordinator/job/gone.h"
#include "coordinator/job/conditions.h"
#include "coordinator/job/job_private.h"
#include "coordinator/job/light_groups.h"
#include "coordinator/job/options.h"
#include "worker/base/memory.h"
#include "worker/sampling/direction_set.h"

#define TIMED_ERROR 0.005 /* error of published light asked for by --time or --rounds without --quality */

static struct kiln_job_owned *owned(struct kiln_job *job) { return job->strings; }

bool kiln_is_yaml(const char *path)
{
    const char *dot = strrchr(path, '.');
    return dot != NULL && (strcasecmp(dot, ".yaml") == 0 || strcasecmp(dot, ".yml") == 0);
}

static int set_defaults(struct kiln_job *job, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; i < kiln_option_count && status == KILN_OK; i++)
        if (kiln_options[i].fallback != NULL)
            status = kiln_option_set(job, &kiln_options[i], kiln_options[i].fallback, kiln_options[i].name, KILN_BUG,
                                     NULL, error);
    return status;
}

/* The preset that a quality is, or is like: the coarsest with no more error. */
static const struct kiln_quality *preset_of(const char *quality)
{
    double percent;
    const bool error = kiln_option_percentage(quality, &percent);
    size_t i = 0;
    while (i + 1 < kiln_quality_count &&
           (error ? percent < kiln_qualities[i].error : strcmp(kiln_qualities[i].name, quality) != 0))
        i++;
    return &kiln_qualities[i];
}

static void set_quality(struct kiln_job *job)
{
    const struct kiln_quality *like = preset_of(job->light.quality);
    job->light.samples_direct = like->samples_direct;
    job->light.samples_bounce = like->samples_bounce;
    job->light.samples_indirect = like->samples_indirect;
    job->volume.samples = like->samples_probe;
}

/* Sets an option's second value to the one given behind the colon. If none is given there, the default replaces one
 * that was given behind a colon before. */
static int give_second(struct kiln_job *job, const struct kiln_option *second, const char *text, const char *where,
                       int status, struct kiln_error *error)
{
    struct kiln_job_owned *own = owned(job);
    const size_t index = (size_t)(second - kiln_options);
    if (text == NULL && (!own->given[index] || own->renamed[index]))
        return KILN_OK;
    own->given[index] = text != NULL;
    own->renamed[index] = false;
    return kiln_option_set(job, second, text != NULL ? text : second->fallback, where, status, NULL, error);
}

int kiln_job_give(struct kiln_job *job, const struct kiln_option *option, const char *name, const char *text,
                  const char *where, int status, const char *folder, struct kiln_error *error)
{
    struct kiln_job_owned *own = owned(job);
    const struct kiln_option *second = kiln_option_second(option);
    const char *colon = second != NULL ? strchr(text, ':') : NULL;
    char first[KILN_OPTION_TEXT];
    own->given[option - kiln_options] = true;
    if (option->second_of != NULL || strcmp(name, option->name) != 0)
        own->renamed[option - kiln_options] = true;
    if (colon != NULL) {
        (void)snprintf(first, sizeof first, "%.*s", (int)(colon - text), text);
        text = first;
    }
    const int given = kiln_option_set(job, option, text, where, status, folder, error);
    return given != KILN_OK || second == NULL
               ? given
               : give_second(job, second, colon != NULL ? colon + 1 : NULL, where, status, error);
}

/* An option on the command line. */
struct word {
    const struct kiln_option *option;
    const char *value; /* the text after '='; NULL: none */
    bool negated;      /* given as --no-NAME */
    char name[64];     /* name as given, without dashes and "no-" */
};

static int unknown_option(const struct kiln_command *command, const char *name, struct kiln_error *error)
{
    const struct kiln_option *elsewhere = kiln_option_find(name);
    const bool negated = strncmp(name, "no-", 3) == 0;
    const char *nearest = kiln_option_nearest(negated ? name + 3 : name, command->bit);
    const struct kiln_gone_option *gone = kiln_gone_option_find(name);
    char near[80] = "", list[200] = "";
    if (gone != NULL)
        return kiln_fail(error, KILN_USAGE, "--%s is no more since kiln %s: %s", name, gone->since, gone->instead);
    if (nearest != NULL)
        (void)snprintf(near, sizeof near, "the nearest one is --%s%s", negated ? "no-" : "", nearest);
    if (elsewhere == NULL)
        return kiln_fail(error, KILN_USAGE, "unknown option --%.200s; %s%skiln %s --help all lists them%s", name, near,
                         nearest == NULL ? "" : " (", command->name, nearest == NULL ? "" : ")");
    for (size_t i = 0; i < kiln_command_count; i++)
        if ((elsewhere->commands & kiln_commands[i].bit) != 0) {
            const size_t used = strlen(list);
            (void)snprintf(list + used, sizeof list - used, "%s%s", used == 0 ? "" : ", ", kiln_commands[i].name);
        }
    return kiln_fail(error, KILN_USAGE, "kiln %s has no option --%s; it belongs to %s%s%s%s", command->name, name, list,
                     nearest == NULL ? "" : " (here, ", near, nearest == NULL ? "" : ")");
}

static int recognise(const struct kiln_command *command, const char *argument, struct word *word,
                     struct kiln_error *error)
{
    char name[64];
    const char *start = argument + 2, *equals = strchr(start, '=');
    if (strncmp(argument, "--", 2) != 0) {
        if (argument[1] != 'o' || (argument[2] != '\0' && argument[2] != '='))
            return kiln_fail(error, KILN_USAGE, "unknown option %.200s; the short options are -o and -h", argument);
        word->option = kiln_option_find("output");
        word->value = argument[2] == '=' ? argument + 3 : NULL;
        (void)snprintf(word->name, sizeof word->name, "output");
        return (word->option->commands & command->bit) != 0 ? KILN_OK : unknown_option(command, "output", error);
    }
    (void)snprintf(name, sizeof name, "%.*s", (int)(equals == NULL ? strlen(start) : (size_t)(equals - start)), start);
    word->value = equals == NULL ? NULL : equals + 1;
    word->option = kiln_option_find_for(name, command->bit);
    if (word->option == NULL && strncmp(name, "no-", 3) == 0) {
        word->option = kiln_option_find(name + 3);
        word->negated = true;
        if (word->option != NULL && (word->option->kind != KILN_OPTION_FLAG || word->value != NULL))
            return kiln_fail(error, KILN_USAGE,
                             "--%.200s: only a switch can be turned off with --no-, and without a value", start);
    }
    if (word->option == NULL || (word->option->commands & command->bit) == 0)
        return unknown_option(command, word->option == NULL ? name : word->option->name, error);
    (void)snprintf(word->name, sizeof word->name, "%s", word->negated ? name + 3 : name);
    return KILN_OK;
}

/* Reads the option at arguments[*at], and moves *at past it. With `only`, stores it only if it has that name. */
static int read_option(struct kiln_job *job, const struct kiln_command *command, char **arguments, int *at,
                       const char *only, struct kiln_error *error)
{
    struct word word = {NULL, NULL, false, ""};
    char where[80];
    int status = recognise(command, arguments[*at], &word, error);
    if (status != KILN_OK)
        return status;
    (void)snprintf(where, sizeof where, "--%s", word.option->name);
    const char *value = word.value;
    if (word.option->kind == KILN_OPTION_FLAG)
        value = word.negated ? "false" : value == NULL ? "true" : value;
    else if (value == NULL) {
        value = arguments[*at + 1];
        if (value == NULL || strncmp(value, "--", 2) == 0)
            return kiln_fail(error, KILN_USAGE, "%s needs a value%s%s", where, word.option->value != NULL ? ": " : "",
                             word.option->value != NULL ? word.option->value : "");
        *at += 1;
    }
    *at += 1;
    if (only != NULL && strcmp(only, word.option->name) != 0)
        return KILN_OK;
    return kiln_job_give(job, word.option, word.name, value, where, KILN_USAGE, NULL, error);
}

/* Whether an argument is an option. One that begins with '-' may be a number: kiln probe DIR -1 0 2. */
static bool is_option(const char *argument)
{
    return argument[0] == '-' && argument[1] != '\0' && strchr("0123456789.", argument[1]) == NULL;
}

/* Reads the command line and collects the arguments. Stores all options, or with `only` just the option of that name.
 */
static int read_command_line(struct kiln_job *job, const struct kiln_command *command, int argc, char **argv,
                             const char *only, struct kiln_error *error)
{
    bool options = true;
    job->argument_count = 0;
    for (int at = 2; at < argc;) {
        if (options && strcmp(argv[at], "--") == 0) {
            options = false;
            at++;
        } else if (options && is_option(argv[at])) {
            const int status = read_option(job, command, argv, &at, only, error);
            if (status != KILN_OK)
                return status;
        } else {
            job->arguments[job->argument_count++] = argv[at++];
        }
    }
    return KILN_OK;
}

/* Returns the command's first example that begins with the command itself. */
static const char *example_of(const struct kiln_command *command)
{
    const size_t length = strlen(command->name);
    for (size_t i = 0; command->examples[i] != NULL; i++)
        if (strncmp(command->examples[i] + strlen("kiln "), command->name, length) == 0)
            return command->examples[i];
    return command->examples[0];
}

static int check_arguments(const struct kiln_job *job, const struct kiln_command *command, struct kiln_error *error)
{
    const size_t count = job->argument_count;
    if (job->machine.devices)
        return count == 0 ? KILN_OK
                          : kiln_fail(error, KILN_USAGE, "kiln %s --devices takes no argument '%.200s'", command->name,
                                      job->arguments[0]);
    if (count > command->maximum)
        return kiln_fail(error, KILN_USAGE, "kiln %s takes no argument '%.200s'; usage: kiln %s %s", command->name,
                         job->arguments[command->maximum], command->name, command->arguments);
    if (count < command->minimum)
        return kiln_fail(error, KILN_USAGE, "kiln %s needs %s; for example: %s", command->name, command->arguments,
                         example_of(command));
    return KILN_OK;
}

int kiln_job_default_output(struct kiln_job *job, const char *path, const char *ending, struct kiln_error *error)
{
    const char *slash = strrchr(path, '/');
    const char *name = slash == NULL ? path : slash + 1, *dot = strrchr(name, '.');
    const size_t length = dot == NULL || dot == name ? strlen(name) : (size_t)(dot - name);
    char text[300];
    (void)snprintf(text, sizeof text, "%s%.*s%s", name[0] == '-' ? "./" : "", length < 240 ? (int)length : 240, name,
                   ending);
    return kiln_job_keep(job, text, strlen(text), &job->output, error);
}

static bool given(struct kiln_job *job, const char *name)
{
    return owned(job)->given[kiln_option_find(name) - kiln_options];
}

/* Refuses judging all surfaces' light where only some is computed. */
static int check_visible_from(const struct kiln_job *job, struct kiln_error *error)
{
    const char *other = job->light.target_error > 0.0  ? "--target-error"
                        : kiln_job_parts(job) > 1      ? "--error-map"
                        : job->lightmaps.check_density ? "--check-density"
                                                       : NULL;
    return other == NULL ? KILN_OK
                         : kiln_fail(error, KILN_USAGE,
                                     "--only-visible-from and %s exclude each other: surfaces that no view needs have "
                                     "no light to judge; leave one of the two out",
                                     other);
}

/* Refuses measured errors with --final-scale: they do not include the light lost between nodes. */
static int check_final_scale(const struct kiln_job *job, struct kiln_error *error)
{
    const char *other = job->light.target_error > 0.0 ? "--target-error"
                        : kiln_job_parts(job) > 1     ? "--error-map"
                                                      : NULL;
    if (other != NULL)
        return kiln_fail(error, KILN_USAGE,
                         "--final-scale and %s exclude each other: the error that mixing texels' light makes is not "
                         "measured; leave one of the two out",
                         other);
    return job->light.schedule == KILN_SCHEDULE_EQUAL
               ? kiln_fail(error, KILN_USAGE,
                           "--final-scale is for the final gather, which --schedule equal does not have; give "
                           "--schedule lean, or --final-scale 1")
               : KILN_OK;
}

/* Checks options that need lightmaps. Denoising works in their texels, and without lightmaps and light at vertices
 * nothing can be exported. */
static int settle_store(struct kiln_job *job, struct kiln_error *error)
{
    if (job->lightmaps.store == KILN_STORE_KIND_VERTEX && given(job, "vertex-light") && !job->lightmaps.vertex_light)
        return kiln_fail(error, KILN_USAGE, "--store vertex and --no-vertex-light exclude each other");
    job->lightmaps.vertex_light = job->lightmaps.vertex_light || job->lightmaps.store == KILN_STORE_KIND_VERTEX;
    const struct {
        const char *name;
        bool wanted;
    } of_lightmaps[] = {{"check-density", job->lightmaps.check_density},
                        {"denoise", job->lightmaps.denoise == KILN_DENOISE_REGRESSION},
                        {"export", job->write_scene && !job->lightmaps.vertex_light},
                        {"indirect-scale", job->light.indirect_scale > 0},
                        {"final-scale", job->light.final_scale > 0},
                        {"guide", job->light.guide > 0}};
    if (job->lightmaps.store == KILN_STORE_KIND_LIGHTMAP)
        return job->lightmaps.leaf_size > 0.0
                   ? kiln_fail(error, KILN_USAGE, "--leaf-size needs --store octree or vertex")
                   : KILN_OK;
    for (size_t i = 0; i < sizeof of_lightmaps / sizeof *of_lightmaps; i++)
        if (given(job, of_lightmaps[i].name) && of_lightmaps[i].wanted)
            return kiln_fail(error, KILN_USAGE, "--%s needs lightmaps%s, which --store %s does not make",
                             of_lightmaps[i].name, i == 2 ? " or --vertex-light" : "",
                             job->lightmaps.store == KILN_STORE_KIND_VERTEX ? "vertex" : "octree");
    job->lightmaps.check_density = false;
    job->lightmaps.denoise = KILN_DENOISE_NONE;
    job->write_scene = job->write_scene && job->lightmaps.vertex_light;
    return KILN_OK;
}

static int check_guide(const struct kiln_job *job, struct kiln_error *error)
{
    if (job->light.schedule == KILN_SCHEDULE_EQUAL)
        return kiln_fail(error, KILN_USAGE,
                         "--guide is for the final gather, which --schedule equal does not have; give --schedule lean, "
                         "or --guide none");
    if (job->light.indirect_scale > 0 || job->light.final_scale > 0)
        return kiln_fail(error, KILN_USAGE,
                         "--guide learns from the rays of every texel: give --indirect-scale 1 and --final-scale 1, or "
                         "--guide none");
    return KILN_OK;
}

/* Options of light paths, which not all --caustics have. Of other methods: settle_reference. */
static int check_paths(struct kiln_job *job, struct kiln_error *error)
{
    static const char *const caustics[] = {"auto", "none", "gather", "land", "merge", "vcm"};
    static const struct {
        const char *name, *what, *choice;
        int from, to; /* enum kiln_caustics */
    } of_paths[] = {{"photons", "traces no light paths", "land", KILN_CAUSTICS_LAND, KILN_CAUSTICS_VCM},
                    {"iterations", "traces no light paths", "land", KILN_CAUSTICS_LAND, KILN_CAUSTICS_VCM},
                    {"merge-radius", "merges nothing", "merge", KILN_CAUSTICS_MERGE, KILN_CAUSTICS_VCM},
                    {"radius-alpha", "merges nothing", "merge", KILN_CAUSTICS_MERGE, KILN_CAUSTICS_VCM},
                    {"mis", "shares nothing", "vcm", KILN_CAUSTICS_VCM, KILN_CAUSTICS_VCM}};
    for (size_t i = 0; i < sizeof of_paths / sizeof *of_paths && !kiln_job_is_reference(job); i++) {
        const int settled = job->light.caustics == KILN_CAUSTICS_AUTO ? KILN_CAUSTICS_VCM : job->light.caustics;
        if ((settled < of_paths[i].from || settled > of_paths[i].to) && given(job, of_paths[i].name))
            return kiln_fail(error, KILN_USAGE, "--%s: --caustics %s %s; give --caustics %s, or leave --%s out",
                             of_paths[i].name, caustics[job->light.caustics], of_paths[i].what, of_paths[i].choice,
                             of_paths[i].name);
    }
    if (job->light.iterations == KILN_ITERATIONS_ALL && !(job->light.target_error > 0.0))
        return kiln_fail(error, KILN_USAGE,
                         "--iterations all: light paths are sent until the error is small enough, and nothing says how "
                         "small; give --target-error, with --max-time where time is to end the bake, or a number of "
                         "iterations");
    return KILN_OK;
}

/* An option that a method does not use, and whether it was asked for. */
struct unused_option {
    const char *name;
    bool wanted;
};

/* The error of published light that --quality asks for, %. */
static double error_asked(const struct kiln_job *job)
{
    double percent;
    return kiln_option_percentage(job->light.quality, &percent) ? percent : preset_of(job->light.quality)->error;
}

/* The option that gives sample counts, or with which light has no rounds; NULL: none does. */
static const char *excludes_rounds(struct kiln_job *job)
{
    const struct kiln_job_light *l = &job->light;
    const struct unused_option others[] = {{"samples-direct", given(job, "samples-direct")},
                                           {"samples-bounce", given(job, "samples-bounce")},
                                           {"samples-indirect", given(job, "samples-indirect")},
                                           {"target-error", l->target_error > 0.0},
                                           {"keep-transport", l->keep != KILN_KEEP_NONE},
                                           {"light-groups", job->scene.light_groups != NULL},
                                           {"sky-patches", job->scene.sky_patches != 0},
                                           {"only-visible-from", l->only_visible_from != NULL},
                                           {"indirect-scale", l->indirect_scale > 0},
                                           {"final-scale", l->final_scale > 0},
                                           {"schedule", l->schedule != KILN_SCHEDULE_LEAN},
                                           {"method", kiln_job_is_reference(job) || kiln_job_is_radiosity(job)},
                                           {"store", job->lightmaps.store != KILN_STORE_KIND_LIGHTMAP},
                                           {"relight", job->command != NULL && strcmp(job->command, "relight") == 0},
                                           {"states", job->relighting.states != NULL || job->relighting.listen}};
    for (size_t i = 0; i < sizeof others / sizeof *others; i++)
        if (others[i].wanted)
            return others[i].name;
    return NULL;
}

/* Reads --rounds: ascending levels, or 0 alone. */
static int read_rounds(struct kiln_job *job, struct kiln_error *error)
{
    struct kiln_round_list list = {.given = job->light.rounds != NULL};
    const char *at = job->light.rounds;
    while (at != NULL && *at != '\0') {
        char *end;
        const unsigned long level = *at >= '0' && *at <= '9' ? strtoul(at, &end, 10) : KILN_ROUND_LEVELS;
        const uint32_t last = list.count > 0 ? list.levels[list.count - 1] : 0;
        if (level >= KILN_ROUND_LEVELS || (*end != ',' && *end != '\0') || (*end == ',' && end[1] == '\0') ||
            (level <= last && !(level == 0 && list.count == 0 && *end == '\0')))
            return kiln_fail(error, KILN_USAGE,
                             "--rounds %s: give ascending levels below %d, such as 3,7, or 0 for the first round alone",
                             job->light.rounds, KILN_ROUND_LEVELS);
        if (level > 0)
            list.levels[list.count++] = (uint8_t)level;
        at = *end == ',' ? end + 1 : end;
    }
    if (job->light.rounds != NULL && *job->light.rounds == '\0')
        return kiln_fail(error, KILN_USAGE, "--rounds is empty: give ascending levels, such as 3,7");
    job->light.round_list = list;
    return KILN_OK;
}

/* Makes the error that --quality stands for a target of bakes. A preset's sample counts take its place where an option
 * excludes rounds; an error in % is refused then. */
static int settle_quality(struct kiln_job *job, uint32_t command, struct kiln_error *error)
{
    struct kiln_job_light *l = &job->light;
    double percent;
    const char *excluding = excludes_rounds(job);
    l->published_error = 0.0;
    l->counted_for = excluding;
    job->lightmaps.texels = (command & KILN_FOR_VIEW) == 0 ? (double)preset_of(l->quality)->texels : 0.0;
    if ((command & (KILN_FOR_BAKE | KILN_FOR_PLAN | KILN_FOR_SUBMIT)) == 0)
        return KILN_OK;
    if (excluding != NULL && kiln_option_percentage(l->quality, &percent))
        return kiln_fail(
            error, KILN_USAGE,
            "--quality %s asks for an error, and --%s excludes that; leave it out, or give a preset, whose "
            "sample counts are taken then (--quality preview)",
            l->quality, excluding);
    const char *of_rounds = l->time > 0.0 ? "time" : l->rounds != NULL ? "rounds" : NULL;
    if (excluding != NULL && of_rounds != NULL)
        return kiln_fail(error, KILN_USAGE, "--%s is about rounds of samples, and --%s excludes rounds: leave one out",
                         of_rounds, excluding);
    const bool timed = of_rounds != NULL && !given(job, "quality");
    l->published_error = excluding != NULL ? 0.0 : timed ? TIMED_ERROR : error_asked(job) / 100.0;
    return read_rounds(job, error);
}

static int refuse_unused(const struct kiln_job *job, const struct unused_option *options, size_t count,
                         struct kiln_error *error)
{
    for (size_t i = 0; i < count; i++)
        if (options[i].wanted)
            return kiln_fail(error, KILN_USAGE,
                             "--%s is for --method cells, and --method %s has no use for it: leave one of the two out",
                             options[i].name, job->light.method);
    return KILN_OK;
}

/* Refuses the options of gathering in "cells", for other methods. */
static int refuse_cells(struct kiln_job *job, struct kiln_error *error)
{
    const struct unused_option of_cells[] = {
        {"tail", job->light.tail && given(job, "tail")},
        {"schedule", job->light.schedule != KILN_SCHEDULE_LEAN && given(job, "schedule")},
        {"indirect-scale", job->light.indirect_scale > 0},
        {"final-scale", job->light.final_scale > 0},
        {"guide", job->light.guide > 0},
        {"caustics", job->light.caustics != KILN_CAUSTICS_AUTO},
        {"photons", given(job, "photons")},
        {"iterations", given(job, "iterations")},
        {"radius-alpha", given(job, "radius-alpha")},
        {"mis", given(job, "mis")},
        {"tracing-range", kiln_job_has_probes(job)}};
    return refuse_unused(job, of_cells, sizeof of_cells / sizeof *of_cells, error);
}

/* Refuses options of patches, for other methods. */
static int refuse_patches(struct kiln_job *job, struct kiln_error *error)
{
    static const char *const of_patches[] = {
        "patches",   "link-error",  "lights",     "undersample", "directions",   "sampling-window",
        "subdivide", "node-max",    "gather",     "clamp",       "albedo-scale", "visibility-cache",
        "order",     "unshot-left", "visibility", "voxels",      "keep-nodes"};
    for (size_t i = 0; i < sizeof of_patches / sizeof *of_patches; i++)
        if (given(job, of_patches[i]))
            return kiln_fail(error, KILN_USAGE,
                             "--%s is for light between patches: give --method radiosity, or leave --%s out",
                             of_patches[i], of_patches[i]);
    return KILN_OK;
}

/* Checks options with links, which replace the options of nodes by a tree of their own. */
static int check_links(struct kiln_job *job, struct kiln_error *error)
{
    const struct unused_option others[] = {
        {"undersample", job->light.patches.undersample != KILN_SAMPLE_ALL},
        {"subdivide", job->light.patches.subdivide > 0.0},
        {"clamp", job->light.patches.clamp},
        {"visibility-cache", job->light.patches.visibility_cache > 0.0},
        {"order unshot", job->light.patches.order == KILN_ORDER_UNSHOT},
        {"visibility voxels", job->light.patches.visibility == KILN_VISIBILITY_VOXELS}};
    for (size_t i = 0; job->light.patches.patches == KILN_PATCHES_LINKS && i < sizeof others / sizeof *others; i++)
        if (others[i].wanted)
            return kiln_fail(error, KILN_USAGE,
                             "--%s is for patches that all texels gather from: leave --patches links or --%s out",
                             others[i].name, others[i].name);
    return KILN_OK;
}

/* Checks options of gathering by rays. Rays read single texels, and there are no form factors to adjust. */
static int check_gather(struct kiln_job *job, struct kiln_error *error)
{
    static const char *const of_pairs[] = {"undersample", "subdivide",   "sampling-window", "node-max",
                                           "clamp",       "patches",     "link-error",      "visibility-cache",
                                           "order",       "unshot-left", "visibility",      "voxels"};
    const uint32_t directions = job->light.patches.directions;
    const bool pairs = job->light.patches.gather == KILN_GATHER_PAIRS;
    for (size_t i = 0; i < sizeof of_pairs / sizeof *of_pairs && !pairs; i++)
        if (given(job, of_pairs[i]))
            return kiln_fail(error, KILN_USAGE, "--%s is for pairs of patches: give --gather pairs, or leave it out",
                             of_pairs[i]);
    if (job->light.patches.gather == KILN_GATHER_CIRCLES &&
        (directions > 0 ? directions : job->light.samples_indirect) > KILN_CIRCLES_MOST)
        return kiln_fail(error, KILN_USAGE,
                         "--gather circles has %d directions at most: give --gather circles:%d, or even",
                         KILN_CIRCLES_MOST, KILN_CIRCLES_MOST);
    if (job->light.patches.gather == KILN_GATHER_CIRCLES &&
        (directions > 0 ? directions : job->light.samples_indirect) < KILN_CIRCLES_LEAST)
        return kiln_fail(
            error, KILN_USAGE,
            "--gather circles needs %d directions: fewer have so few heights that the light is off by 2 to "
            "6 %% all over; give --gather circles:%d, or even",
            KILN_CIRCLES_LEAST, KILN_CIRCLES_LEAST);
    return KILN_OK;
}

/* Checks the options for nodes that patches gather from. */
static int check_nodes(struct kiln_job *job, struct kiln_error *error)
{
    const bool samples = job->light.patches.undersample != KILN_SAMPLE_ALL,
               divides = job->light.patches.subdivide > 0.0;
    if (samples && divides)
        return kiln_fail(
            error, KILN_USAGE,
            "--undersample and --subdivide both say what stands for several texels: leave one of them out");
    if (job->light.patches.keep_nodes && !samples && !divides)
        return kiln_fail(error, KILN_USAGE,
                         "--keep-nodes: each texel is a node; give --undersample or --subdivide, or leave it out");
    if ((samples || divides) && job->lightmaps.store != KILN_STORE_KIND_LIGHTMAP)
        return kiln_fail(error, KILN_USAGE,
                         "--%s is for texels, which lie beside each other: give --store lightmap, or leave it out",
                         samples ? "undersample" : "subdivide");
    return KILN_OK;
}

/* Checks options with rounds of unshot light, which complete rows in the same way as the step before them. */
static int check_order(struct kiln_job *job, struct kiln_error *error)
{
    const struct unused_option others[] = {{"undersample random", job->light.patches.undersample == KILN_SAMPLE_RANDOM},
                                           {"subdivide", job->light.patches.subdivide > 0.0},
                                           {"clamp", job->light.patches.clamp}};
    for (size_t i = 0; job->light.patches.order == KILN_ORDER_UNSHOT && i < sizeof others / sizeof *others; i++)
        if (others[i].wanted)
            return kiln_fail(error, KILN_USAGE,
                             "--%s is not for --order unshot, whose nodes and view factors stay from round to round: "
                             "leave one of the two out",
                             others[i].name);
    return KILN_OK;
}

/* Refuses second values without the first value that they belong to. */
static int check_seconds(struct kiln_job *job, struct kiln_error *error)
{
    static const char *const names[] = {"link-error",      "unshot-left", "directions",
                                        "sampling-window", "node-max",    "voxels"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        const struct kiln_option *option = kiln_option_find(names[i]);
        const bool behind = kiln_option_behind(job, option);
        char room[KILN_OPTION_TEXT];
        const char *text = kiln_option_text(job, option, room);
        if (given(job, names[i]) && !option->when->holds(job) && strcmp(text, option->fallback) != 0)
            return kiln_fail(error, KILN_USAGE, "--%s%s%s: %s, or leave %s out",
                             behind ? option->second_of : option->name, behind ? " ...:" : "", behind ? text : "",
                             option->when->otherwise, behind ? "that number" : "it");
    }
    return KILN_OK;
}

/* Checks options of radiosity. Patches are diffuse, and only with links does light have noise whose error can be
 * stated. */
static int settle_radiosity(struct kiln_job *job, struct kiln_error *error)
{
    const struct unused_option others[] = {
        {"merge-radius", given(job, "merge-radius")},
        {"samples-bounce", given(job, "samples-bounce")},
        {"schedule lean", given(job, "schedule") && job->light.schedule == KILN_SCHEDULE_LEAN},
        {"target-error", job->light.target_error > 0.0 && !kiln_job_has_links(job)},
        {"error-map", job->lightmaps.error_map && !kiln_job_has_links(job)},
        {"only-visible-from", job->light.only_visible_from != NULL},
        {"exchange-points", job->ranks.exchange_points == KILN_EXCHANGE_VISIBLE}};
    int status = refuse_cells(job, error);
    if (status == KILN_OK)
        status = refuse_unused(job, others, sizeof others / sizeof *others, error);
    if (status != KILN_OK)
        return status;
    if (job->light.materials != KILN_GLOSS_MODE_DIFFUSE && given(job, "materials"))
        return kiln_fail(error, KILN_USAGE,
                         "--method radiosity knows the diffuse part of materials alone: give --materials diffuse, or "
                         "--method cells");
    KILN_TRY(check_links(job, error));
    KILN_TRY(check_gather(job, error));
    KILN_TRY(check_nodes(job, error));
    KILN_TRY(check_order(job, error));
    KILN_TRY(check_seconds(job, error));
end:
    if (status != KILN_OK)
        return status;
    job->light.diffuse_unasked = !given(job, "materials");
    job->light.materials = KILN_GLOSS_MODE_DIFFUSE;
    job->light.tail = false;
    job->light.schedule = KILN_SCHEDULE_EQUAL;
    return KILN_OK;
}

/* Checks options of paths from surface points. Embree traces them, unless Vulkan is asked for. */
static int settle_reference(struct kiln_job *job, struct kiln_error *error)
{
    const int status = refuse_cells(job, error);
    if (status != KILN_OK)
        return status;
    if (given(job, "merge-radius") && strcmp(job->light.method, "vcm") != 0)
        return kiln_fail(error, KILN_USAGE,
                         "--merge-radius: --method %s merges nothing; give --method vcm, or leave --merge-radius out",
                         job->light.method);
    job->light.tail = false;
    job->light.paths = (struct kiln_reference_parameters){
        .method = strcmp(job->light.method, "path") == 0   ? KILN_REFERENCE_PATH
                  : strcmp(job->light.method, "bdpt") == 0 ? KILN_REFERENCE_BDPT
                                                           : KILN_REFERENCE_VCM,
        .radius = job->light.merge_radius > 0.0 ? job->light.merge_radius : 0.0,
        .bounces = job->light.bounces < 0 ? KILN_PATH_ALL_BOUNCES : (uint32_t)job->light.bounces};
    return strcmp(job->machine.backend, "vulkan") == 0
               ? KILN_OK
               : kiln_job_keep(job, "embree", strlen("embree"), &job->machine.backend, error);
}

/* Checks options of light against one another, and derives others from them. */
static int settle_light(struct kiln_job *job, uint32_t commands, struct kiln_error *error)
{
    int status;
    KILN_TRY((commands & (KILN_FOR_BAKE | KILN_FOR_PLAN)) != 0 ? check_paths(job, error) : KILN_OK);
    if (kiln_job_is_reference(job))
        KILN_TRY(settle_reference(job, error));
    if (kiln_job_is_radiosity(job))
        KILN_TRY(settle_radiosity(job, error));
    else
        KILN_TRY(refuse_patches(job, error));
    if (job->light.indirect_scale > 0 && job->light.schedule == KILN_SCHEDULE_EQUAL)
        KILN_TRY(kiln_fail(error, KILN_USAGE,
                           "--indirect-scale is for bounces that a final gather reads: --schedule equal has no final "
                           "gather; give --schedule lean, or --indirect-scale 1"));
    if (job->light.final_scale > 0)
        KILN_TRY(check_final_scale(job, error));
    if (job->light.guide > 0)
        KILN_TRY(check_guide(job, error));
    if (job->light.only_visible_from != NULL)
        KILN_TRY(check_visible_from(job, error));
    if (job->ranks.exchange_points == KILN_EXCHANGE_VISIBLE && kiln_job_has_probes(job))
        KILN_TRY(
            kiln_fail(error, KILN_USAGE,
                      "--exchange-points visible sends what surface points see, and radiance probes see more: give "
                      "--tracing-range inf, or --exchange-points all"));
    KILN_TRY(settle_store(job, error));
    KILN_TRY(settle_quality(job, commands, error));
end:
    return status;
}

int kiln_job_settle_light(struct kiln_job *job, struct kiln_error *error)
{
    const bool unasked = job->light.diffuse_unasked;
    const int status = settle_light(job, KILN_FOR_BAKE, error);
    job->light.diffuse_unasked = unasked;
    return status;
}

/* Sets the output folder of a command that has a default for it. */
static int default_output(struct kiln_job *job, const struct kiln_command *command, struct kiln_error *error)
{
    const char *ending = (command->bit & (KILN_FOR_BAKE | KILN_FOR_IMPORT)) != 0 ? "-bake"
                         : command->bit == KILN_FOR_RELIGHT                      ? "-relit"
                         : command->bit == KILN_FOR_MIX                          ? "-mixed"
                                                                                 : NULL;
    if (ending == NULL || job->output != NULL)
        return KILN_OK;
    return kiln_job_default_output(job, job->arguments[0], ending, error);
}

/* Reads the files that options name, checks options against one another, and derives others from them. */
static int complete(struct kiln_job *job, const struct kiln_command *command, struct kiln_error *error)
{
    int status;
    KILN_TRY(kiln_job_changes_read(job, error));
    KILN_TRY(kiln_job_groups_read(job, error));
    KILN_TRY(kiln_job_states_read(job, error));
    KILN_TRY(default_output(job, command, error));
    if (!given(job, "tail"))
        job->light.tail = job->light.bounces < 0;
    KILN_TRY(settle_light(job, command->bit, error));
    if (job->relighting.states != NULL && job->relighting.listen)
        KILN_TRY(
            kiln_fail(error, KILN_USAGE, "--states and --listen exclude each other: a line of --listen is a state"));
    if (job->quiet && job->verbose)
        KILN_TRY(kiln_fail(error, KILN_USAGE, "--quiet and --verbose exclude each other"));
end:
    return status;
}

/* Reads the job file and the command line, which wins. */
static int fill(struct kiln_job *job, const struct kiln_command *command, int argc, char **argv,
                struct kiln_error *error)
{
    int status = set_defaults(job, error);
    if (status == KILN_OK)
        status = read_command_line(job, command, argc, argv, "devices", error);
    if (status == KILN_OK)
        status = read_command_line(job, command, argc, argv, "quality", error);
    if (status == KILN_OK)
        status = check_arguments(job, command, error);
    if (status == KILN_OK && command->bit == KILN_FOR_BENCH)
        job->scene.file = job->arguments[1];
    const bool scene = status == KILN_OK && command->scene && job->argument_count > 0;
    const char *file = scene && kiln_is_yaml(job->arguments[0]) ? job->arguments[0] : NULL;
    if (file != NULL && !given(job, "quality"))
        status = kiln_job_file_read_quality(job, file, error);
    if (status != KILN_OK)
        return status;
    set_quality(job);
    if (file != NULL)
        status = kiln_job_file_read(job, file, error);
    else if (scene)
        status = kiln_job_keep(job, job->arguments[0], strlen(job->arguments[0]), &job->scene.file, error);
    if (status == KILN_OK)
        status = read_command_line(job, command, argc, argv, NULL, error);
    return status == KILN_OK ? complete(job, command, error) : status;
}

int kiln_job_parse(struct kiln_job **job, int argc, char **argv, struct kiln_error *error)
{
    *job = NULL;
    if (argc < 2)
        return kiln_fail(error, KILN_USAGE, "no command given; kiln --help lists them");
    const struct kiln_command *command = kiln_command_find(argv[1]);
    if (command == NULL)
        return kiln_command_unknown(argv[1], error);
    struct kiln_job *made = NULL;
    struct kiln_job_owned *own = NULL;
    int status = kiln_allocate(&made, 1, sizeof *made, "the job", error);
    if (status == KILN_OK) {
        status = kiln_allocate(&own, 1, sizeof *own, "the job", error);
        made->strings = own;
    }
    if (status == KILN_OK)
        status = kiln_allocate(&own->given, kiln_option_count, sizeof(bool), "the job", error);
    if (status == KILN_OK)
        status = kiln_allocate(&own->renamed, kiln_option_count, sizeof(bool), "the job", error);
    if (status == KILN_OK)
        status = kiln_allocate(&made->arguments, (size_t)argc, sizeof(char *), "the job", error);
    if (status == KILN_OK) {
        made->command = command->name;
        status = fill(made, command, argc, argv, error);
    }
    if (status == KILN_OK)
        status = kiln_faults_read(&made->faults, error);
    if (status == KILN_OK)
        *job = made;
    else
        kiln_job_destroy(&made);
    return status;
}

bool kiln_option_behind(const struct kiln_job *job, const struct kiln_option *option)
{
    const struct kiln_job_owned *own = job->strings;
    return option->second_of != NULL && own->given[option - kiln_options] && !own->renamed[option - kiln_options];
}

/* The present form of an option that was given by its former name. */
static void print_renamed(const struct kiln_job *job, const struct kiln_option *option, FILE *stream)
{
    char room[KILN_OPTION_TEXT];
    if (option->second_of == NULL)
        (void)fprintf(stream, "kiln: note: the option %s is now called %s; ", option->former, option->name);
    else
        (void)fprintf(stream, "kiln: note: the option %s is now part of %s: write %s %s; ", option->name,
                      option->second_of, option->second_of,
                      kiln_option_argument(job, kiln_option_find_for(option->second_of, option->commands), room));
    (void)fputs("the next version will not accept the old name\n", stream);
}

void kiln_job_print_renamed(const struct kiln_job *job, FILE *stream)
{
    const struct kiln_job_owned *own = job->strings;
    for (size_t i = 0; i < kiln_option_count; i++)
        if (own->renamed[i])
            print_renamed(job, &kiln_options[i], stream);
}

void kiln_job_destroy(struct kiln_job **job)
{
    if (*job == NULL)
        return;
    struct kiln_job_owned *own = owned(*job);
    if (own != NULL) {
        for (size_t i = 0; i < own->count; i++)
            kiln_free(&own->strings[i]);
        kiln_free(&own->strings);
        kiln_free(&own->given);
        kiln_free(&own->renamed);
    }
    kiln_free(&own);
    kiln_free(&(*job)->arguments);
    kiln_free(job);
}
