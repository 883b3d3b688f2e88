#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <sys/stat.h>
#include <unistd.h>

#include "coordinator/bake/bake_private.h"
#include "coordinator/files/output_name.h"
#include "coordinator/files/publish.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/output/manifest.h"
#include "worker/base/calls.h"
#include "worker/base/text.h"

static const char scene_name[] = "scene.kscene", before_name[] = ".scene.kscene.before";

void kiln_bake_keep_scene(struct kiln_bake *b)
{
    struct kiln_folder folder;
    struct stat there;
    if (kiln_folder_open(&folder, b->job->output, NULL, false, NULL) != KILN_OK)
        return;
    (void)kiln_unlinkat(folder.descriptor, before_name, 0);
    b->makes_scene = fstatat(folder.descriptor, scene_name, &there, AT_SYMLINK_NOFOLLOW) != 0;
    /* linkat fails on a file system without hard links: then the earlier scene file is not kept, and a refused bake
     * loses it */
    b->keeps_scene = !b->makes_scene && linkat(folder.descriptor, scene_name, folder.descriptor, before_name, 0) == 0;
    kiln_folder_close(&folder);
}

void kiln_bake_settle_scene(const struct kiln_bake *b, bool refused)
{
    struct kiln_folder folder;
    if ((!b->makes_scene && !b->keeps_scene) ||
        kiln_folder_open(&folder, b->asked->output, NULL, false, NULL) != KILN_OK)
        return;
    if (refused && b->makes_scene)
        (void)kiln_unlinkat(folder.descriptor, scene_name, 0);
    else if (refused)
        (void)kiln_renameat(folder.descriptor, before_name, scene_name);
    if (b->keeps_scene) /* rename() of two names of one file keeps both names */
        (void)kiln_unlinkat(folder.descriptor, before_name, 0);
    kiln_folder_close(&folder);
}

int kiln_bake_check_folder(struct kiln_bake *b, struct kiln_error *error)
{
    static const struct kiln_optional_results all = {.volume = true, .preview = true, .scene = true};
    const struct kiln_output_name trace = {
        .option = "--trace",
        .path = b->job->ranks.trace,
        .inputs = {b->job->scene.file, b->job->arguments[0], b->job->scene.environment},
        .bakes = {b->job->output}};
    int status = KILN_OK;
    if (b->rank == 0) {
        status = kiln_manifest_look(b->job->output, NULL, NULL, &all, error);
        if (status == KILN_OK && b->job->ranks.trace != NULL)
            status = kiln_output_name_check(&trace, error);
    }
    return kiln_agree(b->communicator, status, error);
}

static int make_lightmap_folder(struct kiln_bake *b, struct kiln_error *error)
{
    struct kiln_folder folder;
    int status = KILN_OK;
    if (b->rank == 0 && b->job->lightmaps.store == KILN_STORE_KIND_LIGHTMAP) {
        status = kiln_folder_open(&folder, b->job->output, "lightmaps", true, error);
        kiln_folder_close(&folder);
    }
    return kiln_agree(b->communicator, status, error);
}

/* Rank 0. Removes files of an earlier bake that this one will not replace. The manifest of that bake lists them. */
static int remove_stale(const struct kiln_bake *b, struct kiln_error *error)
{
    struct kiln_pruned pruned;
    const struct kiln_optional_results parts = {.volume = b->job->volume.samples != 0,
                                                .preview = b->job->preview,
                                                .scene = b->job->write_scene,
                                                .groups = b->job->scene.group_count,
                                                .more = b->transport_files,
                                                .more_count = b->transport_file_count};
    const int status =
        kiln_manifest_prune(b->job->output, b->prepared->scene, b->prepared->surface, &parts, &pruned, error);
    if (status == KILN_OK && b->job->light.keep == KILN_KEEP_NONE)
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
