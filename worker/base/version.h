/* Versions of kiln whose results have the same bits. Checkpoints, sums of views and kept transport hold part of a
 * result. Only a version that computes the same bits may continue them. CMakeLists.txt names the first version that has
 * the bits of this one (KILN_SAME_BITS_SINCE). The layout of a file has a format number of its own. */
#ifndef KILN_WORKER_BASE_VERSION_H
#define KILN_WORKER_BASE_VERSION_H

#include <stdbool.h>

/* Whether the results of `version`, such as "0.1.0", have the same bits as those of this kiln. NULL: no. */
bool kiln_version_has_same_bits(const char *version);

#endif
