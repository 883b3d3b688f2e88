/* Where to look from when a scene has no camera. Private to coordinator/view/view*.c.
 *
 * Places to stand are found from the surfaces: points spread over all objects (weighed by the fourth root of an
 * object's area, so that a ground plane does not take them all), and from each along its normal part of the way to the
 * surface opposite. From every place rays go out in all directions. It is *enclosed* when few of them leave the scene,
 * none meets the back of a single-sided surface, and light falls on what they meet. The scene is *closed* when a tenth
 * of the points lead to enclosed places, most of these have a roof, and most cannot be seen from outside. Nooks, from
 * which one sees less than a third as far as from the widest tenth of the places, do not count.
 *
 * Of the enclosed places the best view is the one with the greatest viewpoint entropy (Vazquez, Feixas, Sbert,
 * Heidrich: Viewpoint Selection using Viewpoint Entropy, 2001): -sum p ln p over the things in the picture, p each
 * one's share of it. A thing is what one object shows in one box of space, turned one way; things in the dark, and
 * nearer than an eye would like, count less.
 *
 * All of it is decided from the published lightmaps and a fixed set of rays: the same on any number of ranks and
 * threads. */
#ifndef KILN_COORDINATOR_VIEW_VIEW_SEEK_H
#define KILN_COORDINATOR_VIEW_VIEW_SEEK_H

#include "coordinator/view/view_light.h"

/* Points the camera; y is up, unless that is where it looks. `forward` is unit. */
void kiln_view_look(struct kiln_view_camera *camera, struct kiln_dvec3 forward);

/* `camera` has its extents; when *found, it has a place inside and *distance says how far it looks, m. `outside` are
 * the cameras that would do from outside, one to 100; *best is the one among them that shows most, by the same measure.
 * Traces about a million rays when the scene is closed, a hundred thousand when it is not; lightmaps are kept at most
 * 64 texels wide. KILN_NO_INPUT, KILN_BAD_INPUT as for lightmaps, KILN_SYSTEM. */
int kiln_view_seek(const struct kiln_view_source *source, const struct kiln_view_camera *outside, size_t outside_count,
                   struct kiln_view_camera *camera, bool *found, size_t *best, double *distance,
                   struct kiln_error *error);

#endif
