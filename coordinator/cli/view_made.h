/* Data that kiln view --show makes of a bake before it draws: the grid of voxels, the links of a texel, what a texel
 * sees. Not collective. */
#ifndef KILN_COORDINATOR_CLI_VIEW_MADE_H
#define KILN_COORDINATOR_CLI_VIEW_MADE_H

#include "coordinator/job/job.h"
#include "coordinator/view/point_map.h"
#include "coordinator/view/seen.h"
#include "coordinator/view/show.h"
#include "coordinator/view/voxel_view.h"

struct kiln_view_made {
    struct kiln_voxels *voxels;         /* NULL: none are shown */
    bool boxes;                         /* they are drawn as such */
    struct kiln_view_renderer renderer; /* then, of these */
    struct kiln_color_key key;          /* of voxels, or of what a texel sees; pairs 0: of neither */
    struct kiln_point_rows *rows;       /* of links, or of what a texel sees; NULL: neither is shown */
    uint32_t nodes, single;             /* as in struct kiln_texel_links, as is: */
    double all;
    struct kiln_seen seen; /* likewise; the values are gone */
    char note[200];        /* a sentence of these; empty: no links are shown, nor what a texel sees */
};

/* Before anything is read: KILN_USAGE where --voxels, --texel or --filter do not go with what is shown. */
int kiln_view_made_check(const struct kiln_job *job, const struct kiln_show *show, bool voxels_given, bool filter_given,
                         struct kiln_error *error);
/* `geometry`: as it is baked, receiver-only objects not to be met. KILN_NO_INPUT where the bake has not kept what is
 * shown. */
int kiln_view_made_create(struct kiln_view_made *made, const struct kiln_job *job, const struct kiln_show *show,
                          struct kiln_results *results, const struct kiln_scene *scene,
                          const struct kiln_geometry *geometry, struct kiln_error *error);
/* Lends voxels to what is drawn, or hands the rows over to its lightmaps. */
void kiln_view_made_lend(struct kiln_view_made *made, struct kiln_view_source *source);
void kiln_view_made_give_rows(struct kiln_view_made *made, struct kiln_view_maps *maps);
void kiln_view_made_destroy(struct kiln_view_made *made);

#endif
