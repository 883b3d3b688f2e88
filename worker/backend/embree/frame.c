#include "worker/backend/embree/frame.h"

#include <math.h>

#include "shaders/shared/streams.h"
#include "worker/backend/embree/coincident.h"
#include "worker/sampling/keys.h"
#include "worker/sampling/sequence.h"

/* Looks a triangle up in a cache of recent ones. The footprints of a tile run have few triangles, which recur. */
static const struct frame_triangle *know(struct tile_run_frame *f, const struct embree_backend *b, uint32_t triangle)
{
    struct frame_triangle *known = &f->known[triangle % FRAME_TRIANGLES];
    if (known->triangle == triangle)
        return known;
    known->triangle = triangle;
    const struct kiln_vec3 front = kiln_triangle_exact_normal(b->params.scene, b->params.geometry, triangle);
    known->normal = f->back ? vec3_scale(front, -1.0f) : front;
    known->offset = kiln_offset_distance(b->params.geometry, triangle, known->normal);
    known->lifts = f->lifts && kiln_triangle_lift(b->params.scene, b->params.geometry, triangle, f->back, &known->lift);
    return known;
}

/* Prepares positions on the whole square, with the offset applied once: the rounding of s and t is within the bound. */
static void build_whole(struct tile_run_frame *f, const struct embree_backend *b, uint32_t j, uint32_t triangle)
{
    const struct kiln_footprint *p = &f->footprint[j];
    const struct frame_triangle *known = know(f, b, triangle);
    const struct kiln_vec3 origin = vec3_madd(p->whole.origin, known->normal, known->offset);
    f->offset[j] = known->offset;
    const struct kiln_vec3 du = p->whole.du, dv = p->whole.dv;
    f->origin[0][j] = origin.x, f->origin[1][j] = origin.y, f->origin[2][j] = origin.z;
    f->edge_s[0][j] = du.x, f->edge_s[1][j] = du.y, f->edge_s[2][j] = du.z;
    f->edge_t[0][j] = dv.x, f->edge_t[1][j] = dv.y, f->edge_t[2][j] = dv.z;
}

/* Number of rays that test whether a position is buried: along the normal and three around it. */
enum { BURIED_RAYS = 4 };

static struct kiln_vec3 buried_way(struct kiln_vec3 normal, int ray)
{
    static const float turn[BURIED_RAYS][2] = {{0.0f, 0.0f},
                                               {KILN_BURIED_ACROSS, 0.0f},
                                               {-KILN_BURIED_HALF, KILN_BURIED_SIDE},
                                               {-KILN_BURIED_HALF, -KILN_BURIED_SIDE}};
    if (ray == 0)
        return normal;
    struct kiln_vec3 t, s;
    kiln_basis(normal, &t, &s);
    return vec3_madd(vec3_madd(vec3_scale(t, turn[ray][0]), s, turn[ray][1]), normal, KILN_BURIED_ALONG);
}

/* Whether a ray along d has hit the back of a solid. */
static bool is_solid_back(const struct embree_backend *b, const struct RTCHit *hit, struct kiln_vec3 d)
{
    if (hit->geomID == RTC_INVALID_GEOMETRY_ID || hit->Ng_x * d.x + hit->Ng_y * d.y + hit->Ng_z * d.z <= 0.0f)
        return false;
    return kiln_geometry_is_solid(b->params.geometry, embree_triangle(b, hit->geomID, hit->primID));
}

