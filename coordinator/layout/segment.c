#include "coordinator/layout/segment.h"

#include <stdbool.h>
#include <string.h>

#include "worker/base/arena.h"
#include "worker/base/memory.h"

/* Least cosine between a triangle's normal and that of the seed of its flat patch. */
static const double FLAT_COSINE = 0.9994; /* 2 degrees */
/* Two pieces are not merged over a border shorter than this fraction of the smaller piece's outline: the chart would be
 * two charts joined by a narrow strip. */
static const double BORDER_FRACTION = 0.02;
static const double BORDER_WEIGHT = 0.5;
enum { ROUNDS = 6 };

struct cone {
    struct kiln_dvec3 axis;
    double angle;
};

struct piece {
    struct cone cone;
    double outline; /* m */
    uint32_t parent;
    uint32_t first_link, last_link; /* linked list of its borders; a link is 2 x border + side */
    uint32_t links;
};

struct border {
    uint32_t piece[2];
    double length; /* m */
    bool gone;
};

struct candidate {
    double cost;
    uint32_t border;
};

struct merger {
    const struct kiln_topology *topology;
    uint32_t *patch; /* per triangle: its patch */
    struct piece *pieces;
    size_t piece_count, piece_capacity;
    struct border *borders;
    size_t border_count, border_capacity;
    uint32_t *links; /* 2 per border: the next link in the list */
    uint32_t *table; /* hash table: border by pair of pieces; entries of merged or removed borders may remain */
    size_t table_size, table_used;
    struct candidate *heap;
    size_t heap_count, heap_capacity;
    uint32_t *queue; /* room for one per triangle, for the flood fill */
    struct kiln_arena arena;
};

static double angle_between(struct kiln_dvec3 a, struct kiln_dvec3 b)
{
    return atan2(dvec3_length(dvec3_cross(a, b)), dvec3_dot(a, b));
}

/* The smallest cone that holds both cones. */
static struct cone cone_merge(const struct cone *a, const struct cone *b)
{
    const double between = angle_between(a->axis, b->axis);
    if (between + b->angle <= a->angle)
        return *a;
    if (between + a->angle <= b->angle)
        return *b;
    const double angle = 0.5 * (between + a->angle + b->angle), turn = angle - a->angle, sine = sin(between);
    if (!(sine > 1e-9))
        return (struct cone){a->axis, between > 1.0 ? KILN_PI : angle};
    const struct kiln_dvec3 axis =
        dvec3_add(dvec3_scale(a->axis, sin(between - turn) / sine), dvec3_scale(b->axis, sin(turn) / sine));
    return (struct cone){dvec3_scale(axis, 1.0 / dvec3_length(axis)), angle};
}

static double edge_length(const struct kiln_topology *t, size_t half)
{
    const size_t triangle = half / 3, k = half % 3;
    const uint32_t *c = t->triangles + 3 * triangle;
    return dvec3_length(dvec3_sub(t->points[c[(k + 1) % 3]], t->points[c[k]]));
}

