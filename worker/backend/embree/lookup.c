#include "worker/backend/embree/lookup.h"

/* Looks up the store for each hit of lanes [begin, end); drops rays that missed or hit a back face. */
KILN_CLONES static void enter(const struct embree_backend *b, const struct tile_run_rays *rays, uint32_t begin,
                              uint32_t end, struct rays_found *restrict f)
{
    const struct kiln_hit_record *records = b->params.geometry->records;
    const struct kiln_store store = b->store;
    uint32_t count = f->count, escaped = f->escaped, blocked = f->blocked;
    for (uint32_t l = begin; l < end; l++) {
        const struct RTCRayHit8 *r = &rays->packets[l / PACKET];
        const uint32_t i = l % PACKET;
        const unsigned geometry = r->hit.geomID[i];
        if (geometry == RTC_INVALID_GEOMETRY_ID) {
            f->escaped_lane[escaped++] = (uint8_t)l;
            continue;
        }
        const uint32_t triangle = embree_triangle(b, geometry, r->hit.primID[i]);
        const float facing = r->hit.Ng_x[i] * rays->direction[0][l] + r->hit.Ng_y[i] * rays->direction[1][l] +
                             r->hit.Ng_z[i] * rays->direction[2][l];
        if (facing > 0.0f && (records[triangle].material & KILN_RECORD_DOUBLE_SIDED) == 0) {
            f->blocked_lane[blocked++] = (uint8_t)l;
            continue;
        }
        kiln_store_enter(&store, &f->ways, count, triangle, r->hit.u[i], r->hit.v[i], facing > 0.0f);
        f->lane[count++] = (uint8_t)l;
    }
    f->count = count;
    f->escaped = escaped;
    f->blocked = blocked;
}

/* Finishes the lookup of hit i, which one step could not complete. */
static uint64_t settle(const struct embree_backend *b, const struct tile_run_rays *rays, const struct rays_found *f,
                       uint32_t i)
{
    const uint32_t l = f->lane[i], k = l % PACKET;
    const struct RTCRayHit8 *r = &rays->packets[l / PACKET];
    const bool back = r->hit.Ng_x[k] * rays->direction[0][l] + r->hit.Ng_y[k] * rays->direction[1][l] +
                          r->hit.Ng_z[k] * rays->direction[2][l] >
                      0.0f;
    return kiln_store_settle(&b->store, embree_triangle(b, r->hit.geomID[k], r->hit.primID[k]), r->hit.u[k],
                             r->hit.v[k], back, (struct kiln_global_point){f->point[i]})
        .at;
}

KILN_CLONES static void follow(const struct embree_backend *b, const struct tile_run_rays *rays,
                               struct rays_found *restrict f)
{
    const struct kiln_store store = b->store;
    const uint32_t open = kiln_store_follow(&store, &f->ways, f->count, b->radiosity, f->point);
    for (uint32_t k = 0; k < open; k++) {
        const uint32_t i = f->ways.open[k];
        f->point[i] = settle(b, rays, f, i);
        if (f->point[i] != KILN_NO_POINT)
            __builtin_prefetch(&b->radiosity[f->point[i]]);
    }
}

/* Prefetches the records of packet p's hits, which are looked up next. */
static void ask_for_records(const struct embree_backend *b, const struct tile_run_rays *rays, uint32_t p)
{
    const struct RTCRayHit8 *r = &rays->packets[p];
    const struct kiln_hit_record *records = b->params.geometry->records;
    for (uint32_t i = 0; i < PACKET; i++)
        if (r->hit.geomID[i] != RTC_INVALID_GEOMETRY_ID)
            __builtin_prefetch(&records[embree_triangle(b, r->hit.geomID[i], r->hit.primID[i])]);
}

void embree_trace_and_find(const struct embree_backend *b, struct embree_context *context, struct tile_run_rays *rays,
                           uint32_t lanes, struct rays_found *found)
{
    if (b->store.surface->bricks != NULL) {
        rays_trace(rays, b, context, lanes);
        embree_find(b, rays, lanes, found);
        return;
    }
    found->count = found->escaped = found->blocked = 0;
    for (uint32_t l = 0; l < lanes; l += PACKET) {
        rays_trace_packet(rays, b, context, l / PACKET, lanes);
        ask_for_records(b, rays, l / PACKET);
        if (l > 0)
            enter(b, rays, l - PACKET, l, found);
    }
    enter(b, rays, lanes > 0 ? (lanes - 1) / PACKET * PACKET : 0, lanes, found);
    follow(b, rays, found);
}

void embree_find(const struct embree_backend *b, const struct tile_run_rays *rays, uint32_t lanes,
                 struct rays_found *found)
{
    found->count = found->escaped = found->blocked = 0;
    if (b->store.surface->bricks != NULL)
        embree_enter_octrees(b, rays, lanes, found);
    else
        enter(b, rays, 0, lanes, found);
    follow(b, rays, found);
}
