#include "coordinator/bake/light/visible_from.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include <xxhash.h>

#include "coordinator/mpi/agree.h"
#include "coordinator/view/camera_path.h"
#include "coordinator/view/view.h"
#include "coordinator/view/view_light.h"
#include "worker/base/arena.h"
#include "worker/base/memory.h"
#include "worker/sampling/keys.h"
#include "worker/scene/footprint.h"
#include "worker/store/store.h"

enum {
    WIDTH = 480,          /* of a view, pixels */
    FRAMES_A_KEY = 8,     /* of a path */
    CHUNK_RAYS = 1 << 16, /* traced at a time */
    HOPS = 2
};
static const uint32_t RAYS[HOPS] = {16, 16}; /* of a point, in each hop */
#define RAYS_KEY 0x76696577u

struct search {
    const struct kiln_prepared *p;
    struct kiln_view_source source;
    struct kiln_view_wish *wishes;
    struct kiln_camera_frame *frames; /* frames of a camera path, which the wishes point to */
    size_t count;
    struct kiln_view_rays *rays;
    uint64_t *hit;   /* bit mask of each tile: texels hit by a ray of the first hop */
    bool hits_known; /* the first hop is over */
    uint8_t *marks;  /* mark of each tile; FOUND: first reached within the present hop */
    struct kiln_arena arena;
};
enum mark { UNSEEN, REACHED, SEEN, FOUND };

/* ---- views ---- */

static int make_wishes(struct search *s, size_t count, struct kiln_error *error)
{
    const int status = kiln_arena_allocate(&s->arena, &s->wishes, count, sizeof *s->wishes, "views", error);
    s->count = status == KILN_OK ? count : 0;
    for (size_t i = 0; i < s->count; i++)
        s->wishes[i].width = WIDTH;
    return status;
}

static int path_views(struct search *s, const char *file, struct kiln_error *error)
{
    struct kiln_camera_path *path = NULL;
    int status;
    KILN_TRY(kiln_camera_path_read(&path, file, error));
    KILN_TRY(make_wishes(s, FRAMES_A_KEY * (kiln_camera_path_keys(path) - 1) + 1, error));
    KILN_TRY(kiln_arena_allocate(&s->arena, &s->frames, s->count, sizeof *s->frames, "views", error));
    for (size_t i = 0; i < s->count; i++) {
        kiln_camera_path_frame(path, i, s->count, &s->frames[i]);
        s->wishes[i].from = s->frames[i].from;
        s->wishes[i].to = s->frames[i].to;
        s->wishes[i].field_of_view = s->frames[i].field_of_view;
    }
end:
    kiln_camera_path_destroy(&path);
    return status;
}

static int all_cameras(struct search *s, struct kiln_error *error)
{
    const struct kiln_scene *scene = s->p->scene;
    if (scene->camera_count == 0)
        return kiln_fail(error, KILN_USAGE,
                         "--only-visible-from all: the scene has no camera; name a table of key frames, FILE.csv");
    const int status = make_wishes(s, scene->camera_count, error);
    for (size_t i = 0; i < s->count; i++)
        s->wishes[i].camera = &scene->cameras[i];
    return status;
}

/* Takes a list of cameras, separated by commas, or one camera whose name has commas. */
static int named_cameras(struct search *s, const char *names, struct kiln_error *error)
{
    size_t count = 1;
    char name[512];
    for (const char *c = names; *c != '\0'; c++)
        count += *c == ',';
    int status = make_wishes(s, count, error);
    if (status == KILN_OK && kiln_view_find_camera(s->p->scene, names, &s->wishes[0].camera, NULL) == KILN_OK) {
        s->count = 1;
        return KILN_OK;
    }
    for (size_t i = 0; i < s->count && status == KILN_OK; i++) {
        const size_t length = strcspn(names, ",");
        (void)snprintf(name, sizeof name, "%.*s", length < sizeof name ? (int)length : (int)sizeof name - 1, names);
        status = kiln_view_find_camera(s->p->scene, name, &s->wishes[i].camera, error);
        names += length + (names[length] == ',');
    }
    return status;
}

static bool is_file(const char *views)
{
    const size_t length = strlen(views);
    return length > 4 && strcasecmp(views + length - 4, ".csv") == 0;
}

