/* A request to stop early, polled by long-running work so that it returns soon.
 *
 * Work that stops returns KILN_STOPPED (kiln_give_up) and leaves its unfinished results to be destroyed as after any
 * failure. The caller knows who asked for the stop and which results are saved, and reports both. */
#ifndef KILN_WORKER_BASE_STOP_H
#define KILN_WORKER_BASE_STOP_H

#include <stdbool.h>
#include <stddef.h>

#include "worker/base/status.h"

struct kiln_stop {
    bool (*asked)(void *context); /* called from any thread; cheap; once true it stays true */
    void *context;
};

/* NULL: never asked. */
static inline bool kiln_stop_asked(const struct kiln_stop *stop) { return stop != NULL && stop->asked(stop->context); }

static inline int kiln_give_up(struct kiln_error *error)
{
    return kiln_fail(error, KILN_STOPPED, "stopped before it was done");
}

#endif
