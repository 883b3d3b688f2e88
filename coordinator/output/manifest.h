/* The manifest of a finished bake, DIR/manifest: the list of its files with sizes and hashes, which shows whether a
 * file is as it was written.
 *
 * It is one JSON object {"kiln": version, "files": [{"path", "bytes", "xxh3_128"}, ...]} with a checksum
 * (files/checksummed_json.h). Files of more than 4 MiB have "xxh3_128_of_pieces" and "piece", the bytes of one, in
 * place of "xxh3_128" (piece_hash.h). It is written after all other files, so a bake with a manifest is complete.
 * Pictures and reports that are made later are not in it. */
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
    char *path; /* relative to the folder */
    uint64_t bytes;
    uint64_t piece_bytes; /* size of the pieces, whose hashes are hashed; 0: `hash` is that of all bytes */
    char hash[KILN_HASH_TEXT];
};

struct kiln_manifest {
    struct kiln_manifest_file *files; /* when read from a file: sorted by path, each once, all within the folder */
    size_t count;
};

/* Which of the optional results a bake has. */
struct kiln_optional_results {
    bool volume, preview, scene; /* volume.hdf, preview.png, scene.glb */
    char *const *more;           /* paths of further files, relative to the folder; borrowed */
    size_t more_count;
    size_t groups;  /* of lights (field/group_fields.h) */
    bool no_points; /* there is no kiln.h5 */
};

/* Collective. Hashes the results of a bake of `scene` in `directory`, each rank some of their pieces, with all threads,
 * and writes the manifest on rank 0. KILN_IO if a result is missing. */
int kiln_manifest_write(MPI_Comm communicator, const char *directory, const struct kiln_scene *scene,
                        const struct kiln_surface *surface, const struct kiln_optional_results *parts,
                        struct kiln_error *error);

/* Rank 0. Removes the manifest, before results are replaced, so that the folder no longer counts as complete. */
int kiln_manifest_remove(const char *directory, struct kiln_error *error);

/* Result of kiln_manifest_prune. */
struct kiln_pruned {
    size_t removed, kept; /* numbers of files; kept ones have been changed by somebody since kiln wrote them */
    char first_kept[256];
};

/* Rank 0, before kiln_manifest_remove. Removes the files that the manifest of an earlier bake in `directory` lists and
 * that a bake of `scene` will not replace, such as lightmaps of objects that no longer exist, or a volume or preview
 * that is no longer wanted. Also removes the pictures that kiln report and kiln view made under their default names,
 * which contain KILN_MADE_BY. A file that is not as kiln wrote it stays. If the manifest is missing or damaged, only
 * these pictures are removed. KILN_CANNOT_CREATE if a file cannot be removed. Can be called again after it was
 * interrupted. */
int kiln_manifest_prune(const char *directory, const struct kiln_scene *scene, const struct kiln_surface *surface,
                        const struct kiln_optional_results *parts, struct kiln_pruned *pruned,
                        struct kiln_error *error);

/* Rank 0, before the first pass. Checks that every result of a bake of `scene` can be written; with `scene` and
 * `surface` NULL, those results that have the same name in every bake. KILN_CANNOT_CREATE, with a message that names
 * the link, folder or device that has the name of a result. */
int kiln_manifest_look(const char *directory, const struct kiln_scene *scene, const struct kiln_surface *surface,
                       const struct kiln_optional_results *parts, struct kiln_error *error);

/* Parses the manifest from the text of the file `path`. KILN_BAD_INPUT if it is damaged. Destroy with
 * kiln_manifest_destroy. Not collective. */
int kiln_manifest_parse(struct kiln_manifest **manifest, const char *path, const char *text, size_t size,
                        struct kiln_error *error);
void kiln_manifest_destroy(struct kiln_manifest **manifest);

/* Reads the complete open file from its beginning, compares its size and hash, and rewinds it. KILN_BAD_INPUT, with a
 * message that names `path`, if they differ. Thread-safe. */
int kiln_manifest_compare(const struct kiln_manifest_file *file, int descriptor, const char *path,
                          struct kiln_error *error);

/* Whether the folder is that of a bake: it contains run.json, a manifest, a scene file or a checkpoint. Not collective.
 */
bool kiln_folder_of_bake(const char *directory);

#endif
