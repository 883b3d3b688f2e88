/* Imports a scene file (glTF 2.0 .gltf or .glb, OBJ) into kiln's own scene file.
 *
 * The file is read in a child process of this same program ("kiln import-child ..."). The child has limits on memory,
 * CPU time, open files and file size, and may open files only beneath the scene's own folder. If it crashes, reaches a
 * limit or refuses the file, the result is one sentence and KILN_BAD_INPUT. The result is cached: if `output` exists
 * and its import_hash matches the source files, settings and program, nothing is read again. If another build of the
 * program wrote `output` and the import gives the same scene, the file is left as it is.
 *
 * A kiln scene file as input is checked and copied. It already has lightmap sizes and an environment, so settings of
 * these are KILN_USAGE. */
#ifndef KILN_COORDINATOR_IMPORT_IMPORT_H
#define KILN_COORDINATOR_IMPORT_IMPORT_H

#include <stdbool.h>
#include <stdint.h>

#include "worker/base/stop.h"

/* Zero means default in every field but environment_scale. */
struct kiln_import_params {
    const char *path;   /* scene file; a kiln scene file (.kscene) is copied */
    const char *output; /* where to write the scene file; "/proc/self/fd/N": into that open, empty file */
    double texels_per_metre;
    double texels; /* as in struct kiln_layout_params */
    uint32_t lightmap_size, lightmap_max;
    bool repack, keep_shared; /* as in struct kiln_layout_params */
    bool part;                /* the file is a part of a scene (parts.h): settings of the whole scene do not count */
    bool no_layout;           /* no lightmap layout is made, for stores that do not need it (kiln_layout_none) */
    const char *environment;  /* as in struct kiln_job; an image that the user names may lie anywhere */
    double environment_scale; /* factor; 1: unchanged, 0: no light from the environment */
    double environment_rotation_degrees;
    const char *objects; /* rules for single objects (coordinator/job/object_settings.h); NULL: none */
    const char *changes; /* of lights, materials and sky, as JSON (coordinator/job/changes.h); NULL: none */
    /* if normals point to the back of a triangle's winding, the normals decide which side is the front, not the winding
     */
    bool trust_normals;
    bool up_z;   /* the z of an OBJ file points up, otherwise its y; other files: KILN_USAGE if set */
    double unit; /* length unit of an OBJ file, m; 0: 1 m; other files: KILN_USAGE unless it is their unit */
    bool strict; /* missing pictures are an error that lists their names; otherwise each is a note */
    /* bytes; 0: 4 GiB + 64 times the size of the scene's files, at most 3/4 of the machine's memory */
    uint64_t memory_limit;
    /* seconds of CPU time; 0: 60 + 1 for each 10 MB, and for the layout 60 + 1 for each 2,000 triangles */
    uint32_t time_limit;
    /* bytes of the files that the scene consists of, for the limit on wall-clock time; 0: those of `path` */
    uint64_t bytes;
    const char *program;          /* the kiln program to run as the child; NULL: the running one */
    const struct kiln_stop *stop; /* borrowed; NULL: none. When asked, returns KILN_STOPPED and leaves no file */
};

/* Size in a struct kiln_source that marks a missing file which the scene names. */
#define KILN_SOURCE_MISSING UINT64_MAX

struct kiln_import_report {
    bool cached; /* the file existed already and nothing was imported */
    double seconds;
};

/* Whether `output` was made from the same files, with these settings, by this program: nothing would be read. */
bool kiln_import_is_fresh(const struct kiln_import_params *params);

/* Imports the scene. Not collective: call it on one rank and tell the others. The file is written under a temporary
 * name, synced and renamed to `output`. If another process is importing to the same place, waits for it
 * (kiln_publish_claim). */
int kiln_import(const struct kiln_import_params *params, struct kiln_import_report *report, struct kiln_error *error);

#endif
