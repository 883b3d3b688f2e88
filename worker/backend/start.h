/* Early start of a device, while its scene is still being read: drivers take some tenths of a second to start, and need
 * nothing of the scene. Errors are kept until kiln_backend_create, which returns them. */
#ifndef KILN_WORKER_BACKEND_START_H
#define KILN_WORKER_BACKEND_START_H

#include "worker/backend/backend.h"

/* Starts, in a separate thread, the device that kiln_backend_create of the backend called `name` will need. Only the
 * members of `params` that concern devices are read; what they point to must outlive the start. *start: for
 * kiln_backend_params.start; NULL if there is nothing to begin. End with kiln_backend_start_end. */
void kiln_backend_begin(struct kiln_backend_start **start, const char *name, const struct kiln_backend_params *params);
/* Waits for the thread, and destroys a device that no kiln_backend_create has taken. */
void kiln_backend_start_end(struct kiln_backend_start **start);

/* ---- for backend.c, which knows the backends ---- */

/* Starts a device of `api`; with `best` only if it has a hardware device. *start: as above. */
void kiln_backend_start_run(struct kiln_backend_start **start, const struct kiln_backend_api *api, bool best,
                            const struct kiln_backend_params *params);
/* Whether `api` has a suitable hardware device; a driver that does not start counts as none. `start`: a start with
 * `best` has already found this out; NULL: none. */
bool kiln_backend_has_gpu(struct kiln_backend_start *start, const struct kiln_backend_api *api);
/* Waits for the thread and takes its result. False: it was started for another backend, or was taken before. Else
 * *status and `error` are those of api->begin, and *backend belongs to the caller. */
bool kiln_backend_start_take(struct kiln_backend_start *start, const struct kiln_backend_api *api,
                             struct kiln_backend **backend, int *status, struct kiln_error *error);

#endif
