/* Closest hits of any rays. */
#include <math.h>

#include "worker/backend/embree/passage.h"

/* Factor on the length of rays: rounding might miss a hit at the very end. */
static const float LENGTHENED = 1.0001f;

/* Traces rays [first, first + lanes) in one packet. `lengths`: NULL: unlimited. */
static void intersect8(const struct embree_backend *b, struct embree_context *context, const struct kiln_vec3 *origins,
                       const struct kiln_vec3 *directions, const float *lengths, uint32_t lanes, struct kiln_hit *hits)
{
    struct RTCRayHit8 r;
    int valid[PACKET] __attribute__((aligned(32)));
    uint32_t seed[PACKET] = {0};
    float tint[PACKET][3];
    for (uint32_t i = 0; i < PACKET; i++) {
        const uint32_t from = i < lanes ? i : 0;
        valid[i] = i < lanes && (lengths == NULL || lengths[i] > 0.0f) ? -1 : 0;
        r.ray.org_x[i] = origins[from].x, r.ray.org_y[i] = origins[from].y, r.ray.org_z[i] = origins[from].z;
        r.ray.dir_x[i] = directions[from].x, r.ray.dir_y[i] = directions[from].y, r.ray.dir_z[i] = directions[from].z;
        r.ray.tnear[i] = r.ray.time[i] = 0.0f;
        r.ray.tfar[i] = lengths != NULL ? LENGTHENED * lengths[from] : INFINITY;
        r.ray.mask[i] = ~0u;
        r.ray.flags[i] = 0;
        r.hit.geomID[i] = r.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
        for (int c = 0; c < 3; c++)
            tint[i][c] = 1.0f;
        if (embree_blends(b))
            seed[i] = kiln_ray_seed(origins[from], directions[from]);
    }
    embree_nearest8(b, context, valid, &r, seed, tint);
    for (uint32_t i = 0; i < lanes; i++) {
        hits[i] = (struct kiln_hit){.triangle = KILN_NONE, .tint = {tint[i][0], tint[i][1], tint[i][2]}};
        if (r.hit.geomID[i] == RTC_INVALID_GEOMETRY_ID)
            continue;
        hits[i].triangle = embree_triangle(b, r.hit.geomID[i], r.hit.primID[i]);
        hits[i].u = r.hit.u[i];
        hits[i].v = r.hit.v[i];
        hits[i].distance = r.ray.tfar[i];
        hits[i].back =
            r.hit.Ng_x[i] * r.ray.dir_x[i] + r.hit.Ng_y[i] * r.ray.dir_y[i] + r.hit.Ng_z[i] * r.ray.dir_z[i] > 0.0f;
    }
}

static void intersect_each(const struct embree_backend *b, const struct kiln_vec3 *origins,
                           const struct kiln_vec3 *directions, size_t count, struct kiln_hit *hits)
{
#pragma omp parallel num_threads((int)b->threads)
    {
        const unsigned saved = embree_enter();
        struct embree_context context;
        embree_context(b, &context);
#pragma omp for schedule(dynamic, 4096)
        for (size_t i = 0; i < count; i++) {
            struct RTCRayHit r = {.ray = {.org_x = origins[i].x,
                                          .org_y = origins[i].y,
                                          .org_z = origins[i].z,
                                          .dir_x = directions[i].x,
                                          .dir_y = directions[i].y,
                                          .dir_z = directions[i].z,
                                          .tfar = INFINITY,
                                          .mask = ~0u},
                                  .hit = {.geomID = RTC_INVALID_GEOMETRY_ID, .instID = {RTC_INVALID_GEOMETRY_ID}}};
            hits[i] = (struct kiln_hit){.triangle = KILN_NONE, .tint = {1.0f, 1.0f, 1.0f}};
            embree_nearest1(b, &context, &r, kiln_ray_seed(origins[i], directions[i]), hits[i].tint);
            if (r.hit.geomID == RTC_INVALID_GEOMETRY_ID)
                continue;
            hits[i].triangle = embree_triangle(b, r.hit.geomID, r.hit.primID);
            hits[i].u = r.hit.u;
            hits[i].v = r.hit.v;
            hits[i].distance = r.ray.tfar;
            hits[i].back = r.hit.Ng_x * r.ray.dir_x + r.hit.Ng_y * r.ray.dir_y + r.hit.Ng_z * r.ray.dir_z > 0.0f;
        }
        embree_leave(saved);
    }
}

/* Traces eight consecutive rays at a time. `lengths`: NULL: unlimited. */
static void intersect_packets(const struct embree_backend *b, const struct kiln_vec3 *origins,
                              const struct kiln_vec3 *directions, const float *lengths, size_t count,
                              struct kiln_hit *hits)
{
#pragma omp parallel num_threads((int)b->threads)
    {
        const unsigned saved = embree_enter();
        struct embree_context context;
        embree_context(b, &context);
        context.rtc.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
#pragma omp for schedule(dynamic, 512)
        for (size_t i = 0; i < count; i += PACKET)
            intersect8(b, &context, origins + i, directions + i, lengths != NULL ? lengths + i : NULL,
                       count - i < PACKET ? (uint32_t)(count - i) : PACKET, hits + i);
        embree_leave(saved);
    }
}

int embree_intersect(struct kiln_backend *backend, const struct kiln_vec3 *origins, const struct kiln_vec3 *directions,
                     size_t count, const struct kiln_ray_hints *hints, struct kiln_hit *hits, struct kiln_error *error)
{
    (void)error;
    const struct embree_backend *b = (const struct embree_backend *)backend;
    if (hints->alike || hints->lengths != NULL)
        intersect_packets(b, origins, directions, hints->lengths, count, hits);
    else
        intersect_each(b, origins, directions, count, hits);
    return KILN_OK;
}
