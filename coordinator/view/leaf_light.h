/* The light of an octree's leaves (worker/scene/leaves.h), read from kiln.h5, at any place of the surface. Private to
 * coordinator/view. */
#ifndef KILN_COORDINATOR_VIEW_LEAF_LIGHT_H
#define KILN_COORDINATOR_VIEW_LEAF_LIGHT_H

#include "coordinator/view/view.h"

struct kiln_leaf_light;

/* Reads source->field, or light, of all leaves; the source has results, and its geometry has leaves. Destroy with
 * kiln_leaf_light_destroy; *leaves may be NULL. KILN_NO_INPUT, KILN_BAD_INPUT. */
int kiln_leaf_light_create(struct kiln_leaf_light **leaves, const struct kiln_view_source *source,
                           struct kiln_error *error);
void kiln_leaf_light_destroy(struct kiln_leaf_light **leaves);

/* The value at a hit on a front or, with `back`, on the back there: trilinear among the eight nearest leaves of the
 * same object and side that have a valid point, whose weights are raised to 1 in all. False: none of them has one.
 * Thread-safe. */
bool kiln_leaf_light_at(const struct kiln_leaf_light *leaves, const struct kiln_geometry *geometry,
                        const struct kiln_hit *hit, bool back, float rgb[3]);

/* The value of the leaf that a hit on a front lies in. False: it has no valid point. Thread-safe. */
bool kiln_leaf_light_in(const struct kiln_leaf_light *leaves, const struct kiln_geometry *geometry,
                        const struct kiln_hit *hit, float rgb[3]);

/* Whether both have the same leaves; with `light` also whether all values are the same, bit for bit. */
bool kiln_leaf_light_same(const struct kiln_leaf_light *a, const struct kiln_leaf_light *b, bool light);

#endif