/* Tests whether a position is buried. Coincident fronts are searched last: only if all rays have hit backs. */
bool frame_buried(const struct embree_backend *backend, struct kiln_vec3 position, struct kiln_vec3 normal)
{
    struct RTCRayHit rays[BURIED_RAYS];
    struct embree_context context;
    embree_context_solid(&context);
    for (int i = 0; i < BURIED_RAYS; i++) {
        const struct kiln_vec3 p = position, d = buried_way(normal, i);
        rays[i] = (struct RTCRayHit){.ray = {.org_x = p.x,
                                             .org_y = p.y,
                                             .org_z = p.z,
                                             .dir_x = d.x,
                                             .dir_y = d.y,
                                             .dir_z = d.z,
                                             .tfar = INFINITY,
                                             .mask = ~0u},
                                     .hit = {.geomID = RTC_INVALID_GEOMETRY_ID, .instID = {RTC_INVALID_GEOMETRY_ID}}};
        rtcIntersect1(backend->scene, &context.rtc, &rays[i]);
        if (!is_solid_back(backend, &rays[i].hit, d))
            return false;
    }
    for (int i = 0; i < BURIED_RAYS && backend->coincides != NULL; i++) {
        embree_prefer_front1(backend, &context, &rays[i]);
        if (!is_solid_back(backend, &rays[i].hit, buried_way(normal, i)))
            return false;
    }
    return true;
}

/* Whether a position is buried, from the hits of its rays: backs, and at most KILN_BURIED_BOTH other hits, which may
 * coincide with backs. Coincident faces are searched last, and at few positions. */
static bool all_meet_backs(const struct embree_backend *b, const struct embree_context *context,
                           struct kiln_vec3 normal, const struct RTCHit hits[BURIED_RAYS])
{
    int both = 0;
    for (int i = 0; i < BURIED_RAYS && both <= KILN_BURIED_BOTH; i++) {
        const struct kiln_vec3 d = buried_way(normal, i);
        const bool back = is_solid_back(b, &hits[i], d), other = embree_coincides(b, context, &hits[i], d, !back);
        if (!back && !other)
            return false;
        both += other ? 1 : 0;
    }
    return both <= KILN_BURIED_BOTH;
}

static void start_packet(struct RTCRayHit8 *rays, const struct kiln_vec3 *position, const struct kiln_vec3 *normal,
                         const int *valid, int ray)
{
    *rays = (struct RTCRayHit8){0};
    for (uint32_t i = 0; i < PACKET; i++) {
        rays->hit.geomID[i] = rays->hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
        if (valid[i] == 0)
            continue;
        const struct kiln_vec3 p = position[i], d = buried_way(normal[i], ray);
        rays->ray.org_x[i] = p.x, rays->ray.org_y[i] = p.y, rays->ray.org_z[i] = p.z;
        rays->ray.dir_x[i] = d.x, rays->ray.dir_y[i] = d.y, rays->ray.dir_z[i] = d.z;
        rays->ray.tfar[i] = INFINITY;
        rays->ray.mask[i] = ~0u;
    }
}

static struct RTCHit hit_of(const struct RTCRayHit8 *rays, uint32_t i)
{
    return (struct RTCHit){.Ng_x = rays->hit.Ng_x[i],
                           .Ng_y = rays->hit.Ng_y[i],
                           .Ng_z = rays->hit.Ng_z[i],
                           .u = rays->hit.u[i],
                           .v = rays->hit.v[i],
                           .primID = rays->hit.primID[i],
                           .geomID = rays->hit.geomID[i]};
}

/* Keeps only lanes valid in which all rays have hits, and at most KILN_BURIED_BOTH hits are not backs. Returns their
 * number. */
static uint32_t keep_backs(const struct embree_backend *b, const struct RTCRayHit8 *rays, int others[PACKET],
                           int *valid)
{
    uint32_t count = 0;
    for (uint32_t i = 0; i < PACKET; i++) {
        const struct RTCHit hit = hit_of(rays, i);
        const struct kiln_vec3 d = vec3(rays->ray.dir_x[i], rays->ray.dir_y[i], rays->ray.dir_z[i]);
        others[i] += valid[i] != 0 && !is_solid_back(b, &hit, d) ? 1 : 0;
        if (hit.geomID == RTC_INVALID_GEOMETRY_ID || others[i] > KILN_BURIED_BOTH)
            valid[i] = 0;
        count += valid[i] != 0;
    }
    return count;
}

