#include "coordinator/math/elimination.h"

#include <stdbool.h>
#include <string.h>

#include "worker/base/arena.h"
#include "worker/base/memory.h"

enum { NONE = UINT32_MAX };

/* Limits for the work of a complete factorization, as the sum of squared numbers of entries in columns: a number per
 * unknown, plus a constant for small systems. */
enum { MUCH_WORK = 300, MUCH_WORK_OF_FEW = 1 << 18 };
/* If the work exceeds the limit, unknowns with more neighbours than this form the core. */
enum { MANY_NEIGHBOURS = 14 };

/* A set of unknowns that have entries with one another: a clique, or what is left of an eliminated unknown's. */
struct element {
    size_t first; /* in `lists` */
    uint32_t count;
    uint32_t outside; /* number of its unknowns outside the new element; valid if `stamp` is the present one */
    uint32_t stamp;
    bool alive;
};

/* An unknown, and its neighbours in the list of unknowns with the same degree. */
struct node {
    size_t first; /* of its elements in `elements_of` */
    uint32_t count, degree, before, after, stamp;
};

struct graph {
    size_t count, clique_count, capacity; /* capacity: of rows */
    struct node *nodes;
    struct element *elements; /* cliques first, then elements made by elimination, in the order of pivots */
    uint32_t *elements_of;
    uint32_t *least;   /* the first unknown of each degree */
    uint32_t *cliques; /* without those that occur again */
    size_t row_count;
    uint32_t *rows;
    uint32_t lowest, stamp;
    uint32_t pivots, placed;
    double work; /* sum of the squares of entries in columns */
    bool has_core;
    struct kiln_elimination *result;
    struct kiln_arena arena;
};

/* ---- lists of unknowns by degree ---- */

static void link_node(struct graph *g, uint32_t u, uint32_t degree)
{
    struct node *node = &g->nodes[u];
    node->degree = degree;
    node->before = NONE;
    node->after = g->least[degree];
    if (node->after != NONE)
        g->nodes[node->after].before = u;
    g->least[degree] = u;
    g->lowest = degree < g->lowest ? degree : g->lowest;
}

static void unlink_node(struct graph *g, uint32_t u)
{
    const struct node *node = &g->nodes[u];
    if (node->after != NONE)
        g->nodes[node->after].before = node->before;
    if (node->before != NONE)
        g->nodes[node->before].after = node->after;
    else
        g->least[node->degree] = node->after;
}

static uint32_t lowest_degree(struct graph *g)
{
    while (g->least[g->lowest] == NONE)
        g->lowest++;
    return g->lowest;
}

static uint32_t take_least(struct graph *g)
{
    const uint32_t u = g->least[lowest_degree(g)];
    unlink_node(g, u);
    return u;
}

/* ---- elements ---- */

static const uint32_t *element_list(const struct graph *g, uint32_t e)
{
    return (e < g->clique_count ? g->cliques : g->rows) + g->elements[e].first;
}

/* Marks the unmarked unknowns of an element. Returns their number, and lists them unless `to` is NULL. */
static uint32_t mark_element(struct graph *g, uint32_t e, uint32_t *to)
{
    const uint32_t *list = element_list(g, e);
    uint32_t marked = 0;
    for (uint32_t k = 0; k < g->elements[e].count; k++)
        if (g->nodes[list[k]].stamp != g->stamp) {
            g->nodes[list[k]].stamp = g->stamp;
            if (to != NULL)
                to[marked] = list[k];
            marked++;
        }
    return marked;
}

/* The degree of a node, without itself. */
static uint32_t find_degree(struct graph *g, uint32_t u)
{
    const struct node *node = &g->nodes[u];
    uint32_t degree = 0;
    g->stamp++;
    for (uint32_t k = 0; k < node->count; k++)
        degree += mark_element(g, g->elements_of[node->first + k], NULL);
    return degree - 1;
}

/* Makes the pivot's row list, of all that it has an entry with; its elements are gone then. */
static uint32_t unite_elements(struct graph *g, uint32_t pivot, uint32_t *rows)
{
    const struct node *node = &g->nodes[pivot];
    uint32_t count = 0;
    g->stamp++;
    g->nodes[pivot].stamp = g->stamp;
    for (uint32_t k = 0; k < node->count; k++) {
        const uint32_t e = g->elements_of[node->first + k];
        count += mark_element(g, e, rows + count);
        g->elements[e].alive = false;
    }
    return count;
}

/* Counts, for each element with some of these rows, its other unknowns. Elements without any are absorbed by the new
 * element, which contains them. */
