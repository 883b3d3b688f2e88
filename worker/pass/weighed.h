/* The weighed pass: the caustic pass's light (caustic.h), of which each path counts by how well gather rays find it
 * against light paths that land (land.h): multiple importance sampling (caustic_weights.h).
 *
 * Rays, chains and results are those of the caustic pass, with these differences. All lobes of a chain's surfaces but
 * mirrors and smooth glass are hit by its rays and sampled from the lights, and each path's weight says which technique
 * brings how much of it: there are no sharp lobes. At each surface one sample is drawn of the tree of lights, one of
 * each directional light, and one, by luminance, of an environment with an image; through glass too. Gather rays of all
 * points and the landings of all light paths, whose parameters name the same techniques, add up to the light.
 *
 * Lamps without extent that flat mirrors show (worker/backend/mirror_images.h) are left to their images: of light that
 * one such reflection brings straight to a point the pass adds all, from the places of all samples, and landings bring
 * nothing.
 *
 * Items: tile runs. Samples: rays of a point, n of the weights; the texel's area is kiln_lit_area. Results, streams and
 * rays as of the caustic pass. Devices take
 * no images, nor any of it where they trace by their ray-tracing pipeline (kiln_backend_takes). */
#ifndef KILN_WORKER_PASS_WEIGHED_H
#define KILN_WORKER_PASS_WEIGHED_H

#include "worker/pass/caustic_weights.h"
#include "worker/pass/pass.h"
#include "worker/pass/point.h"

struct kiln_aims;
struct kiln_emission;
struct kiln_mirror_images;

/* The parameters: what gather rays and light paths know of each other. All borrowed. */
struct kiln_caustic_techniques {
    const struct kiln_aims *aims; /* shared out; the same for all iterations */
    const struct kiln_emission *emission;
    uint64_t iterations;                     /* of aims->paths light paths */
    const struct kiln_mirror_images *images; /* NULL: there are none */
    enum kiln_mis mis;
};

#endif
