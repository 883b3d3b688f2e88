/* The light of a bake with octrees at places of its objects, for comparisons (compare_surface.h). Not collective. */
#ifndef KILN_COORDINATOR_VIEW_COMPARE_LEAVES_H
#define KILN_COORDINATOR_VIEW_COMPARE_LEAVES_H

#include "coordinator/output/read/results.h"
#include "worker/scene/scene.h"

struct kiln_compared_leaves;

/* Reads the leaves of a bake, whose folder is `directory`, if its light is in octrees, by run.json; else *leaves is
 * NULL. results, scene and directory are borrowed. KILN_NO_INPUT, KILN_BAD_INPUT, KILN_SYSTEM. */
int kiln_compared_leaves_open(struct kiln_compared_leaves **leaves, struct kiln_results *results,
                              const struct kiln_scene *scene, const char *directory, struct kiln_error *error);
void kiln_compared_leaves_close(struct kiln_compared_leaves **leaves);

/* Whether both have the same leaves; with `light` also whether the same light, bit for bit, is in them. */
bool kiln_compared_leaves_same(const struct kiln_compared_leaves *a, const struct kiln_compared_leaves *b, bool light);

/* From now on kiln_compared_leaves_at gives the light of the leaf that a place lies in. */
void kiln_compared_leaves_alone(struct kiln_compared_leaves *leaves);

/* Irradiance at the front of an object: on the k-th triangle of its mesh, where corners 1 and 2 have the weights b1 and
 * b2; interpolated between leaves, unless they are to be alone. False: there is none. Thread-safe. */
bool kiln_compared_leaves_at(const struct kiln_compared_leaves *leaves, uint32_t object, uint64_t k, double b1,
                             double b2, float rgb[3]);

#endif