static void absorb_elements(struct graph *g, const uint32_t *rows, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++)
        for (uint32_t k = 0; k < g->nodes[rows[i]].count; k++) {
            struct element *e = &g->elements[g->elements_of[g->nodes[rows[i]].first + k]];
            if (!e->alive)
                continue;
            if (e->stamp != g->stamp) {
                e->stamp = g->stamp;
                e->outside = e->count;
            }
            e->alive = --e->outside > 0;
        }
}

/* Replaces the absorbed elements of a node, of which there is at least one, by the new element. */
static void replace_elements(struct graph *g, uint32_t u, uint32_t with)
{
    struct node *node = &g->nodes[u];
    uint32_t *of = g->elements_of + node->first, kept = 0;
    for (uint32_t k = 0; k < node->count; k++)
        if (g->elements[of[k]].alive)
            of[kept++] = of[k];
    of[kept++] = with;
    node->count = kept;
}

/* ---- elimination ---- */

static void place_node(struct graph *g, uint32_t u, size_t first_row, uint32_t entries)
{
    struct kiln_elimination *r = g->result;
    r->place[u] = g->placed;
    r->first_row[g->placed] = first_row;
    r->first[g->placed + 1] = r->first[g->placed] + entries;
    g->work += (double)entries * (double)entries;
    g->placed++;
}

/* Also eliminates those rows whose only element is the new one, and moves them to the front. Updates the degrees of the
 * others. */
static void eliminate_more(struct graph *g, size_t first_row, uint32_t count, uint32_t element)
{
    uint32_t *rows = g->rows + first_row, done = 0;
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t u = rows[i];
        unlink_node(g, u);
        if (g->nodes[u].count > 1)
            continue;
        rows[i] = rows[done];
        rows[done++] = u;
        place_node(g, u, first_row + done, count - done);
    }
    struct element *e = &g->elements[element];
    e->first = first_row + done;
    e->count = count - done;
    for (uint32_t i = done; i < count; i++)
        link_node(g, rows[i], find_degree(g, rows[i]));
}

static int eliminate(struct graph *g, struct kiln_error *error)
{
    const uint32_t pivot = take_least(g), element = (uint32_t)g->clique_count + g->pivots++;
    const size_t first_row = g->row_count;
    const int status = kiln_grow(&g->rows, &g->capacity, first_row + g->nodes[pivot].degree, sizeof *g->rows,
                                 "the order of elimination", error);
    if (status != KILN_OK)
        return status;
    const uint32_t count = unite_elements(g, pivot, g->rows + first_row);
    g->row_count += count;
    place_node(g, pivot, first_row, count);
    absorb_elements(g, g->rows + first_row, count);
    for (uint32_t i = 0; i < count; i++)
        replace_elements(g, g->rows[first_row + i], element);
    g->elements[element].alive = true;
    eliminate_more(g, first_row, count, element);
    return KILN_OK;
}

/* ---- initial graph ---- */

/* The unknowns of each clique, once each. */
static void list_cliques(struct graph *g, const uint32_t *cliques, size_t size)
{
    for (size_t e = 0; e < g->clique_count; e++) {
        struct element *element = &g->elements[e];
        *element = (struct element){.first = e * size, .alive = true};
        g->stamp++;
        for (size_t k = e * size; k < (e + 1) * size; k++) {
            struct node *node = &g->nodes[cliques[k]];
            if (node->stamp == g->stamp)
                continue;
            node->stamp = g->stamp;
            node->count++;
            g->cliques[element->first + element->count++] = cliques[k];
        }
    }
}

static void list_elements_of_nodes(struct graph *g)
{
    for (size_t u = 0, first = 0; u < g->count; u++) {
        g->nodes[u].first = first;
        first += g->nodes[u].count;
        g->nodes[u].count = 0;
    }
    for (size_t e = 0; e < g->clique_count; e++)
        for (uint32_t k = 0; k < g->elements[e].count; k++) {
            struct node *node = &g->nodes[g->cliques[g->elements[e].first + k]];
            g->elements_of[node->first + node->count++] = (uint32_t)e;
        }
}

static int begin_graph(struct graph *g, const uint32_t *cliques, size_t size, struct kiln_error *error)
{
    const char *what = "the order of elimination";
    int status;
    KILN_TRY(kiln_arena_allocate(&g->arena, &g->nodes, g->count, sizeof *g->nodes, what, error));
    KILN_TRY(
        kiln_arena_allocate(&g->arena, &g->elements, g->clique_count + g->count, sizeof *g->elements, what, error));
    KILN_TRY(kiln_arena_allocate_bare(&g->arena, &g->elements_of, g->clique_count * size, sizeof *g->elements_of, what,
                                      error));
    KILN_TRY(kiln_arena_allocate_bare(&g->arena, &g->cliques, g->clique_count * size, sizeof *g->cliques, what, error));
    KILN_TRY(kiln_arena_allocate_bare(&g->arena, &g->least, g->count, sizeof *g->least, what, error));
end:
    if (status != KILN_OK)
        return status;
    list_cliques(g, cliques, size);
    list_elements_of_nodes(g);
    memset(g->least, 0xff, g->count * sizeof *g->least);
    g->lowest = (uint32_t)g->count;
    for (size_t u = g->count; u-- > 0;)
        link_node(g, (uint32_t)u, g->nodes[u].count == 0 ? 0 : find_degree(g, (uint32_t)u));
    return KILN_OK;
}

