/* kiln generate: makes a scene file. */
#include <inttypes.h>
#include <jansson.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/cli/commands.h"
#include "coordinator/files/json.h"
#include "coordinator/job/options.h"
#include "coordinator/files/output_name.h"
#include "coordinator/files/publish.h"
#include "coordinator/generate/scenes.h"
#include "worker/base/memory.h"
#include "worker/base/text.h"

static void list(void)
{
    (void)printf("Scenes that kiln generate NAME -o FILE.glb makes\n");
    for (size_t i = 0; i < kiln_generator_count; i++)
        (void)printf("  %-16s%s\n", kiln_generators[i].name, kiln_generators[i].description);
}

static int list_json(struct kiln_error *error)
{
    json_t *names = json_array();
    for (size_t i = 0; i < kiln_generator_count; i++)
        (void)json_array_append_new(names, json_pack("{s:s, s:s}", "name", kiln_generators[i].name, "description",
                                                     kiln_generators[i].description));
    return kiln_json_print(json_pack("{s:s, s:o}", "status", "done", "scenes", names), error);
}

static int find(const char *name, const struct kiln_generator **found, struct kiln_error *error)
{
    char names[512] = "";
    const char *nearest = NULL;
    size_t least = SIZE_MAX;
    for (size_t i = 0; i < kiln_generator_count; i++) {
        if (strcmp(kiln_generators[i].name, name) == 0) {
            *found = &kiln_generators[i];
            return KILN_OK;
        }
        const size_t used = strlen(names), distance = kiln_edit_distance(name, kiln_generators[i].name);
        (void)snprintf(names + used, sizeof names - used, "%s%s", i == 0 ? "" : ", ", kiln_generators[i].name);
        if (distance < least && kiln_is_near(name, kiln_generators[i].name)) {
            least = distance;
            nearest = kiln_generators[i].name;
        }
    }
    if (nearest == NULL)
        return kiln_fail(error, KILN_USAGE, "no scene is called '%.100s'; there are: %s", name, names);
    return kiln_fail(error, KILN_USAGE, "no scene is called '%.100s'; the nearest one is '%s' (there are: %s)", name,
                     nearest, names);
}

/* Refuses options that the scene does not use. */
static int check_options(const struct kiln_job *job, const struct kiln_generator *generator, struct kiln_error *error)
{
    const char *unused = NULL;
    if (job->generated.triangles != 0 && (generator->takes & KILN_TAKES_TRIANGLES) == 0)
        unused = "--triangles";
    if ((job->generated.columns != 0 || job->generated.rows != 0) && (generator->takes & KILN_TAKES_GRID) == 0)
        unused = "--columns or --rows";
    if (job->generated.albedo >= 0 && (generator->takes & KILN_TAKES_ALBEDO) == 0)
        unused = "--albedo";
    if ((job->generated.distinct || job->generated.parts > 1) && (generator->takes & KILN_TAKES_PARTS) == 0)
        unused = "--distinct or --parts";
    if (unused != NULL)
        return kiln_fail(error, KILN_USAGE, "the scene %s takes no %s; it is %s", generator->name, unused,
                         generator->description);
    return KILN_OK;
}

static int report(const struct kiln_job *job, const struct kiln_generator *generator,
                  const struct kiln_glb_totals *totals, struct kiln_error *error)
{
    const uint32_t parts = job->generated.parts;
    if (!job->json) {
        char files[32] = "";
        if (parts > 1)
            (void)snprintf(files, sizeof files, " of %" PRIu32 " parts", parts);
        if (!job->quiet)
            kiln_print(stdout,
                       "%s: %s%s, %" PRIu64 " triangles (%" PRIu64 " with instances) in %" PRIu64 " meshes, %" PRIu64
                       " nodes, %.2f MB\n",
                       job->output, generator->name, files, totals->triangles, totals->triangles_placed, totals->meshes,
                       totals->nodes, (double)totals->bytes * 1e-6);
        return KILN_OK;
    }
    json_t *json =
        json_pack("{s:s, s:s, s:o, s:I, s:I, s:I, s:I, s:I}", "status", "done", "scene", generator->name, "file",
                  kiln_json_string(job->output), "triangles", (json_int_t)totals->triangles, "triangles_with_instances",
                  (json_int_t)totals->triangles_placed, "meshes", (json_int_t)totals->meshes, "nodes",
                  (json_int_t)totals->nodes, "bytes", (json_int_t)totals->bytes);
    if (parts > 1)
        (void)json_object_set_new(json, "parts", json_integer((json_int_t)parts));
    return kiln_json_print(json, error);
}

