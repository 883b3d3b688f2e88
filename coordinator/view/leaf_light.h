/* Lookup of light in octree leaves (worker/scene/leaves.h) at any point of the surface, from kiln.h5. Private to
 * coordinator/view. */
#ifndef KILN_COORDINATOR_VIEW_LEAF_LIGHT_H
#define KILN_COORDINATOR_VIEW_LEAF_LIGHT_H

#include "coordinator/view/view.h"

struct kiln_leaf_light;

/* Reads source->field of all leaves, or light if there is no field. The source must have results, and its geometry
 * leaves. Destroy with kiln_leaf_light_destroy; *leaves may be NULL. KILN_NO_INPUT, KILN_BAD_INPUT. */
int kiln_leaf_light_create(struct kiln_leaf_light **leaves, const struct kiln_view_source *source,
                           struct kiln_error *error);
void kiln_leaf_light_destroy(struct kiln_leaf_light **leaves);

/* Interpolates the value at a hit on a front or, with `back`, on the back there. Interpolation is trilinear between
 * those of the eight nearest leaves of the same object and side that have a valid point, with weights normalised to 1.
 * False: none has a valid point. Thread-safe. */
bool kiln_leaf_light_at(const struct kiln_leaf_light *leaves, const struct kiln_geometry *geometry,
                        const struct kiln_hit *hit, bool back, float rgb[3]);

/* Reads the value of the leaf that contains a hit on a front. False: the leaf has no valid point. Thread-safe. */
bool kiln_leaf_light_in(const struct kiln_leaf_light *leaves, const struct kiln_geometry *geometry,
                        const struct kiln_hit *hit, float rgb[3]);

/* Tells whether both have the same leaves, and with `light` also the same values, bit for bit. */
bool kiln_leaf_light_same(const struct kiln_leaf_light *a, const struct kiln_leaf_light *b, bool light);

#endif
