/* The patches pass: light that arrives at surface points from other surface points, one bounce, pair by pair (Goral et
 * al., "Modeling the Interaction of Light Between Diffuse Surfaces", SIGGRAPH 1984; Kahl, "RTX Radiosity", 2023,
 * chapters 2.8 and 4.7).
 *
 *     E(i) = sum over nodes j of  B(j) F(i, j),      F(i, j) = A(j) cos(i) cos(j) V(i, j) / (pi r^2)
 *
 * A node stands for a surface point, or for several (coordinator/integrate/patches/patches.h). Light goes straight
 * between the places of the two; V is what the surfaces on the way let through, of each colour. Nodes that look away
 * from the point, or lie behind it, are left out before a ray is traced; and so are those in whose plane it lies, or
 * that lie in its own, but for KILN_PATCHES_FLAT of the world's extent, which rounding decides. A node counts as the
 * parallelogram of its edges: its factor is the mean over that, to the second order in its size. One that is nearer
 * than KILN_PATCHES_NEAR times the root of its area, or crosses the point's horizon, is clipped at the horizon and has
 * the exact one (worker/light/view_factor.h). The point itself is its place. E about the shading normal has the factors
 * about that, of what lies above both horizons.
 *
 * Rows. The factors of a point add up to what its rays by the cosine meet: 1 - escaped - blocked, less what tinted
 * surfaces take. These shares are those that the gather pass finds with the same samples and stream, and where the sum
 * of the factors is off by more than chance explains, all factors of the row are scaled: with d what the shares say
 * less the sum, and s = 3 max(sqrt(e (1 - e)), e q^(1/4)) samples^(-3/4), e = escaped + blocked, q the larger one of
 * the sum and of what rays have met, by which a net of so many samples is hardly ever off, the row then adds up to its
 * sum + d max(0, 1 - s^2 / d^2). Where no ray escapes that is exactly 1. The second s is of what is small: a net has
 * about 4 (q samples)^(1/2) cells on its edge; that all rays have passed a small lamp by does not say that it is not
 * there. Nothing is clamped, but on request: then rows are as they come, and a factor is that of a node's middle
 * (Kahl's form).
 *
 * Surfaces are diffuse: chains through gloss are not followed. What the rays meet that is no node's brings nothing.
 *
 * Where a part of all nodes send, rows cannot be closed: then they are multiplied as a step with all of them has found
 * (`closing`), and no ray measures shares. With `voxels` these say what pairs see, and no ray goes between them.
 *
 * Items: tile runs. Result: struct kiln_patches_result; `error` is 0, for what pairs are off by is no chance. Samples:
 * rays that measure the shares. Streams: as the gather pass, with the same rays. Rays: the samples of all valid points,
 * and one for each pair that face each other, that no grid answers, and of which nothing is known
 * (visibility_cache.h). Time: as many pairs as points times nodes.
 *
 * Embree reckons in doubles; devices have floats, with sums that are good to their last bits, and doubles where a node
 * is near. */
#ifndef KILN_WORKER_PASS_PATCHES_H
#define KILN_WORKER_PASS_PATCHES_H

#include "worker/pass/pass.h"
#include "worker/pass/point.h"
#include "worker/scene/voxels.h"

#define KILN_PATCHES_NEAR 8.0
#define KILN_PATCHES_FLAT 0x1p-20

/* A piece of flat surface; area 0: nothing leaves it. m, from the scene's centre. */
struct kiln_patch {
    struct kiln_vec3 place;  /* off the surface by as much as rays need (worker/scene/footprint.h) */
    struct kiln_vec3 centre; /* of its parallelogram; of what is no square of one triangle it may lie off the surface */
    struct kiln_vec3 normal; /* geometric, unit */
    /* Edges of the parallelogram about `centre` that stands for it; their cross product is the area times the normal.
     */
    struct kiln_vec3 edge_s, edge_t;
    float area;      /* m2, of what is there to be lit */
    uint32_t number; /* of the point, in an order that is the same for any cells and ranks */
};

struct kiln_patch_node {
    struct kiln_patch patch; /* at the place of one surface point, whose number it has */
    struct kiln_vec3 centre; /* of the parallelogram; rays go to the place */
    float radiosity[3];      /* W/m2 */
};

/* Numbers kept of a point's row, in the order of struct kiln_surface.closing: the scale of its factors; the shares of
 * its rays that escape, are blocked, and are taken by tinted surfaces, of each colour; the part of it that is present.
 */
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
    float row_scale; /* what the factors of its row were multiplied by */
};

struct kiln_visibility_cache;

struct kiln_patches_parameters {
    const struct kiln_patch *points;     /* of all surface points, by global index; borrowed */
    const struct kiln_patch_node *nodes; /* borrowed */
    uint64_t count;                      /* of nodes */
    /* A factor is at most the first, and what a node adds to the radiosity of a point, of a colour, at most the second;
     * 0: nothing is clamped. */
    double most_factor, most_added;
    struct kiln_visibility_cache *cache; /* borrowed; NULL: all pairs are traced */
    const struct kiln_voxels *voxels;    /* what pairs see of each other; borrowed; NULL: rays say it */
    /* The nodes are a part of all, and rows are closed as the surface says. A bit a point, by global index, in words:
     * the points whose light they send. Borrowed; NULL: the nodes are all that there are. */
    const uint64_t *shot;
};

/* Scale of the factors of a row, whose sum is `row`, where nothing is clamped; `gathered`: what the point's rays have
 * met. */
double kiln_patches_row_scale(const struct kiln_point_result *gathered, double row);

/* Irradiance about the shading normal of a row that is closed by this scale, one channel; `incident`: the same about
 * the geometric normal. Where patches stand low over the surface and high over its tilted shading normal the row is
 * short, and its scale may be in the hundreds: so what is added is no more than what is added to `incident`. */
static inline double kiln_patches_closed(double scale, double incident, double irradiance)
{
    return scale <= 1.0 || irradiance <= incident ? scale * irradiance : irradiance + (scale - 1.0) * incident;
}

/* Between what is kept of a row and what its point's rays have met: sums over `samples`, no light, no error. */
void kiln_closing_keep(const struct kiln_patches_result *result, float closing[KILN_CLOSING_FLOATS]);
struct kiln_point_result kiln_closing_rays(const float closing[KILN_CLOSING_FLOATS], uint32_t samples);

#endif
