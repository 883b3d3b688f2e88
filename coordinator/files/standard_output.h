/* End of a command's output to stdout: checks whether all of it was written, and if not, why. */
#ifndef KILN_COORDINATOR_FILES_STANDARD_OUTPUT_H
#define KILN_COORDINATOR_FILES_STANDARD_OUTPUT_H

#include "worker/base/status.h"

/* Flushes stdout. KILN_IO, with the system's reason, if any output so far is lost. Streams forget the reason of an
 * earlier failed write; then a line feed is written, which fails for the same reason. */
int kiln_stdout_flush(struct kiln_error *error);

#endif
