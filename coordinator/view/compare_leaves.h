/* Lookup of light in the octree leaves of a bake, at points on its objects, for comparisons (compare_surface.h). Not
 * collective. */
#ifndef KILN_COORDINATOR_VIEW_COMPARE_LEAVES_H
#define KILN_COORDINATOR_VIEW_COMPARE_LEAVES_H

#include "coordinator/output/read/results.h"
#include "worker/scene/scene.h"

struct kiln_compared_leaves;

/* Reads the leaves of the bake in folder `directory`. *leaves becomes NULL if its light is not in octrees, according to
 * run.json. results, scene and directory are borrowed. KILN_NO_INPUT, KILN_BAD_INPUT, KILN_SYSTEM. */
int kiln_compared_leaves_open(struct kiln_compared_leaves **leaves, struct kiln_results *results,
                              const struct kiln_scene *scene, const char *directory, struct kiln_error *error);
void kiln_compared_leaves_close(struct kiln_compared_leaves **leaves);

/* Tells whether both have the same leaves, and with `light` also the same light in them, bit for bit. */
bool kiln_compared_leaves_same(const struct kiln_compared_leaves *a, const struct kiln_compared_leaves *b, bool light);

/* Turns interpolation off: kiln_compared_leaves_at then gives the light of the leaf that contains the point. */
void kiln_compared_leaves_alone(struct kiln_compared_leaves *leaves);

/* Finds the irradiance on the front of an object, at barycentric weights b1 and b2 (of corners 1 and 2) of the k-th
 * triangle of its mesh. It is interpolated between leaves, unless that is turned off. False: there is none.
 * Thread-safe. */
bool kiln_compared_leaves_at(const struct kiln_compared_leaves *leaves, uint32_t object, uint64_t k, double b1,
                             double b2, float rgb[3]);

#endif