/* Finds flat patches by flood fill from each triangle that belongs to none yet. */
static int flood(struct merger *m, struct kiln_error *error)
{
    const struct kiln_topology *t = m->topology;
    memset(m->patch, 0xff, t->triangle_count * sizeof *m->patch);
    for (size_t seed = 0; seed < t->triangle_count; seed++) {
        if (m->patch[seed] != KILN_NONE || !(t->areas[seed] > 0.0))
            continue;
        const int status = kiln_arena_grow(&m->arena, &m->pieces, &m->piece_capacity, m->piece_count + 1,
                                           sizeof *m->pieces, "charts", error);
        if (status != KILN_OK)
            return status;
        const uint32_t id = (uint32_t)m->piece_count++;
        const struct kiln_dvec3 normal = t->normals[seed];
        struct kiln_dvec3 sum = dvec3(0.0, 0.0, 0.0);
        size_t count = 0;
        m->queue[count++] = (uint32_t)seed;
        m->patch[seed] = id;
        for (size_t i = 0; i < count; i++) {
            const uint32_t triangle = m->queue[i];
            sum = dvec3_add(sum, dvec3_scale(t->normals[triangle], t->areas[triangle]));
            for (size_t k = 0; k < 3; k++) {
                const uint32_t other = t->neighbours[3 * (size_t)triangle + k];
                if (other == KILN_NONE || m->patch[other] != KILN_NONE ||
                    dvec3_dot(t->normals[other], normal) < FLAT_COSINE)
                    continue;
                m->patch[other] = id;
                m->queue[count++] = other;
            }
        }
        struct piece *piece = &m->pieces[id];
        *piece = (struct piece){.cone.axis = dvec3_scale(sum, 1.0 / dvec3_length(sum)),
                                .parent = id,
                                .first_link = KILN_NONE,
                                .last_link = KILN_NONE};
        for (size_t i = 0; i < count; i++)
            piece->cone.angle = fmax(piece->cone.angle, angle_between(piece->cone.axis, t->normals[m->queue[i]]));
    }
    return KILN_OK;
}

static size_t table_slot(const struct merger *m, uint32_t a, uint32_t b)
{
    const uint64_t key = a < b ? (uint64_t)a << 32 | b : (uint64_t)b << 32 | a;
    return (size_t)kiln_layout_mix(key) & (m->table_size - 1);
}

static bool borders_pair(const struct border *border, uint32_t a, uint32_t b)
{
    return !border->gone &&
           ((border->piece[0] == a && border->piece[1] == b) || (border->piece[0] == b && border->piece[1] == a));
}

/* Returns the border between two pieces; KILN_NONE if there is none, with the slot for it in *free_slot. */
static uint32_t table_find(const struct merger *m, uint32_t a, uint32_t b, size_t *free_slot)
{
    size_t slot = table_slot(m, a, b);
    for (; m->table[slot] != KILN_NONE; slot = (slot + 1) & (m->table_size - 1))
        if (borders_pair(&m->borders[m->table[slot]], a, b))
            return m->table[slot];
    *free_slot = slot;
    return KILN_NONE;
}

/* Rebuilds the table from the borders that still exist. */
static int table_rebuild(struct merger *m, struct kiln_error *error)
{
    size_t alive = 0;
    for (size_t i = 0; i < m->border_count; i++)
        alive += !m->borders[i].gone;
    kiln_arena_free(&m->arena, &m->table);
    m->table_size = kiln_layout_table_size(2 * alive);
    const int status = kiln_arena_allocate(&m->arena, &m->table, m->table_size, sizeof *m->table, "charts", error);
    if (status != KILN_OK)
        return status;
    memset(m->table, 0xff, m->table_size * sizeof *m->table);
    m->table_used = 0;
    for (size_t i = 0; i < m->border_count; i++) {
        if (m->borders[i].gone)
            continue;
        size_t slot = table_slot(m, m->borders[i].piece[0], m->borders[i].piece[1]);
        while (m->table[slot] != KILN_NONE)
            slot = (slot + 1) & (m->table_size - 1);
        m->table[slot] = (uint32_t)i;
        m->table_used++;
    }
    return KILN_OK;
}

static int table_put(struct merger *m, size_t slot, uint32_t border, struct kiln_error *error)
{
    m->table[slot] = border;
    m->table_used++;
    return 3 * m->table_used > 2 * m->table_size ? table_rebuild(m, error) : KILN_OK;
}

static void link_piece(struct merger *m, uint32_t piece, uint32_t link)
{
    struct piece *p = &m->pieces[piece];
    m->links[link] = KILN_NONE;
    if (p->last_link == KILN_NONE)
        p->first_link = link;
    else
        m->links[p->last_link] = link;
    p->last_link = link;
    p->links++;
}

