#include "coordinator/integrate/sparse/blocks.h"

#include <math.h>
#include <string.h>

#include "worker/base/memory.h"
#include "worker/sampling/keys.h"
#include "worker/scene/footprint.h"

enum {
    CHUNK_TILE_RUNS = 1024,
    /* most links between blocks of two points in a tile run */
    LINKS_MOST = KILN_TILE_TEXELS / 2 * (KILN_TILE_TEXELS / 2 - 1) / 2,
    SMALL_PART = 4, /* a block is small if it has at most 1 / SMALL_PART of K x K texels */
    ROUNDS = 16     /* rounds, after which each remaining point becomes its own block */
};
#define UNKNOWN UINT16_MAX
#define TURN_KEY 0x626c6f63u
static const float ALIKE = 0.9063f; /* cosine of 25 degrees */
/* Height of rays above the surface, in texel sides, so that they pass over small things; and extra height over a convex
 * edge between two points, as a fraction of their distance times the difference of their normals (the edge itself is a
 * quarter of that high). */
static const float HEIGHT = 0.25f, OVER_EDGE = 0.3f;
/* Least free distance of a texel that shares its light, in texel sides: above it, and on all sides. */
#define ROOM 0.5f
#define ROOM_BESIDE 1.5f

/* A point with the data by which it is compared with others. */
struct place {
    struct kiln_vec3 position, normal; /* of a place on its surface, m; mean, unit */
    float height;                      /* m: of rays above it */
    float side;                        /* m: of the texel */
    bool whole;                        /* not partly there */
};

/* A pair of points to test, and the first point of their tile run; indices of own points in the chunk's range. */
struct pair {
    uint64_t run, first, other;
};

struct search {
    const struct kiln_surface *surface;
    struct kiln_backend *backend;
    uint32_t threads, scale;
    uint16_t *block;
    uint64_t *links; /* NULL: nobody asks for them */
    /* of a chunk of tile runs */
    size_t begin, end;
    uint64_t first; /* own point with which it begins */
    struct place *places;
    struct pair *pairs;
    size_t pair_count;
    struct kiln_vec3 *origins, *directions;
    float *lengths;
    struct kiln_hit *hits;
};

static void release(struct search *s)
{
    kiln_free(&s->places);
    kiln_free(&s->pairs);
    kiln_free(&s->origins);
    kiln_free(&s->directions);
    kiln_free(&s->lengths);
    kiln_free(&s->hits);
}

static int make_room(struct search *s, struct kiln_error *error)
{
    const char *what = "the blocks of points";
    const size_t points = (size_t)CHUNK_TILE_RUNS * KILN_TILE_TEXELS;
    int status;
    KILN_TRY(kiln_allocate(&s->places, points, sizeof *s->places, what, error));
    KILN_TRY(kiln_allocate(&s->pairs, points, sizeof *s->pairs, what, error));
    KILN_TRY(kiln_allocate(&s->origins, points, sizeof *s->origins, what, error));
    KILN_TRY(kiln_allocate(&s->directions, points, sizeof *s->directions, what, error));
    KILN_TRY(kiln_allocate(&s->lengths, points, sizeof *s->lengths, what, error));
    KILN_TRY(kiln_allocate(&s->hits, points, sizeof *s->hits, what, error));
end:
    return status;
}

/* ---- places ---- */

/* A texel's side by its footprint; 0: unknown. */
static float side_of(const struct kiln_footprint *f)
{
    return f->kind == KILN_FOOTPRINT_WHOLE ? fmaxf(vec3_length(f->whole.du), vec3_length(f->whole.dv)) : 0.0f;
}

static void find_place(const struct search *s, const struct kiln_point_cursor *at, struct place *place)
{
    const struct kiln_backend_params *world = &s->backend->params;
    struct kiln_footprint footprint;
    struct kiln_mask mask;
    struct kiln_vec3 shading;
    uint32_t triangle;
    float b1, b2;
    kiln_footprint_prepare(&footprint, world->scene, world->geometry, s->surface, at);
    if (footprint.kind == KILN_FOOTPRINT_WHOLE)
        kiln_footprint_sample(&footprint, 0.5f, 0.5f, &triangle, &b1, &b2);
    /* a place within one triangle of the piece: (0.5, 0.5) may be its rim, where a wall stands that divides the
     * texel */
    else
        kiln_footprint_sample(&footprint, 0.45f, 0.55f, &triangle, &b1, &b2);
    kiln_footprint_normals(&footprint, &place->normal, &shading);
    place->position = kiln_triangle_position(world->geometry, triangle, b1, b2);
    place->height = 4.0f * kiln_offset_distance(world->geometry, triangle, place->normal);
    place->side = side_of(&footprint);
    const uint64_t texel = (uint64_t)at->y * s->surface->lightmaps[at->map].width + at->x;
    place->whole = kiln_footprint_opacity(&footprint, kiln_texel_key(KILN_LOOKS_KEY, at->map, texel), &mask) >= 1.0f;
}

