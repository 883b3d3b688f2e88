/* From a scene file somebody else wrote (glTF 2.0 .gltf/.glb, OBJ) to kiln's own scene file.
 *
 * The reading happens in a child process of this same program ("kiln import-child ..."), with limits on memory, CPU
 * time, open files and file size, which may open files only beneath the scene's own folder. A crash there, a limit
 * reached or a refusal becomes one sentence here and KILN_BAD_INPUT. The result is cached: when `output` exists and its
 * import_hash is that of the same source files, settings and program, nothing is read again.
 *
 * A kiln scene file as input is checked and copied; it has its lightmap sizes and its environment already, so settings
 * that ask for others are KILN_USAGE. */
#ifndef KILN_COORDINATOR_IMPORT_IMPORT_H
#define KILN_COORDINATOR_IMPORT_IMPORT_H

#include <stdbool.h>
#include <stdint.h>

#include "worker/base/stop.h"

/* Zero means default in every field but environment_scale. */
struct kiln_import_params {
    const char *path;   /* scene file; a kiln scene file (.kscene) is taken as it is */
    const char *output; /* where to put the scene file; "/proc/self/fd/N": into that open, empty file */
    double texels_per_metre;
    uint32_t lightmap_size, lightmap_max;
    bool repack;              /* as in struct kiln_layout_params */
    const char *environment;  /* as in struct kiln_job; an image named by the user may lie anywhere */
    double environment_scale; /* factor; 1: as it is, 0: no light from outside */
    double environment_rotation_degrees;
    const char *objects; /* rules for single objects, as coordinator/job/object_settings.h has them; NULL: none */
    /* where a triangle's normals lean against its winding: they decide its front, not the winding */
    bool trust_normals;
    /* bytes; 0: 4 GiB + 64 x the size of the scene's files, at most 3/4 of the machine's memory */
    uint64_t memory_limit;
    uint32_t time_limit;          /* seconds of CPU; 0: 60 + 1 a 10 MB, and for the layout 60 + 1 a 2,000 triangles */
    const char *program;          /* the kiln program that is to read; NULL: the one that runs */
    const struct kiln_stop *stop; /* borrowed; NULL: none. KILN_STOPPED then, and nothing is left */
};

struct kiln_import_report {
    bool cached; /* nothing was read */
    double seconds;
};

/* Not collective; call it on one rank and tell the others. The file at `output` is written aside, synced and renamed.
 * Another process that imports to the same place at the same time is waited for (kiln_publish_claim). */
int kiln_import(const struct kiln_import_params *params, struct kiln_import_report *report, struct kiln_error *error);

#endif
