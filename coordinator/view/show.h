/* Subject of `kiln view --show NAME`: light of a bake, its texels, a layer of its lightmaps, or data of its surface
 * points in kiln.h5. Nothing here is collective.
 *
 * A layer that lightmaps have is read from there, as published (denoised, filled, seams smoothed); else the dataset of
 * kiln.h5 is, point by point (point_map.h). */
#ifndef KILN_COORDINATOR_VIEW_SHOW_H
#define KILN_COORDINATOR_VIEW_SHOW_H

#include "coordinator/field/field.h"

/* Data made for the picture. */
enum kiln_show_kind {
    KILN_SHOW_READ,   /* nothing: a field is read, or there is none */
    KILN_SHOW_VOXELS, /* the filled cells of a grid, as boxes; or as KILN_SHOW_VOXEL where a lightmap is drawn */
    KILN_SHOW_VOXEL,  /* which cells the surfaces lie in; the field is their places */
    KILN_SHOW_SEEN,   /* which points a texel sees; the field is what is known of each then */
    KILN_SHOW_LINKS   /* which nodes a texel gathers from; the field is what is known of each point then */
};

struct kiln_show {
    enum kiln_show_kind kind;
    bool texels;             /* the checkerboard; else light, where `field` has no name */
    bool squares;            /* texels are drawn as such unless told otherwise: what lies between two of them is none */
    struct kiln_field field; /* what is read; name NULL: none */
    /* of a group of lights, whose names no table has */
    char dataset[KILN_GROUP_NAME + 16], channel[3][KILN_GROUP_NAME + 16];
    const char *channels[3];
};

/* Finds what is meant by a name: one of kiln_show_row, that of a field, or group:NAME. The show must not be moved
 * afterwards. KILN_USAGE, with a list, where nothing has that name. */
int kiln_show_find(struct kiln_show *show, const char *name, struct kiln_error *error);

/* For --help: name, unit ("": that of the bake's light) and sentence of the i-th; false beyond the last. The strings
 * are static. */
bool kiln_show_row(size_t i, const char **name, const char **unit, const char **sentence);

#endif
