/* Range check: verifies that the values in a result file are possible results of a bake: finite, irradiance of surfaces
 * not negative, fractions between 0 and 1. Not collective. */
#ifndef KILN_COORDINATOR_OUTPUT_READ_RANGES_H
#define KILN_COORDINATOR_OUTPUT_READ_RANGES_H

#include <stdbool.h>

#include "worker/base/status.h"

/* Reads the complete open file, whose descriptor is borrowed. The end of `path` gives its format: .exr, .h5, .hdf,
 * .kscene, .json or transport/links; other files pass. KILN_BAD_INPUT, with a message that names `path`, the channel or
 * dataset and the value. Two threads must not check HDF5 files at the same time. */
int kiln_ranges_check(int descriptor, const char *path, struct kiln_error *error);
/* Tells whether kiln_ranges_check checks files with this path. */
bool kiln_ranges_has(const char *path);

#endif
