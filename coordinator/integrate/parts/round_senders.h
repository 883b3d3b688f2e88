/* Samples of a round for light that others gather.
 *
 * The light that a tile run shows may be good enough while the noise of what it sends is not: that noise is in all
 * light gathered from it, and more gather rays do not lessen it. A patch of sun on a floor is soon finished, and lights
 * the room. So a round gives all of its samples to the tile runs that gain most for the others, too, up to the work of
 * those that need them for themselves.
 *
 * Power sent by a tile run of c points has a variance v = sum over its points of (error x area x albedo)^2, which falls
 * as V / n with the samples n of a point. At given work c n the sum of all v is least where -dv/dn over c, which is
 * v / (n c), is the same everywhere (Neyman, "On the Two Different Aspects of the Representative Method", 1934): the
 * tile runs with the largest come first. */
#ifndef KILN_COORDINATOR_INTEGRATE_PARTS_ROUND_SENDERS_H
#define KILN_COORDINATOR_INTEGRATE_PARTS_ROUND_SENDERS_H

#include "coordinator/integrate/integrate.h"

struct kiln_part_survey;

/* Collective. Raises the needs in the field `samples` (rounds_published.h) of tile runs that gain most for others to
 * all samples of the round. The same choice for any number of ranks and threads. KILN_SYSTEM. */
int kiln_round_senders(const struct kiln_integrate_params *params, const struct kiln_rank_data *data,
                       const struct kiln_part_survey *survey, const struct kiln_round *round, struct kiln_error *error);

#endif