/* Sets the sides of texels in a tile run: the largest known one or, without any, one estimated from the largest
 * area. */
static void fill_sides(const struct search *s, const struct kiln_tile_run *run, struct place *places)
{
    const uint64_t own = kiln_own_of_global(s->surface, run->first).at;
    float side = 0.0f, area = 0.0f;
    for (uint32_t k = 0; k < run->count; k++) {
        side = fmaxf(side, places[k].side);
        area = fmaxf(area, s->surface->area[own + k]);
    }
    for (uint32_t k = 0; k < run->count; k++)
        places[k].side = side > 0.0f ? side : 2.0f * sqrtf(area);
}

static void find_places(const struct search *s)
{
#pragma omp parallel for schedule(dynamic, 8) num_threads((int)s->threads)
    for (size_t f = s->begin; f < s->end; f++) {
        struct kiln_point_cursor at = kiln_point_first(s->surface, f);
        struct place *places = s->places + (at.point.at - s->first);
        for (uint32_t k = 0; k < s->surface->tile_runs[f].count; k++, kiln_point_next(s->surface, &at)) {
            const bool valid = kiln_point_valid(s->surface, at.point);
            if (valid)
                find_place(s, &at, &places[k]);
            else
                places[k] = (struct place){.whole = false};
            s->block[at.point.at] = valid && places[k].whole ? UNKNOWN : (uint16_t)k;
        }
        fill_sides(s, &s->surface->tile_runs[f], places);
    }
}

/* Directions of the test for close surfaces: along the normal; for nodes also sideways. A direction is `along` times
 * the normal plus two tangential parts. */
static const struct {
    float along, across[2], room;
} looks[] = {{1.0f, {0.0f, 0.0f}, ROOM},
             {0.3f, {0.954f, 0.0f}, ROOM_BESIDE},
             {0.3f, {0.0f, 0.954f}, ROOM_BESIDE},
             {0.3f, {-0.954f, 0.0f}, ROOM_BESIDE},
             {0.3f, {0.0f, -0.954f}, ROOM_BESIDE}};

static void look(const struct search *s, size_t i, size_t direction)
{
    const struct place *place = &s->places[i];
    const struct kiln_vec3 n = place->height > 0.0f ? place->normal : vec3(1.0f, 0.0f, 0.0f);
    const struct kiln_vec3 axis = fabsf(n.x) < 0.6f ? vec3(1.0f, 0.0f, 0.0f) : vec3(0.0f, 1.0f, 0.0f);
    const struct kiln_vec3 u = vec3_normalize(vec3_cross(n, axis)), v = vec3_cross(n, u);
    const struct kiln_vec3 across = vec3_madd(vec3_scale(u, looks[direction].across[0]), v, looks[direction].across[1]);
    s->directions[i] = vec3_madd(across, n, looks[direction].along);
    s->origins[i] = vec3_madd(place->position, n, place->height);
}

/* Makes each point with a close surface a block of its own, since light changes too fast there. */
static int find_room(struct search *s, struct kiln_error *error)
{
    const struct kiln_tile_run *last = &s->surface->tile_runs[s->end - 1];
    const size_t count = (size_t)(kiln_own_of_global(s->surface, last->first).at + last->count - s->first),
                 directions = s->links != NULL ? sizeof looks / sizeof *looks : 1;
    int status = KILN_OK;
    for (size_t d = 0; d < directions && status == KILN_OK; d++) {
        for (size_t i = 0; i < count; i++)
            look(s, i, d);
        status = kiln_backend_intersect(s->backend, s->origins, s->directions, count, s->hits, error);
        for (size_t f = s->begin; f < s->end && status == KILN_OK; f++) {
            const struct kiln_tile_run *run = &s->surface->tile_runs[f];
            const uint64_t own = kiln_own_of_global(s->surface, run->first).at;
            for (uint32_t k = 0; k < run->count; k++) {
                const size_t i = (size_t)(own + k - s->first);
                if (s->hits[i].triangle != KILN_NONE && s->hits[i].distance < looks[d].room * s->places[i].side)
                    s->block[own + k] = (uint16_t)k;
            }
        }
    }
    for (size_t i = 0; i < count; i++)
        s->places[i].height += HEIGHT * s->places[i].side;
    return status;
}

