#include "worker/scene/coincident.h"

#include <math.h>
#include <string.h>

#include "worker/base/arena.h"
#include "worker/base/memory.h"

enum { SAME_EDGE_MOST = 64 };

/* A triangle's shortest edge, from its lower to its higher end, and its third corner. */
struct shortest {
    struct kiln_vec3 low, high, third;
};

/* A triangle in a hash table, with the hash of its shortest edge. */
struct entry {
    uint64_t hash;
    uint32_t number; /* among the triangles that rays meet */
};

static bool is_below(struct kiln_vec3 a, struct kiln_vec3 b)
{
    if (a.x < b.x || a.x > b.x)
        return a.x < b.x;
    if (a.y < b.y || a.y > b.y)
        return a.y < b.y;
    return a.z < b.z;
}

static bool is_same(struct kiln_vec3 a, struct kiln_vec3 b) { return !is_below(a, b) && !is_below(b, a); }

static double square_between(struct kiln_vec3 a, struct kiln_vec3 b)
{
    const struct kiln_dvec3 way = dvec3_sub(dvec3_of(a), dvec3_of(b));
    return dvec3_dot(way, way);
}

/* Finds a triangle's shortest edge; of equal ones that with the lower ends. False: two corners are equal. */
static bool shortest_of(const struct kiln_geometry *g, uint64_t triangle, struct shortest *s)
{
    struct kiln_vec3 corner[3];
    double least = INFINITY;
    kiln_geometry_corners(g, triangle, corner);
    for (int i = 0; i < 3; i++) {
        const struct kiln_vec3 a = corner[i], b = corner[(i + 1) % 3], low = is_below(b, a) ? b : a,
                               high = is_below(b, a) ? a : b;
        const double square = square_between(low, high);
        const bool first = is_below(low, s->low) || (is_same(low, s->low) && is_below(high, s->high));
        if (square > least || (!(square < least) && !first))
            continue;
        least = square;
        *s = (struct shortest){low, high, corner[(i + 2) % 3]};
    }
    return least > 0.0;
}

/* Hash of an edge, never 0. Different edges have equal hashes with a probability of 2^-64. */
static uint64_t hash_of(const struct shortest *s)
{
    const float number[6] = {s->low.x + 0.0f,  s->low.y + 0.0f,  s->low.z + 0.0f,
                             s->high.x + 0.0f, s->high.y + 0.0f, s->high.z + 0.0f}; /* no -0 */
    uint64_t hash = 0x9e3779b97f4a7c15u;
    for (int i = 0; i < 6; i++) {
        uint32_t bits;
        memcpy(&bits, &number[i], sizeof bits);
        hash = (hash ^ bits) * 0xff51afd7ed558ccdu;
        hash ^= hash >> 32;
    }
    return hash == 0 ? 1 : hash;
}

static struct kiln_dvec3 normal_of(const struct kiln_geometry *g, uint64_t triangle)
{
    struct kiln_vec3 corner[3];
    kiln_geometry_corners(g, triangle, corner);
    const struct kiln_dvec3 a = dvec3_of(corner[0]);
    return dvec3_cross(dvec3_sub(dvec3_of(corner[1]), a), dvec3_sub(dvec3_of(corner[2]), a));
}

/* Whether two triangles with the same shortest edge lie in one plane, on the same side of that edge. */
static bool coincide(const struct kiln_geometry *g, uint64_t t, const struct shortest *s, const struct shortest *o)
{
    const struct kiln_dvec3 normal = normal_of(g, t), low = dvec3_of(s->low), along = dvec3_sub(dvec3_of(s->high), low),
                            across = dvec3_cross(normal, along), to_own = dvec3_sub(dvec3_of(s->third), low),
                            to_other = dvec3_sub(dvec3_of(o->third), low);
    const double height = dvec3_dot(normal, to_other), margin = (double)(KILN_COINCIDENT * g->extent);
    return height * height <= margin * margin * dvec3_dot(normal, normal) &&
           dvec3_dot(across, to_own) * dvec3_dot(across, to_other) > 0.0;
}

/* ---- triangles with the same edge ---- */

/* Parts, by the upper bits of the hash, are searched independently. Blocks are consecutive triangles. */
enum { PART_BITS = 10, PARTS = 1 << PART_BITS, BLOCK = 1 << 15 };

/* Two triangles that coincide, by their numbers; `other` is the lower one. */
struct pair {
    uint32_t number, other;
};

struct pairs {
    struct pair *list;
    size_t count, capacity;
};

