#include "worker/backend/embree/lookup.h"

/* As `enter` of lookup.c, into octrees. */
KILN_CLONES void embree_enter_octrees(const struct embree_backend *b, const struct tile_run_rays *rays, uint32_t lanes,
                                      struct rays_found *restrict f)
{
    const struct kiln_hit_record *records = b->params.geometry->records;
    const struct kiln_store store = b->store;
    struct kiln_octree_ways octree;
    uint32_t count = 0, escaped = 0, blocked = 0;
    for (uint32_t l = 0; l < lanes; l++) {
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
        kiln_octree_enter(&store, &octree, &f->ways, count, triangle, r->hit.u[i], r->hit.v[i], facing > 0.0f);
        f->lane[count++] = (uint8_t)l;
    }
    kiln_octree_reach(&store, &octree, &f->ways, count);
    f->count = count;
    f->escaped = escaped;
    f->blocked = blocked;
}