/* ---- pairs ---- */

/* Whether two texels may be in one block, as far as can be told without rays. */
static bool may_be_alike(const struct place *a, const struct place *b, uint32_t bit_a, uint32_t bit_b)
{
    const float dx = (float)kiln_morton8_x(bit_a) - (float)kiln_morton8_x(bit_b),
                dy = (float)kiln_morton8_y(bit_a) - (float)kiln_morton8_y(bit_b);
    const float away = vec3_length(vec3_sub(b->position, a->position));
    return vec3_dot(a->normal, b->normal) >= ALIKE && away > 0.0f &&
           away <= 1.5f * a->side * (sqrtf(dx * dx + dy * dy) + 1.0f);
}

/* Whether two texels are near enough that texels between them can mix the answers of both: corners of adjacent blocks
 * are. */
static bool are_near(uint32_t bit_a, uint32_t bit_b, uint32_t scale)
{
    const int dx = (int)kiln_morton8_x(bit_a) - (int)kiln_morton8_x(bit_b),
              dy = (int)kiln_morton8_y(bit_a) - (int)kiln_morton8_y(bit_b), most = 2 * (int)scale - 1;
    return dx * dx <= most * most && dy * dy <= most * most;
}

/* Bounding rectangle of a block's texels so far. */
struct extent {
    uint32_t low[2], high[2];
};

/* Adds the texel of a bit, unless the block would become wider or higher than `most` texels. */
static bool take_in(struct extent *e, uint32_t bit, uint32_t most)
{
    const uint32_t at[2] = {kiln_morton8_x(bit), kiln_morton8_y(bit)};
    struct extent larger = *e;
    for (int i = 0; i < 2; i++) {
        larger.low[i] = at[i] < e->low[i] ? at[i] : e->low[i];
        larger.high[i] = at[i] > e->high[i] ? at[i] : e->high[i];
        if (larger.high[i] - larger.low[i] >= most)
            return false;
    }
    *e = larger;
    return true;
}

/* Starts a new block with the point at place `first`, which has none yet, and lists the later points to test against
 * it. */
static void begin_block(struct search *s, const struct kiln_tile_run *run, uint32_t first, const uint8_t *bits,
                        uint64_t *asked)
{
    const uint64_t own = kiln_own_of_global(s->surface, run->first).at;
    const struct place *places = s->places + (own - s->first);
    struct extent extent = {{kiln_morton8_x(bits[first]), kiln_morton8_y(bits[first])},
                            {kiln_morton8_x(bits[first]), kiln_morton8_y(bits[first])}};
    s->block[own + first] = (uint16_t)first;
    for (uint32_t k = first + 1; k < run->count; k++)
        if (s->block[own + k] == UNKNOWN && (*asked >> k & 1u) == 0 &&
            may_be_alike(&places[first], &places[k], bits[first], bits[k]) && take_in(&extent, bits[k], s->scale)) {
            *asked |= 1ull << k;
            s->pairs[s->pair_count++] = (struct pair){own, own + first, own + k};
        }
}

/* Starts blocks until each point of the tile run has a block or is to be tested. `last`: nothing more is tested. */
static void begin_blocks_of(struct search *s, const struct kiln_tile_run *run, bool last)
{
    const uint64_t own = kiln_own_of_global(s->surface, run->first).at;
    uint8_t bits[KILN_TILE_TEXELS];
    uint64_t asked = 0, rest = run->mask;
    for (uint32_t k = 0; k < run->count; k++, rest &= rest - 1)
        bits[k] = (uint8_t)__builtin_ctzll(rest);
    for (uint32_t k = 0; k < run->count; k++)
        if (s->block[own + k] == UNKNOWN && (asked >> k & 1u) == 0) {
            if (last)
                s->block[own + k] = (uint16_t)k;
            else
                begin_block(s, run, k, bits, &asked);
        }
}

