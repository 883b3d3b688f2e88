/* Rounds of a bake, foretold from the errors of some of its tile runs.
 *
 * The rounds are gone through as a bake does (rounds_published.h), with these tile runs in the place of all, an error
 * that falls with the root of a tile run's samples, and typical figures for what only a bake knows: what denoising
 * leaves of an error, and the samples of tile runs that others gather from (round_senders.h), which are as many as
 * those that tile runs take for themselves. */
#ifndef KILN_COORDINATOR_INTEGRATE_PARTS_ROUNDS_FORETOLD_H
#define KILN_COORDINATOR_INTEGRATE_PARTS_ROUNDS_FORETOLD_H

#include <mpi.h>
#include <stddef.h>

#include "coordinator/integrate/foretold.h"
#include "coordinator/integrate/settings.h"
#include "worker/base/status.h"

enum { KILN_TRIED_TILES_MOST = 512 }; /* of all ranks; a rank has one more than its share of them, at most */

/* A tile run with the samples that it has had so far. */
struct kiln_tried_tile {
    float raw;       /* standard error of raw light, relative: root mean square over its points */
    float had;       /* samples, in halves of those of the first round */
    uint32_t weight; /* of its points, by coverage */
    uint32_t points;
};

/* Where the rounds to come begin. */
struct kiln_foretell_from {
    const struct kiln_integrate_settings *settings; /* with a published_error */
    uint32_t level;                                 /* of rounds.h */
    bool denoises;                                  /* lightmaps are denoised */
    double scale; /* error of denoised light over that of raw light, where it was judged; 0: a typical one */
    double most;  /* samples of the rounds to come, over those of the first; INFINITY: any */
};

/* Goes through the rounds of `count` tile runs. Pure. KILN_SYSTEM. */
int kiln_rounds_foretell(const struct kiln_foretell_from *from, const struct kiln_tried_tile *tiles, size_t count,
                         struct kiln_foretold *foretold, struct kiln_error *error);

/* Collective. The tile runs of all ranks on rank 0, in *all, with their number in *total; none on others. Free with
 * kiln_free, after a failure too. KILN_SYSTEM. */
int kiln_tried_tiles_gather(MPI_Comm communicator, const struct kiln_tried_tile *own, size_t count,
                            struct kiln_tried_tile **all, size_t *total, struct kiln_error *error);

/* Number of tile runs that a rank tries of the `wanted` that it would like to. */
size_t kiln_tried_tiles_bounded(MPI_Comm communicator, size_t wanted);

#endif