uint32_t frame_count_buried(const struct embree_backend *backend, const struct kiln_vec3 *position,
                            const struct kiln_vec3 *normal, uint32_t count)
{
    struct RTCRayHit8 rays[BURIED_RAYS];
    int valid[PACKET] __attribute__((aligned(32))), others[PACKET] = {0};
    struct embree_context context;
    uint32_t buried = 0;
    embree_context_solid(&context);
    context.rtc.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT; /* positions in one texel, rays along one normal */
    for (uint32_t i = 0; i < PACKET; i++)
        valid[i] = i < count ? -1 : 0;
    for (int i = 0; i < BURIED_RAYS && count > 0; i++) {
        start_packet(&rays[i], position, normal, valid, i);
        rtcIntersect8(valid, backend->scene, &context.rtc, &rays[i]);
        count = keep_backs(backend, &rays[i], others, valid);
    }
    for (uint32_t k = 0; k < PACKET && count > 0; k++) {
        struct RTCHit hits[BURIED_RAYS];
        for (int i = 0; i < BURIED_RAYS; i++)
            hits[i] = hit_of(&rays[i], k);
        buried += valid[k] != 0 && all_meet_backs(backend, &context, normal[k], hits) ? 1 : 0;
    }
    return buried;
}

/* Returns the offset. */
static float draw_position(struct tile_run_frame *frame, const struct embree_backend *backend, uint32_t j, float s,
                           float t, struct kiln_vec3 *position, struct kiln_vec3 *normal)
{
    uint32_t triangle;
    float b1, b2;
    if (frame->mask[j].count != 0)
        kiln_footprint_sample_present(&frame->footprint[j], &frame->mask[j], frame->key[j], s, t, &triangle, &b1, &b2);
    else
        kiln_footprint_sample(&frame->footprint[j], s, t, &triangle, &b1, &b2);
    const struct kiln_geometry *g = backend->params.geometry;
    const struct frame_triangle *known = know(frame, backend, triangle);
    *normal = known->normal;
    *position = vec3_madd(kiln_triangle_position(g, triangle, b1, b2), known->normal, known->offset);
    float lift = known->lifts ? kiln_lift_at(known->lift, b1, b2) : 0.0f;
    if (!(lift > 0.0f))
        return known->offset;
    lift = embree_clear_lift(backend, *position, *normal, lift);
    *position = vec3_madd(*position, *normal, lift);
    return known->offset + lift;
}

float frame_position(struct tile_run_frame *frame, const struct embree_backend *backend, uint32_t j, float s, float t,
                     struct kiln_vec3 *position, struct kiln_vec3 *normal)
{
    if (frame->whole[j]) {
        float p[3];
        for (int c = 0; c < 3; c++)
            p[c] = frame->origin[c][j] + s * frame->edge_s[c][j] + t * frame->edge_t[c][j];
        *position = vec3(p[0], p[1], p[2]);
        *normal = vec3(frame->normal[0][j], frame->normal[1][j], frame->normal[2][j]);
        return frame->offset[j];
    }
    float offset = draw_position(frame, backend, j, s, t, position, normal);
    for (uint32_t i = 0; frame->partly_buried[j] && i < KILN_BURIED_TRIES && frame_buried(backend, *position, *normal);
         i++) {
        const uint32_t hash = kiln_buried_retry(s, t, frame->key[j], i);
        offset = draw_position(frame, backend, j, kiln_unit_float(hash), kiln_unit_float(kiln_hash1(hash)), position,
                               normal);
    }
    return offset;
}

/* Finds the scattering of a material with gloss, with the texture at the point's middle. */
static void find_lobes(struct tile_run_frame *f, const struct embree_backend *b, uint32_t j)
{
    const struct kiln_scene *scene = b->params.scene;
    const struct kiln_geometry *g = b->params.geometry;
    uint32_t triangle;
    float b1, b2, s1, s2;
    kiln_footprint_sample(&f->footprint[j], 0.5f, 0.5f, &triangle, &b1, &b2);
    const struct kiln_hit_record *record = &g->records[triangle];
    f->glossy[j] = (record->material & KILN_RECORD_GLOSS) != 0;
    if (!f->glossy[j])
        return;
    kiln_geometry_stored_barycentrics(scene, g, triangle, b1, b2, &s1, &s2);
    f->lobes[j] = kiln_surface_lobes(scene, &b->lobes[record->material & KILN_RECORD_MATERIAL],
                                     &scene->meshes[scene->objects[record->object].mesh], g->stored_triangle[triangle],
                                     s1, s2, false);
}

