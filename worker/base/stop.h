/* Whether somebody wants the work to end early: asked by what works long, so that it comes back soon.
 *
 * Work that gives up returns KILN_STOPPED (kiln_give_up) and leaves what it was making to be destroyed as after any
 * failure; who asked, and what is kept, is said where that is known. */
#ifndef KILN_WORKER_BASE_STOP_H
#define KILN_WORKER_BASE_STOP_H

#include <stdbool.h>
#include <stddef.h>

#include "worker/base/status.h"

struct kiln_stop {
    bool (*asked)(void *context); /* from any thread, and cheap; once true it stays so */
    void *context;
};

/* NULL: nobody ever does. */
static inline bool kiln_stop_asked(const struct kiln_stop *stop) { return stop != NULL && stop->asked(stop->context); }

static inline int kiln_give_up(struct kiln_error *error)
{
    return kiln_fail(error, KILN_STOPPED, "stopped before it was done");
}

#endif
