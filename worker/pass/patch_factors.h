/* View factors of patches, as points see them: what the passes over patches (patches.h, links.h) share. */
#ifndef KILN_WORKER_PASS_PATCH_FACTORS_H
#define KILN_WORKER_PASS_PATCH_FACTORS_H

#include "worker/pass/patches.h"

/* A point that gathers. */
struct kiln_patch_receiver {
    struct kiln_dvec3 n, s; /* geometric and shading normal, unit */
    bool smooth;            /* these may differ */
};

/* F about the geometric and the shading normal. */
struct kiln_patch_factors {
    double factor, shading;
};

/* Factors of a node's parallelogram at d, a distance whose square is `square`. `cosine`, `other`: d along the
 * receiver's normal and -d along the node's, both above 0. */
struct kiln_patch_factors kiln_patch_factors(const struct kiln_patch_receiver *receiver, const struct kiln_patch *from,
                                             struct kiln_dvec3 d, double square, double cosine, double other);

#endif
