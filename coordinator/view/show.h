/* Subject of `kiln view --show NAME`: light of a bake, its texels, a layer of its lightmaps, or data of its surface
 * points in kiln.h5. Nothing here is collective.
 *
 * A layer is read from the lightmaps, as published (denoised, filled, seams smoothed), if they have it; otherwise from
 * the dataset of kiln.h5, point by point (point_map.h). */
#ifndef KILN_COORDINATOR_VIEW_SHOW_H
#define KILN_COORDINATOR_VIEW_SHOW_H

#include "coordinator/field/field.h"

/* Data made for the picture. */
enum kiln_show_kind {
    KILN_SHOW_READ,   /* nothing is made: a field is read, or light is shown */
    KILN_SHOW_VOXELS, /* filled cells of a voxel grid, as boxes; in a lightmap as KILN_SHOW_VOXEL */
    KILN_SHOW_VOXEL,  /* the voxel that each surface point lies in; the field is the points' positions */
    KILN_SHOW_SEEN,   /* points that a texel sees; the field holds the result for each point */
    KILN_SHOW_LINKS   /* nodes from which a texel gathers; the field holds the result for each point */
};

struct kiln_show {
    enum kiln_show_kind kind;
    bool texels;             /* the checkerboard; else light, where `field` has no name */
    bool squares;            /* by default texels are not interpolated: values between two of them have no meaning */
    struct kiln_field field; /* what is read; name NULL: none */
    /* storage for the names of a light group's dataset and channels, which are in no table */
    char dataset[KILN_GROUP_NAME + 16], channel[3][KILN_GROUP_NAME + 16];
    const char *channels[3];
};

/* Finds the subject called `name`: a name of kiln_show_row, the name of a field, or group:NAME. The struct must not be
 * moved afterwards. KILN_USAGE, with a list of names, if there is none. */
int kiln_show_find(struct kiln_show *show, const char *name, struct kiln_error *error);

/* Gives name, unit ("": that of the bake's light) and description of the i-th subject, for --help; false beyond the
 * last. The strings are static. */
bool kiln_show_row(size_t i, const char **name, const char **unit, const char **sentence);

#endif
