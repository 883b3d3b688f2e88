/* Visibility from a texel: finds the surface points of a bake that a texel sees, by rays and by the voxel grid of
 * --visibility voxels (worker/scene/voxels.h). Tests the segments between positions of surface points in kiln.h5.
 * Nothing here is collective. */
#ifndef KILN_COORDINATOR_VIEW_SEEN_H
#define KILN_COORDINATOR_VIEW_SEEN_H

#include "coordinator/output/read/results.h"
#include "coordinator/view/view.h"
#include "worker/scene/voxels.h"

struct kiln_seen {
    /* colours of the points in the order of kiln.h5: all reds, then greens, then blues. A colour (kiln_seen_key) tells
     * whether the texel sees the point, by voxels if there are any, else by rays; NaN if no light could be gathered
     * there */
    float *color;
    uint64_t points;
    char texel[100]; /* OBJECT,X,Y */
    /* points that face the texel and that it faces; those of them that it sees by rays, by voxels, by both */
    uint64_t facing, by_rays, by_voxels, by_both;
};

/* Finds the points that a texel sees. `geometry`: as for the bake; rays pass through receiver-only objects. `texel`:
 * "OBJECT,X,Y", counted from the upper left of the object's front lightmap; NULL: the middle texel of the object with
 * the largest surface. `voxels`: NULL if there are none. KILN_NO_INPUT: the bake has no kiln.h5; KILN_USAGE: no such
 * texel; KILN_BAD_INPUT. Release with kiln_seen_release, also after a failure. */
int kiln_seen_find(struct kiln_seen *seen, struct kiln_results *results, const struct kiln_scene *scene,
                   const struct kiln_geometry *geometry, const char *texel, const struct kiln_voxels *voxels,
                   struct kiln_error *error);
void kiln_seen_release(struct kiln_seen *seen);

void kiln_seen_key(struct kiln_color_key *key);

#endif
