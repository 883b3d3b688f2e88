/* Selection of the surface points that a set of cameras needs (--only-visible-from), after Vandersanden 2023, section
 * 4.7.1. Each tile (8 x 8 texels) gets a mark, the same on all ranks:
 *
 *   seen      a ray through a pixel of one of the views hits it. Views are 480 pixels wide; rays pass through backs of
 *             single-sided surfaces, as kiln view draws them. Receiver-only objects, which rays pass through, are
 *             seen as a whole.
 *   reached   not seen, but seen tiles gather light from it: one of some rays from each seen point hits it, or one of
 *             a few rays from each point which those rays hit. Its light contributes to that of seen tiles.
 *   neither   all other tiles: they get no light.
 *
 * Direct light and bounces are computed for seen and reached tiles. The final gather and the result are for seen tiles
 * alone: all other points are invalid in the result, and lightmaps fill them from their neighbours. Light that arrives
 * by way of unmarked tiles is missing; except where rays have missed a tile, such light has bounced at least three
 * times. */
#ifndef KILN_COORDINATOR_BAKE_LIGHT_VISIBLE_FROM_H
#define KILN_COORDINATOR_BAKE_LIGHT_VISIBLE_FROM_H

#include "coordinator/bake/prepare/prepare.h"

struct kiln_visible_from {
    uint64_t views;                               /* cameras, or frames of a path */
    uint64_t points, points_seen, points_reached; /* numbers of valid points, over all ranks */
    uint16_t *seen; /* one for each own tile run of the prepared surface: whether a view sees it; NULL: no views */
};

/* Collective. Marks the tiles for `views`: "all", names of the scene's cameras separated by commas, or the path of a
 * table of key frames that ends in .csv (view/camera_path.h), with 8 frames an interval. Makes own points that are
 * neither seen nor reached invalid (surface->visible becomes 0) and tells the backend. KILN_USAGE and KILN_BAD_INPUT,
 * with a sentence, for views that do not exist or that see nothing. Release with kiln_visible_from_release. */
int kiln_visible_from_find(struct kiln_visible_from *visible, const struct kiln_prepared *prepared, const char *views,
                           struct kiln_error *error);
void kiln_visible_from_release(struct kiln_visible_from *visible);

/* Computes a hash of the frames of a camera path, low half first, if `views` names a file. Returns false if it does
 * not, or if the file cannot be read. Not collective. */
bool kiln_visible_from_hash(const char *views, uint64_t hash[2]);

/* Makes the surface's own points that are not seen invalid. Called once nothing will gather from them. */
void kiln_visible_from_leave_seen(const struct kiln_surface *surface, const uint16_t *seen);

#endif
