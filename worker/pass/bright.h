/* How points choose bright patches (directions.h): the points of one cluster alike. */
#ifndef KILN_WORKER_PASS_BRIGHT_H
#define KILN_WORKER_PASS_BRIGHT_H

#include "worker/pass/directions.h"

struct kiln_bright_receiver {
    uint32_t cluster;   /* KILN_NO_CLUSTER: its points are of none, and choose no patch */
    uint32_t by_cosine; /* of its points' samples; the others go to patches */
    double share;       /* of the others among all */
    double *sums;       /* of the weights of clusters up to each; the last is that of all. Borrowed, bright->count */
};

/* The receiver whose cluster and sums' room are given, of points with so many samples. */
void kiln_bright_begin(const struct kiln_bright *bright, uint32_t samples, struct kiln_bright_receiver *receiver);

#endif