/* Finds the borders between patches and their lengths. */
static int find_borders(struct merger *m, struct kiln_error *error)
{
    const struct kiln_topology *t = m->topology;
    int status = table_rebuild(m, error);
    for (size_t half = 0; half < 3 * t->triangle_count && status == KILN_OK; half++) {
        const uint32_t own = m->patch[half / 3];
        if (own == KILN_NONE)
            continue;
        const uint32_t other = t->neighbours[half] == KILN_NONE ? KILN_NONE : m->patch[t->neighbours[half]];
        if (own == other)
            continue;
        const double length = edge_length(t, half);
        m->pieces[own].outline += length;
        if (other == KILN_NONE || t->neighbours[half] < half / 3)
            continue;
        size_t slot = 0;
        uint32_t border = table_find(m, own, other, &slot);
        if (border == KILN_NONE) {
            status = kiln_arena_grow(&m->arena, &m->borders, &m->border_capacity, m->border_count + 1,
                                     sizeof *m->borders, "charts", error);
            if (status != KILN_OK)
                break;
            border = (uint32_t)m->border_count++;
            m->borders[border] = (struct border){.piece = {own, other}};
            status = table_put(m, slot, border, error);
        }
        m->borders[border].length += length;
    }
    if (status == KILN_OK)
        status = kiln_arena_allocate(&m->arena, &m->links, 2 * m->border_count, sizeof *m->links, "charts", error);
    for (size_t i = 0; i < m->border_count && status == KILN_OK; i++) {
        link_piece(m, m->borders[i].piece[0], (uint32_t)(2 * i));
        link_piece(m, m->borders[i].piece[1], (uint32_t)(2 * i + 1));
    }
    return status;
}

static bool before(const struct candidate *a, const struct candidate *b)
{
    return a->cost < b->cost || (a->cost == b->cost && a->border < b->border);
}

/* The cost of merging over this border; false if the two pieces must not be merged. */
static bool border_cost(const struct merger *m, uint32_t border, double *cost)
{
    const struct border *b = &m->borders[border];
    const struct piece *p = &m->pieces[b->piece[0]], *q = &m->pieces[b->piece[1]];
    const struct cone cone = cone_merge(&p->cone, &q->cone);
    const double fraction = b->length / fmin(p->outline, q->outline);
    *cost = cone.angle / KILN_CHART_CONE + BORDER_WEIGHT * (1.0 - fraction);
    return cone.angle <= KILN_CHART_CONE && fraction >= BORDER_FRACTION;
}

static int heap_push(struct merger *m, uint32_t border, struct kiln_error *error)
{
    struct candidate c = {.border = border};
    if (!border_cost(m, border, &c.cost))
        return KILN_OK;
    const int status =
        kiln_arena_grow(&m->arena, &m->heap, &m->heap_capacity, m->heap_count + 1, sizeof *m->heap, "charts", error);
    if (status != KILN_OK)
        return status;
    size_t i = m->heap_count++;
    for (; i > 0 && before(&c, &m->heap[(i - 1) / 2]); i = (i - 1) / 2)
        m->heap[i] = m->heap[(i - 1) / 2];
    m->heap[i] = c;
    return KILN_OK;
}

static struct candidate heap_pop(struct merger *m)
{
    const struct candidate top = m->heap[0], last = m->heap[--m->heap_count];
    size_t i = 0;
    for (;;) {
        size_t child = 2 * i + 1;
        if (child >= m->heap_count)
            break;
        if (child + 1 < m->heap_count && before(&m->heap[child + 1], &m->heap[child]))
            child++;
        if (!before(&m->heap[child], &last))
            break;
        m->heap[i] = m->heap[child];
        i = child;
    }
    if (m->heap_count > 0)
        m->heap[i] = last;
    return top;
}

