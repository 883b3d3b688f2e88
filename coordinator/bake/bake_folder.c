#include <errno.h>
#include <stdio.h>
#include <sys/stat.h>
#include <unistd.h>

#include "coordinator/bake/bake_private.h"
#include "coordinator/files/output_name.h"
#include "coordinator/files/publish.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/output/manifest.h"
#include "worker/base/text.h"

int kiln_bake_make_folder(struct kiln_bake *b, struct kiln_error *error)
{
    int status = kiln_path_join(b->scene_file, b->job->output, "scene.kscene", error);
    if (status == KILN_OK && b->rank == 0) {
        struct stat there;
        b->made_folder = stat(b->job->output, &there) != 0;
        status = kiln_make_directories(b->job->output, error);
    }
    return kiln_agree(b->communicator, status, error);
}

void kiln_bake_forget_folder(const struct kiln_bake *b)
{
    if (b->rank == 0 && b->made_folder)
        (void)rmdir(b->job->output);
}

int kiln_bake_check_folder(struct kiln_bake *b, struct kiln_error *error)
{
    static const struct kiln_manifest_parts all = {.volume = true, .preview = true, .scene = true};
    const struct kiln_output_name trace = {.option = "--trace",
                                           .path = b->job->trace,
                                           .inputs = {b->job->scene, b->job->arguments[0], b->job->environment},
                                           .bakes = {b->job->output}};
    int status = KILN_OK;
    if (b->rank == 0) {
        status = kiln_manifest_look(b->job->output, NULL, NULL, &all, error);
        if (status == KILN_OK && b->job->trace != NULL)
            status = kiln_output_name_check(&trace, error);
    }
    return kiln_agree(b->communicator, status, error);
}

static int make_lightmap_folder(struct kiln_bake *b, struct kiln_error *error)
{
    struct kiln_folder folder;
    int status = KILN_OK;
    if (b->rank == 0 && b->job->store == KILN_STORE_KIND_LIGHTMAP) {
        status = kiln_folder_open(&folder, b->job->output, "lightmaps", true, error);
        kiln_folder_close(&folder);
    }
    return kiln_agree(b->communicator, status, error);
}

/* Rank 0. Removes files of an earlier bake that this one will not replace. The manifest of that bake lists them. */
static int remove_stale(const struct kiln_bake *b, struct kiln_error *error)
{
    struct kiln_pruned pruned;
    const struct kiln_manifest_parts parts = {.volume = b->job->samples_probe != 0,
                                              .preview = b->job->preview,
                                              .scene = b->job->export,
                                              .groups = b->job->group_count,
                                              .more = b->transport_files,
                                              .more_count = b->transport_file_count};
    const int status =
        kiln_manifest_prune(b->job->output, b->prepared->scene, b->prepared->surface, &parts, &pruned, error);
    if (status == KILN_OK && b->job->keep_transport == KILN_KEEP_NONE)
        (void)kiln_rmdir_below(b->job->output, "transport"); /* if that has left it empty */
    if (status == KILN_OK && pruned.removed > 0 && !b->job->quiet)
        (void)fprintf(stderr, "kiln: removed %zu file%s of the previous bake that this one does not write\n",
                      pruned.removed, pruned.removed == 1 ? "" : "s");
    if (status == KILN_OK && pruned.kept > 0)
        kiln_print(stderr,
                   "kiln: note: %zu file%s of the previous bake %s changed since, and left in place: %s first\n",
                   pruned.kept, pruned.kept == 1 ? "" : "s", pruned.kept == 1 ? "was" : "were", pruned.first_kept);
    return status;
}

/* Removes the manifest and run.json of an earlier bake before any of its results is replaced, since they would no
 * longer be true. */
static int forget_old_report(struct kiln_bake *b, struct kiln_error *error)
{
    int status = KILN_OK;
    if (b->rank == 0) {
        status = kiln_control_check_folder(b->control, error);
        if (status == KILN_OK)
            status = kiln_scene_check_unchanged(b->prepared->scene, b->scene_file, error);
        if (status == KILN_OK)
            status = remove_stale(b, error);
        if (status == KILN_OK)
            status = kiln_manifest_remove(b->job->output, error);
        if (status == KILN_OK && kiln_unlink_below(b->job->output, "run.json") != 0 && errno != ENOENT)
            status = kiln_fail_errno(error, KILN_CANNOT_CREATE, "cannot replace %s/run.json", b->job->output);
    }
    return kiln_agree(b->communicator, status, error);
}

int kiln_bake_clear_folder(struct kiln_bake *b, struct kiln_error *error)
{
    const int status = forget_old_report(b, error);
    return status == KILN_OK ? make_lightmap_folder(b, error) : status;
}
