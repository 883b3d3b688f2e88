/* Viewpoint selection for scenes without a camera. Private to coordinator/view.
 *
 * Candidate positions are derived from points on the surfaces: from each point, part of the way along its normal to the
 * opposite surface. The points are spread over all objects, weighted by the fourth root of an object's area, so that a
 * ground plane does not get all of them. From each candidate rays are traced in all directions. The candidate is
 * *enclosed* if few rays leave the scene, none hits the back of a single-sided surface, and the surfaces they hit are
 * lit. The scene is *closed* if a tenth of the points lead to enclosed candidates, most of these have a roof, and most
 * are invisible from outside. Nooks are ignored: candidates with a view less than a third as far as that of the widest
 * tenth of the candidates.
 *
 * The best view from the enclosed candidates is the one with the greatest viewpoint entropy (Vazquez, Feixas, Sbert,
 * Heidrich: Viewpoint Selection using Viewpoint Entropy, 2001): -sum p ln p over the items in the picture, where p is
 * the fraction of the picture that an item covers. An item is the part of an object that lies in one box of space and
 * faces one direction. Items that are dark, or too close to the eye, have less weight. The entropy is multiplied by the
 * visible amount of lit surface: the sum over the visible surface points of their light, clamped to the median.
 *
 * The choice depends only on the published lightmaps and a fixed set of rays, so it is the same for any number of ranks
 * and threads. */
#ifndef KILN_COORDINATOR_VIEW_VIEW_SEEK_H
#define KILN_COORDINATOR_VIEW_VIEW_SEEK_H

#include "coordinator/view/view_light.h"

/* Orients the camera along the unit vector `forward`, with y up unless it looks along y. */
void kiln_view_look(struct kiln_view_camera *camera, struct kiln_dvec3 forward);

/* Chooses a viewpoint. On entry `camera` has its extents. If the scene is closed, *found is true, `camera` receives a
 * position inside, and *distance receives its viewing distance, m. `outside` are 1 to 100 candidate cameras outside;
 * *best is the index of the one with the greatest entropy. Traces about a million rays if the scene is closed, else a
 * hundred thousand. Lightmaps are reduced to at most 64 texels a side. KILN_NO_INPUT, KILN_BAD_INPUT as for lightmaps,
 * KILN_SYSTEM. */
int kiln_view_seek(const struct kiln_view_source *source, const struct kiln_view_camera *outside, size_t outside_count,
                   struct kiln_view_camera *camera, bool *found, size_t *best, double *distance,
                   struct kiln_error *error);

#endif
