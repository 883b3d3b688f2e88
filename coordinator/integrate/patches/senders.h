/* Senders: the patches that send in a round of unshot light (radiosity/unshot.h). They are the nodes (patches.h) with
 * the most unshot power, one in KILN_UNSHOT_ROUNDS. Power is area times luminance; among equals the earlier node sends.
 * A function of the nodes alone, so the same on all ranks. */
#ifndef KILN_COORDINATOR_INTEGRATE_PATCHES_SENDERS_H
#define KILN_COORDINATOR_INTEGRATE_PATCHES_SENDERS_H

#include "worker/pass/patches.h"

enum { KILN_UNSHOT_ROUNDS = 16 };

struct kiln_senders;

/* Creates senders for at most one node per point. KILN_SYSTEM. */
int kiln_senders_create(struct kiln_senders **senders, uint64_t points, struct kiln_error *error);
/* NULL is accepted. */
void kiln_senders_destroy(struct kiln_senders **senders);
/* Bytes of memory that senders take. */
uint64_t kiln_senders_bytes(uint64_t points);

/* kiln_senders_begin starts without nodes. kiln_senders_add appends a point, by global index, to node `node`; the first
 * point begins the node. */
void kiln_senders_begin(struct kiln_senders *senders);
void kiln_senders_add(struct kiln_senders *senders, uint64_t node, uint64_t point);

/* Reduces a pass's nodes from all to the senders, with their points; borrowed until the next call. */
void kiln_senders_choose(struct kiln_senders *senders, struct kiln_patches_parameters *parameters);

#endif