struct search {
    struct kiln_geometry *g;
    size_t count, blocks;
    uint64_t *hash;        /* per triangle; 0: two of its corners are equal */
    uint32_t *part_at;     /* blocks x PARTS: where the entries of a block begin in the part */
    uint32_t *part_end;    /* of each part */
    struct entry *entries; /* sorted by part, then by triangle */
    uint32_t *before;      /* per triangle: number + 1 of the previous triangle with an equal hash; 0: none */
    struct pairs *pairs;   /* of each block */
    struct kiln_arena arena;
};

static size_t part_of(uint64_t hash) { return hash >> (64 - PART_BITS); }

static size_t block_end(const struct search *s, size_t block)
{
    return (block + 1) * BLOCK < s->count ? (block + 1) * BLOCK : s->count;
}

static void hash_block(struct search *s, size_t block)
{
    uint32_t *counts = s->part_at + block * PARTS;
    memset(counts, 0, PARTS * sizeof *counts);
    for (size_t i = block * BLOCK; i < block_end(s, block); i++) {
        struct shortest edge = {0};
        s->hash[i] = shortest_of(s->g, kiln_geometry_hittable(s->g, i), &edge) ? hash_of(&edge) : 0;
        counts[part_of(s->hash[i])] += s->hash[i] != 0 ? 1 : 0;
    }
}

static void place_parts(struct search *s)
{
    uint32_t at = 0;
    for (size_t part = 0; part < PARTS; part++) {
        for (size_t block = 0; block < s->blocks; block++) {
            uint32_t *count = &s->part_at[block * PARTS + part];
            const uint32_t own = *count;
            *count = at;
            at += own;
        }
        s->part_end[part] = at;
    }
}

static void sort_block(struct search *s, size_t block)
{
    uint32_t *at = s->part_at + block * PARTS;
    for (size_t i = block * BLOCK; i < block_end(s, block); i++)
        if (s->hash[i] != 0)
            s->entries[at[part_of(s->hash[i])]++] = (struct entry){s->hash[i], (uint32_t)i};
}

/* Entry of an open hash table: the triangles with one hash; hash 0: empty. */
struct same {
    uint64_t hash;
    uint32_t last, count; /* last triangle that others link to, and number of triangles up to it */
};

/* Links each triangle to the previous one with an equal hash; only to the first SAME_EDGE_MOST triangles. */
static int link_part(struct search *s, size_t part, struct kiln_error *error)
{
    const uint32_t begin = part > 0 ? s->part_end[part - 1] : 0, end = s->part_end[part];
    struct same *table = NULL;
    size_t size = 16;
    if (begin == end)
        return KILN_OK;
    while (size < 2 * (size_t)(end - begin))
        size *= 2;
    const int status = kiln_allocate(&table, size, sizeof *table, "the search for coincident faces", error);
    for (uint32_t i = begin; status == KILN_OK && i < end; i++) {
        const struct entry own = s->entries[i];
        size_t at = own.hash & (size - 1);
        while (table[at].hash != 0 && table[at].hash != own.hash)
            at = (at + 1) & (size - 1);
        if (table[at].count > 0)
            s->before[own.number] = table[at].last + 1;
        if (table[at].count < SAME_EDGE_MOST)
            table[at] = (struct same){own.hash, own.number, table[at].count + 1};
    }
    kiln_free(&table);
    return status;
}

/* ---- which of them coincide ---- */

static int compare(const struct search *s, uint32_t number, struct pairs *pairs, struct kiln_error *error)
{
    const struct kiln_geometry *g = s->g;
    const uint64_t triangle = kiln_geometry_hittable(g, number);
    struct shortest edge = {0}, theirs = {0};
    uint32_t others[SAME_EDGE_MOST], count = 0;
    for (uint32_t link = s->before[number]; link != 0; link = s->before[link - 1])
        others[count++] = link - 1;
    if (count == 0)
        return KILN_OK;
    (void)shortest_of(g, triangle, &edge);
    while (count-- > 0) {
        (void)shortest_of(g, kiln_geometry_hittable(g, others[count]), &theirs);
        if (!is_same(edge.low, theirs.low) || !is_same(edge.high, theirs.high) ||
            !coincide(g, triangle, &edge, &theirs))
            continue;
        const int status =
            kiln_grow(&pairs->list, &pairs->capacity, pairs->count + 1, sizeof *pairs->list, "coincident faces", error);
        if (status != KILN_OK)
            return status;
        pairs->list[pairs->count++] = (struct pair){number, others[count]};
    }
    return KILN_OK;
}

static int compare_block(struct search *s, size_t block, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = block * BLOCK; status == KILN_OK && i < block_end(s, block); i++)
        status = compare(s, (uint32_t)i, &s->pairs[block], error);
    return status;
}

