/* DIR/manifest: what a finished bake consists of, so that a file that is not as it was written is noticed.
 *
 * One JSON object {"kiln": version, "files": [{"path", "bytes", "xxh3_128"}, ...]}, with its hash
 * (coordinator/files/checksummed_json.h). It is written last of all and gets its name when it is whole: where there is
 * one, the bake is complete. Pictures and reports made later are not in it. */
#ifndef KILN_COORDINATOR_OUTPUT_MANIFEST_H
#define KILN_COORDINATOR_OUTPUT_MANIFEST_H

#include <mpi.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "coordinator/files/checksummed_json.h"
#include "worker/scene/scene.h"
#include "worker/scene/surface.h"

struct kiln_manifest_file {
    char *path; /* within the folder */
    uint64_t bytes;
    char hash[KILN_HASH_TEXT];
};

struct kiln_manifest {
    struct kiln_manifest_file *files; /* as read: in the order of paths, each once, all below the folder */
    size_t count;
};

/* Results that not every bake has. */
struct kiln_manifest_parts {
    bool volume, preview, scene; /* volume.hdf, preview.png, scene.glb */
};

/* Collective. Hashes the results of a bake of `scene` in `directory`, a share on each rank, and writes the manifest on
 * rank 0. KILN_IO when a result is not there. */
int kiln_manifest_write(MPI_Comm communicator, const char *directory, const struct kiln_scene *scene,
                        const struct kiln_surface *surface, const struct kiln_manifest_parts *parts,
                        struct kiln_error *error);

/* Rank 0, before results are replaced: without it the folder no longer claims to be complete. */
int kiln_manifest_remove(const char *directory, struct kiln_error *error);

/* What kiln_manifest_prune did. */
struct kiln_pruned {
    size_t removed, kept; /* files; kept: changed since kiln wrote them, so they are somebody's own */
    char first_kept[256];
};

/* Rank 0, before kiln_manifest_remove: removes what an earlier bake left in `directory`, by its manifest, and a bake of
 * `scene` will not replace: lightmaps of objects that are gone, a volume or a preview that is not wanted any more; and
 * the pictures of it that kiln report and kiln view made under their default names (KILN_MADE_BY tells them from
 * others). A file that is not as kiln wrote it stays. Without a manifest, or with one that is damaged, only these
 * pictures go. KILN_CANNOT_CREATE when a file cannot be removed; killed halfway, it can be called again. */
int kiln_manifest_prune(const char *directory, const struct kiln_scene *scene, const struct kiln_surface *surface,
                        const struct kiln_manifest_parts *parts, struct kiln_pruned *pruned, struct kiln_error *error);

/* Rank 0, before the first pass: whether every result of a bake of `scene` can be put in its place (without scene and
 * surface, NULL: those that have the same names in every bake). KILN_CANNOT_CREATE with what is in the way: a link, a
 * folder, a device. */
int kiln_manifest_look(const char *directory, const struct kiln_scene *scene, const struct kiln_surface *surface,
                       const struct kiln_manifest_parts *parts, struct kiln_error *error);

/* KILN_NO_INPUT without one, KILN_BAD_INPUT when it is damaged. Destroy with kiln_manifest_destroy. Not collective. */
int kiln_manifest_read(struct kiln_manifest **manifest, const char *directory, struct kiln_error *error);
/* The same from the text of the file called `path`. */
int kiln_manifest_parse(struct kiln_manifest **manifest, const char *path, const char *text, size_t size,
                        struct kiln_error *error);
void kiln_manifest_destroy(struct kiln_manifest **manifest);

/* Reads the whole file and compares size and hash. KILN_BAD_INPUT with a sentence that names the file when they differ
 * or it is gone. Thread-safe. */
int kiln_manifest_check(const struct kiln_manifest_file *file, const char *directory, struct kiln_error *error);

/* The same of a file that is open, from its beginning on, where the descriptor stands again afterwards; `path` is for
 * sentences. */
int kiln_manifest_compare(const struct kiln_manifest_file *file, int descriptor, const char *path,
                          struct kiln_error *error);

/* Whether a bake has been at work in this folder: it has run.json, a manifest, a scene file or a checkpoint. Not
 * collective. */
bool kiln_folder_of_bake(const char *directory);

#endif