static void free_graph(struct graph *g)
{
    kiln_arena_release(&g->arena);
    kiln_free(&g->rows);
}

/* Replaces unknowns in row lists by their places, in ascending order. Columns that share a list follow one another,
 * each beginning one row later. */
static void sort_rows(struct kiln_elimination *r)
{
    for (size_t j = 0, end = 0; j < r->count; j++) {
        if (r->first_row[j] < end)
            continue;
        const size_t begin = r->first_row[j];
        end = begin + r->first[j + 1] - r->first[j];
        for (size_t k = begin; k < end; k++) {
            const uint32_t row = r->place[r->rows[k]];
            size_t to = k;
            for (; to > begin && r->rows[to - 1] > row; to--)
                r->rows[to] = r->rows[to - 1];
            r->rows[to] = row;
        }
    }
}

/* Lists the remaining unknowns, the core, in their order. Each has entries for those of its neighbours that come
 * later. */
static int list_core(struct graph *g, struct kiln_error *error)
{
    struct kiln_elimination *r = g->result;
    uint32_t place = g->placed;
    int status = KILN_OK;
    for (size_t u = 0; u < g->count; u++)
        if (r->place[u] == NONE)
            r->place[u] = place++;
    for (uint32_t u = 0; status == KILN_OK && u < g->count; u++) {
        if (r->place[u] != g->placed)
            continue;
        const struct node *node = &g->nodes[u];
        const size_t first = g->row_count;
        uint32_t count = 0;
        status = kiln_grow(&g->rows, &g->capacity, first + node->degree + 1, sizeof *g->rows,
                           "the order of elimination", error);
        g->stamp++;
        for (uint32_t k = 0; status == KILN_OK && k < node->count; k++)
            count += mark_element(g, g->elements_of[node->first + k], g->rows + first + count);
        for (uint32_t k = 0; k < count; k++)
            if (r->place[g->rows[first + k]] > r->place[u])
                g->rows[g->row_count++] = g->rows[first + k];
        place_node(g, u, first, (uint32_t)(g->row_count - first));
    }
    return status;
}

/* All unknowns, or with a core; `too_much`: all would be much work. */
static int order_all(struct graph *g, bool *too_much, struct kiln_error *error)
{
    const double most = (double)MUCH_WORK_OF_FEW + (double)MUCH_WORK * (double)g->count;
    int status = KILN_OK;
    memset(g->result->place, 0xff, g->count * sizeof *g->result->place);
    while (status == KILN_OK && g->placed < g->count && !*too_much &&
           !(g->has_core && lowest_degree(g) > MANY_NEIGHBOURS)) {
        status = eliminate(g, error);
        *too_much = !g->has_core && g->work > most;
    }
    g->result->eliminated = g->placed;
    if (status == KILN_OK && g->placed < g->count && !*too_much)
        status = list_core(g, error);
    return status;
}

int kiln_elimination_create(struct kiln_elimination *r, size_t count, const uint32_t *cliques, size_t clique_count,
                            size_t size, struct kiln_error *error)
{
    const char *what = "the order of elimination";
    bool again = true;
    *r = (struct kiln_elimination){.count = count};
    int status = kiln_arena_allocate_bare(&r->arena, &r->place, count, sizeof *r->place, what, error);
    if (status == KILN_OK)
        status = kiln_arena_allocate(&r->arena, &r->first, count + 1, sizeof *r->first, what, error);
    if (status == KILN_OK)
        status = kiln_arena_allocate_bare(&r->arena, &r->first_row, count, sizeof *r->first_row, what, error);
    for (int way = 0; status == KILN_OK && again; way++) {
        struct graph g = {.count = count, .clique_count = clique_count, .result = r, .has_core = way > 0};
        again = false;
        status = begin_graph(&g, cliques, size, error);
        if (status == KILN_OK)
            status = order_all(&g, &again, error);
        if (status == KILN_OK && !again) {
            r->rows = g.rows;
            g.rows = NULL;
            sort_rows(r);
        }
        free_graph(&g);
    }
    return status;
}

void kiln_elimination_destroy(struct kiln_elimination *r)
{
    kiln_arena_release(&r->arena);
    kiln_free(&r->rows);
}
