/* Data that kiln view --show computes from a bake before it draws: the grid of voxels, the links of a texel, the points
 * that a texel sees. Not collective. */
#ifndef KILN_COORDINATOR_CLI_VIEW_MADE_H
#define KILN_COORDINATOR_CLI_VIEW_MADE_H

#include "coordinator/job/job.h"
#include "coordinator/view/point_map.h"
#include "coordinator/view/seen.h"
#include "coordinator/view/show.h"
#include "coordinator/view/voxel_view.h"

struct kiln_view_made {
    struct kiln_voxels *voxels;         /* NULL: none are shown */
    bool boxes;                         /* voxels are drawn as boxes */
    struct kiln_view_renderer renderer; /* with `boxes`: renderer of the voxels */
    struct kiln_color_key key;          /* color key of voxels, or of points that a texel sees; pairs 0: no key */
    struct kiln_point_dataset *rows;    /* values for links, or for points that a texel sees; NULL: neither is shown */
    uint32_t nodes, single;             /* with `all`: as in struct kiln_texel_links */
    double all;
    struct kiln_seen seen; /* of the texel; its arrays of values are already released */
    char note[200];        /* sentence about links or points seen; empty: neither is shown */
};

/* Checks the options before anything is read. KILN_USAGE if --voxels, --texel or --filter do not fit `show`. */
int kiln_view_made_check(const struct kiln_job *job, const struct kiln_show *show, bool voxels_given, bool filter_given,
                         struct kiln_error *error);
/* Computes the data. `geometry`: as it is baked; rays must not hit receiver-only objects. KILN_NO_INPUT if the bake has
 * not kept the data to show. */
int kiln_view_made_create(struct kiln_view_made *made, const struct kiln_job *job, const struct kiln_show *show,
                          struct kiln_results *results, const struct kiln_scene *scene,
                          const struct kiln_geometry *geometry, struct kiln_error *error);
/* The first lends voxels to the source of the view; the second hands the rows over to the lightmaps of the view. */
void kiln_view_made_lend(struct kiln_view_made *made, struct kiln_view_source *source);
void kiln_view_made_give_rows(struct kiln_view_made *made, struct kiln_view_maps *maps);
void kiln_view_made_destroy(struct kiln_view_made *made);

#endif
