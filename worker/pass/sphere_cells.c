#include "worker/pass/sphere_cells.h"

#include <math.h>
#include <stdbool.h>

#include "worker/base/memory.h"
#include "worker/pass/spheres.h"

/* Range of cell indices that a sphere overlaps along an axis. */
static void find_range(const struct kiln_sphere_cells *c, const struct kiln_probe_spheres *s,
                       const struct kiln_sphere *sphere, int axis, int64_t range[2])
{
    const double middle = ((double)sphere->centre[axis] - s->origin[axis]) / s->spacing[axis],
                 reach = (double)sphere->radius / s->spacing[axis] + 0.5 - KILN_SPHERE_SLACK,
                 first = (double)c->first[axis], last = first + (double)c->size[axis] - 1.0;
    range[0] = (int64_t)(fmax(first, ceil(middle - reach)) - first);
    range[1] = (int64_t)(fmin(last, floor(middle + reach)) - first);
}

/* Callback for each cell that a sphere overlaps. */
typedef void (*each_cell)(struct kiln_sphere_cells *c, size_t cell, const struct kiln_cell_sphere *sphere);

static void count(struct kiln_sphere_cells *c, size_t cell, const struct kiln_cell_sphere *sphere)
{
    (void)sphere;
    c->begin[cell + 2]++;
}

static void put(struct kiln_sphere_cells *c, size_t cell, const struct kiln_cell_sphere *sphere)
{
    c->spheres[c->begin[cell + 1]++] = *sphere;
}

static void for_cells(struct kiln_sphere_cells *c, const struct kiln_probe_spheres *s, each_cell each)
{
    for (size_t i = 0; i < s->count; i++) {
        int64_t range[3][2];
        if (!(s->sphere[i].radius > 0.0f))
            continue;
        for (int a = 0; a < 3; a++)
            find_range(c, s, &s->sphere[i], a, range[a]);
        const bool several = range[0][0] < range[0][1] || range[1][0] < range[1][1] || range[2][0] < range[2][1];
        const struct kiln_cell_sphere sphere = {s->sphere[i], (uint32_t)i, several};
        for (int64_t z = range[2][0]; z <= range[2][1]; z++)
            for (int64_t y = range[1][0]; y <= range[1][1]; y++)
                for (int64_t x = range[0][0]; x <= range[0][1]; x++)
                    each(c, (size_t)((z * c->size[1] + y) * c->size[0] + x), &sphere);
    }
}

int kiln_sphere_cells_make(struct kiln_sphere_cells *c, const struct kiln_probe_spheres *s, struct kiln_error *error)
{
    const uint64_t layer = s->size[0] * s->size[1], low = s->first / layer,
                   high = s->count > 0 ? (s->first + s->count - 1) / layer : low;
    kiln_sphere_cells_release(c);
    if (s->count > UINT32_MAX)
        return kiln_fail(error, KILN_SYSTEM, "%zu spheres of probes at once are too many", s->count);
    for (int a = 0; a < 3; a++) {
        c->first[a] = a < 2 ? -1 : (int64_t)low - 1;
        c->size[a] = a < 2 ? (int64_t)s->size[a] + 2 : (int64_t)(high - low) + 3;
    }
    const size_t cells = (size_t)c->size[0] * (size_t)c->size[1] * (size_t)c->size[2];
    int status = kiln_allocate(&c->begin, cells + 2, sizeof *c->begin, "the cells of probes", error);
    if (status != KILN_OK)
        return status;
    for_cells(c, s, count);
    for (size_t i = 2; i <= cells + 1; i++)
        c->begin[i] += c->begin[i - 1];
    status = kiln_allocate(&c->spheres, c->begin[cells + 1], sizeof *c->spheres, "the cells of probes", error);
    if (status == KILN_OK)
        for_cells(c, s, put);
    return status;
}

void kiln_sphere_cells_release(struct kiln_sphere_cells *c)
{
    kiln_free(&c->begin);
    kiln_free(&c->spheres);
}
