/* Footprints: the covered part of one surface point's texel, prepared for sampling. Also normals, and the offset of ray
 * origins from a surface.
 *
 * A footprint is plain data of about 500 bytes. It owns no memory and borrows scene, geometry and surface. All
 * functions are pure and thread-safe; none fails.
 *
 * Samples are uniform over the surface area of the covered part. A position is given as (world triangle, b1, b2), where
 * b1, b2 >= 0 and b1 + b2 <= 1 are the barycentric weights of the triangle's corners 1 and 2. */
#ifndef KILN_WORKER_SCENE_FOOTPRINT_H
#define KILN_WORKER_SCENE_FOOTPRINT_H

#include <math.h>
#include <stdbool.h>

#include "shaders/shared/lift.h"
#include "shaders/shared/mask.h"
#include "worker/scene/surface.h"
#include "worker/scene/texel.h"

/* A cursor over the points of a tile run, in order:
 *
 *   struct kiln_point_cursor at = kiln_point_first(surface, run);
 *   for (uint32_t k = 0; k < surface->tile_runs[run].count; k++, kiln_point_next(surface, &at)) ... */
struct kiln_point_cursor {
    struct kiln_own_point point;
    uint64_t piece;                /* index of its first piece in surface->pieces */
    uint64_t cdf;                  /* index of its first entry in surface->area_cdf, if it has more than one piece */
    uint64_t rest;                 /* mask of the tile run's texels, from this point on */
    uint32_t map, x, y;            /* lightmap and texel of the point; undefined after the last point */
    struct kiln_texel_place place; /* the texel, or the leaf of an octree; undefined after the last point */
    uint32_t object;
    bool leaves;                   /* the lightmap is an octree, and the tile a brick */
    bool back;                     /* the lightmap is of backs: the triangles' normals are reversed */
    uint32_t tile_x, tile_y;       /* first texel of the tile */
    struct kiln_texel_place first; /* first leaf of the brick */
};

/* The first leaf of brick `tile` of an octree. */
static inline struct kiln_texel_place kiln_brick_first(const struct kiln_surface *s, uint32_t map, uint32_t tile)
{
    const uint64_t place = s->bricks[s->lightmaps[map].tile_first + tile];
    return (struct kiln_texel_place){KILN_BRICK_SIDE * kiln_brick_x(place), KILN_BRICK_SIDE * kiln_brick_y(place),
                                     KILN_BRICK_SIDE * kiln_brick_layer(place), 0};
}

static inline void kiln_point_locate(struct kiln_point_cursor *at)
{
    if (at->rest != 0) {
        const uint32_t bit = (uint32_t)__builtin_ctzll(at->rest);
        at->x = at->tile_x + kiln_morton8_x(bit);
        at->y = at->tile_y + kiln_morton8_y(bit);
        at->place.x = at->leaves ? at->first.x + kiln_morton4_x(bit) : at->x;
        at->place.y = at->leaves ? at->first.y + kiln_morton4_y(bit) : at->y;
        at->place.layer = at->leaves ? at->first.layer + kiln_morton4_layer(bit) : 0;
    }
}

/* Returns a cursor with the places of points, but without their pieces. */
static inline struct kiln_point_cursor kiln_point_begin(const struct kiln_surface *s, const struct kiln_tile_run *f)
{
    const uint32_t tiles_x = s->lightmaps[f->map].tiles_x;
    struct kiln_point_cursor at = {.point = kiln_own_of_global(s, f->first),
                                   .rest = f->mask,
                                   .map = f->map,
                                   .object = kiln_map_object(s, f->map),
                                   .place = {.shift = s->lightmaps[f->map].shift},
                                   .leaves = s->bricks != NULL,
                                   .back = kiln_map_back(s, f->map),
                                   .tile_x = f->tile % tiles_x * KILN_TILE_SIDE,
                                   .tile_y = f->tile / tiles_x * KILN_TILE_SIDE};
    if (at.leaves)
        at.first = kiln_brick_first(s, f->map, f->tile);
    kiln_point_locate(&at);
    return at;
}

static inline struct kiln_point_cursor kiln_point_first(const struct kiln_surface *s, size_t tile_run)
{
    struct kiln_point_cursor at = kiln_point_begin(s, &s->tile_runs[tile_run]);
    at.piece = s->piece_base[tile_run];
    at.cdf = s->area_cdf_base[tile_run];
    return at;
}

