/* Which surface points a set of cameras needs (--only-visible-from), after Vandersanden 2023, section 4.7.1.
 *
 * By tiles (8 x 8 texels), with marks that are the same on all ranks:
 *
 *   seen      a ray through a pixel of one of the views meets it. Views have 480 pixels across; rays go on behind backs
 *             of single-sided surfaces, as kiln view draws them. Receiver-only objects, which rays pass through, are
 *             seen as a whole.
 *   reached   not seen, but rays of what is seen gather from it: some rays of each of its points find it, or a few rays
 *             of each point that those have found. Its light goes into that of what is seen.
 *   neither   the rest: it has no light.
 *
 * What is reached and seen has direct light and the bounces. The final gather is of what is seen alone, and so is the
 * result: other points are not valid in it, and lightmaps fill them from their neighbours. Light that comes to what is
 * seen by way of the rest is missing: that has bounced three times at least, but for what no ray has found. */
#ifndef KILN_COORDINATOR_BAKE_LIGHT_VISIBLE_FROM_H
#define KILN_COORDINATOR_BAKE_LIGHT_VISIBLE_FROM_H

#include "coordinator/bake/prepare/prepare.h"

struct kiln_visible_from {
    uint64_t views;                               /* cameras, or frames of a path */
    uint64_t points, points_seen, points_reached; /* valid ones, of all ranks */
    uint16_t *seen; /* 1 an own tile run of the prepared surface: whether a view sees it; NULL: there are no views */
};

/* Collective. Finds the marks for `views`: "all", names of the scene's cameras with commas between them, or the path of
 * a table of key frames that ends in .csv (view/camera_path.h), with 8 frames an interval. Takes the validity of own
 * points that are neither seen nor reached (surface->visible becomes 0) and tells the backend. KILN_USAGE and
 * KILN_BAD_INPUT, with a sentence, for views that there are not, or that see nothing. Release with
 * kiln_visible_from_release. */
int kiln_visible_from_find(struct kiln_visible_from *visible, const struct kiln_prepared *prepared, const char *views,
                           struct kiln_error *error);
void kiln_visible_from_release(struct kiln_visible_from *visible);

/* Hash of the frames of a path, low half first, where `views` names a file; false where it does not, or where the file
 * cannot be read. Not collective. */
bool kiln_visible_from_hash(const char *views, uint64_t hash[2]);

/* Takes the validity of the surface's own points that are not seen, once nothing will gather from them. */
void kiln_visible_from_leave_seen(const struct kiln_surface *surface, const uint16_t *seen);

#endif