static void begin_blocks(struct search *s, bool last)
{
    s->pair_count = 0;
    for (size_t f = s->begin; f < s->end; f++)
        begin_blocks_of(s, &s->surface->tile_runs[f], last);
}

/* The ray from point to point. */
static void make_ray(const struct search *s, const struct pair *pair, size_t ray)
{
    const struct place *a = &s->places[pair->first - s->first], *b = &s->places[pair->other - s->first];
    const float away = vec3_length(vec3_sub(b->position, a->position)),
                bend = vec3_length(vec3_sub(b->normal, a->normal));
    const float height = fminf(a->height, b->height) + OVER_EDGE * bend * away;
    const struct kiln_vec3 from = vec3_madd(a->position, a->normal, height),
                           way = vec3_sub(vec3_madd(b->position, b->normal, height), from);
    const float length = vec3_length(way);
    s->origins[ray] = from;
    s->directions[ray] = length > 0.0f ? vec3_scale(way, 1.0f / length) : a->normal;
    s->lengths[ray] = length;
}

static int trace_pairs(struct search *s, struct kiln_error *error)
{
    for (size_t i = 0; i < s->pair_count; i++)
        make_ray(s, &s->pairs[i], i);
    return kiln_backend_intersect(s->backend, s->origins, s->directions, s->pair_count, s->hits, error);
}

/* Whether no surface separates the points of a traced pair. */
static bool is_free(const struct search *s, size_t pair)
{
    return s->hits[pair].triangle == KILN_NONE || s->hits[pair].distance >= s->lengths[pair];
}

/* Traces the rays of all pairs, and joins the points that no surface separates into one block. */
static int join(struct search *s, struct kiln_error *error)
{
    const int status = trace_pairs(s, error);
    for (size_t i = 0; status == KILN_OK && i < s->pair_count; i++)
        if (is_free(s, i))
            s->block[s->pairs[i].other] = s->block[s->pairs[i].first];
    return status;
}

/* ---- links: blocks that continue each other ---- */

void kiln_block_corners(const struct kiln_tile_run *run, const uint16_t *block, uint8_t corner[KILN_TILE_TEXELS])
{
    int farthest[KILN_TILE_TEXELS];
    uint64_t rest = run->mask;
    for (uint32_t k = 0; k < run->count; k++, rest &= rest - 1) {
        const uint32_t bit = (uint32_t)__builtin_ctzll(rest), first = block[k];
        const int x = 2 * (int)kiln_morton8_x(bit) - (KILN_TILE_SIDE - 1),
                  y = 2 * (int)kiln_morton8_y(bit) - (KILN_TILE_SIDE - 1), away = x * x + y * y;
        if (first == k || away > farthest[first]) {
            farthest[first] = away;
            corner[first] = (uint8_t)k;
        }
    }
}

/* Lists pairs of corner points to test, for each two blocks of the tile run that may continue each other. */
static void ask_links(struct search *s, const struct kiln_tile_run *run)
{
    const uint64_t own = kiln_own_of_global(s->surface, run->first).at;
    const uint16_t *block = s->block + own;
    const struct place *places = s->places + (own - s->first);
    uint8_t corner[KILN_TILE_TEXELS], bits[KILN_TILE_TEXELS], count[KILN_TILE_TEXELS] = {0};
    uint64_t rest = run->mask;
    kiln_block_corners(run, block, corner);
    for (uint32_t k = 0; k < run->count; k++, rest &= rest - 1) {
        bits[k] = (uint8_t)__builtin_ctzll(rest);
        count[block[k]]++;
        s->links[own + k] = 0;
    }
    for (uint32_t a = 0; a < run->count; a++)
        for (uint32_t b = a + 1; b < run->count && count[a] > 1; b++) {
            const uint32_t i = corner[a], j = corner[b];
            if (count[b] > 1 && are_near(bits[i], bits[j], s->scale) &&
                may_be_alike(&places[i], &places[j], bits[i], bits[j]))
                s->pairs[s->pair_count++] = (struct pair){own, own + i, own + j};
        }
}

