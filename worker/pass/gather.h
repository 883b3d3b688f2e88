/* The gather pass: light that arrives at surface points from other surface points, one bounce.
 *
 *     E(x) = integral over the hemisphere of (B(hit(x, w)) / pi) n.w dw
 *
 * with hit(x, w) the nearest surface point that a ray from x in direction w meets and B its radiosity (Kajiya, "The
 * Rendering Equation", SIGGRAPH 1986, equation 1, for surfaces that are diffuse). With directions drawn with density
 * n.w / pi this is the plain mean of B(hit). Where a mesh has shading normals s, directions are drawn about the axis
 * half-way between n and s, and E about n and about s are means with weights (shaders/shared/warp.h says which); their
 * mean weight is 1, so that no energy is lost.
 *
 * The samples of a point start at places that are uniform over the part of its texel that is covered, not buried
 * (validity.h) and, by its opacity, there. A ray that meets the back of a double-sided surface finds the radiosity of
 * the back's own points. A ray that meets the back of a single-sided surface, or of a solid's (worker/scene/solids.h),
 * brings nothing and counts as blocked; a ray that meets nothing as escaped. A ray meets a surface that lets light
 * through with a chance that is the surface's opacity, and is tinted by the surfaces that it passes.
 *
 * Where the scene's materials are taken with their gloss (kiln_scene_take_gloss), a ray that meets such a one goes on
 * in a chain (shaders/shared/chain.h): it finds what the diffuse parts on its way send, weighted. The shares of it that
 * escape, are blocked or are taken on the way count as `escaped` and `blocked` (means of the colours) and as `gloss`. A
 * point on such a material counts as incident what its diffuse part takes up (kiln_chain_taken_up); its irradiance is
 * that of all light. Radiosity is the albedo (kiln_surface_albedo) times `incident`.
 *
 * Where the backend has radiance probes (kiln_backend_set_probes), a ray of a point that sees one ends at their range.
 * If it meets nothing before, and does not leave the scene's box, it asks a probe for the radiance from where it goes
 * on to: one of the eight about its end, drawn by trilinear weights, if another short ray says that it is seen from
 * there; else one of those that the point sees, drawn likewise at the ray's origin. It counts as neither escaped nor
 * blocked (Vandersanden, "Radiance Cells", 2023, chapters 3.6 and 3.7; worker/NOTES.md says what differs). That is
 * biased. With range 0 such a point traces no ray. Harmonics may be negative in places; the sum of a point is at least
 * 0.
 *
 * What rays meet can be kept in a file, and be taken from there in the place of tracing them (rows.h): the same bits.
 *
 * Items: tile runs. Result: struct kiln_point_result. No parameters. Samples: rays of a point. Streams: 1, 2, ... for
 * bounces, 0xffff for the final gather. Rays: the samples of all valid points; with range 0 of those that see no
 * probe. The short rays to probes, the rays of chains and those that a row stands for are not counted. */
#ifndef KILN_WORKER_PASS_GATHER_H
#define KILN_WORKER_PASS_GATHER_H

#include "worker/pass/pass.h"
#include "worker/pass/point.h"

#endif
