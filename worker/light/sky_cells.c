#include "worker/light/sky_cells.h"

#include <math.h>
#include <string.h>

#include "shaders/shared/environment.h"
#include "worker/base/arena.h"
#include "worker/base/memory.h"
#include "worker/light/environment.h"

#define SUN_PART 0.125    /* least luminance of a sun's texel, over that of the brightest */
#define SUN_WIDTH 0.04    /* of the image's width and height: largest distance of a sun's texel from the brightest */
#define SUN_BRIGHTER 20.0 /* least mean luminance of a sun, over that of the image */
#define LEAST_GAIN 1e-3   /* of all light: least gain of a cut */

enum { MOMENTS = 4 }; /* flux, and flux times direction */

struct sums {
    double of[MOMENTS];
};

/* The best cut of a cell: before row or column `at`. */
struct cut {
    double gain;
    uint32_t at;
    bool along_rows;
};

struct cutting {
    struct kiln_sky_cells *cells;
    const struct kiln_lights *lights;
    const struct kiln_environment *e;
    struct kiln_dvec3 *columns; /* directions of the columns' middles, at the horizon */
    struct sums *rows, *sums;   /* of a cell's rows, and of its columns */
    struct cut *cuts;           /* of each cell */
    struct kiln_arena arena;
};

static double luminance_of(const struct cutting *w, uint32_t x, uint32_t y)
{
    return kiln_luminance_of_floats(w->lights->scene->environment_texels + 3 * ((size_t)y * w->e->width + x));
}

/* Returns the probability that a texel is drawn. */
static double chance_of(const struct kiln_lights *lights, uint32_t width, uint32_t x, uint32_t y)
{
    return kiln_step_chance(lights->marginal, 0, y) * kiln_step_chance(lights->conditional, (size_t)y * width, x);
}

static double spread_of(const struct sums *s)
{
    return s->of[0] - sqrt(s->of[1] * s->of[1] + s->of[2] * s->of[2] + s->of[3] * s->of[3]);
}

static void add(struct sums *to, const struct sums *s)
{
    for (int i = 0; i < MOMENTS; i++)
        to->of[i] += s->of[i];
}

/* Sums over each row and each column of a cell. */
static void add_up(const struct cutting *w, const struct kiln_sky_cell *cell)
{
    memset(w->rows, 0, (cell->y1 - cell->y0) * sizeof *w->rows);
    memset(w->sums, 0, (cell->x1 - cell->x0) * sizeof *w->sums);
    for (uint32_t y = cell->y0; y < cell->y1; y++) {
        const double height = cos(KILN_PI * ((double)y + 0.5) / (double)w->e->height),
                     level = sqrt(1.0 - height * height);
        for (uint32_t x = cell->x0; x < cell->x1; x++) {
            const double flux = chance_of(w->lights, w->e->width, x, y);
            const struct sums texel = {
                {flux, flux * level * w->columns[x].x, flux * height, flux * level * w->columns[x].z}};
            add(&w->rows[y - cell->y0], &texel);
            add(&w->sums[x - cell->x0], &texel);
        }
    }
}

static struct sums less(const struct sums *all, const struct sums *part)
{
    struct sums rest;
    for (int i = 0; i < MOMENTS; i++)
        rest.of[i] = all->of[i] - part->of[i];
    return rest;
}

/* Tries the cuts between these rows or columns, from number `first` on; keeps the best in *best. */
static void try_cuts(const struct sums *lines, uint32_t count, uint32_t first, bool along_rows, struct cut *best)
{
    struct sums all = {{0}}, part = {{0}};
    for (uint32_t i = 0; i < count; i++)
        add(&all, &lines[i]);
    for (uint32_t i = 0; i + 1 < count; i++) {
        add(&part, &lines[i]);
        const struct sums rest = less(&all, &part);
        const double gain = spread_of(&all) - spread_of(&part) - spread_of(&rest);
        if (gain > best->gain)
            *best = (struct cut){.gain = gain, .at = first + i + 1, .along_rows = along_rows};
    }
}

/* Finds the cut with the least spread of directions. */
static struct cut best_cut(const struct cutting *w, const struct kiln_sky_cell *cell)
{
    struct cut best = {0};
    add_up(w, cell);
    try_cuts(w->sums, cell->x1 - cell->x0, cell->x0, false, &best);
    try_cuts(w->rows, cell->y1 - cell->y0, cell->y0, true, &best);
    return best;
}

