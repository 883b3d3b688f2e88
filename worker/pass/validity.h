/* The validity pass: which share of each surface point is not buried in other geometry.
 *
 * A place on a surface is buried when a ray along its normal and three rays around the normal all meet back faces of
 * single-sided surfaces. Where a front coincides with the back (KILN_COINCIDENT), that counts as well, of one of the
 * four: so what is in a box that stands on a floor is buried, and what is in a room whose walls are two faces in one
 * place is not. What lets light through does not count: rays pass triangles with holes, blended or
 * transmissive ones (worker/scene/holes.h), and the backs of glass that is taken as such say nothing
 * (KILN_RECORD_CLEAR): what stands behind a pane or in water is lit. 16 places of a point are looked at first. When
 * some of them are buried and some are not, 64 more places give the share; a point of which less than 1/32 is left
 * counts as buried altogether. The places are the same shares of every texel's sides for any seed (kiln_validity_key),
 * so that the seed buries nothing.
 *
 * Items: tile runs. No parameters; its number of samples is its own. All points are looked at, valid or not.
 * Rays are counted as one for each place of a look, though Embree ends the first look once it has seen a place that is
 * buried and one that is not. The three rays around the normal, which few places need, are not counted: devices do not
 * report them.
 *
 * The result of a point is a uint16_t: 65535 x the share of its area that is not buried, 0: not a valid point. It is
 * what surface->visible holds. */
#ifndef KILN_WORKER_PASS_VALIDITY_H
#define KILN_WORKER_PASS_VALIDITY_H

#include "shaders/shared/streams.h"
#include "worker/pass/pass.h"
#include "worker/scene/surface.h"

/* A point's result when `buried` of the places of the second look are. */
static inline uint16_t kiln_validity_share(uint32_t buried)
{
    const uint32_t all = KILN_VALIDITY_SECOND_LOOK, left = all - buried;
    if (left == all) /* the first look saw a corner that the second missed */
        return (uint16_t)(0xffff - 0xffff / all);
    return left < all / 32 ? 0 : (uint16_t)(left * 0xffffu / all);
}

/* A kiln_take_results that writes the results to `visible` of the surface that the context points to; where that is 0
 * already it stays 0. It must be the surface the backend has; no other pass of the backend may be under way. */
int kiln_validity_keep(void *surface, size_t first, size_t count, const void *results, struct kiln_error *error);

#endif