/* Traces the rays of the pairs, and links the blocks that no surface separates. */
static int link_pairs(struct search *s, struct kiln_error *error)
{
    const int status = trace_pairs(s, error);
    for (size_t i = 0; status == KILN_OK && i < s->pair_count; i++)
        if (is_free(s, i)) {
            const uint64_t run = s->pairs[i].run, a = s->block[s->pairs[i].first], b = s->block[s->pairs[i].other];
            s->links[run + a] |= 1ull << b;
            s->links[run + b] |= 1ull << a;
        }
    s->pair_count = 0;
    return status;
}

static int find_links(struct search *s, struct kiln_error *error)
{
    int status = KILN_OK;
    s->pair_count = 0;
    for (size_t f = s->begin; f < s->end && status == KILN_OK; f++) {
        if (s->pair_count + LINKS_MOST > (size_t)CHUNK_TILE_RUNS * KILN_TILE_TEXELS)
            status = link_pairs(s, error);
        if (status == KILN_OK)
            ask_links(s, &s->surface->tile_runs[f]);
    }
    return status == KILN_OK ? link_pairs(s, error) : status;
}

static int find_chunk(struct search *s, struct kiln_error *error)
{
    int status = KILN_OK;
    find_places(s);
    status = find_room(s, error);
    s->pair_count = 1;
    for (uint32_t round = 0; round < ROUNDS && s->pair_count > 0 && status == KILN_OK; round++) {
        begin_blocks(s, false);
        status = join(s, error);
    }
    begin_blocks(s, true);
    return status == KILN_OK && s->links != NULL ? find_links(s, error) : status;
}

int kiln_blocks_find(const struct kiln_surface *surface, struct kiln_backend *backend, uint32_t threads, uint32_t scale,
                     uint16_t *block, uint64_t *links, struct kiln_error *error)
{
    struct search s = {
        .surface = surface, .backend = backend, .threads = threads, .scale = scale, .block = block, .links = links};
    int status = make_room(&s, error);
    for (size_t f = 0; f < surface->tile_run_count && status == KILN_OK; f = s.end) {
        s.begin = f;
        s.end = surface->tile_run_count - f < CHUNK_TILE_RUNS ? surface->tile_run_count : f + CHUNK_TILE_RUNS;
        s.first = kiln_own_of_global(surface, surface->tile_runs[f].first).at;
        status = find_chunk(&s, error);
    }
    release(&s);
    return status;
}

/* ---- drawing ---- */

/* Returns the one of `count` points of a block that gathers in the step. */
static uint32_t turn_of(const struct kiln_tile_run *run, uint32_t first, uint32_t count, uint64_t seed,
                        const struct kiln_step *step)
{
    const uint32_t tile = kiln_tile_key(kiln_seed_key(seed), run->map, run->tile),
                   start = kiln_hash2(kiln_hash2(tile ^ TURN_KEY, first), step->part);
    return (uint32_t)((uint64_t)(start + kiln_reverse_bits(step->stream)) * count >> 32);
}

void kiln_blocks_draw(struct kiln_sparse *sparse, const struct kiln_surface *surface, const struct kiln_tile_run *run,
                      const uint16_t *block, uint32_t scale, uint64_t seed, const struct kiln_step *step)
{
    const uint32_t small = scale * scale / SMALL_PART;
    const struct kiln_own_point own = kiln_own_of_global(surface, run->first);
    uint8_t count[KILN_TILE_TEXELS] = {0}, chosen[KILN_TILE_TEXELS] = {0}, turn[KILN_TILE_TEXELS] = {0};
    uint32_t k = 0;
    struct kiln_selection *selection = &sparse->selection;
    *selection = (struct kiln_selection){0};
    for (k = 0; k < run->count; k++)
        count[block[k]]++;
    k = 0;
    for (uint64_t rest = run->mask; rest != 0; rest &= rest - 1, k++) {
        const uint32_t first = block[k];
        if (first == k)
            turn[k] = (uint8_t)turn_of(run, (uint32_t)__builtin_ctzll(rest), count[k], seed, step);
        if (turn[first]-- == 0) {
            chosen[first] = (uint8_t)k;
            if (kiln_point_valid(surface, (struct kiln_own_point){own.at + k}))
                selection->computed |= 1ull << k;
            if (count[first] <= small)
                selection->few |= 1ull << k;
        }
    }
    selection->few &= selection->computed;
    for (k = 0; k < run->count; k++)
        sparse->mixture[k] = (struct kiln_mixture){1, {chosen[block[k]]}, {1.0}};
}
