/* kiln generate: makes a scene file. */
#include <inttypes.h>
#include <jansson.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/cli/commands.h"
#include "coordinator/files/json.h"
#include "coordinator/job/options.h"
#include "coordinator/files/output_name.h"
#include "coordinator/generate/scenes.h"
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
    if (unused != NULL)
        return kiln_fail(error, KILN_USAGE, "the scene %s takes no %s; it is %s", generator->name, unused,
                         generator->description);
    return KILN_OK;
}

static int report(const struct kiln_job *job, const struct kiln_generator *generator, const struct kiln_glb *glb,
                  struct kiln_error *error)
{
    struct kiln_glb_totals totals;
    kiln_glb_totals(glb, &totals);
    if (!job->json) {
        if (!job->quiet)
            kiln_print(stdout,
                       "%s: %s, %" PRIu64 " triangles (%" PRIu64 " with instances) in %" PRIu64 " meshes, %" PRIu64
                       " nodes, %.2f MB\n",
                       job->output, generator->name, totals.triangles, totals.triangles_placed, totals.meshes,
                       totals.nodes, (double)totals.bytes * 1e-6);
        return KILN_OK;
    }
    return kiln_json_print(json_pack("{s:s, s:s, s:o, s:I, s:I, s:I, s:I, s:I}", "status", "done", "scene",
                                     generator->name, "file", kiln_json_string(job->output), "triangles",
                                     (json_int_t)totals.triangles, "triangles_with_instances",
                                     (json_int_t)totals.triangles_placed, "meshes", (json_int_t)totals.meshes, "nodes",
                                     (json_int_t)totals.nodes, "bytes", (json_int_t)totals.bytes),
                           error);
}

int kiln_command_generate(struct kiln_job *job, struct kiln_error *error)
{
    const struct kiln_generator *generator = NULL;
    struct kiln_glb *glb = NULL;
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
    if (job->output == NULL)
        KILN_TRY(kiln_fail(error, KILN_USAGE, "say where the scene goes: kiln generate %s -o %s.glb", generator->name,
                           generator->name));
    if (strlen(job->output) < 5 || strcmp(job->output + strlen(job->output) - 4, ".glb") != 0)
        KILN_TRY(kiln_fail(error, KILN_USAGE, "-o %.200s: the file's name must end in .glb", job->output));
    const struct kiln_output_name name = {.option = "--output", .path = job->output};
    KILN_TRY(kiln_output_name_check(&name, error));
    KILN_TRY(kiln_glb_create(&glb, error));
    const struct kiln_generate_params params = {.triangles = job->generated.triangles,
                                                .columns = job->generated.columns,
                                                .rows = job->generated.rows,
                                                .albedo = job->generated.albedo >= 0 ? job->generated.albedo : 0.5,
                                                .seed = job->light.seed};
    KILN_TRY(generator->build(glb, generator, &params, error));
    KILN_TRY(kiln_glb_write(glb, job->output, error));
    KILN_TRY(report(job, generator, glb, error));
end:
    kiln_glb_destroy(&glb);
    return status;
}
