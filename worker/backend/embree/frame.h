/* Points of a tile run, prepared for sampling: the places and normals of their samples. */
#ifndef KILN_WORKER_BACKEND_EMBREE_FRAME_H
#define KILN_WORKER_BACKEND_EMBREE_FRAME_H

#include "shaders/shared/chain.h"
#include "worker/backend/embree/embree.h"
#include "worker/scene/footprint.h"

/* Offset and lift of ray origins on a triangle. */
struct frame_triangle {
    uint32_t triangle;       /* KILN_NONE: none */
    struct kiln_vec3 normal; /* normal on the lit side */
    float offset;            /* m: offset of ray origins along the normal */
    bool lifts;              /* whether origins are also lifted */
    struct kiln_lift lift;
};

enum { FRAME_TRIANGLES = 32 };

/* The requested valid points of a tile run, in order. Positions include the offset that keeps rays from hitting their
 * own surface (see worker/scene/footprint.h). About 60 KiB: keep one a thread. */
struct tile_run_frame {
    uint32_t count;                   /* points */
    uint32_t tile_key;                /* hash of (seed, object, tile) */
    bool smooth;                      /* some shading normal differs from the geometric one */
    bool lifts;                       /* ray origins are lifted off facets (FRAME_LIFT) */
    bool back;                        /* points of backs: all normals are the triangles' normals turned round */
    uint32_t place[KILN_TILE_TEXELS]; /* of point j among the tile run's points */
    uint32_t key[KILN_TILE_TEXELS];   /* hash of (seed, object, texel); key for redrawing places */
    bool whole[KILN_TILE_TEXELS];     /* position = origin + s edge_s + t edge_t, one normal; else use frame_position */
    bool lifted[KILN_TILE_TEXELS];    /* rays begin above the surface (shaders/shared/lift.h); never `whole` */
    bool partly_buried[KILN_TILE_TEXELS]; /* frame_position draws again until a place is not buried; never `whole` */
    float origin[3][KILN_TILE_TEXELS], edge_s[3][KILN_TILE_TEXELS], edge_t[3][KILN_TILE_TEXELS];
    float normal[3][KILN_TILE_TEXELS];       /* geometric, unit; if not whole: the normal of the point's first piece */
    float offset[KILN_TILE_TEXELS];          /* m: offset along the normal included in a whole point's positions */
    float shading[3][KILN_TILE_TEXELS];      /* unit; set where `smooth` */
    float present[KILN_TILE_TEXELS];         /* see struct kiln_point_result */
    struct kiln_mask mask[KILN_TILE_TEXELS]; /* cells where its surface may be; a point with one is never `whole` */
    /* whether the point's material has simulated gloss, and the material's lobes at one place of the point */
    bool glossy[KILN_TILE_TEXELS];
    struct kiln_bsdf_lobes lobes[KILN_TILE_TEXELS];
    /* with FRAME_EXTENT only */
    struct kiln_footprint_extent extent[KILN_TILE_TEXELS];
    struct kiln_footprint footprint[KILN_TILE_TEXELS];
    struct frame_triangle known[FRAME_TRIANGLES]; /* cache of hit triangles, at their number modulo its size */
};

enum frame_wish {
    /* includes invalid points, and treats all as not buried: for the validity pass itself */
    FRAME_EVERY = 1,
    FRAME_EXTENT = 2, /* fills `extent`: for choosing lights */
    FRAME_PLACES = 4, /* only for frame_position: no lobes, no shading normals */
    FRAME_LIFT = 8    /* positions are ray origins: on smooth meshes lifted off coarse facets */
};
/* Prepares a tile run's points; bit k of `points`: the k-th point is requested. */
void frame_build(struct tile_run_frame *frame, const struct embree_backend *backend, size_t tile_run, uint64_t points,
                 unsigned wish);

/* Samples a position (offset included) and geometric normal of point j by s and t in (0,1), uniformly over the part of
 * its area that is present and not buried. Returns the offset with the lift, m along the normal. Light is evaluated on
 * the surface itself; only its ray starts at the offset position. */
float frame_position(struct tile_run_frame *frame, const struct embree_backend *backend, uint32_t j, float s, float t,
                     struct kiln_vec3 *position, struct kiln_vec3 *normal);

/* Returns the shading normal of a sample of point j with geometric normal n. On a coarse texel some pieces may face
 * away from the mean shading normal; these use n. Without smooth normals the result is n, too. */
static inline struct kiln_vec3 frame_shading(const struct tile_run_frame *f, uint32_t j, struct kiln_vec3 n)
{
    if (!f->smooth)
        return n;
    const struct kiln_vec3 shading = vec3(f->shading[0][j], f->shading[1][j], f->shading[2][j]);
    return vec3_dot(shading, n) > 0.0f ? shading : n;
}

/* Whether light from a direction reaches point j without being blocked by the point's own surface: decided by the
 * cosine with the geometric normal or, where ray origins are lifted, with the shading normal. */
static inline bool frame_faces(const struct tile_run_frame *f, uint32_t j, double cosine, double shading_cosine)
{
    return (f->lifted[j] ? shading_cosine : cosine) > 0.0;
}

/* Share of the light from a direction that counts as incident at point j; `cosine` is between the direction and the
 * shading normal on the point's side. 1 unless the material's gloss is simulated (kiln_chain_taken_up). */
static inline float frame_taken_up(const struct tile_run_frame *f, uint32_t j, float cosine)
{
    if (!f->glossy[j])
        return 1.0f;
    return cosine > 0.0f ? kiln_chain_taken_up(f->lobes[j], f->back ? -cosine : cosine) : 0.0f;
}

/* Returns the geometric normal of point j, or 0 if its area has several or if light from below it may count. For
 * choosing lights; needs FRAME_EXTENT. */
static inline struct kiln_dvec3 frame_one_normal(const struct tile_run_frame *f, uint32_t j)
{
    return f->extent[j].one_normal && !f->lifted[j]
               ? dvec3((double)f->normal[0][j], (double)f->normal[1][j], (double)f->normal[2][j])
               : dvec3(0.0, 0.0, 0.0);
}

/* Whether a place (offset included) of a partly buried point with this normal is buried, as in worker/pass/validity.h.
 * Exception: where faces coincide that are not whole triangles, the ray decides. Buried samples are drawn again; a
 * second ray for each would make passes half as long again. */
bool frame_buried(const struct embree_backend *backend, struct kiln_vec3 position, struct kiln_vec3 normal);
/* Counts the buried places among `count` <= PACKET places with these normals, as in worker/pass/validity.h. */
uint32_t frame_count_buried(const struct embree_backend *backend, const struct kiln_vec3 *position,
                            const struct kiln_vec3 *normal, uint32_t count);

#endif
