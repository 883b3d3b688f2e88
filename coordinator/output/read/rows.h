/* Reads datasets as an image one pixel high: datasets of kiln.h5 with one row for each point or each vertex, or
 * datasets of volume.hdf with one or more values for each probe. Each point, vertex or probe is a pixel. Not
 * collective. */
#ifndef KILN_COORDINATOR_OUTPUT_READ_ROWS_H
#define KILN_COORDINATOR_OUTPUT_READ_ROWS_H

#include "coordinator/output/image.h"

/* Reads an open file, whose descriptor is borrowed. `datasets` are names such as "/irradiance/total"; all must have the
 * same number of rows. Each component becomes a channel, named by dataset and component: "/irradiance/total.0".
 * Integers become floats. KILN_NO_INPUT if the file has no such dataset; KILN_BAD_INPUT if it is damaged. For the
 * confined child of a reader (reader.h). */
int kiln_datasets_read(int descriptor, const char *path, const char *const *datasets, size_t count,
                       struct kiln_image **image, struct kiln_error *error);

/* The values of a component of a dataset, or NULL. */
const float *kiln_dataset_of(const struct kiln_image *image, const char *dataset, unsigned component);

#endif