static inline void kiln_point_next(const struct kiln_surface *s, struct kiln_point_cursor *at)
{
    const uint32_t pieces = kiln_piece_count(s, at->point);
    at->point.at++;
    at->piece += pieces;
    at->cdf += pieces - 1;
    at->rest &= at->rest - 1;
    kiln_point_locate(at);
}

enum kiln_footprint_kind {
    KILN_FOOTPRINT_WHOLE = 0, /* one triangle holds the whole square of the texel: a parallelogram on the surface */
    KILN_FOOTPRINT_FEW = 1,   /* at most KILN_FOOTPRINT_PIECES pieces, stored as polygons */
    KILN_FOOTPRINT_MANY = 2   /* a piece is chosen by the area CDF and clipped each time it is sampled */
};

enum { KILN_FOOTPRINT_PIECES = 4, KILN_FOOTPRINT_CORNERS = 7 };

/* A convex piece, with corners in barycentric weights. until[i] is the cumulative area fraction of the piece's triangle
 * fan up to and with triangle (0, i + 1, i + 2). */
struct kiln_footprint_polygon {
    float b1[KILN_FOOTPRINT_CORNERS], b2[KILN_FOOTPRINT_CORNERS];
    float until[KILN_FOOTPRINT_CORNERS - 2];
    uint32_t corners;
};

struct kiln_footprint {
    const struct kiln_scene *scene;
    const struct kiln_geometry *geometry;
    const uint32_t *pieces; /* world triangles */
    /* area CDF: the cumulative fractions of the point's area; piece_count - 1 entries, since the last is 1 */
    const float *area_cdf;
    uint32_t piece_count;
    struct kiln_texel_place place;            /* the texel or leaf */
    uint8_t kind;                             /* enum kiln_footprint_kind */
    const struct kiln_divided_texel *divided; /* the texel, if walls divide it; NULL: undivided */
    uint32_t part;                            /* the point's part of the divided texel */
    bool back; /* the point is on the backs: kiln_footprint_normals reverses the triangles' normals */
    union {
        /* KILN_FOOTPRINT_WHOLE. The position at (s, t) in the texel's square, both 0..1, is origin + s du + t dv, m,
         * relative to the scene's centre. Its barycentric weight of corner 1 is b[0] + s b_du[0] + t b_dv[0]; that of
         * corner 2 uses [1]. */
        struct {
            struct kiln_vec3 origin, du, dv;
            float b[2], b_du[2], b_dv[2];
        } whole;
        struct kiln_footprint_polygon few[KILN_FOOTPRINT_PIECES];
    };
};

/* Prepares the footprint of the cursor's point. */
void kiln_footprint_prepare(struct kiln_footprint *footprint, const struct kiln_scene *scene,
                            const struct kiln_geometry *geometry, const struct kiln_surface *surface,
                            const struct kiln_point_cursor *at);

/* Clips a triangle to the footprint; kiln_subtexel_clip clips a polygon in the footprint to a part of a divided texel.
 * Both return the number of corners, below 3 if nothing is left. The outline is moved inwards by the rounding error of
 * positions. */
uint32_t kiln_footprint_clip(const struct kiln_footprint *footprint, uint32_t triangle,
                             struct kiln_clip_corner polygon[KILN_CLIP_CORNERS]);
uint32_t kiln_subtexel_clip(const struct kiln_divided_texel *texel, uint32_t part,
                            struct kiln_clip_corner polygon[KILN_CLIP_CORNERS], uint32_t corners);

/* Whether the surface in a texel, of `area` m2, is so small that rounding moves places across its edge: the end of a
 * surface that continues in other texels. `triangle`: its largest triangle. No light is gathered there. */
bool kiln_texel_is_sliver(const struct kiln_scene *scene, const struct kiln_geometry *geometry, uint32_t triangle,
                          const struct kiln_texel_place *place, double area);

/* Draws a sample from u1, u2 in [0, 1). Stratified (u1, u2) give positions stratified within each convex piece. */
void kiln_footprint_sample(const struct kiln_footprint *footprint, float u1, float u2, uint32_t *triangle, float *b1,
                           float *b2);

