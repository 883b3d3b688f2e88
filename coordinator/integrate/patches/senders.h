/* Which patches send in a round of unshot light (radiosity/unshot.h): those with the most unshot power, a
 * KILN_UNSHOT_ROUNDS-th of all nodes (patches.h) in number. Power is area times luminance; of equal ones the earlier
 * node sends. A function of the nodes alone, so the same on all ranks. */
#ifndef KILN_COORDINATOR_INTEGRATE_PATCHES_SENDERS_H
#define KILN_COORDINATOR_INTEGRATE_PATCHES_SENDERS_H

#include "worker/pass/patches.h"

enum { KILN_UNSHOT_ROUNDS = 16 };

struct kiln_senders;

/* For as many nodes as there are points, at most. KILN_SYSTEM. */
int kiln_senders_create(struct kiln_senders **senders, uint64_t points, struct kiln_error *error);
/* NULL is accepted. */
void kiln_senders_destroy(struct kiln_senders **senders);
/* Bytes of memory that senders take. */
uint64_t kiln_senders_bytes(uint64_t points);

/* Nodes are made: there are none yet; a point, by global index, is appended, and begins node `node` unless that has
 * others. */
void kiln_senders_begin(struct kiln_senders *senders);
void kiln_senders_add(struct kiln_senders *senders, uint64_t node, uint64_t point);

/* Takes of a pass's nodes, all, those that send, with the points that they stand for; these are borrowed until the next
 * call. */
void kiln_senders_choose(struct kiln_senders *senders, struct kiln_patches_parameters *parameters);

#endif
