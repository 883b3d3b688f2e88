/* The weighed pass: the caustic pass's light (caustic.h), with multiple importance sampling of gather rays against
 * light paths that land (land.h; weights: caustic_weights.h).
 *
 * Rays, chains and results are those of the caustic pass, with these differences. No lobes count as sharp: on all
 * surfaces of a chain but mirrors and smooth glass, light is found both by rays that hit lamps and by sampling lights,
 * and the path's weight divides it between the techniques. Each surface draws one sample of the light tree, one of each
 * directional light, and one, by luminance, of an environment image; through glass, too. The total light is the sum of
 * the gather rays of all points and of the landings of all light paths; both must be given the same techniques.
 *
 * Lamps without extent seen in flat mirrors are handled by mirror images (worker/backend/mirror_images.h): light that
 * reaches a point by one such reflection is added by this pass in full, from the places of all samples, and landings
 * bring none of it.
 *
 * Items: tile runs. Samples: rays of a point, the n of the weights; their A is kiln_lit_area. Results, streams and rays
 * as of the caustic pass. Devices do not support mirror images, and not this pass at all if they trace with their
 * ray-tracing pipeline (kiln_backend_takes). */
#ifndef KILN_WORKER_PASS_WEIGHED_H
#define KILN_WORKER_PASS_WEIGHED_H

#include "worker/pass/caustic_weights.h"
#include "worker/pass/pass.h"
#include "worker/pass/point.h"

struct kiln_aims;
struct kiln_emission;
struct kiln_mirror_images;

/* Parameters: the data that gather rays and light paths need for each other's densities. All borrowed. */
struct kiln_caustic_techniques {
    const struct kiln_aims *aims; /* shared out; the same for all iterations */
    const struct kiln_emission *emission;
    uint64_t iterations;                     /* of aims->paths light paths */
    const struct kiln_mirror_images *images; /* NULL: there are none */
    enum kiln_mis mis;
};

#endif
