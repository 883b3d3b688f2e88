#include "coordinator/files/standard_output.h"

#include <errno.h>
#include <stdbool.h>
#include <stdio.h>
#include <unistd.h>

int kiln_stdout_flush(struct kiln_error *error)
{
    const bool before = ferror(stdout) != 0;
    if (fflush(stdout) != 0)
        return kiln_fail_errno(error, KILN_IO, "cannot write to stdout");
    if (!before)
        return KILN_OK;
    return write(STDOUT_FILENO, "\n", 1) < 0
               ? kiln_fail_errno(error, KILN_IO, "cannot write to stdout")
               : kiln_fail(error, KILN_IO, "a part of what was printed to stdout is lost");
}
