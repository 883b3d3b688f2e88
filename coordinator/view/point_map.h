/* Point maps: lightmap images made from kiln.h5, with the data of each surface point at its texel. Nothing here is
 * collective. */
#ifndef KILN_COORDINATOR_VIEW_POINT_MAP_H
#define KILN_COORDINATOR_VIEW_POINT_MAP_H

#include "coordinator/field/field.h"
#include "coordinator/output/read/results.h"

/* A dataset with a row for each point, 12 to 28 bytes per point in memory. */
struct kiln_point_dataset;

/* Reads the dataset of a field from the results' kiln.h5. `objects`: of the scene. KILN_NO_INPUT if the bake does not
 * have it; KILN_BAD_INPUT. */
int kiln_point_dataset_read(struct kiln_point_dataset **rows, struct kiln_results *results,
                            const struct kiln_field *field, uint32_t objects, struct kiln_error *error);
/* Replaces the values of the dataset by copies of `values`: one for each of the bake's `count` points; with
 * `components` 3 the reds of all points, then the greens, then the blues. KILN_BAD_INPUT if the rows have another
 * number of points. */
int kiln_point_dataset_replace(struct kiln_point_dataset *rows, const float *values, size_t components, uint64_t count,
                               struct kiln_error *error);
/* NULL is accepted. */
void kiln_point_dataset_destroy(struct kiln_point_dataset **rows);

/* Makes an image of width x height texels with channels R, G, B. The texels of an object's points (`back`: of its back)
 * get the first three components; with fewer components the last one is repeated. Texels without a point are NaN; so
 * are points at which no light could be gathered, unless the dataset is of the surface (/points). KILN_BAD_INPUT if a
 * point lies outside the image. */
int kiln_point_map_create(struct kiln_image **image, const struct kiln_point_dataset *rows, uint32_t object, bool back,
                          uint32_t width, uint32_t height, struct kiln_error *error);

#endif
