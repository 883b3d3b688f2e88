/* Which surface points of a bake a texel sees: by rays, and by the grid of --visibility voxels (worker/scene/voxels.h).
 * Between the places of surface points, as kiln.h5 has them. Nothing here is collective. */
#ifndef KILN_COORDINATOR_VIEW_SEEN_H
#define KILN_COORDINATOR_VIEW_SEEN_H

#include "coordinator/output/read/results.h"
#include "coordinator/view/view.h"
#include "worker/scene/voxels.h"

struct kiln_seen {
    /* red of each point, as kiln.h5 has them, then green, then blue: whether the texel sees it, by voxels where there
     * are any, else by rays, in the colours of kiln_seen_key; NaN where no light could be gathered */
    float *color;
    uint64_t points;
    char texel[100]; /* OBJECT,X,Y */
    /* points that it faces and that face it; those of them that it sees by rays, by voxels, by both */
    uint64_t facing, by_rays, by_voxels, by_both;
};

/* `geometry`: as it is baked, receiver-only objects not to be met. `texel`: "OBJECT,X,Y", counted from the upper left
 * of the object's lightmap, of its front; NULL: the one in the middle of the object with most surface. `voxels`: NULL,
 * there are none. KILN_NO_INPUT: the bake has no kiln.h5; KILN_USAGE: there is no such texel; KILN_BAD_INPUT. Release
 * with kiln_seen_release, also after a failure. */
int kiln_seen_find(struct kiln_seen *seen, struct kiln_results *results, const struct kiln_scene *scene,
                   const struct kiln_geometry *geometry, const char *texel, const struct kiln_voxels *voxels,
                   struct kiln_error *error);
void kiln_seen_release(struct kiln_seen *seen);

void kiln_seen_key(struct kiln_color_key *key);

#endif
