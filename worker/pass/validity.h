/* The validity pass: computes the share of each surface point's area that is not buried in other geometry.
 *
 * A place on a surface is buried when a ray along its normal and three rays around the normal all meet back faces of
 * single-sided surfaces. One of the four rays may instead meet a front that coincides with a back (KILN_COINCIDENT). So
 * a place in a box that stands on a floor is buried, but a place in a room whose walls are pairs of coincident faces is
 * not. Surfaces that let light through are ignored: rays pass triangles with holes, blended or transmissive ones
 * (worker/scene/holes.h), and backs of simulated glass (KILN_RECORD_CLEAR). So objects behind a pane or in water are
 * lit. The first look tests 16 places of a point. If some are buried and some are not, a second look at 64 more places
 * gives the share; below 1/32 the point counts as wholly buried. Places have the same relative position in every texel
 * for any seed (kiln_validity_key), so the result does not depend on the seed.
 *
 * Items: tile runs. No parameters; its number of samples is its own. All points are looked at, valid or not. Rays: one
 * is counted for each place of a look, although Embree stops the first look early once it has both a buried and a free
 * place. The three rays around the normal, needed at few places, are not counted, as devices do not report them.
 *
 * The result of a point is a uint16_t: 65535 x the share of its area that is not buried, 0: not a valid point. It is
 * what surface->visible holds. */
#ifndef KILN_WORKER_PASS_VALIDITY_H
#define KILN_WORKER_PASS_VALIDITY_H

#include "shaders/shared/streams.h"
#include "worker/pass/pass.h"
#include "worker/scene/surface.h"

/* Result of a point if `buried` places of the second look are buried. */
static inline uint16_t kiln_validity_share(uint32_t buried)
{
    const uint32_t all = KILN_VALIDITY_SECOND_LOOK, left = all - buried;
    if (left == all) /* the first look saw a corner that the second missed */
        return (uint16_t)(0xffff - 0xffff / all);
    return left < all / 32 ? 0 : (uint16_t)(left * 0xffffu / all);
}

/* A kiln_take_results that writes results to `visible` of a surface, the context; entries that are 0 stay 0. The
 * surface must be the backend's. No other pass of the backend may be running. */
int kiln_validity_keep(void *surface, size_t first, size_t count, const void *results, struct kiln_error *error);

#endif
