/* Wrapper that verifies another backend. It passes every call on, and repeats passes that define how to compare results
 * (kiln_pass.figures) over a pseudo-random share of the tile runs, with its own Embree backend. A hash of (seed,
 * lightmap, tile, stream) selects the tile runs: the same on any ranks.
 *
 * All backends draw the same random numbers. So a healthy device differs from Embree by rounding, and here and there by
 * a ray that passes an edge on the other side, which moves a texel by about its own standard error. A pass has failed
 * when
 *   - a result is not sound (kiln_pass_figures.sound): not a number, infinite, negative; or of another number of
 *     samples;
 *   - more than 4 and 0.2 % of its texels have levels that differ by more than 6 standard errors of both and 1e-4 of
 *     their value;
 *   - the sum of the texels' levels differs by more than 6 standard errors of both and 1 % (from 64 texels on); or
 *   - a figure, summed over each tile run, differs to the same side: by 6 times the root of the sum of the squares of
 *     the tile runs' differences, and 1e-4 of its value (needs 37 tile runs at least; finds a device that is off by
 * less than the noise). Tallies add up over a backend's life, one for each pass; kiln_backend_info has what was
 * compared so far. Then the call returns KILN_NO_DEVICE, naming the worst texel's object and place and both levels. */
#ifndef KILN_WORKER_BACKEND_VERIFY_H
#define KILN_WORKER_BACKEND_VERIFY_H

#include "worker/backend/backend.h"

/* Wraps *backend, which becomes the wrapper (and dies with it), verifying params->verify_fraction of its tile runs. On
 * failure *backend is destroyed and NULL. */
int kiln_verify_create(struct kiln_backend **backend, const struct kiln_backend_params *params,
                       struct kiln_error *error);

#endif