bool kiln_visible_from_hash(const char *views, uint64_t hash[2])
{
    struct search s = {.count = 0};
    struct kiln_error error;
    const bool known = is_file(views) && path_views(&s, views, &error) == KILN_OK;
    if (known) {
        const XXH128_hash_t of = XXH3_128bits(s.frames, s.count * sizeof *s.frames);
        hash[0] = of.low64;
        hash[1] = of.high64;
    }
    kiln_arena_release(&s.arena);
    return known;
}

static int find_views(struct search *s, const char *views, struct kiln_error *error)
{
    if (is_file(views))
        return path_views(s, views, error);
    return strcmp(views, "all") == 0 ? all_cameras(s, error) : named_cameras(s, views, error);
}

/* ---- marks ---- */

static void mark_tile(struct search *s, uint64_t tile, uint32_t bit, uint8_t value)
{
    s->marks[tile] = s->marks[tile] == UNSEEN || value == SEEN ? value : s->marks[tile];
    const struct kiln_global_point entry = kiln_tile_entry(s->p->surface, &s->p->surface->tiles[tile], bit);
    if (value == FOUND && !s->hits_known && entry.at != KILN_NO_POINT)
        s->hit[tile] |= 1ull << bit;
}

/* The part of its texel that a hit lies on; KILN_SUBTEXELS: none. Views show part 0. */
static uint32_t part_of_hit(const struct search *s, const struct kiln_hit *hit, bool back, uint8_t value)
{
    const struct kiln_store store = {s->p->surface, s->p->geometry};
    if (value == SEEN || s->p->surface->divided_count == 0)
        return 0;
    const struct kiln_global_point point = s->p->surface->bricks != NULL
                                               ? kiln_octree_find(&store, hit->triangle, hit->u, hit->v, back)
                                               : kiln_store_find(&store, hit->triangle, hit->u, hit->v, back);
    const struct kiln_subtexel *part = point.at != KILN_NO_POINT ? kiln_surface_subtexel(s->p->surface, point) : NULL;
    return point.at == KILN_NO_POINT ? KILN_SUBTEXELS : part != NULL ? part->part : 0;
}

/* Marks a tile in the lightmap that holds the given part of divided texels. */
static void mark_part(struct search *s, uint32_t map, uint32_t part, uint32_t tile, uint32_t bit, uint8_t value)
{
    const struct kiln_surface *surface = s->p->surface;
    const uint32_t m = map + part * surface->whole_maps;
    if (part < KILN_SUBTEXELS && m < surface->map_count && surface->lightmaps[m].tiles_x > 0)
        mark_tile(s, surface->lightmaps[m].tile_first + tile, bit, value);
}

static void mark(struct search *s, const struct kiln_hit *hit, bool back, uint32_t map, uint32_t x, uint32_t y,
                 uint8_t value)
{
    const struct kiln_lightmap *m = &s->p->surface->lightmaps[map];
    if (m->tiles_x == 0)
        return;
    const uint32_t column = x >> m->shift, row = y >> m->shift;
    mark_part(s, map, part_of_hit(s, hit, back, value), kiln_tile_of(column, row, m->tiles_x),
              kiln_morton8(column % KILN_TILE_SIDE, row % KILN_TILE_SIDE), value);
}

/* The same for an octree's brick. */
static void mark_brick(struct search *s, const struct kiln_hit *hit, bool back, uint8_t value)
{
    const struct kiln_store store = {s->p->surface, s->p->geometry};
    const struct kiln_octree_leaf leaf = kiln_octree_leaf(&store, hit->triangle, hit->u, hit->v, back);
    const struct kiln_brick_slot *slot = kiln_brick_slot(s->p->surface, leaf.map, leaf.brick);
    if (slot->tile != 0)
        mark_part(s, leaf.map, part_of_hit(s, hit, back, value),
                  (uint32_t)(slot->tile - 1 - s->p->surface->lightmaps[leaf.map].tile_first), leaf.bit, value);
}

