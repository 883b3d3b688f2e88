/* Which parts of the texels are buried in other geometry: their rays meet back faces of single-sided surfaces.
 *
 * 16 rays a point first; where two or more of them meet back faces, 128 more say which of the texel's 4 x 4 sub-squares are
 * buried: those whose rays meet back faces three times out of four. A point with no open sub-square is invalid. */
#include <math.h>
#include <omp.h>
#include <string.h>

#include "shaders/random.h"
#include "worker/backend/embree/embree.h"
#include "worker/backend/embree/frame.h"
#include "worker/base/memory.h"
#include "worker/sampling/sequence.h"

enum { FIRST_LOOK = 16, SECOND_LOOK = 128, SUSPECT = 2, SUB_SQUARES = 16 };

struct sub_squares {
    uint32_t rays[SUB_SQUARES], back[SUB_SQUARES];
    uint32_t back_all;
};

/* Sub-square of the texel in which a sample lies: a parallelogram's own coordinates, or the record's texel coordinates. */
static uint32_t sub_square_of(const struct embree_backend *b, const struct kiln_footprint *footprint, uint32_t triangle, float b1, float b2)
{
    const struct kiln_hit_record *r = &b->params.geometry->records[triangle];
    const float x = r->texel[0] + b1 * r->texel[2] + b2 * r->texel[4] - (float)footprint->x;
    const float y = r->texel[1] + b1 * r->texel[3] + b2 * r->texel[5] - (float)footprint->y;
    const int32_t sx = (int32_t)(x * 4.0f), sy = (int32_t)(y * 4.0f);
    return (uint32_t)(sy < 0 ? 0 : sy > 3 ? 3 : sy) * 4u + (uint32_t)(sx < 0 ? 0 : sx > 3 ? 3 : sx);
}

static void look(const struct embree_backend *b, struct RTCIntersectContext *context, const struct fragment_frame *f, uint32_t j,
                 uint32_t samples, uint32_t stream, struct sub_squares *found)
{
    const uint32_t key = kiln_hash2(f->key[j], stream);
    const struct kiln_geometry *g = b->params.geometry;
    for (uint32_t k = 0; k < samples; k++) {
        float r[4];
        for (uint32_t d = 0; d < 4; d++)
            r[d] = kiln_unit_float(kiln_owen_scramble(kiln_sobol(k, d), kiln_hash2(key, d)));
        uint32_t triangle;
        float b1, b2;
        kiln_footprint_sample(&f->footprint[j], r[2], r[3], &triangle, &b1, &b2);
        const uint32_t square = sub_square_of(b, &f->footprint[j], triangle, b1, b2);
        const struct kiln_vec3 n = kiln_triangle_normal(g, triangle);
        const struct kiln_vec3 p = kiln_offset_origin(kiln_triangle_position(g, triangle, b1, b2), n, g, triangle);
        const struct kiln_dvec3 local = kiln_cosine_direction((double)r[0], (double)r[1]);
        struct kiln_vec3 t, s;
        kiln_basis(n, &t, &s);
        const struct kiln_vec3 d = vec3_madd(vec3_madd(vec3_scale(t, (float)local.x), s, (float)local.y), n, (float)local.z);
        struct RTCRayHit ray = {.ray = {.org_x = p.x, .org_y = p.y, .org_z = p.z, .dir_x = d.x, .dir_y = d.y, .dir_z = d.z,
                                        .tfar = INFINITY, .mask = ~0u},
                                .hit = {.geomID = RTC_INVALID_GEOMETRY_ID, .instID = {RTC_INVALID_GEOMETRY_ID}}};
        rtcIntersect1(b->scene, context, &ray);
        found->rays[square]++;
        if (ray.hit.geomID == RTC_INVALID_GEOMETRY_ID || ray.hit.Ng_x * d.x + ray.hit.Ng_y * d.y + ray.hit.Ng_z * d.z <= 0.0f)
            continue;
        const uint32_t hit = embree_triangle(b, ray.hit.geomID, ray.hit.primID);
        if ((g->records[hit].material & KILN_RECORD_DOUBLE_SIDED) == 0) {
            found->back[square]++;
            found->back_all++;
        }
    }
}

static void judge(const struct embree_backend *b, struct RTCIntersectContext *context, const struct fragment_frame *f, uint32_t j,
                  uint16_t *open)
{
    struct sub_squares found = {0};
    *open = 0xffff;
    look(b, context, f, j, FIRST_LOOK, 0x76616c31u, &found);
    if (found.back_all < SUSPECT)
        return;
    memset(&found, 0, sizeof found);
    look(b, context, f, j, SECOND_LOOK, 0x76616c32u, &found);
    bool some_open = false;
    for (int i = 0; i < SUB_SQUARES; i++) {
        if (found.rays[i] == 0)
            continue; /* not covered, or next to nothing */
        if (4 * found.back[i] >= 3 * found.rays[i])
            *open = (uint16_t)(*open & ~(1u << i));
        else
            some_open = true;
    }
    if (!some_open)
        *open = 0;
}

int embree_validity(struct kiln_backend *backend, size_t fragment_first, size_t fragment_count, uint16_t *open,
                    struct kiln_error *error)
{
    const struct embree_backend *b = (const struct embree_backend *)backend;
    struct fragment_frame *frames = NULL;
    const int status = kiln_allocate(&frames, b->threads, sizeof *frames, "the validity pass", error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel num_threads((int)b->threads)
    {
        const unsigned saved = embree_enter();
        struct RTCIntersectContext context;
        rtcInitIntersectContext(&context);
        struct fragment_frame *f = &frames[omp_get_thread_num()];
#pragma omp for schedule(dynamic, 4)
        for (size_t i = 0; i < fragment_count; i++) {
            const struct kiln_fragment *fragment = &b->surface->fragments[fragment_first + i];
            const uint64_t own = fragment->first - b->surface->first;
            frame_build(f, b, fragment_first + i, FRAME_EVERY);
            for (uint32_t j = 0; j < f->count; j++)
                judge(b, &context, f, j, &open[own + f->place[j]]);
        }
        embree_leave(saved);
    }
    kiln_free(&frames);
    return KILN_OK;
}