static bool is_opaque(const struct kiln_geometry *g, uint64_t triangle) { return triangle < g->opaque_count; }

/* Records two triangles that coincide. `largest`, m2: area of the smaller triangle in the pair named by `doubled`. */
static void take(struct kiln_geometry *g, uint64_t triangle, uint64_t other, double *largest)
{
    const bool two_sided = (g->records[triangle].material & g->records[other].material & KILN_RECORD_DOUBLE_SIDED) != 0,
               opposite = dvec3_dot(normal_of(g, triangle), normal_of(g, other)) < 0.0;
    g->coincident = g->coincident || (opposite && !two_sided);
    if ((opposite && !two_sided) || !is_opaque(g, triangle) || !is_opaque(g, other))
        return;
    const double area = fmin(kiln_geometry_triangle_area(g, triangle), kiln_geometry_triangle_area(g, other));
    g->doubled_area += area;
    if (area > *largest) {
        *largest = area;
        g->doubled[0] = g->records[other].object;
        g->doubled[1] = g->records[triangle].object;
    }
}

/* Records all pairs in the order of the triangles, so that sums do not depend on threads. */
static void take_all(const struct search *s)
{
    double largest = 0.0;
    for (size_t block = 0; block < s->blocks; block++)
        for (size_t i = 0; i < s->pairs[block].count; i++) {
            const struct pair *pair = &s->pairs[block].list[i];
            take(s->g, kiln_geometry_hittable(s->g, pair->number), kiln_geometry_hittable(s->g, pair->other), &largest);
        }
}

/* ---- all of it ---- */

/* Runs `work` on each part or block, by all threads. */
static int for_each(struct search *s, size_t count,
                    int (*work)(struct search *s, size_t which, struct kiln_error *error), struct kiln_error *error)
{
    int status = KILN_OK;
#pragma omp parallel for schedule(dynamic)
    for (size_t which = 0; which < count; which++) {
        struct kiln_error own;
        const int failed = work(s, which, &own);
        if (failed != KILN_OK) {
#pragma omp critical(kiln_coincident_failure)
            status = kiln_fail(error, failed, "%s", own.message);
        }
    }
    return status;
}

static int run(struct search *s, struct kiln_error *error)
{
#pragma omp parallel for schedule(dynamic)
    for (size_t block = 0; block < s->blocks; block++)
        hash_block(s, block);
    place_parts(s);
#pragma omp parallel for schedule(dynamic)
    for (size_t block = 0; block < s->blocks; block++)
        sort_block(s, block);
    int status;
    KILN_TRY(for_each(s, PARTS, link_part, error));
    KILN_TRY(for_each(s, s->blocks, compare_block, error));
    take_all(s);
end:
    return status;
}

static int allocate(struct search *s, struct kiln_error *error)
{
    static const char what[] = "the search for coincident faces";
    int status;
    KILN_TRY(kiln_arena_allocate_bare(&s->arena, &s->hash, s->count, sizeof *s->hash, what, error));
    KILN_TRY(kiln_arena_allocate_bare(&s->arena, &s->entries, s->count, sizeof *s->entries, what, error));
    KILN_TRY(kiln_arena_allocate(&s->arena, &s->before, s->count, sizeof *s->before, what, error));
    kiln_expect_whole(s->hash, s->count, sizeof *s->hash);
    kiln_expect_whole(s->entries, s->count, sizeof *s->entries);
    kiln_expect_whole(s->before, s->count, sizeof *s->before);
    KILN_TRY(kiln_arena_allocate_bare(&s->arena, &s->part_at, s->blocks * PARTS, sizeof *s->part_at, what, error));
    KILN_TRY(kiln_arena_allocate(&s->arena, &s->part_end, PARTS, sizeof *s->part_end, what, error));
    KILN_TRY(kiln_arena_allocate(&s->arena, &s->pairs, s->blocks, sizeof *s->pairs, what, error));
end:
    return status;
}

int kiln_coincident_find(struct kiln_geometry *g, struct kiln_error *error)
{
    struct search s = {.g = g, .count = kiln_geometry_hittable_count(g)};
    s.blocks = (s.count + BLOCK - 1) / BLOCK;
    g->coincident = false;
    g->doubled_area = 0.0;
    int status = allocate(&s, error);
    if (status == KILN_OK)
        status = run(&s, error);
    for (size_t block = 0; s.pairs != NULL && block < s.blocks; block++)
        kiln_free(&s.pairs[block].list);
    kiln_arena_release(&s.arena);
    return status;
}