/* Makes one file of the scene, and adds what it has to the totals. */
static int make_file(const struct kiln_job *job, const struct kiln_generator *generator, uint32_t part,
                     const char *path, struct kiln_glb_totals *totals, struct kiln_error *error)
{
    const struct kiln_generate_params params = {.triangles = job->generated.triangles,
                                                .columns = job->generated.columns,
                                                .rows = job->generated.rows,
                                                .albedo = job->generated.albedo >= 0 ? job->generated.albedo : 0.5,
                                                .seed = job->light.seed,
                                                .distinct = job->generated.distinct,
                                                .part = part,
                                                .parts = job->generated.parts};
    struct kiln_glb_totals own;
    struct kiln_glb *glb = NULL;
    int status;
    KILN_TRY(kiln_glb_create(&glb, error));
    KILN_TRY(generator->build(glb, generator, &params, error));
    KILN_TRY(kiln_glb_write(glb, path, error));
    kiln_glb_totals(glb, &own);
    totals->triangles += own.triangles;
    totals->triangles_placed += own.triangles_placed;
    totals->meshes += own.meshes;
    totals->nodes += own.nodes;
    totals->bytes += own.bytes;
end:
    kiln_glb_destroy(&glb);
    return status;
}

/* Makes the files of parts, NAME-1.glb, ..., and then the job NAME.yaml that lists them. */
static int make_parts(const struct kiln_job *job, const struct kiln_generator *generator,
                      struct kiln_glb_totals *totals, struct kiln_error *error)
{
    const uint32_t parts = job->generated.parts;
    const int stem = (int)(strlen(job->output) - strlen(".yaml")), digits = snprintf(NULL, 0, "%" PRIu32, parts);
    const char *slash = strrchr(job->output, '/'), *base = slash == NULL ? job->output : slash + 1;
    const size_t line = strlen(base) + 80;
    char path[KILN_PATH_SIZE], *text = NULL;
    size_t length = 0;
    int status;
    KILN_TRY(kiln_allocate(&text, (parts + 1) * line, 1, "the job", error));
    length = (size_t)snprintf(text, line, "parts:\n");
    for (uint32_t k = 0; k < parts; k++) {
        if (snprintf(path, sizeof path, "%.*s-%0*" PRIu32 ".glb", stem, job->output, digits, k + 1) >= KILN_PATH_SIZE)
            KILN_TRY(kiln_fail(error, KILN_USAGE, "-o %.200s: the path is too long", job->output));
        KILN_TRY(make_file(job, generator, k, path, totals, error));
        length +=
            (size_t)snprintf(text + length, line, "  - {name: part_%0*" PRIu32 ", file: \"%.*s-%0*" PRIu32 ".glb\"}\n",
                             digits, k + 1, stem - (int)(base - job->output), base, digits, k + 1);
    }
    KILN_TRY(kiln_publish_bytes(job->output, text, length, error));
end:
    kiln_free(&text);
    return status;
}

static int check_output(const struct kiln_job *job, const struct kiln_generator *generator, struct kiln_error *error)
{
    const char *ending = job->generated.parts > 1 ? ".yaml" : ".glb";
    const struct kiln_output_name name = {.option = "--output", .path = job->output};
    if (job->output == NULL)
        return kiln_fail(error, KILN_USAGE, "say where the scene goes: kiln generate %s -o %s%s", generator->name,
                         generator->name, ending);
    const size_t length = strlen(job->output), end = strlen(ending);
    if (length < end + 1 || strcmp(job->output + length - end, ending) != 0)
        return kiln_fail(error, KILN_USAGE, "-o %.200s: the file's name must end in %s", job->output, ending);
    if (job->generated.parts > 1 && strpbrk(job->output, "\"\\") != NULL)
        return kiln_fail(error, KILN_USAGE, "-o %.200s: a job cannot name files with \" or \\ in their names",
                         job->output);
    return kiln_output_name_check(&name, error);
}

int kiln_command_generate(struct kiln_job *job, struct kiln_error *error)
{
    const struct kiln_generator *generator = NULL;
    struct kiln_glb_totals totals = {0};
    if (job->argument_count == 0 && job->output == NULL) {
        if (job->json)
            return list_json(error);
        list();
        return KILN_OK;
    }
    if (job->argument_count == 0)
        return kiln_fail(error, KILN_USAGE, "name the scene to generate; kiln generate lists them");
    int status;
    KILN_TRY(find(job->arguments[0], &generator, error));
    KILN_TRY(check_options(job, generator, error));
    KILN_TRY(check_output(job, generator, error));
    KILN_TRY(job->generated.parts > 1 ? make_parts(job, generator, &totals, error)
                                      : make_file(job, generator, 0, job->output, &totals, error));
    KILN_TRY(report(job, generator, &totals, error));
end:
    return status;
}
