/* kiln import: reads a scene, or the parts of one, as a bake does first, and ends. */
#include <stdio.h>

#include <jansson.h>
#include <mpi.h>

#include "coordinator/bake/prepare/import_scene.h"
#include "coordinator/cli/commands.h"
#include "coordinator/files/json.h"
#include "coordinator/files/publish.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/run/output_folder.h"
#include "worker/base/text.h"

static json_t *import_json(const struct kiln_job *job, const struct kiln_scene_import *import,
                           const struct kiln_scene *scene, const char *path)
{
    json_t *json = json_pack("{s:s, s:o, s:o, s:b, s:f, s:I, s:I, s:I}", "status", "done", "scene",
                             kiln_json_string(job->scene.file), "scene_file", kiln_json_string(path), "up_to_date",
                             (int)import->report.cached, "seconds", import->report.seconds, "objects",
                             (json_int_t)scene->object_count, "triangles", (json_int_t)scene->triangle_count,
                             "scene_file_bytes", (json_int_t)scene->mapped_bytes);
    json_t *parts = kiln_parts_report(job, import->parts);
    if (parts != NULL)
        (void)json_object_set_new(json, "parts", parts);
    return json;
}

/* Rank 0. */
static int print_import(const struct kiln_job *job, const struct kiln_scene_import *import, const char *path,
                        struct kiln_error *error)
{
    struct kiln_scene *scene = NULL;
    char parts[400];
    int status;
    KILN_TRY(kiln_scene_open(&scene, path, error));
    if (job->json) {
        KILN_TRY(kiln_json_print(import_json(job, import, scene, path), error));
    } else if (!job->quiet) {
        kiln_parts_sentence(job, import->parts, parts, sizeof parts);
        if (import->parts != NULL)
            kiln_print(stdout, "%s\n", parts);
        kiln_print(stdout, "%s %s: %zu objects, %zu triangles stored, %.1f MiB\n", path,
                   import->report.cached ? "was up to date" : "is written", scene->object_count, scene->triangle_count,
                   (double)scene->mapped_bytes / 0x1p20);
    }
end:
    kiln_scene_close(&scene);
    return status;
}

int kiln_command_import(struct kiln_job *job, struct kiln_error *error)
{
    const struct kiln_output_folder_params params = {
        .directory = job->output, .kind = KILN_FOLDER_LOCKED, .no_locks = job->faults.no_locks};
    struct kiln_output_folder *folder = NULL;
    struct kiln_scene_import import = {0};
    char path[KILN_PATH_SIZE];
    int rank, status;
    (void)MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    KILN_TRY(kiln_path_join(path, job->output, "scene.kscene", error));
    KILN_TRY(
        kiln_agree(MPI_COMM_WORLD, rank == 0 ? kiln_output_folder_begin(&folder, &params, error) : KILN_OK, error));
    KILN_TRY(kiln_scene_import(&import, MPI_COMM_WORLD, job, path, NULL, error));
    KILN_TRY(kiln_agree(MPI_COMM_WORLD, rank == 0 ? print_import(job, &import, path, error) : KILN_OK, error));
end:
    kiln_scene_import_release(&import);
    kiln_output_folder_end(&folder, status == KILN_OK);
    return status;
}
