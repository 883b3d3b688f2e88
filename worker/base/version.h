/* Versions of kiln whose results have the same bits. Checkpoints, sums of views and kept transport hold part of a
 * result, and only a version that would give the same whole may go on from them. CMakeLists.txt names the first
 * version that has the bits of this one (KILN_SAME_BITS_SINCE). What a file's layout is, its own format number says. */
#ifndef KILN_WORKER_BASE_VERSION_H
#define KILN_WORKER_BASE_VERSION_H

#include <stdbool.h>

/* Whether the results of `version`, such as "0.1.0", have the same bits as those of this kiln. NULL: no. */
bool kiln_version_has_same_bits(const char *version);

#endif
