/* Lightmaps made of kiln.h5: what it has of surface points, put at their texels. Nothing here is collective. */
#ifndef KILN_COORDINATOR_VIEW_POINT_MAP_H
#define KILN_COORDINATOR_VIEW_POINT_MAP_H

#include "coordinator/field/field.h"
#include "coordinator/output/read/results.h"

/* A dataset of all points, 12 to 28 bytes for each. */
struct kiln_point_rows;

/* Reads the dataset of a field from the results' kiln.h5. `objects`: of the scene. KILN_NO_INPUT if the bake does not
 * have it; KILN_BAD_INPUT. */
int kiln_point_rows_read(struct kiln_point_rows **rows, struct kiln_results *results, const struct kiln_field *field,
                         uint32_t objects, struct kiln_error *error);
/* Puts other values in the place of the dataset's, one for each of the bake's `count` points, or `components` 3: as
 * many of red, then of green, then of blue; they are copied. KILN_BAD_INPUT: the rows have another number of points. */
int kiln_point_rows_replace(struct kiln_point_rows *rows, const float *values, size_t components, uint64_t count,
                            struct kiln_error *error);
/* NULL is accepted. */
void kiln_point_rows_destroy(struct kiln_point_rows **rows);

/* Makes an image of width x height texels with channels R, G, B: the first three components at the texels of an
 * object's points (`back`: of its back), the last one again where there are fewer. NaN where there is no point, and,
 * unless the dataset is of the surface (/points), where no light could be gathered. KILN_BAD_INPUT if a point lies
 * beside the image. */
int kiln_point_map_create(struct kiln_image **image, const struct kiln_point_rows *rows, uint32_t object, bool back,
                          uint32_t width, uint32_t height, struct kiln_error *error);

#endif
