/* The patches pass: classical radiosity, one bounce of light, computed for each pair of surface points (Goral et al.,
 * "Modeling the Interaction of Light Between Diffuse Surfaces", SIGGRAPH 1984; Kahl, "RTX Radiosity", 2023, chapters
 * 2.8 and 4.7).
 *
 *     E(i) = sum over nodes j of  B(j) F(i, j),      F(i, j) = A(j) cos(i) cos(j) V(i, j) / (pi r^2)
 *
 * A node stands for a surface point, or for several (coordinator/integrate/patches/patches.h). Light goes straight
 * between the places of the two; V is the transmittance of the surfaces between them, by colour. Nodes that face away
 * from the point or lie behind it are skipped without a ray; so are pairs of which one lies in the plane of the other,
 * within KILN_PATCHES_FLAT of the world's extent, where rounding would decide. A node's shape is the parallelogram of
 * its edges; F is the mean over it, to the second order in its size. A node nearer than KILN_PATCHES_NEAR times the
 * root of its area, or crossing the point's horizon, is clipped at the horizon and has the exact factor
 * (worker/light/view_factor.h). The receiving point is only a place, without area. E about the shading normal uses
 * factors about that normal, for the part above both horizons.
 *
 * Rows. The factors of a point (its row) should add up to the share of its cosine-distributed rays that hit nodes: 1 -
 * escaped - blocked, less absorption by tinted surfaces. These shares are measured as in the gather pass, with the same
 * samples and stream. If the sum differs from them by more than chance explains, the row is closed: all its factors are
 * scaled. Let d be the measured share minus the sum, e = escaped + blocked, q the larger one of the sum and the
 * measured share, and s = 3 max(sqrt(e (1 - e)), e q^(1/4)) samples^(-3/4), the sampling error that is hardly ever
 * exceeded. The row then adds up to its sum + d max(0, 1 - s^2 / d^2). If no ray escapes, this is exactly 1. The second
 * term of s is for small shares: a sampling net of q samples has about 4 (q samples)^(1/2) cells on the outline, and a
 * small lamp may exist though all rays miss it. Factors are clamped only on request; rows are then not closed, and a
 * factor is that of the node's middle (Kahl's form).
 *
 * Surfaces are diffuse: chains through gloss are not followed. Surfaces that belong to no node bring no light.
 *
 * If only some nodes send light, rows cannot be closed from their sum: they take the scale found by an earlier step
 * with all nodes (`closing`), and no rays measure shares. With `voxels`, the voxel grid decides the visibility of pairs
 * instead of rays.
 *
 * Items: tile runs. Result: struct kiln_patches_result; `error` is 0, since the error of pairs is not random. Samples:
 * rays that measure the shares. Streams: as the gather pass, with the same rays. Rays: the samples of all valid points,
 * and one for each pair that face each other, unless the voxel grid or the cache (visibility_cache.h) knows its
 * visibility. Time: as many pairs as points times nodes.
 *
 * Embree reckons in doubles; devices use floats, with sums accurate to the last bits, and doubles for near nodes. */
#ifndef KILN_WORKER_PASS_PATCHES_H
#define KILN_WORKER_PASS_PATCHES_H

#include "worker/pass/pass.h"
#include "worker/pass/point.h"
#include "worker/scene/voxels.h"

#define KILN_PATCHES_NEAR 8.0
#define KILN_PATCHES_FLAT 0x1p-20

/* A piece of flat surface; lengths in m, places from the scene's centre. Area 0: it sends no light. */
struct kiln_patch {
    struct kiln_vec3 place;  /* ray origin, offset from the surface (worker/scene/footprint.h) */
    struct kiln_vec3 centre; /* of its parallelogram; off the surface, maybe, for partial texels */
    struct kiln_vec3 normal; /* geometric, unit */
    /* Edges of the parallelogram about `centre` that replaces the surface; their cross product is the area times the
     * normal. */
    struct kiln_vec3 edge_s, edge_t;
    float area;      /* m2, of the present surface, not cut out by opacity */
    uint32_t number; /* of the point, in an order independent of cells and ranks */
};

struct kiln_patch_node {
    struct kiln_patch patch; /* at the place of one surface point, whose number it has */
    struct kiln_vec3 centre; /* of the parallelogram; rays go to the place */
    float radiosity[3];      /* W/m2 */
};

/* Numbers kept for a point's row, indices in struct kiln_surface.closing: the scale of its factors; the shares of its
 * rays that escape, that are blocked, and that tinted surfaces absorb, by colour; its present share. */
enum {
    KILN_CLOSING_SCALE = 0,
    KILN_CLOSING_ESCAPED = 1,
    KILN_CLOSING_BLOCKED = 2,
    KILN_CLOSING_GLASS = 3,
    KILN_CLOSING_PRESENT = 6,
    KILN_CLOSING_FLOATS = 7
};

struct kiln_patches_result {
    struct kiln_point_result point;
    float row_scale; /* factor by which the factors of its row were scaled */
};

struct kiln_visibility_cache;

struct kiln_patches_parameters {
    const struct kiln_patch *points;     /* of all surface points, by global index; borrowed */
    const struct kiln_patch_node *nodes; /* borrowed */
    uint64_t count;                      /* of nodes */
    /* Clamps: of a factor; of the radiosity, by colour, that a node adds to a point; 0: no clamping. */
    double most_factor, most_added;
    struct kiln_visibility_cache *cache; /* borrowed; NULL: all pairs are traced */
    const struct kiln_voxels *voxels;    /* visibility of pairs; borrowed; NULL: by rays */
    /* Set if `nodes` are only some of all nodes: then rows are closed by the surface's `closing`. A bit for each point,
     * by global index, in words: points whose light the nodes send. Borrowed; NULL: `nodes` are all nodes. */
    const uint64_t *shot;
};

/* Returns the scale of a row whose factors sum to `row`, without clamping. `gathered`: shares measured by the point's
 * rays. */
double kiln_patches_row_scale(const struct kiln_point_result *gathered, double row);

/* Irradiance about the shading normal, one channel, of a row closed by this scale; `incident`: the row's irradiance
 * about the geometric normal. Patches that are low over the surface but high over a tilted shading normal can make the
 * scale reach hundreds. So at most the amount that closing adds to `incident` is added. */
static inline double kiln_patches_closed(double scale, double incident, double irradiance)
{
    return scale <= 1.0 || irradiance <= incident ? scale * irradiance : irradiance + (scale - 1.0) * incident;
}

/* Convert between a row's kept numbers and the result of its point's rays: sums over `samples`, without light and
 * error. */
void kiln_closing_keep(const struct kiln_patches_result *result, float closing[KILN_CLOSING_FLOATS]);
struct kiln_point_result kiln_closing_rays(const float closing[KILN_CLOSING_FLOATS], uint32_t samples);

#endif
