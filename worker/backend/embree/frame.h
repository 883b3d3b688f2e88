/* One tile run's points made ready for sampling: where their samples may lie and which way they face. */
#ifndef KILN_WORKER_BACKEND_EMBREE_FRAME_H
#define KILN_WORKER_BACKEND_EMBREE_FRAME_H

#include "shaders/shared/chain.h"
#include "worker/backend/embree/embree.h"
#include "worker/scene/footprint.h"

/* Where rays begin on a triangle. */
struct frame_triangle {
    uint32_t triangle;       /* KILN_NONE: none */
    struct kiln_vec3 normal; /* towards the side that is lit */
    float offset;            /* m along the normal: how far rays start off it */
    bool lifts;              /* whether they are lifted besides */
    struct kiln_lift lift;
};

enum { FRAME_TRIANGLES = 32 };

/* Valid points of a tile run that are asked for, in order. Positions already carry the offset off their surface that
 * keeps rays from meeting it again (see worker/scene/footprint.h). About 60 KiB: keep one a thread. */
struct tile_run_frame {
    uint32_t count;                   /* points */
    uint32_t tile_key;                /* hash of (seed, object, tile) */
    bool smooth;                      /* some shading normal differs from the geometric one */
    bool lifts;                       /* and rays are lifted off facets (FRAME_LIFT) */
    bool back;                        /* of backs: all normals are those of the triangles turned round */
    uint32_t place[KILN_TILE_TEXELS]; /* of point j among the tile run's points */
    uint32_t key[KILN_TILE_TEXELS];   /* hash of (seed, object, texel); what places are drawn again by */
    bool whole[KILN_TILE_TEXELS];     /* position = origin + s edge_s + t edge_t, one normal; else use frame_position */
    bool lifted[KILN_TILE_TEXELS];    /* rays begin above the surface (shaders/shared/lift.h); never `whole` */
    bool partly_buried[KILN_TILE_TEXELS]; /* frame_position draws again until a place is not buried; never `whole` */
    float origin[3][KILN_TILE_TEXELS], edge_s[3][KILN_TILE_TEXELS], edge_t[3][KILN_TILE_TEXELS];
    float normal[3][KILN_TILE_TEXELS];       /* geometric, unit; of a point that is not whole: its first piece's */
    float offset[KILN_TILE_TEXELS];          /* m along the normal that positions of a whole point carry */
    float shading[3][KILN_TILE_TEXELS];      /* unit; set where `smooth` */
    float present[KILN_TILE_TEXELS];         /* see struct kiln_point_result */
    struct kiln_mask mask[KILN_TILE_TEXELS]; /* where something may be; a point with one is never `whole` */
    /* whether the point's material is taken with its gloss, and how it scatters light then: by one place of the point
     */
    bool glossy[KILN_TILE_TEXELS];
    struct kiln_bsdf_lobes lobes[KILN_TILE_TEXELS];
    /* with FRAME_EXTENT only */
    struct kiln_footprint_extent extent[KILN_TILE_TEXELS];
    struct kiln_footprint footprint[KILN_TILE_TEXELS];
    struct frame_triangle known[FRAME_TRIANGLES]; /* those met last, each at its number modulo the table's size */
};

enum frame_wish {
    /* the invalid points too, and all of them as if nothing was buried: for the validity pass itself */
    FRAME_EVERY = 1,
    FRAME_EXTENT = 2, /* `extent` too: for choosing lights */
    FRAME_PLACES = 4, /* for frame_position alone: nothing of how light is scattered, no shading normals */
    FRAME_LIFT = 8    /* positions are where rays begin: of smooth meshes lifted off coarse facets */
};
/* `points`: bit k says whether the k-th point is asked for. */
void frame_build(struct tile_run_frame *frame, const struct embree_backend *backend, size_t tile_run, uint64_t points,
                 unsigned wish);

/* Position (offset included) and geometric normal of a sample of point j; s and t in (0,1), uniform over what of its
 * area is there and not buried. Returns the offset, m along the normal, with the lift: light is weighed where the
 * surface is, only its ray starts off it. */
float frame_position(struct tile_run_frame *frame, const struct embree_backend *backend, uint32_t j, float s, float t,
                     struct kiln_vec3 *position, struct kiln_vec3 *normal);

/* The shading normal of a sample of point j whose geometric normal is n: of a coarse texel's pieces some may turn away
 * from the mean of them all; those are lit as their own normal says. n itself where the frame is not smooth. */
static inline struct kiln_vec3 frame_shading(const struct tile_run_frame *f, uint32_t j, struct kiln_vec3 n)
{
    if (!f->smooth)
        return n;
    const struct kiln_vec3 shading = vec3(f->shading[0][j], f->shading[1][j], f->shading[2][j]);
    return vec3_dot(shading, n) > 0.0f ? shading : n;
}

/* Whether light from a direction reaches point j as far as its own surface goes: by the cosine with the geometric
 * normal or, where rays are lifted above it, by that with the shading normal. */
static inline bool frame_faces(const struct tile_run_frame *f, uint32_t j, double cosine, double shading_cosine)
{
    return (f->lifted[j] ? shading_cosine : cosine) > 0.0;
}

/* Share of the light from a direction that counts as incident at point j; `cosine` is the direction's with the shading
 * normal of the point's own side. 1 but for materials that are taken with their gloss (kiln_chain_taken_up). */
static inline float frame_taken_up(const struct tile_run_frame *f, uint32_t j, float cosine)
{
    if (!f->glossy[j])
        return 1.0f;
    return cosine > 0.0f ? kiln_chain_taken_up(f->lobes[j], f->back ? -cosine : cosine) : 0.0f;
}

/* The geometric normal of point j, or 0 where its area has several or light from below it may count; with FRAME_EXTENT.
 * For choosing lights. */
static inline struct kiln_dvec3 frame_one_normal(const struct tile_run_frame *f, uint32_t j)
{
    return f->extent[j].one_normal && !f->lifted[j]
               ? dvec3((double)f->normal[0][j], (double)f->normal[1][j], (double)f->normal[2][j])
               : dvec3(0.0, 0.0, 0.0);
}

/* Whether a place (offset included) with this normal, of a partly buried point, is buried: as worker/pass/validity.h
 * has it, but where faces coincide that are no whole triangles the ray decides. Samples are drawn again by it: a second
 * ray for each would make passes half as long again. */
bool frame_buried(const struct embree_backend *backend, struct kiln_vec3 position, struct kiln_vec3 normal);
/* Counts the buried ones of `count` <= PACKET places with these normals, as worker/pass/validity.h has it. */
uint32_t frame_count_buried(const struct embree_backend *backend, const struct kiln_vec3 *position,
                            const struct kiln_vec3 *normal, uint32_t count);

#endif
