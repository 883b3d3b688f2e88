/* Whether the values in a result can be what a bake writes: finite, no irradiance of a surface below 0, shares between
 * 0 and 1. */
#ifndef KILN_COORDINATOR_OUTPUT_READ_RANGES_H
#define KILN_COORDINATOR_OUTPUT_READ_RANGES_H

#include <stdbool.h>

#include "worker/base/status.h"

/* Reads the whole file, by its name's ending: .exr, .h5, .hdf, .kscene, .json; others have nothing to check.
 * KILN_BAD_INPUT with a sentence that names the file, the channel or dataset and the value. Not for two threads at once
 * with HDF5 files. */
int kiln_ranges_check(const char *path, struct kiln_error *error);
/* The same of an open file, which is borrowed. */
int kiln_ranges_check_open(int descriptor, const char *path, struct kiln_error *error);
/* Whether there is something to check in a file of that name. */
bool kiln_ranges_has(const char *path);

#endif