/* A triangle of a footprint that is cut into triangles, for devices that cannot clip. Its corners are in barycentric
 * weights of world triangle `triangle`. Sampling with u1 and u2 takes the first of the triangles whose `until` is above
 * u1, rescales u1 to 0..1 within it, and gives the position (1 - r) a + r (1 - u2) b + r u2 c with r = sqrt(u1). The
 * positions are those of kiln_footprint_sample but for rounding. Not for KILN_FOOTPRINT_WHOLE. */
struct kiln_footprint_triangle {
    uint32_t triangle;
    double b1[3], b2[3];
    double until; /* cumulative fraction of the point's area at this triangle's end; 1 for the last */
};
enum { KILN_FOOTPRINT_TRIANGLES = KILN_CLIP_CORNERS - 2 }; /* triangles of one piece, at most */
/* Writes the triangles of piece `piece`, at most KILN_FOOTPRINT_TRIANGLES, and returns their number. */
uint32_t kiln_footprint_triangles(const struct kiln_footprint *footprint, uint32_t piece,
                                  struct kiln_footprint_triangle *triangles);

/* Area of piece `piece` within the footprint, m2. */
double kiln_footprint_piece_area(const struct kiln_footprint *footprint, uint32_t piece);

/* Bounds of a point's surface: the centre of its bounding box, the greatest distance from there, and whether all pieces
 * lie in parallel planes. */
struct kiln_footprint_extent {
    struct kiln_vec3 centre;
    float spread; /* m */
    bool one_normal;
};
struct kiln_footprint_extent kiln_footprint_extent(const struct kiln_footprint *footprint);

/* An opacity mask: which cells of the unit square of (u1, u2), as kiln_footprint_sample takes them, may hold surface
 * (shaders/shared/mask.h). */
struct kiln_mask {
    uint32_t cells[KILN_MASK_WORDS];
    uint32_t count; /* number of set bits; 0: no mask, sample the whole point */
    float most;     /* upper limit of opacity in sampling; above 0, at most 1 */
};

/* Returns the mean opacity over the point (kiln_surface_opacity); 1 where the material is opaque everywhere. It is the
 * mean of texture samples, one in each cell of a grid of 4 x 4 (texture as coarse as the lightmap) up to 16 x 16
 * (texture 4 times as fine, or finer). If they differ, `mask` is filled with the cells where a sample, or one in a
 * neighbouring cell, was not 0; with all cells if at least one sample in eight was not 0. `most` is twice the largest
 * sample, or 1. Places of samples are a function of `key`, which should differ from point to point but not depend on
 * the seed: details missed here are missed by all samples of the point. */
float kiln_footprint_opacity(const struct kiln_footprint *footprint, uint32_t key, struct kiln_mask *mask);

/* Draws a sample from u1, u2 in [0, 1) with a density proportional to the opacity, of a point with a mask whose count
 * is not 0: opaque places uniformly, places of opacity 1/2 half as often. Places are drawn in the mask's cells and
 * accepted by their opacity; a rejected place is drawn again, from hashes of u1, u2 and `key`. The last of
 * KILN_PLACE_TRIES places is always accepted. */
void kiln_footprint_sample_present(const struct kiln_footprint *footprint, const struct kiln_mask *mask, uint32_t key,
                                   float u1, float u2, uint32_t *triangle, float *b1, float *b2);

/* Maps (u1, u2) in [0, 1)^2 uniformly onto the cells that the mask has set. */
static inline void kiln_mask_place(const struct kiln_mask *mask, float *u1, float *u2)
{
    float rest;
    uint32_t n = kiln_mask_choose(*u1, mask->count, &rest), word = 0;
    for (uint32_t bits; n >= (bits = KILN_COUNT_BITS(mask->cells[word])); word++)
        n -= bits;
    const uint32_t cell = 32u * word + kiln_set_bit(mask->cells[word], n);
    *u1 = kiln_mask_s(cell, rest);
    *u2 = kiln_mask_t(cell, *u2);
}

/* Position of a sample, m, relative to the scene's centre: c0 + b1 (c1 - c0) + b2 (c2 - c0). */
static inline struct kiln_vec3 kiln_triangle_position(const struct kiln_geometry *g, uint32_t triangle, float b1,
                                                      float b2)
{
    struct kiln_vec3 c[3];
    kiln_geometry_corners(g, triangle, c);
    const struct kiln_vec3 e1 = vec3_sub(c[1], c[0]), e2 = vec3_sub(c[2], c[0]);
    return vec3_add(c[0], vec3_madd(vec3_scale(e1, b1), e2, b2));
}

