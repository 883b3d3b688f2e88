#include "coordinator/integrate/patches/link_rooms.h"

#include <string.h>

#include "coordinator/mpi/agree.h"
#include "worker/backend/extended.h"
#include "worker/base/arena.h"
#include "worker/base/disjoint_sets.h"
#include "worker/base/memory.h"
#include "worker/sampling/keys.h"
#include "worker/sampling/sequence.h"
#include "worker/store/lightmap.h"
#include "worker/store/octree.h"
#include "worker/store/store.h"

enum {
    RAYS = 16, /* of a point */
    TOGETHER = 1 << 16,
    SENT = 1 << 28 /* numbers that MPI reduces at a time */
};

static const char WHAT[] = "the rooms of links";

/* Rooms as disjoint sets of points. The element behind all points stands for outdoors. */
struct rooms {
    const struct kiln_rooms_source *source;
    uint32_t *parent; /* kiln_sets */
    uint32_t count;   /* points, and outdoors */
    struct kiln_store store;
    struct kiln_vec3 *origins, *directions;
    struct kiln_hit *hits;
    uint32_t *from, *to; /* points */
    float *lengths;
    struct kiln_arena arena;
};

/* Returns cosine-distributed direction k over the hemisphere of a point. */
static struct kiln_vec3 direction_of(const struct kiln_patch *p, uint32_t k)
{
    const uint32_t key = kiln_hash1(p->number);
    const struct kiln_dvec3 local = kiln_cosine_direction(kiln_unit_double(kiln_sobol(k, 0) ^ key),
                                                          kiln_unit_double(kiln_sobol(k, 1) ^ kiln_hash1(key)));
    struct kiln_vec3 t, b;
    kiln_basis(p->normal, &t, &b);
    return vec3_normalize(
        vec3_madd(vec3_madd(vec3_scale(t, (float)local.x), b, (float)local.y), p->normal, (float)local.z));
}

static void set_rays(const struct rooms *r, uint32_t point, size_t first)
{
    const struct kiln_patch *p = &r->source->points[point];
    for (uint32_t k = 0; k < RAYS; k++) {
        r->from[first + k] = point;
        r->origins[first + k] = p->place;
        r->directions[first + k] = direction_of(p, k);
    }
}

/* Returns the point that a ray has hit, or the element of outdoors; KILN_NONE: neither. */
static uint32_t met(const struct rooms *r, const struct kiln_hit *hit)
{
    const struct kiln_geometry *g = r->source->backend->params.geometry;
    if (hit->triangle == KILN_NONE)
        return r->count - 1;
    if (hit->back && (g->records[hit->triangle].material & KILN_RECORD_DOUBLE_SIDED) == 0)
        return KILN_NONE;
    const struct kiln_global_point point = r->store.surface->bricks != NULL
                                               ? kiln_octree_find(&r->store, hit->triangle, hit->u, hit->v, hit->back)
                                               : kiln_store_find(&r->store, hit->triangle, hit->u, hit->v, hit->back);
    if (point.at == KILN_NO_POINT || !(r->source->points[point.at].area > 0.0f))
        return KILN_NONE;
    return (uint32_t)point.at;
}

/* Makes ray i's return ray: from the centre of the point that it has hit to its origin, since a wall may stand across
 * the texel between the hit and the centre. Rays to outdoors need none. */
static void turn_ray(const struct rooms *r, size_t i)
{
    r->to[i] = met(r, &r->hits[i]);
    r->lengths[i] = 0.0f;
    if (r->to[i] == KILN_NONE || r->to[i] == r->count - 1)
        return;
    const struct kiln_patch *p = &r->source->points[r->to[i]];
    const struct kiln_vec3 hit = vec3_madd(r->origins[i], r->directions[i], r->hits[i].distance);
    const float height = vec3_dot(p->normal, vec3_sub(p->place, hit));
    const struct kiln_vec3 way = vec3_sub(vec3_madd(hit, p->normal, height), p->place);
    const float length = vec3_length(way);
    if (!(length > 0.0f))
        return;
    r->origins[i] = p->place;
    r->directions[i] = vec3_scale(way, 1.0f / length);
    r->lengths[i] = length;
}

static int trace(struct rooms *r, size_t rays, struct kiln_error *error)
{
    int status;
    KILN_TRY(kiln_backend_intersect(r->source->backend, r->origins, r->directions, rays, r->hits, error));
    for (size_t i = 0; i < rays; i++)
        turn_ray(r, i);
    KILN_TRY(kiln_backend_intersect_hinted(r->source->backend, r->origins, r->directions, rays,
                                           &(struct kiln_ray_hints){.lengths = r->lengths}, r->hits, error));
    for (size_t i = 0; i < rays; i++) {
        const bool is_parted =
            r->lengths[i] > 0.0f && r->hits[i].triangle != KILN_NONE && r->hits[i].distance < r->lengths[i];
        if (r->to[i] != KILN_NONE && !is_parted)
            kiln_sets_join(r->parent, r->from[i], r->to[i]);
    }
end:
    return status;
}

