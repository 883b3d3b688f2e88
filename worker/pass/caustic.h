/* The caustic pass: light of lamps and sky that arrives at surface points by mirrors, glass and gloss alone.
 *
 *     E(x) = integral over the hemisphere of L(x, w) n.w dw
 *
 * where L is the radiance that has left a light and has been scattered at least once, and by lobes that are not diffuse
 * only. Rays leave points as in the gather pass (gather.h): cosine-distributed, with its places and weights. A ray that
 * meets a surface whose material is taken with its gloss (kiln_scene_take_gloss) follows the chain from there
 * (shaders/shared/chain.h), and brings what lamps and sky send through it; any other ray brings nothing, for the direct
 * pass has what comes straight.
 *
 * With the direct pass's light this is all light before the first bounce. At points whose own material is taken with
 * its gloss, `incident` is weighted as in the direct pass (direct.h).
 *
 * Items: tile runs. Result: struct kiln_point_result, whose `escaped`, `blocked`, `glass` and `gloss` are 0. No
 * parameters. Samples: rays of a point. Streams: as the gather pass, but a stream has other random numbers here. Rays:
 * the samples of all valid points; rays of chains are not counted. */
#ifndef KILN_WORKER_PASS_CAUSTIC_H
#define KILN_WORKER_PASS_CAUSTIC_H

#include "worker/pass/pass.h"
#include "worker/pass/point.h"

#endif
