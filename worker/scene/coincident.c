#include "worker/scene/coincident.h"

#include <math.h>
#include <string.h>

#include "worker/base/memory.h"

enum { SAME_EDGE_MOST = 64 };

/* A triangle's shortest edge, from its lower to its higher end, and its third corner. */
struct shortest {
    struct kiln_vec3 low, high, third;
};

/* An entry of an open hash table; `triangle` + 1, so that 0 is empty. */
struct entry {
    uint32_t hash, triangle;
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

/* Of edges of equal length the one with the lower ends counts as the shortest. False: two corners are equal. */
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

static uint32_t hash_of(const struct shortest *s)
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
    return (uint32_t)hash;
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

/* What the search has found so far. */
struct search {
    struct kiln_geometry *g;
    struct entry *table;
    uint64_t mask;
    double largest; /* m2: the smaller of the two triangles of the pair that `doubled` names */
};

static bool is_opaque(const struct kiln_geometry *g, uint64_t triangle) { return triangle < g->opaque_count; }

/* Takes down two triangles that coincide. */
static void take(struct search *search, uint64_t triangle, uint64_t other)
{
    struct kiln_geometry *g = search->g;
    const bool two_sided = (g->records[triangle].material & g->records[other].material & KILN_RECORD_DOUBLE_SIDED) != 0,
               opposite = dvec3_dot(normal_of(g, triangle), normal_of(g, other)) < 0.0;
    g->coincident = g->coincident || (opposite && !two_sided);
    if ((opposite && !two_sided) || !is_opaque(g, triangle) || !is_opaque(g, other))
        return;
    const double area = fmin(kiln_geometry_triangle_area(g, triangle), kiln_geometry_triangle_area(g, other));
    g->doubled_area += area;
    if (area > search->largest) {
        search->largest = area;
        g->doubled[0] = g->records[other].object;
        g->doubled[1] = g->records[triangle].object;
    }
}

/* Puts the triangle into the table, and takes down those there that it coincides with. */
static void put(struct search *search, uint64_t triangle)
{
    const struct kiln_geometry *g = search->g;
    struct entry *table = search->table;
    struct shortest s = {0}, o = {0};
    uint32_t same = 0;
    if (!shortest_of(g, triangle, &s))
        return;
    const uint32_t hash = hash_of(&s);
    uint64_t at = hash & search->mask;
    for (; table[at].triangle != 0 && same < SAME_EDGE_MOST; at = (at + 1) & search->mask) {
        const uint64_t other = table[at].triangle - 1;
        if (table[at].hash != hash || !shortest_of(g, other, &o) || !is_same(s.low, o.low) || !is_same(s.high, o.high))
            continue;
        same++;
        if (coincide(g, triangle, &s, &o))
            take(search, triangle, other);
    }
    if (table[at].triangle == 0)
        table[at] = (struct entry){hash, (uint32_t)triangle + 1};
}

int kiln_coincident_find(struct kiln_geometry *g, struct kiln_error *error)
{
    const size_t count = kiln_geometry_hittable_count(g);
    struct search search = {.g = g};
    uint64_t size = 16;
    g->coincident = false;
    g->doubled_area = 0.0;
    while (size < 2 * (uint64_t)count)
        size *= 2;
    const int status =
        kiln_allocate(&search.table, size, sizeof *search.table, "the search for coincident faces", error);
    search.mask = size - 1;
    for (size_t i = 0; status == KILN_OK && i < count; i++)
        put(&search, kiln_geometry_hittable(g, i));
    kiln_free(&search.table);
    return status;
}