/* Marks the tile that a hit lies in; of a back, and of its front too if `both`. */
static void mark_hit(struct search *s, const struct kiln_hit *hit, bool both, uint8_t value)
{
    const struct kiln_surface *surface = s->p->surface;
    const struct kiln_hit_record *record = &s->p->geometry->records[hit->triangle];
    const struct kiln_lightmap *front = &surface->lightmaps[record->object];
    if (surface->bricks != NULL) {
        if (hit->back)
            mark_brick(s, hit, true, value);
        if (!hit->back || both)
            mark_brick(s, hit, false, value);
        return;
    }
    if (front->width == 0 || front->height == 0)
        return;
    const uint32_t x = (uint32_t)kiln_hit_column(record, hit->u, hit->v, front->width),
                   y = (uint32_t)kiln_hit_row(record, hit->u, hit->v, front->height);
    if (hit->back && surface->whole_maps > surface->object_count)
        mark(s, hit, true, record->object + surface->object_count, x, y, value);
    if (!hit->back || both)
        mark(s, hit, false, record->object, x, y, value);
}

/* Collective. */
static void share_marks(struct search *s)
{
    const uint64_t all = s->p->surface->tile_count, most = 1u << 30;
    for (uint64_t at = 0; at < all; at += most)
        (void)MPI_Allreduce(MPI_IN_PLACE, s->marks + at, (int)(all - at < most ? all - at : most), MPI_UINT8_T, MPI_MAX,
                            s->p->communicator);
    for (uint64_t at = 0; at < all; at += most)
        (void)MPI_Allreduce(MPI_IN_PLACE, s->hit + at, (int)(all - at < most ? all - at : most), MPI_UINT64_T, MPI_BOR,
                            s->p->communicator);
}

/* ---- what is seen ---- */

static int see(struct search *s, size_t rays, struct kiln_error *error)
{
    const int status = kiln_view_trace(&s->source, s->rays, rays, error);
    for (size_t i = 0; i < rays && status == KILN_OK; i++)
        if (kiln_view_is_seen(&s->source, &s->rays->hits[i]))
            mark_hit(s, &s->rays->hits[i], true, SEEN);
    return status;
}

/* Traces some rows of a view on this rank. */
static int look(struct search *s, const struct kiln_view_wish *wish, struct kiln_error *error)
{
    struct kiln_view_camera c;
    struct kiln_viewpoint viewpoint;
    uint32_t width, height;
    int status = kiln_view_aim(&s->source, wish, &c, &width, &height, &viewpoint, error);
    size_t rays = 0;
    for (uint32_t y = (uint32_t)s->p->rank; status == KILN_OK && y < height; y += (uint32_t)s->p->ranks) {
        for (uint32_t x = 0; x < width; x++, rays++) {
            const double sx = ((double)x + 0.5) / width * 2.0 - 1.0, sy = 1.0 - ((double)y + 0.5) / height * 2.0;
            const struct kiln_dvec3 aside =
                dvec3_add(dvec3_scale(c.right, sx * c.extent_x), dvec3_scale(c.up, sy * c.extent_y));
            const struct kiln_dvec3 way = c.orthographic ? c.forward : dvec3_add(c.forward, aside);
            s->rays->origins[rays] = vec3_of(c.orthographic ? dvec3_add(c.position, aside) : c.position);
            s->rays->directions[rays] = vec3_of(dvec3_scale(way, 1.0 / dvec3_length(way)));
        }
        if (rays + width > CHUNK_RAYS) {
            status = see(s, rays, error);
            rays = 0;
        }
    }
    return status == KILN_OK ? see(s, rays, error) : status;
}

static void see_receivers(struct search *s)
{
    const struct kiln_surface *surface = s->p->surface;
    for (uint32_t m = 0; m < surface->map_count; m++) {
        const struct kiln_lightmap *map = &surface->lightmaps[m];
        const size_t tiles = (size_t)map->tiles_x * map->tiles_y;
        if ((s->p->scene->objects[kiln_map_object(surface, m)].flags & KILN_OBJECT_RECEIVER_ONLY) != 0)
            memset(s->marks + map->tile_first, SEEN, tiles);
    }
}

/* ---- what is reached ---- */

