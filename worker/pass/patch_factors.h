/* View factors from points to patches: common code of the patches pass (patches.h) and the links pass (links.h). */
#ifndef KILN_WORKER_PASS_PATCH_FACTORS_H
#define KILN_WORKER_PASS_PATCH_FACTORS_H

#include "worker/pass/patches.h"

/* Normals of a point that gathers light from patches. */
struct kiln_patch_receiver {
    struct kiln_dvec3 n, s; /* geometric and shading normal, unit */
    bool smooth;            /* n and s may differ */
};

/* F about the geometric and the shading normal. */
struct kiln_patch_factors {
    double factor, shading;
};

/* Computes the factors of a patch's parallelogram at offset d; `square`: d.d. `cosine`, `other`: d along the receiver's
 * normal, and -d along the patch's normal; both above 0. */
struct kiln_patch_factors kiln_patch_factors(const struct kiln_patch_receiver *receiver, const struct kiln_patch *from,
                                             struct kiln_dvec3 d, double square, double cosine, double other);

#endif