/* Whether rays from any piece of the footprint are lifted. */
static bool is_lifted(struct tile_run_frame *f, const struct embree_backend *b, const struct kiln_footprint *p)
{
    bool lifted = false;
    for (uint32_t i = 0; i < p->piece_count && f->lifts && !lifted; i++)
        lifted = know(f, b, p->pieces[i])->lifts;
    return lifted;
}

static void build_point(struct tile_run_frame *f, const struct embree_backend *b, const struct kiln_point_cursor *at,
                        uint32_t j, bool partly_buried, unsigned wish)
{
    struct kiln_footprint *p = &f->footprint[j];
    const struct kiln_lightmap *map = &b->surface->lightmaps[at->map];
    const uint64_t texel = (uint64_t)at->y * map->width + at->x;
    f->key[j] = kiln_texel_key(kiln_seed_key(b->params.seed), at->map, texel);
    kiln_footprint_prepare(p, b->params.scene, b->params.geometry, b->surface, at);
    if (f->smooth && (wish & FRAME_PLACES) == 0) {
        struct kiln_vec3 mean, shading;
        kiln_footprint_normals(p, &mean, &shading);
        f->shading[0][j] = shading.x, f->shading[1][j] = shading.y, f->shading[2][j] = shading.z;
    }
    f->present[j] = kiln_footprint_opacity(p, kiln_texel_key(KILN_LOOKS_KEY, at->map, texel), &f->mask[j]);
    f->partly_buried[j] = partly_buried;
    f->lifted[j] = is_lifted(f, b, p);
    f->whole[j] = p->kind == KILN_FOOTPRINT_WHOLE && !partly_buried && f->mask[j].count == 0 && !f->lifted[j];
    const struct kiln_vec3 normal = know(f, b, p->pieces[0])->normal;
    f->normal[0][j] = normal.x, f->normal[1][j] = normal.y, f->normal[2][j] = normal.z;
    if (f->whole[j])
        build_whole(f, b, j, p->pieces[0]);
    f->glossy[j] = false;
    if (b->lobes != NULL && (wish & FRAME_PLACES) == 0)
        find_lobes(f, b, j);
    if ((wish & FRAME_EXTENT) != 0)
        f->extent[j] = kiln_footprint_extent(p);
}

void frame_build(struct tile_run_frame *frame, const struct embree_backend *backend, size_t tile_run, uint64_t points,
                 unsigned wish)
{
    const struct kiln_surface *s = backend->surface;
    const struct kiln_tile_run *f = &s->tile_runs[tile_run];
    const struct kiln_scene *scene = backend->params.scene;
    frame->count = 0;
    for (uint32_t i = 0; i < FRAME_TRIANGLES; i++)
        frame->known[i].triangle = KILN_NONE;
    frame->smooth = (scene->meshes[scene->objects[kiln_map_object(s, f->map)].mesh].flags & KILN_MESH_SMOOTH) != 0;
    frame->lifts = frame->smooth && (wish & FRAME_LIFT) != 0;
    frame->back = kiln_map_back(s, f->map);
    frame->tile_key = kiln_tile_key(kiln_seed_key(backend->params.seed), f->map, f->tile);
    struct kiln_point_cursor at = kiln_point_first(s, tile_run);
    for (uint32_t k = 0; k < f->count; k++, kiln_point_next(s, &at)) {
        const bool every = (wish & FRAME_EVERY) != 0;
        if ((points >> k & 1u) == 0 || (!every && !kiln_point_valid(s, at.point)))
            continue;
        const uint32_t j = frame->count++;
        frame->place[j] = k;
        build_point(frame, backend, &at, j, !every && s->visible[at.point.at] != 0xffff, wish);
    }
}
