#include "worker/backend/embree/photons.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

#include "shaders/shared/bidirectional.h"
#include "worker/base/memory.h"

struct photon_grid {
    struct photon *photons;
    uint64_t *first; /* index of the first photon of each bucket, and the end */
    size_t buckets;  /* a power of two */
    double radius;
};

struct cell {
    int64_t x, y, z;
};

int photon_add(struct photon_list *list, const struct photon *photon, struct kiln_error *error)
{
    const int status = kiln_grow(&list->photons, &list->capacity, list->count + 1, sizeof *photon, "photons", error);
    if (status == KILN_OK)
        list->photons[list->count++] = *photon;
    return status;
}

/* The cell of a place, shifted by a share of a cell. */
static struct cell cell_of(const struct photon_grid *grid, struct kiln_vec3 p, double shift)
{
    return (struct cell){kiln_photon_cell(p.x, grid->radius, shift), kiln_photon_cell(p.y, grid->radius, shift),
                         kiln_photon_cell(p.z, grid->radius, shift)};
}

static size_t bucket_of(const struct photon_grid *grid, struct cell c)
{
    return kiln_photon_bucket(c.x, c.y, c.z, (uint32_t)(grid->buckets - 1));
}

static int by_path(const void *a, const void *b)
{
    const struct photon *p = a, *q = b;
    if (p->path != q->path)
        return p->path < q->path ? -1 : 1;
    return (p->number > q->number) - (p->number < q->number);
}

/* Counts the photons of each bucket, and puts each where it belongs. */
static void fill(struct photon_grid *grid, const struct photon_list *lists, size_t count)
{
    for (size_t l = 0; l < count; l++)
        for (size_t i = 0; i < lists[l].count; i++)
            grid->first[bucket_of(grid, cell_of(grid, lists[l].photons[i].position, 0.0)) + 1]++;
    for (size_t i = 0; i < grid->buckets; i++)
        grid->first[i + 1] += grid->first[i];
    for (size_t l = count; l-- > 0;) /* each bucket from its end */
        for (size_t i = lists[l].count; i-- > 0;) {
            const struct photon *p = &lists[l].photons[i];
            grid->photons[--grid->first[bucket_of(grid, cell_of(grid, p->position, 0.0)) + 1]] = *p;
        }
    /* first[b + 1] is now where bucket b begins */
    for (size_t i = 0; i < grid->buckets; i++)
        grid->first[i] = grid->first[i + 1];
}

int photon_grid_create(struct photon_grid **grid, const struct photon_list *lists, size_t count, double radius,
                       struct kiln_error *error)
{
    struct photon_grid *g = NULL;
    size_t all = 0;
    *grid = NULL;
    for (size_t l = 0; l < count; l++)
        all += lists[l].count;
    int status = kiln_allocate(&g, 1, sizeof *g, "photons", error);
    if (status != KILN_OK)
        return status;
    g->radius = radius;
    for (g->buckets = 1; g->buckets < all && g->buckets < (size_t)1 << 31;)
        g->buckets *= 2;
    status = kiln_allocate(&g->photons, all, sizeof *g->photons, "photons", error);
    if (status == KILN_OK)
        status = kiln_allocate(&g->first, g->buckets + 1, sizeof *g->first, "the cells of photons", error);
    if (status != KILN_OK) {
        photon_grid_destroy(&g);
        return status;
    }
    fill(g, lists, count);
    g->first[g->buckets] = all;
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < g->buckets; i++)
        if (g->first[i + 1] > g->first[i] + 1)
            qsort(g->photons + g->first[i], (size_t)(g->first[i + 1] - g->first[i]), sizeof *g->photons, by_path);
    *grid = g;
    return KILN_OK;
}

void photon_grid_destroy(struct photon_grid **grid)
{
    if (*grid == NULL)
        return;
    kiln_free(&(*grid)->photons);
    kiln_free(&(*grid)->first);
    kiln_free(grid);
}

static bool same_cell(struct cell a, struct cell b) { return a.x == b.x && a.y == b.y && a.z == b.z; }

void photon_grid_near(const struct photon_grid *grid, struct kiln_vec3 p,
                      void (*visit)(void *context, const struct photon *photon), void *context)
{
    const struct cell low = cell_of(grid, p, -0.5);
    const float squared = (float)(grid->radius * grid->radius);
    for (int k = 0; k < 8; k++) {
        const struct cell c = {low.x + (k & 1), low.y + (k >> 1 & 1), low.z + (k >> 2)};
        const size_t bucket = bucket_of(grid, c);
        for (uint64_t i = grid->first[bucket]; i < grid->first[bucket + 1]; i++) {
            const struct photon *photon = &grid->photons[i];
            const struct kiln_vec3 d = vec3_sub(photon->position, p);
            /* cells share buckets, and two of the eight cells may have the same */
            if (vec3_dot(d, d) <= squared && same_cell(c, cell_of(grid, photon->position, 0.0)))
                visit(context, photon);
        }
    }
}