/* Makes gather ray k of the point at the cursor. */
static void make_ray(struct search *s, const struct kiln_footprint *f, const struct kiln_point_cursor *at, uint32_t hop,
                     uint32_t k, size_t ray)
{
    const struct kiln_prepared *p = s->p;
    const uint64_t texel = (uint64_t)at->y * p->surface->lightmaps[at->map].width + at->x;
    uint32_t hash = kiln_hash2(kiln_texel_key(RAYS_KEY + hop, at->map, texel), k), triangle;
    float random[4], b1, b2;
    for (int d = 0; d < 4; d++) {
        hash = kiln_hash1(hash + (uint32_t)d);
        random[d] = ((float)(hash >> 9) + 0.5f) * 0x1p-23f; /* in (0, 1) */
    }
    kiln_footprint_sample(f, random[0], random[1], &triangle, &b1, &b2);
    struct kiln_vec3 n = kiln_triangle_normal(p->geometry, triangle);
    n = at->back ? vec3_scale(n, -1.0f) : n;
    /* normal plus a random point on the unit sphere: a cosine-distributed direction */
    const float z = 1.0f - 2.0f * random[2], radius = sqrtf(fmaxf(0.0f, 1.0f - z * z)),
                turn = 2.0f * (float)KILN_PI * random[3];
    const struct kiln_vec3 way = vec3_add(n, vec3(radius * cosf(turn), radius * sinf(turn), z));
    s->rays->origins[ray] =
        kiln_offset_origin(kiln_triangle_position(p->geometry, triangle, b1, b2), n, p->geometry, triangle);
    s->rays->directions[ray] = vec3_length(way) > 0.0f ? vec3_normalize(way) : n;
}

static int trace(struct search *s, size_t count, struct kiln_error *error)
{
    struct kiln_view_rays *r = s->rays;
    const int status = kiln_backend_intersect(s->p->backend, r->origins, r->directions, count, r->hits, error);
    for (size_t i = 0; i < count && status == KILN_OK; i++)
        if (r->hits[i].triangle != KILN_NONE &&
            (!r->hits[i].back ||
             (s->p->geometry->records[r->hits[i].triangle].material & KILN_RECORD_DOUBLE_SIDED) != 0))
            mark_hit(s, &r->hits[i], false, FOUND);
    return status;
}

/* Traces gather rays from this rank's points in tiles with the mark `from`. The second hop starts only at points that
 * the first hop has hit. */
static int reach(struct search *s, uint32_t hop, uint8_t from, struct kiln_error *error)
{
    const struct kiln_surface *surface = s->p->surface;
    size_t rays = 0;
    int status = KILN_OK;
    for (size_t f = 0; f < surface->tile_run_count && status == KILN_OK; f++) {
        const struct kiln_tile_run *run = &surface->tile_runs[f];
        struct kiln_point_cursor at = kiln_point_first(surface, f);
        const uint64_t tile = surface->lightmaps[run->map].tile_first + run->tile;
        if (s->marks[tile] != from)
            continue;
        const uint64_t sources = hop == 0 ? UINT64_MAX : s->hit[tile];
        uint64_t rest = run->mask;
        for (; rest != 0; rest &= rest - 1, kiln_point_next(surface, &at)) {
            struct kiln_footprint footprint;
            if ((sources >> __builtin_ctzll(rest) & 1u) == 0 || !kiln_point_valid(surface, at.point))
                continue;
            kiln_footprint_prepare(&footprint, s->p->scene, s->p->geometry, surface, &at);
            for (uint32_t i = 0; i < RAYS[hop]; i++)
                make_ray(s, &footprint, &at, hop, i, rays++);
        }
        if (rays + (size_t)KILN_TILE_TEXELS * RAYS[hop] > CHUNK_RAYS || f + 1 == surface->tile_run_count) {
            status = trace(s, rays, error);
            rays = 0;
        }
    }
    return status == KILN_OK ? trace(s, rays, error) : status;
}

/* Collective. Traces all hops; each starts at the tiles that the hop before has found. */
static int find_reached(struct search *s, struct kiln_error *error)
{
    static const uint8_t from[HOPS] = {SEEN, REACHED};
    int status = KILN_OK;
    for (uint32_t hop = 0; hop < HOPS && status == KILN_OK; hop++) {
        status = kiln_agree(s->p->communicator, reach(s, hop, from[hop], error), error);
        share_marks(s);
        s->hits_known = true;
        for (uint64_t t = 0; t < s->p->surface->tile_count; t++)
            s->marks[t] = s->marks[t] == FOUND ? REACHED : s->marks[t];
    }
    return status;
}