/* Unit normal of a world triangle, on the side from which its corners run counter-clockwise. The zero vector for a
 * triangle without area. */
struct kiln_vec3 kiln_triangle_normal(const struct kiln_geometry *geometry, uint32_t triangle);

/* The unit normal computed in double from the stored vertices and the transform, without the rounding of world
 * positions. On a flat mesh the stored normal is returned if it agrees, since it is also free of the rounding of the
 * file's positions. Cosines use this normal: at 89.9 degrees, a normal that is off by 2e-6 costs a thousandth. */
struct kiln_vec3 kiln_triangle_exact_normal(const struct kiln_scene *scene, const struct kiln_geometry *geometry,
                                            uint32_t triangle);

/* Unit shading normal: the stored normals interpolated over the triangle and transformed to the world by the inverse
 * transpose. It is the geometric normal where the mesh has no smooth normals, and where the interpolated normal is zero
 * or faces away from the geometric one. */
struct kiln_vec3 kiln_triangle_shading_normal(const struct kiln_scene *scene, const struct kiln_geometry *geometry,
                                              uint32_t triangle, float b1, float b2);

/* Lift of ray origins off the triangle (shaders/shared/lift.h); `back`: on its back. Returns false if there is none.
 * Lifts below 1e-5 of the triangle's size are ignored, so that faces that are flat but for rounding are not lifted. */
bool kiln_triangle_lift(const struct kiln_scene *scene, const struct kiln_geometry *geometry, uint32_t triangle,
                        bool back, struct kiln_lift *lift);

/* Computes the point's mean normals, weighted by area: the mean of its pieces' geometric normals, and the mean of the
 * shading normals at the pieces' centroids. Unit vectors. Where a mean is nearly zero (the surface folds back), the
 * largest piece's normal is used instead; where the shading normal faces away from the geometric normal, the geometric
 * one is used for both. */
void kiln_footprint_normals(const struct kiln_footprint *footprint, struct kiln_vec3 *geometric,
                            struct kiln_vec3 *shading);

/* Distance, m, by which the origin of a ray on a world triangle must be moved along the unit normal `n` (either side),
 * so that rounding cannot leave it on or behind the triangle's plane. It is an error bound, not a constant epsilon: it
 * follows the sizes of the numbers that were rounded, so it means the same in a scene of 1e-6 m and in one of 1e6 m
 * (after "Physically Based Rendering", 4th edition, section 6.8).
 *
 * Let u = 2^-24, M_k the largest absolute coordinate of the corners and S_k their largest difference along axis k. -
 * Error of the position. c0 + b1 e1 + b2 e2 is off by at most u M_k (the last sum) + 4 u S_k (edges, products, inner
 *   sum). The parallelogram's origin + s du + t dv, each rounded from double, with the offset added to the origin, is
 *   off by at most 4 u M_k (origin, offset, two sums) + 4 u S_k. Adding the offset last rounds by u M_k once more. So
 *   E_k = u (5 M_k + 5 S_k) bounds all cases, to first order in u.
 * - Error of the tracer. It finds the distance to the plane from N . (c0 - o), with N = e1 x e2. Differences and the
 *   dot product round by 4 u |N_k| S_k. N itself, computed from rounded edges, is off by dN_k = 6 u (|e1_i e2_j| +
 *   |e1_j e2_i|), which tilts the plane by dN_k S_k / |N| at the far end: large for thin triangles only, 0 for a plane
 *   along two axes.
 *
 * The distance is sum_k |n_k| (E_k + 4 u S_k) + sum_k dN_k S_k / |N|, plus a quarter for terms of second order and for
 * the rounding of this sum. The second sum is limited to 2^-10 of the triangle's size, so that a thin triangle does not
 * throw rays off the scene. The whole is at least u times the triangle's size, for planes without any rounding error
 * (such as y = 0). */
float kiln_offset_distance(const struct kiln_geometry *geometry, uint32_t triangle, struct kiln_vec3 n);

/* Returns the position p on the triangle, moved off it to the side that `n` points to. */
static inline struct kiln_vec3 kiln_offset_origin(struct kiln_vec3 p, struct kiln_vec3 n,
                                                  const struct kiln_geometry *geometry, uint32_t triangle)
{
    return vec3_madd(p, n, kiln_offset_distance(geometry, triangle, n));
}

#endif