/* Merges the piece with fewer borders into the other, so that a border is moved at most log n times. */
static int merge(struct merger *m, uint32_t border, struct kiln_error *error)
{
    uint32_t keep = m->borders[border].piece[0], lose = m->borders[border].piece[1];
    if (m->pieces[keep].links < m->pieces[lose].links) {
        const uint32_t swap = keep;
        keep = lose;
        lose = swap;
    }
    struct piece *k = &m->pieces[keep];
    const struct piece *l = &m->pieces[lose];
    k->cone = cone_merge(&k->cone, &l->cone);
    k->outline = fmax(k->outline + l->outline - 2.0 * m->borders[border].length, 0.0);
    m->pieces[lose].parent = keep;
    m->borders[border].gone = true;
    int status = KILN_OK;
    for (uint32_t link = l->first_link; link != KILN_NONE && status == KILN_OK;) {
        const uint32_t next = m->links[link], moved = link / 2;
        struct border *b = &m->borders[moved];
        if (!b->gone) {
            const uint32_t other = b->piece[1 - link % 2];
            size_t slot = 0;
            uint32_t same = table_find(m, keep, other, &slot);
            if (same == KILN_NONE) {
                same = moved;
                b->piece[link % 2] = keep;
                link_piece(m, keep, link);
                status = table_put(m, slot, moved, error);
            } else {
                m->borders[same].length += b->length;
                b->gone = true;
            }
            if (status == KILN_OK)
                status = heap_push(m, same, error);
        }
        link = next;
    }
    return status;
}

/* Merges pieces in the order of cost. Costs in the heap may be outdated: the cost of an entry taken out is computed
 * again, and the entry is put back if it has grown. */
static int merge_all(struct merger *m, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; i < m->border_count; i++)
        KILN_TRY(heap_push(m, (uint32_t)i, error));
    while (m->heap_count > 0) {
        const struct candidate c = heap_pop(m);
        double cost;
        if (m->borders[c.border].gone || !border_cost(m, c.border, &cost))
            continue;
        KILN_TRY(cost > c.cost + 1e-9 ? heap_push(m, c.border, error) : merge(m, c.border, error));
    }
end:
    return status;
}

static uint32_t find_piece(const struct merger *m, uint32_t piece)
{
    while (m->pieces[piece].parent != piece) {
        m->pieces[piece].parent = m->pieces[m->pieces[piece].parent].parent;
        piece = m->pieces[piece].parent;
    }
    return piece;
}

/* Numbers the remaining pieces by their first triangle and computes exact cones, since merged cones are wider than
 * needed. Of two cones, about the axis so far and about the mean normal, the narrower one is taken. */
static int renumber(struct merger *m, struct kiln_error *error)
{
    const struct kiln_topology *t = m->topology;
    struct kiln_arena arena = {0};
    struct piece *pieces = NULL;
    struct kiln_dvec3 *sums = NULL;
    uint32_t *number = NULL;
    size_t count = 0;
    int status = kiln_arena_allocate(&arena, &number, m->piece_count, sizeof *number, "charts", error);
    if (status == KILN_OK)
        status = kiln_arena_allocate(&arena, &pieces, m->piece_count, sizeof *pieces, "charts", error);
    if (status == KILN_OK)
        status = kiln_arena_allocate(&arena, &sums, m->piece_count, sizeof *sums, "charts", error);
    if (status != KILN_OK)
        goto cleanup;
    memset(number, 0xff, m->piece_count * sizeof *number);
    for (size_t i = 0; i < t->triangle_count; i++) {
        if (m->patch[i] == KILN_NONE)
            continue;
        const uint32_t piece = find_piece(m, m->patch[i]);
        if (number[piece] == KILN_NONE) {
            number[piece] = (uint32_t)count;
            pieces[count] = (struct piece){.cone.axis = m->pieces[piece].cone.axis,
                                           .parent = (uint32_t)count,
                                           .first_link = KILN_NONE,
                                           .last_link = KILN_NONE};
            count++;
        }
        m->patch[i] = number[piece];
        sums[number[piece]] = dvec3_add(sums[number[piece]], dvec3_scale(t->normals[i], t->areas[i]));
    }
    for (size_t i = 0; i < count; i++) {
        const double length = dvec3_length(sums[i]);
        sums[i] = length > 0.0 ? dvec3_scale(sums[i], 1.0 / length) : pieces[i].cone.axis;
        m->pieces[i].cone = (struct cone){.axis = sums[i]}; /* second candidate cone; its angle is found below */
    }
    for (size_t i = 0; i < t->triangle_count; i++) {
        if (m->patch[i] == KILN_NONE)
            continue;
        struct cone *first = &pieces[m->patch[i]].cone, *second = &m->pieces[m->patch[i]].cone;
        first->angle = fmax(first->angle, angle_between(first->axis, t->normals[i]));
        second->angle = fmax(second->angle, angle_between(second->axis, t->normals[i]));
    }
    for (size_t i = 0; i < count; i++) {
        if (m->pieces[i].cone.angle < pieces[i].cone.angle)
            pieces[i].cone = m->pieces[i].cone;
        m->pieces[i] = pieces[i];
    }
    m->piece_count = count;
cleanup:
    kiln_arena_release(&arena);
    return status;
}

