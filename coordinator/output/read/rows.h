/* Reads datasets of kiln.h5 that have one row for each point, or for each vertex, or of volume.hdf that have one value
 * or more for each probe, as an image of one row with a pixel for each. Not collective. */
#ifndef KILN_COORDINATOR_OUTPUT_READ_ROWS_H
#define KILN_COORDINATOR_OUTPUT_READ_ROWS_H

#include "coordinator/output/image.h"

/* Reads an open file, whose descriptor is borrowed. `datasets`: such as "/irradiance/total"; all have as many rows.
 * Each component is a channel of the image, of the dataset's name and the component's number: "/irradiance/total.0".
 * Integers become floats. KILN_NO_INPUT if the file has no such dataset; KILN_BAD_INPUT if it is damaged. For the
 * confined child of a reader (reader.h). */
int kiln_rows_read(int descriptor, const char *path, const char *const *datasets, size_t count,
                   struct kiln_image **image, struct kiln_error *error);

/* The values of a component of a dataset, or NULL. */
const float *kiln_rows_of(const struct kiln_image *image, const char *dataset, unsigned component);

#endif
