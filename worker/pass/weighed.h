/* The weighed pass: the caustic pass's light (caustic.h), of which each path counts by how well gather rays find it
 * against light paths that land (land.h): multiple importance sampling (caustic_weights.h).
 *
 * Rays, chains and results are those of the caustic pass, with these differences. All lobes of a chain's surfaces but
 * mirrors and smooth glass are hit by its rays and sampled from the lights, and each path's weight says which technique
 * brings how much of it: there are no sharp lobes. At each surface one sample is drawn of the tree of lights, one of
 * each directional light, and one, by luminance, of an environment with an image; through glass too. Gather rays of all
 * points and the landings of all light paths, whose parameters name the same techniques, add up to the light.
 *
 * Where light paths are kept, chance connects a ray's place with one surface where such a path has met gloss that is
 * neither a mirror nor smooth glass, picked in proportion to the flux that has arrived there: what that surface sends
 * on to the place, over the chance, if nothing is in the way. Each quarter of a point's samples has kept paths of its
 * own, so that the error, which is told from the quarters, has theirs in it; points share them. The backend traces
 * them where they are first needed: every rank the same.
 *
 * Items: tile runs. Samples: rays of a point, n of the weights; the texel's area is kiln_lit_area. Results, streams and
 * rays as of the caustic pass. Embree only. */
#ifndef KILN_WORKER_PASS_WEIGHED_H
#define KILN_WORKER_PASS_WEIGHED_H

#include "worker/pass/caustic_weights.h"
#include "worker/pass/pass.h"
#include "worker/pass/point.h"

struct kiln_aims;
struct kiln_emission;

/* The parameters: what gather rays and light paths know of each other. All borrowed. */
struct kiln_caustic_techniques {
    const struct kiln_aims *aims; /* shared out; the same for all iterations */
    const struct kiln_emission *emission;
    uint64_t iterations; /* of aims->paths light paths */
    enum kiln_mis mis;
    /* Light paths whose vertices are kept, by aims that are shared out for them; quarter q of a point's samples has
     * those of iteration first_kept + q. NULL: nothing is connected. */
    const struct kiln_aims *kept;
    uint64_t first_kept;
    double connections; /* the chance of a ray's place to be connected */
};

/* That a backend needs for a kept path, about: two vertices. */
enum { KILN_KEPT_PATH_BYTES = 2048 };

#endif
