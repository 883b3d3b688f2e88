/* A backend that checks another: it hands every call on to it, and traces a pseudo-random share of the direct and
 * gather passes' tile runs again with an Embree backend of its own. Which ones is a hash of (seed, object, tile,
 * stream): the same on any ranks.
 *
 * All backends draw the same random numbers, so that a healthy device differs from Embree by rounding, and here and
 * there by a ray that passes an edge on the other side, which moves a texel by about its own standard error. A pass has
 * failed when
 *   - a value is not a number, infinite or negative;
 *   - more than 4 and 0.2 % of its texels lie apart by more than 6 standard errors of both and 1e-4 of their value; or
 *   - the texels' sum is apart by more than 6 standard errors of both and 1 % (from 64 texels on); or
 *   - the tile runs' sums, in any channel, lie apart to the same side: by 6 times the root of the sum of the squares of
 * their distances, and 1e-4 of their value (needs 37 tile runs at least; finds a device that is off by less than the
 * noise). Figures add up over a backend's life, direct and gather passes apart; kiln_backend_info has what was compared
 * so far. Then the call returns KILN_NO_DEVICE, naming the worst texel's object and place and both values. */
#ifndef KILN_WORKER_BACKEND_VERIFY_H
#define KILN_WORKER_BACKEND_VERIFY_H

#include "worker/backend/backend.h"

/* Wraps *backend, which becomes the wrapper (and dies with it), verifying params->verify_share of its tile runs. On
 * failure *backend is destroyed and NULL. */
int kiln_verify_create(struct kiln_backend **backend, const struct kiln_backend_params *params,
                       struct kiln_error *error);

#endif
