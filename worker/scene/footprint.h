/* The covered part of one surface point's texel, ready for sampling; normals; and how far rays start off a surface.
 *
 * A footprint is plain data (about 500 bytes, no memory of its own) and borrows scene, geometry and surface. All
 * functions are pure and thread-safe; none fails.
 *
 * Sampling is uniform over the surface area of the covered part. Positions are given as (world triangle, b1, b2) with
 * b1, b2 >= 0 and b1 + b2 <= 1 the weights of its corners 1 and 2. */
#ifndef KILN_WORKER_SCENE_FOOTPRINT_H
#define KILN_WORKER_SCENE_FOOTPRINT_H

#include <math.h>
#include <stdbool.h>

#include "shaders/shared/mask.h"
#include "worker/scene/surface.h"

/* Walks the points of a tile run in order:
 *
 *   struct kiln_point_cursor at = kiln_point_first(surface, tile run);
 *   for (uint32_t k = 0; k < surface->tile runs[tile run].count; k++, kiln_point_next(surface, &at)) ... */
struct kiln_point_cursor {
    uint64_t point;     /* own index: the global one - surface->first */
    uint64_t piece;     /* its first piece */
    uint64_t share;     /* its first share, if it has more than one piece */
    uint64_t rest;      /* texels of the tile run from this point on */
    uint32_t map, x, y; /* its texel; undefined behind the last point */
    uint32_t object;
    uint32_t shift;          /* of the lightmap */
    bool back;               /* the point is of the backs: normals are those of the triangles turned round */
    uint32_t tile_x, tile_y; /* first texel of the tile */
};

static inline void kiln_point_locate(struct kiln_point_cursor *at)
{
    if (at->rest != 0) {
        const uint32_t bit = (uint32_t)__builtin_ctzll(at->rest);
        at->x = at->tile_x + kiln_morton8_x(bit);
        at->y = at->tile_y + kiln_morton8_y(bit);
    }
}

static inline struct kiln_point_cursor kiln_point_first(const struct kiln_surface *s, size_t tile_run)
{
    const struct kiln_tile_run *f = &s->tile_runs[tile_run];
    const uint32_t tiles_x = s->lightmaps[f->map].tiles_x;
    struct kiln_point_cursor at = {.point = f->first - s->first,
                                   .piece = s->piece_base[tile_run],
                                   .share = s->area_cdf_base[tile_run],
                                   .rest = f->mask,
                                   .map = f->map,
                                   .object = kiln_map_object(s, f->map),
                                   .shift = s->lightmaps[f->map].shift,
                                   .back = kiln_map_back(s, f->map),
                                   .tile_x = f->tile % tiles_x * KILN_TILE_SIDE,
                                   .tile_y = f->tile / tiles_x * KILN_TILE_SIDE};
    kiln_point_locate(&at);
    return at;
}

static inline void kiln_point_next(const struct kiln_surface *s, struct kiln_point_cursor *at)
{
    const uint32_t pieces = kiln_piece_count(s, at->point);
    at->point++;
    at->piece += pieces;
    at->share += pieces - 1;
    at->rest &= at->rest - 1;
    kiln_point_locate(at);
}

enum kiln_footprint_kind {
    KILN_FOOTPRINT_WHOLE = 0, /* the whole square of the texel in one triangle: a parallelogram */
    KILN_FOOTPRINT_FEW = 1,   /* few pieces, kept as polygons */
    KILN_FOOTPRINT_MANY = 2   /* a piece is chosen by its share and clipped when it is sampled */
};

enum { KILN_FOOTPRINT_PIECES = 4, KILN_FOOTPRINT_CORNERS = 7 };

/* A convex piece as corners in barycentric weights; triangle (0, i + 1, i + 2) of its fan ends at `until[i]` of its
 * area. */
struct kiln_footprint_polygon {
    float b1[KILN_FOOTPRINT_CORNERS], b2[KILN_FOOTPRINT_CORNERS];
    float until[KILN_FOOTPRINT_CORNERS - 2];
    uint32_t corners;
};

