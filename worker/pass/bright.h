/* Choice of bright patches (directions.h) by the points of a cluster, all of which choose alike. */
#ifndef KILN_WORKER_PASS_BRIGHT_H
#define KILN_WORKER_PASS_BRIGHT_H

#include "worker/pass/directions.h"

struct kiln_bright_receiver {
    uint32_t cluster;   /* KILN_NO_CLUSTER: the points belong to none and choose no patch */
    uint32_t by_cosine; /* number of samples by the cosine; the others go to patches */
    double share;       /* share of samples that go to patches */
    double *sums;       /* cumulative weights of the bright->count clusters; borrowed */
};

/* Fills in a receiver with this number of samples; its `cluster` and the array `sums` are set by the caller. */
void kiln_bright_begin(const struct kiln_bright *bright, uint32_t samples, struct kiln_bright_receiver *receiver);

#endif