/* Cuts a cell in two, unless one side would be empty. The new cell is appended. */
static void cut_at(const struct cutting *w, size_t index, bool along_rows, uint32_t at)
{
    struct kiln_sky_cell *cell = &w->cells->all[index], *other = &w->cells->all[w->cells->count];
    if (at <= (along_rows ? cell->y0 : cell->x0) || at >= (along_rows ? cell->y1 : cell->x1))
        return;
    *other = *cell;
    *(along_rows ? &cell->y1 : &cell->x1) = at;
    *(along_rows ? &other->y0 : &other->x0) = at;
    w->cells->count++;
}

static double share_of(const struct kiln_lights *lights, const struct kiln_sky_cell *cell)
{
    const uint32_t width = lights->scene->environment->width;
    double sum = 0.0;
    for (uint32_t y = cell->y0; y < cell->y1; y++)
        for (uint32_t x = cell->x0; x < cell->x1; x++)
            sum += chance_of(lights, width, x, y);
    return sum;
}

/* Solid angle of a cell, as a share of the sphere. */
static double size_of(const struct cutting *w, const struct kiln_sky_cell *cell)
{
    const double height = (double)w->e->height;
    return 0.5 * (cos(KILN_PI * cell->y0 / height) - cos(KILN_PI * cell->y1 / height)) * (cell->x1 - cell->x0) /
           (double)w->e->width;
}

static uint32_t below(uint32_t at, uint32_t by) { return at > by ? at - by : 0; }

/* Finds the sun: the texels near the brightest one with a similar luminance. */
static struct kiln_sky_cell sun_of(const struct cutting *w)
{
    const uint32_t width = w->e->width, height = w->e->height;
    uint32_t bx = 0, by = 0;
    double most = -1.0;
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++) {
            const double here = luminance_of(w, x, y);
            if (here > most) {
                most = here;
                bx = x;
                by = y;
            }
        }
    const uint32_t dx = (uint32_t)(SUN_WIDTH * width), dy = (uint32_t)(SUN_WIDTH * height);
    struct kiln_sky_cell sun = {.x0 = bx, .x1 = bx + 1, .y0 = by, .y1 = by + 1};
    for (uint32_t y = below(by, dy); y <= by + dy && y < height; y++)
        for (uint32_t x = below(bx, dx); x <= bx + dx && x < width; x++)
            if (luminance_of(w, x, y) >= SUN_PART * most) {
                sun.x0 = x < sun.x0 ? x : sun.x0;
                sun.x1 = x >= sun.x1 ? x + 1 : sun.x1;
                sun.y0 = y < sun.y0 ? y : sun.y0;
                sun.y1 = y >= sun.y1 ? y + 1 : sun.y1;
            }
    return sun;
}

/* Cuts the sun out of the single cell, if there is a sun, and room for the cells around it. */
static void cut_sun_out(const struct cutting *w, size_t most)
{
    const struct kiln_sky_cell sun = sun_of(w);
    if (most < 5 || share_of(w->lights, &sun) < SUN_BRIGHTER * size_of(w, &sun))
        return;
    cut_at(w, 0, true, sun.y0);
    const size_t strip = w->cells->count - 1;
    cut_at(w, strip, true, sun.y1);
    cut_at(w, strip, false, sun.x0);
    cut_at(w, sun.x0 > 0 ? w->cells->count - 1 : strip, false, sun.x1);
}

static void cut_all(const struct cutting *w, size_t most)
{
    cut_sun_out(w, most);
    for (size_t i = 0; i < w->cells->count; i++)
        w->cuts[i] = best_cut(w, &w->cells->all[i]);
    while (w->cells->count < most) {
        size_t best = 0;
        for (size_t i = 1; i < w->cells->count; i++)
            best = w->cuts[i].gain > w->cuts[best].gain ? i : best;
        if (w->cuts[best].gain < LEAST_GAIN)
            return;
        cut_at(w, best, w->cuts[best].along_rows, w->cuts[best].at);
        w->cuts[best] = best_cut(w, &w->cells->all[best]);
        w->cuts[w->cells->count - 1] = best_cut(w, &w->cells->all[w->cells->count - 1]);
    }
}

/* Makes the tables for drawing directions. */
static int make_tables(struct kiln_sky_cells *cells, struct kiln_error *error)
{
    const struct kiln_lights *l = cells->lights;
    const uint32_t width = l->scene->environment->width;
    size_t rows = 0;
    for (size_t i = 0; i < cells->count; i++)
        rows += cells->all[i].y1 - cells->all[i].y0;
    const int status = kiln_allocate(&cells->until, rows, sizeof *cells->until, "the rows of cells of the sky", error);
    rows = 0;
    for (size_t i = 0; i < cells->count && status == KILN_OK; i++) {
        struct kiln_sky_cell *cell = &cells->all[i];
        cell->first_row = rows;
        for (uint32_t y = cell->y0; y < cell->y1; y++) {
            for (uint32_t x = cell->x0; x < cell->x1; x++)
                cell->share += chance_of(l, width, x, y);
            cells->until[rows++] = cell->share;
        }
        for (size_t row = cell->first_row; row < rows; row++)
            cells->until[row] = cell->share > 0.0 ? cells->until[row] / cell->share : 1.0;
    }
    return status;
}

