/* Light paths of the land pass (worker/pass/land.h) whose vertices are kept. */
#ifndef KILN_WORKER_BACKEND_EMBREE_LAND_H
#define KILN_WORKER_BACKEND_EMBREE_LAND_H

#include "worker/backend/embree/light_vertices.h"

/* Traces `count` paths of the aims `kept`, from number `first` on, and adds the vertices where light can be connected
 * to the list. They land nowhere. One thread's. KILN_SYSTEM. */
int land_keep(const struct embree_backend *b, const struct kiln_caustic_techniques *techniques, uint64_t first,
              uint64_t count, struct light_vertices *list, struct kiln_error *error);

#endif
