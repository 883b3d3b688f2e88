/* The gather pass: one bounce of light, from surface points to surface points.
 *
 *     E(x) = integral over the hemisphere of (B(hit(x, w)) / pi) n.w dw
 *
 * with hit(x, w) the nearest surface point that a ray from x in direction w meets and B its radiosity (Kajiya, "The
 * Rendering Equation", SIGGRAPH 1986, equation 1, for surfaces that are diffuse). With directions drawn with density
 * n.w / pi this is the plain mean of B(hit). Where a mesh has shading normals s, directions are drawn about the axis
 * half-way between n and s, and E about n and about s are means with weights (shaders/shared/warp.h says which); their
 * mean weight is 1, so that no energy is lost.
 *
 * The samples of a point start at places uniform over the part of its texel that is covered by a mesh, not buried
 * (validity.h) and not cut out by opacity. A ray that meets the back of a double-sided surface finds the radiosity of
 * the back's own points. A ray that meets the back of a single-sided surface, or of a solid (worker/scene/solids.h),
 * brings nothing and counts as blocked; a ray that meets nothing as escaped. A surface that lets light through stops a
 * ray with a probability equal to its opacity, else it tints the ray.
 *
 * Where the scene's materials are taken with their gloss (kiln_scene_take_gloss), a ray that meets such a material goes
 * on as a chain (shaders/shared/chain.h) and collects, weighted, the light of the diffuse parts on its way. Shares of
 * the ray that escape or are blocked count as `escaped` and `blocked` (means of the colours), the share absorbed on the
 * way counts as `gloss`. For a point on such a material, `incident` is only the light that its diffuse part takes up
 * (kiln_chain_taken_up), while `irradiance` is all light. Radiosity is the albedo (kiln_surface_albedo) times
 * `incident`.
 *
 * Where the backend has radiance probes (kiln_backend_set_probes), rays of a point that sees a probe end at the probes'
 * range. A ray that meets nothing within the range, and does not leave the scene's box, reads the radiance in its
 * direction from a probe. The probe is one of the eight around the ray's end, drawn by trilinear weights, if a short
 * visibility ray reaches it from there. Else it is one of the probes that the point sees, drawn by trilinear weights at
 * the ray's origin. Such a ray counts as neither escaped nor blocked (Vandersanden, "Radiance Cells", 2023, chapters
 * 3.6 and 3.7; worker/NOTES.md says what differs). The method is biased. With range 0 a point that sees a probe traces
 * no ray. Harmonics may be negative in places; the sum of a point is at least 0.
 *
 * The hits of rays can be kept in a file and read back instead of tracing again (rows.h), with the same bits.
 *
 * Items: tile runs. Result: struct kiln_point_result. No parameters. Samples: rays of a point. Streams: 1, 2, ... for
 * bounces, 0xffff for the final gather. Rays: the samples of all valid points; with range 0 only of points that see no
 * probe. The short rays to probes, the rays of chains and rays replaced by a row are not counted. */
#ifndef KILN_WORKER_PASS_GATHER_H
#define KILN_WORKER_PASS_GATHER_H

#include "worker/pass/pass.h"
#include "worker/pass/point.h"

#endif
