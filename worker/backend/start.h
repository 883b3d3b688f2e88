/* A device that starts while its scene is still being read: drivers take some tenths of a second for that, and need
 * nothing of the scene. Errors are kept, and are those of kiln_backend_create. */
#ifndef KILN_WORKER_BACKEND_START_H
#define KILN_WORKER_BACKEND_START_H

#include "worker/backend/backend.h"

/* Begins, in a thread of its own, what kiln_backend_create of the backend called `name` will need of a device; of
 * `params` what concerns devices is looked at, and what that points to must outlive the start. *start: for
 * kiln_backend_params.start; NULL where there is nothing to begin. End with kiln_backend_start_end. */
void kiln_backend_begin(struct kiln_backend_start **start, const char *name, const struct kiln_backend_params *params);
/* Waits for the thread, and destroys what no kiln_backend_create has taken. */
void kiln_backend_start_end(struct kiln_backend_start **start);

/* ---- for backend.c, which knows the backends ---- */

/* Begins `api`; with `best` only if it has a device that is not software. *start: as above. */
void kiln_backend_start_run(struct kiln_backend_start **start, const struct kiln_backend_api *api, bool best,
                            const struct kiln_backend_params *params);
/* Whether `api` has a fit device that is not software; a driver that does not start counts as none. `start`: has looked
 * already where it was begun with `best`; NULL: none. */
bool kiln_backend_has_gpu(struct kiln_backend_start *start, const struct kiln_backend_api *api);
/* Waits for the thread. False: it was begun for no such backend, or was taken before. Else *status and
 * `error` are those of api->begin, and *backend is the caller's. */
bool kiln_backend_start_take(struct kiln_backend_start *start, const struct kiln_backend_api *api,
                             struct kiln_backend **backend, int *status, struct kiln_error *error);

#endif