struct kiln_footprint {
    const struct kiln_scene *scene;
    const struct kiln_geometry *geometry;
    const uint32_t *pieces; /* world triangles */
    const float *area_cdf;  /* cumulative, piece_count - 1 of them: the last ends at 1 */
    uint32_t piece_count;
    uint32_t x, y;  /* the texel */
    uint32_t shift; /* of the lightmap */
    uint8_t kind;   /* enum kiln_footprint_kind */
    bool back;      /* of backs: kiln_footprint_normals turns round what the triangles say */
    union {
        /* KILN_FOOTPRINT_WHOLE: the point at (s, t) in the texel's square, both 0..1, is origin + s du + t dv (relative
         * to the scene's centre, on the surface), and its weights are b[0] + s b_du[0] + t b_dv[0] of corner 1, [1] of
         * corner 2. */
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

/* Sample for u1, u2 in [0, 1); stratified (u1, u2) give stratified positions within each convex piece. */
void kiln_footprint_sample(const struct kiln_footprint *footprint, float u1, float u2, uint32_t *triangle, float *b1,
                           float *b2);

/* The covered part cut into triangles, by corners in weights of their piece's world triangle: sampling with u1 and u2
 * takes the first part whose `until` is above u1, stretches u1 over it, and the point (1 - r) a + r (1 - u2) b + r u2 c
 * with r = sqrt(u1). What a device that cannot clip samples; the same positions as kiln_footprint_sample but for
 * rounding. Not for KILN_FOOTPRINT_WHOLE. */
struct kiln_footprint_part {
    uint32_t triangle;
    double b1[3], b2[3];
    double until; /* share of the point's area up to this part's end; of the last 1 */
};
enum { KILN_FOOTPRINT_PARTS = 11 }; /* of one piece, at most: clipping leaves room for 13 corners */
/* Writes the parts of piece `piece` (at most KILN_FOOTPRINT_PARTS) and returns how many. */
uint32_t kiln_footprint_parts(const struct kiln_footprint *footprint, uint32_t piece,
                              struct kiln_footprint_part *parts);

/* Where the point is: the middle of a box about it and the greatest distance from there; whether its pieces lie in
 * parallel planes. */
struct kiln_footprint_extent {
    struct kiln_vec3 centre;
    float spread; /* m */
    bool one_normal;
};
struct kiln_footprint_extent kiln_footprint_extent(const struct kiln_footprint *footprint);

/* Where on a point its surface is there (shaders/shared/mask.h), in the square of the (u1, u2) that
 * kiln_footprint_sample takes. */
struct kiln_mask {
    uint32_t cells[KILN_MASK_WORDS];
    uint32_t count; /* bits that are set; 0: the whole point is to be sampled */
};

/* Mean opacity over the point (kiln_surface_opacity); 1 where nothing lets light through. Where it varies over the
 * point, from 16 lookups for a texture as coarse as the lightmap up to 256 for one 4 times as fine and finer, `mask`
 * has the cells where something is: each is set with a chance that is its opacity, stratified over the point; so what
 * is there is sampled uniformly, and what is half there half as often. `key` is what chance hangs on: the point's own.
 */
float kiln_footprint_presence(const struct kiln_footprint *footprint, uint32_t key, struct kiln_mask *mask);

/* Moves (u1, u2) in [0, 1)^2 to where the mask says that something is; all of that is reached alike. */
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

/* Position of a sample, relative to the scene's centre: c0 + b1 (c1 - c0) + b2 (c2 - c0). */
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

/* The same from the stored vertices and the transform in double, free of the rounding of world positions; on a flat
 * mesh the stored normal where the two agree, which the rounding of the file's own positions has not touched. What
 * cosines are taken with: at 89.9 degrees a normal that is off by 2e-6 costs a thousandth. */
struct kiln_vec3 kiln_triangle_exact_normal(const struct kiln_scene *scene, const struct kiln_geometry *geometry,
                                            uint32_t triangle);

/* Unit shading normal: the stored normals interpolated in the mesh and taken to the world by the inverse transpose. The
 * geometric normal where the mesh has no smooth normals, and where that is zero or faces away from the geometric
 * normal. */
struct kiln_vec3 kiln_triangle_shading_normal(const struct kiln_scene *scene, const struct kiln_geometry *geometry,
                                              uint32_t triangle, float b1, float b2);

/* The point's mean normals: of its pieces' geometric normals, and of the shading normals at their centroids, weighted
 * with area. Unit vectors; where the mean is nearly zero (a fold) the largest piece's, and where the shading normal
 * faces away from the geometric one, that. */
void kiln_footprint_normals(const struct kiln_footprint *footprint, struct kiln_vec3 *geometric,
                            struct kiln_vec3 *shading);

/* How far along its unit normal `n` (either side) the start of a ray on a world triangle must be moved, m, so that
 * rounding cannot leave it on or behind the triangle's plane. A bound, not a constant: it follows the sizes of the
 * numbers that were rounded, so that it means the same in a scene of 1e-6 m and of 1e6 m (after pbrt-v4, section 6.8).
 *
 * With u = 2^-24, M the largest absolute coordinate of the corners and S their largest difference, for each axis k:
 *  - the position. c0 + b1 e1 + b2 e2 is off by at most u M_k (the last sum) + 4 u S_k (edges, products, inner sum).
 * The parallelogram's origin + s du + t dv, each rounded from double and the offset added to the origin, is off by at
 * most 4 u M_k (origin, offset, two sums) + 4 u S_k. Adding the offset last rounds by u M_k once more. So E_k = u (5
 * M_k + 5 S_k) holds for all, to first order in u.
 *  - the tracer. It finds the distance to the plane from N . (c0 - o), N = e1 x e2. Differences and the dot product
 *    round by 4 u |N_k| S_k; N itself, of rounded edges, by dN_k = 6 u (|e1_i e2_j| + |e1_j e2_i|), which tilts the
 * plane by dN_k S_k / |N| at the far end: large for needles only, nothing for a plane along two axes. The distance is
 * sum_k |n_k| (E_k + 4 u S_k) + sum_k dN_k S_k / |N|, and a quarter more for the terms of second order and for the
 * rounding of this sum. The second sum is held to 2^-10 of the triangle's size, so that a needle does not throw rays
 * off the scene; the whole is at least u times that size, for planes whose every error is 0 (y = 0, say). */
float kiln_offset_distance(const struct kiln_geometry *geometry, uint32_t triangle, struct kiln_vec3 n);

/* p, a point on the triangle, moved off it to the side of `n`. */
static inline struct kiln_vec3 kiln_offset_origin(struct kiln_vec3 p, struct kiln_vec3 n,
                                                  const struct kiln_geometry *geometry, uint32_t triangle)
{
    return vec3_madd(p, n, kiln_offset_distance(geometry, triangle, n));
}

#endif