/* Merges, narrows the cones, and merges again as long as that still joins many pieces. */
static int merge_in_rounds(struct merger *m, struct kiln_error *error)
{
    int status = KILN_OK;
    for (int round = 0; round < ROUNDS && status == KILN_OK; round++) {
        const size_t before_count = m->piece_count;
        m->border_count = m->heap_count = 0;
        kiln_arena_free(&m->arena, &m->links);
        status = find_borders(m, error);
        if (status == KILN_OK)
            status = merge_all(m, error);
        if (status == KILN_OK)
            status = renumber(m, error);
        if (m->piece_count == before_count)
            break;
    }
    return status;
}

static int copy_segments(struct kiln_segments *s, const struct merger *m, struct kiln_error *error)
{
    const int status = kiln_allocate(&s->axes, m->piece_count, sizeof *s->axes, "charts", error);
    if (status != KILN_OK)
        return status;
    s->count = m->piece_count;
    for (size_t i = 0; i < m->piece_count; i++)
        s->axes[i] = m->pieces[i].cone.axis;
    memcpy(s->segment, m->patch, m->topology->triangle_count * sizeof *s->segment);
    return KILN_OK;
}

int kiln_segments_create(struct kiln_segments **segments, const struct kiln_topology *topology,
                         struct kiln_error *error)
{
    struct kiln_segments *s = NULL;
    struct merger m = {.topology = topology};
    *segments = NULL;
    int status = kiln_allocate(&s, 1, sizeof *s, "charts", error);
    if (status == KILN_OK)
        status = kiln_allocate(&s->segment, topology->triangle_count, sizeof *s->segment, "charts", error);
    if (status == KILN_OK)
        status = kiln_arena_allocate(&m.arena, &m.patch, topology->triangle_count, sizeof *m.patch, "charts", error);
    if (status == KILN_OK)
        status = kiln_arena_allocate(&m.arena, &m.queue, topology->triangle_count, sizeof *m.queue, "charts", error);
    if (status == KILN_OK)
        status = flood(&m, error);
    if (status == KILN_OK)
        status = merge_in_rounds(&m, error);
    if (status == KILN_OK)
        status = copy_segments(s, &m, error);
    kiln_arena_release(&m.arena);
    if (status != KILN_OK && s != NULL)
        kiln_segments_destroy(&s);
    *segments = s;
    return status;
}

void kiln_segments_destroy(struct kiln_segments **segments)
{
    if (*segments == NULL)
        return;
    kiln_free(&(*segments)->axes);
    kiln_free(&(*segments)->segment);
    kiln_free(segments);
}
