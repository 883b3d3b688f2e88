/* Opens the files that a scene refers to, and no others: regular files beneath the scene's own folder.
 *
 * Every open uses openat2(2) with RESOLVE_BENEATH and RESOLVE_NO_MAGICLINKS. So neither "..", nor an absolute path, nor
 * a symbolic link that leaves the folder can reach anything else, even if the disk changes meanwhile. FIFOs and devices
 * are opened without blocking and refused. Every file that is mapped is recorded in the builder's sources with size and
 * hash. */
#ifndef KILN_COORDINATOR_IMPORT_CONFINE_H
#define KILN_COORDINATOR_IMPORT_CONFINE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "coordinator/scene/builder.h"

/* A file mapped into memory, read-only, until kiln_file_unmap. */
struct kiln_file {
    const unsigned char *data; /* never NULL, not even when size is 0 */
    size_t size;
};

struct kiln_confine {
    const char *scene; /* the scene's path as the user wrote it; begins every error sentence; borrowed */
    char *folder;      /* real path of the folder */
    char *name;        /* the scene's file name in it */
    int descriptor;    /* of the folder */
    /* bytes of all files mapped so far, each file counted once; limits on decompression are relative to this */
    uint64_t total_bytes;
    /* hash table of mapped files: hashes of (device, inode) and of recorded paths; zeros: free slot */
    uint64_t (*seen)[2];
    size_t seen_size, seen_used;
    size_t scans;                                /* folders listed so far, by kiln_confine_find */
    void (*mapped)(const struct kiln_confine *); /* called each time total_bytes has grown; may be NULL */
};

/* Opens the scene's folder. If `path` is a link, which may lead anywhere, it opens the folder of the real file.
 * KILN_NO_INPUT, KILN_PERMISSION. `path` must live as long as the result. Destroy with kiln_confine_destroy. */
int kiln_confine_create(struct kiln_confine **confine, const char *path, struct kiln_error *error);
void kiln_confine_destroy(struct kiln_confine **confine);

/* Converts a relative reference (RFC 3986) to a percent-decoded path. KILN_BAD_INPUT for a scheme, an absolute path, a
 * "..", a NUL, or more than 1,024 bytes. `place` says where the reference is in the file ("images[2].uri"). */
int kiln_confine_decode(const struct kiln_confine *confine, const char *uri, const char *place, char path[1025],
                        struct kiln_error *error);

/* Looks for the file that a scene names, without opening it for good. `name` may be a path of another computer
 * ("C:\\work\\Wood.PNG"); `folder` is a path in the scene's folder, empty or ending with '/'. It tries the name as it
 * is, then with '/' for '\\', then ever shorter ends of it, ignoring case. `path` becomes the path found, or the
 * unchanged name. Files that cannot be opened for other reasons count as found: kiln_confine_map reports why. */
enum kiln_found { KILN_FOUND_NOT, KILN_FOUND_AS_NAMED, KILN_FOUND_OTHERWISE };
enum kiln_found kiln_confine_find(struct kiln_confine *confine, const char *folder, const char *name, char path[1025]);
/* Records a missing file that the scene names, so that the scene is imported again once the file exists. */
int kiln_confine_record_missing(struct kiln_confine *confine, struct kiln_builder *builder, const char *path,
                                struct kiln_error *error);
/* Opens a file or folder in the scene's folder, read-only, with additional `flags` of open(2). Returns the descriptor;
 * if negative, errno has the reason. */
int kiln_confine_open(const struct kiln_confine *confine, const char *path, int flags);
/* Whether there is no such file in the folder. */
bool kiln_confine_is_missing(const struct kiln_confine *confine, const char *path);

/* Maps the file `path` in the folder and adds it to the builder's sources (builder may be NULL). KILN_BAD_INPUT when it
 * is missing, leads out of the folder or is not a regular file; KILN_PERMISSION; KILN_SYSTEM. Unmap with
 * kiln_file_unmap. */
int kiln_confine_map(struct kiln_confine *confine, struct kiln_builder *builder, const char *path, const char *place,
                     struct kiln_file *file, struct kiln_error *error);
/* Maps a file that the user named on the command line: it may lie anywhere, and is recorded with its real path.
 * Otherwise like kiln_confine_map. */
int kiln_confine_map_named(struct kiln_confine *confine, struct kiln_builder *builder, const char *path,
                           struct kiln_file *file, struct kiln_error *error);
void kiln_file_unmap(struct kiln_file *file);

#endif