/* ---- all ---- */

/* Collective. Takes over the marks of this rank's tile runs, and counts the points they stand for. */
static int take_marks(struct search *s, struct kiln_visible_from *v, struct kiln_error *error)
{
    struct kiln_surface *surface = s->p->surface;
    uint64_t sums[3] = {0, 0, 0};
    int status = kiln_allocate(&v->seen, surface->tile_run_count, sizeof *v->seen, "what views need", error);
    for (size_t f = 0; f < surface->tile_run_count && status == KILN_OK; f++) {
        const struct kiln_tile_run *run = &surface->tile_runs[f];
        const uint64_t own = kiln_own_of_global(surface, run->first).at;
        const uint8_t found = s->marks[surface->lightmaps[run->map].tile_first + run->tile];
        v->seen[f] = found == SEEN;
        for (uint64_t i = own; i < own + run->count; i++) {
            sums[found] += kiln_point_valid(surface, (struct kiln_own_point){i});
            surface->visible[i] = found == UNSEEN ? 0 : surface->visible[i];
        }
    }
    status = kiln_agree(s->p->communicator, status, error);
    (void)MPI_Allreduce(MPI_IN_PLACE, sums, 3, MPI_UINT64_T, MPI_SUM, s->p->communicator);
    v->views = s->count;
    v->points_seen = sums[SEEN];
    v->points_reached = sums[REACHED];
    v->points = sums[0] + sums[1] + sums[2];
    return status;
}

/* Collective. */
static int search(struct search *s, const char *views, struct kiln_error *error)
{
    const struct kiln_prepared *p = s->p;
    int status;
    KILN_TRY(find_views(s, views, error));
    KILN_TRY(kiln_view_rays_create(&s->rays, CHUNK_RAYS, error));
    KILN_TRY(kiln_arena_allocate(&s->arena, &s->hit, (size_t)p->surface->tile_count, sizeof *s->hit,
                                 "the marks of tiles", error));
    KILN_TRY(kiln_arena_allocate(&s->arena, &s->marks, (size_t)p->surface->tile_count, 1, "the marks of tiles", error));
end:
    status = kiln_agree(p->communicator, status, error);
    for (size_t i = 0; i < s->count && status == KILN_OK; i++)
        status = look(s, &s->wishes[i], error);
    status = kiln_agree(p->communicator, status, error);
    if (status != KILN_OK)
        return status;
    see_receivers(s);
    share_marks(s);
    return find_reached(s, error);
}

int kiln_visible_from_find(struct kiln_visible_from *v, const struct kiln_prepared *p, const char *views,
                           struct kiln_error *error)
{
    struct search s = {
        .p = p, .source = {.scene = p->scene, .geometry = p->geometry, .lights = p->lights, .backend = p->backend}};
    *v = (struct kiln_visible_from){.views = 0};
    int status;
    KILN_TRY(search(&s, views, error));
    KILN_TRY(take_marks(&s, v, error));
    if (v->points_seen == 0 && v->points > 0)
        KILN_TRY(kiln_fail(error, KILN_BAD_INPUT,
                           "--only-visible-from %.200s: none of the %zu views sees a surface that has a lightmap",
                           views, s.count));
    /* the backend's copy of the points' validity is out of date */
    KILN_TRY(kiln_agree(p->communicator, kiln_backend_set_surface(p->backend, p->surface, error), error));
end:
    kiln_view_rays_destroy(&s.rays);
    kiln_arena_release(&s.arena);
    return status;
}

void kiln_visible_from_release(struct kiln_visible_from *v) { kiln_free(&v->seen); }

void kiln_visible_from_leave_seen(const struct kiln_surface *surface, const uint16_t *seen)
{
    for (size_t f = 0; f < surface->tile_run_count; f++) {
        const struct kiln_tile_run *run = &surface->tile_runs[f];
        const uint64_t own = kiln_own_of_global(surface, run->first).at;
        if (seen[f] == 0)
            memset(surface->visible + own, 0, run->count * sizeof *surface->visible);
    }
}