int kiln_sky_cells_create(struct kiln_sky_cells *cells, const struct kiln_lights *lights, size_t most,
                          struct kiln_error *error)
{
    *cells = (struct kiln_sky_cells){.lights = lights};
    if (!lights->environment || lights->conditional == NULL)
        return KILN_OK;
    const struct kiln_environment *e = lights->scene->environment;
    struct cutting w = {.cells = cells, .lights = lights, .e = e};
    const size_t room = most > 1 ? most : 1;
    int status;
    KILN_TRY(kiln_allocate(&cells->all, room, sizeof *cells->all, "the cells of the sky", error));
    KILN_TRY(kiln_arena_allocate(&w.arena, &w.cuts, room, sizeof *w.cuts, "the cuts of the sky", error));
    KILN_TRY(kiln_arena_allocate(&w.arena, &w.columns, e->width, sizeof *w.columns, "the columns of the sky", error));
    KILN_TRY(kiln_arena_allocate(&w.arena, &w.sums, e->width, sizeof *w.sums, "sums over columns of the sky", error));
    KILN_TRY(kiln_arena_allocate(&w.arena, &w.rows, e->height, sizeof *w.rows, "sums over rows of the sky", error));
    for (uint32_t x = 0; x < e->width; x++)
        w.columns[x] = kiln_sky_direction(x, 0.5, 0.5, 0.0, 0.0, e->width, (double)e->rotation);
    cells->all[0] = (struct kiln_sky_cell){.x1 = e->width, .y1 = e->height};
    cells->count = 1;
    if (room > 1)
        cut_all(&w, room);
    KILN_TRY(make_tables(cells, error));
end:
    kiln_arena_release(&w.arena);
    return status;
}

void kiln_sky_cells_release(struct kiln_sky_cells *cells)
{
    kiln_free(&cells->all);
    kiln_free(&cells->until);
    cells->count = 0;
}

/* Finds the first row of a cell whose cumulative probability exceeds v; v becomes the position in this row. */
static uint32_t find_row(const struct kiln_sky_cells *cells, const struct kiln_sky_cell *cell, double *v)
{
    const double *until = cells->until + cell->first_row;
    uint32_t low = 0, high = cell->y1 - cell->y0 - 1;
    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        if (until[middle] > *v)
            high = middle;
        else
            low = middle + 1;
    }
    const double begin = low > 0 ? until[low - 1] : 0.0;
    *v = until[low] > begin ? fmin(fmax((*v - begin) / (until[low] - begin), 0.0), 1.0 - 1e-12) : 0.5;
    return cell->y0 + low;
}

struct kiln_dvec3 kiln_sky_cell_sample(const struct kiln_sky_cells *cells, size_t index, double u, double v,
                                       double *density)
{
    const struct kiln_sky_cell *cell = &cells->all[index];
    const struct kiln_lights *l = cells->lights;
    const uint32_t width = l->scene->environment->width, y = find_row(cells, cell, &v);
    const float *row = l->conditional + (size_t)y * width;
    const double begin = cell->x0 > 0 ? (double)row[cell->x0 - 1] : 0.0, end = (double)row[cell->x1 - 1];
    double fx;
    const uint32_t found = kiln_step_find(row, 0, width, begin + u * (end - begin), &fx),
                   x = found < cell->x0    ? cell->x0
                       : found >= cell->x1 ? cell->x1 - 1
                                           : found;
    *density = cell->share > 0.0 ? kiln_environment_texel_density(l, x, y) / cell->share : 0.0;
    return kiln_environment_in_texel(l, x, y, fx, v);
}

size_t kiln_sky_cell_of(const struct kiln_sky_cells *cells, struct kiln_dvec3 direction)
{
    uint32_t x, y;
    kiln_environment_texel(cells->lights, direction, &x, &y);
    for (size_t i = 0; i + 1 < cells->count; i++) {
        const struct kiln_sky_cell *c = &cells->all[i];
        if (x >= c->x0 && x < c->x1 && y >= c->y0 && y < c->y1)
            return i;
    }
    return cells->count - 1;
}