/* Rays of this rank's points. */
static int look_around(struct rooms *r, struct kiln_error *error)
{
    const struct kiln_surface *s = r->source->surface;
    size_t rays = 0;
    int status = KILN_OK;
    for (uint64_t i = 0; i < s->count && status == KILN_OK; i++) {
        const uint32_t point = (uint32_t)(s->first.at + i);
        if (!(r->source->points[point].area > 0.0f))
            continue;
        set_rays(r, point, rays);
        rays += RAYS;
        if (rays < TOGETHER)
            continue;
        status = trace(r, rays, error);
        rays = 0;
    }
    return status == KILN_OK ? trace(r, rays, error) : status;
}

/* Collective. Joins the rooms that each rank has found, until nothing changes. */
static int join(struct rooms *r, int status, struct kiln_error *error)
{
    uint32_t *least = NULL;
    int ranks, changed = 1;
    (void)MPI_Comm_size(r->source->communicator, &ranks);
    if (status == KILN_OK)
        status = kiln_allocate(&least, r->count, sizeof *least, WHAT, error);
    status = kiln_agree(r->source->communicator, status, error);
    while (status == KILN_OK && ranks > 1 && changed != 0) {
        changed = 0;
        for (uint32_t i = 0; i < r->count; i++)
            least[i] = kiln_sets_root(r->parent, i);
        for (size_t i = 0; i < r->count; i += SENT)
            (void)MPI_Allreduce(MPI_IN_PLACE, least + i, (int)(r->count - i < SENT ? r->count - i : SENT), MPI_UINT32_T,
                                MPI_MIN, r->source->communicator);
        for (uint32_t i = 0; i < r->count; i++)
            if (kiln_sets_root(r->parent, i) != kiln_sets_root(r->parent, least[i])) {
                kiln_sets_join(r->parent, i, least[i]);
                changed = 1;
            }
        (void)MPI_Allreduce(MPI_IN_PLACE, &changed, 1, MPI_INT, MPI_LOR, r->source->communicator);
    }
    kiln_free(&least);
    return status;
}

/* Numbers the rooms in the order of their points' numbers, and writes that of each point. */
static int number_rooms(struct rooms *r, uint32_t *rooms, struct kiln_error *error)
{
    const struct kiln_patch *points = r->source->points;
    const uint32_t count = r->count - 1;
    uint32_t *order = NULL, *size = NULL, next = 0;
    int status;
    KILN_TRY(kiln_allocate(&order, count, sizeof *order, WHAT, error));
    KILN_TRY(kiln_allocate(&size, r->count, sizeof *size, WHAT, error));
    for (uint32_t i = 0; i < count; i++)
        order[i] = KILN_NONE;
    for (uint32_t i = 0; i < count; i++)
        if (points[i].area > 0.0f) {
            order[points[i].number] = i;
            size[kiln_sets_root(r->parent, i)]++;
        }
    size[kiln_sets_root(r->parent, count)]++;
    for (uint32_t k = 0; k < count; k++) {
        const uint32_t i = order[k], root = i != KILN_NONE ? kiln_sets_root(r->parent, i) : 0;
        if (i == KILN_NONE || size[root] == 1)
            continue;
        if (rooms[root] == KILN_NONE) /* the root may be outdoors, which is no point; its points form a room, too */
            rooms[root] = next++;
        rooms[i] = rooms[root];
    }
    for (uint32_t i = 0; i < count; i++)
        rooms[i] = rooms[i] == KILN_NONE ? next : rooms[i];
end:
    kiln_free(&order);
    kiln_free(&size);
    return status;
}

static int allocate(struct rooms *r, struct kiln_error *error)
{
    int status;
    KILN_TRY(kiln_arena_allocate(&r->arena, &r->parent, r->count, sizeof *r->parent, WHAT, error));
    KILN_TRY(kiln_arena_allocate(&r->arena, &r->origins, TOGETHER + RAYS, sizeof *r->origins, WHAT, error));
    KILN_TRY(kiln_arena_allocate(&r->arena, &r->directions, TOGETHER + RAYS, sizeof *r->directions, WHAT, error));
    KILN_TRY(kiln_arena_allocate(&r->arena, &r->hits, TOGETHER + RAYS, sizeof *r->hits, WHAT, error));
    KILN_TRY(kiln_arena_allocate(&r->arena, &r->from, TOGETHER + RAYS, sizeof *r->from, WHAT, error));
    KILN_TRY(kiln_arena_allocate(&r->arena, &r->to, TOGETHER + RAYS, sizeof *r->to, WHAT, error));
    KILN_TRY(kiln_arena_allocate(&r->arena, &r->lengths, TOGETHER + RAYS, sizeof *r->lengths, WHAT, error));
    kiln_sets_begin(r->parent, r->count);
end:
    return status;
}

int kiln_rooms_find(const struct kiln_rooms_source *source, uint32_t **rooms, struct kiln_error *error)
{
    struct rooms r = {.source = source, .count = (uint32_t)source->surface->point_count + 1};
    int status = allocate(&r, error);
    *rooms = NULL;
    kiln_store_build(&r.store, source->surface, source->backend->params.geometry);
    if (status == KILN_OK)
        status = look_around(&r, error);
    status = join(&r, status, error);
    if (status == KILN_OK)
        status = kiln_allocate(rooms, r.count, sizeof **rooms, WHAT, error);
    if (status == KILN_OK) {
        memset(*rooms, 0xff, r.count * sizeof **rooms);
        status = number_rooms(&r, *rooms, error);
    }
    kiln_arena_release(&r.arena);
    status = kiln_agree(source->communicator, status, error);
    if (status != KILN_OK)
        kiln_free(rooms);
    return status;
}
