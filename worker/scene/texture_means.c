#include "worker/scene/texture_means.h"

#include <math.h>
#include <string.h>

#include "shaders/shared/color.h"
#include "worker/base/memory.h"
#include "worker/scene/texture.h"

enum {
    FIRST_LEVEL = 2, /* blocks of 4 x 4 texels; smaller cells are read from the texture */
    LEVELS = 20,     /* of those that are kept, at most */
    FINEST = 6,      /* a texel is divided at most 2^FINEST times, along each side */
    FINE = 64,       /* number of cells along a polygon, from which cells at its border are cut */
    PARTS = 4,       /* each way, of such a cell */
    LOOKS = 4,       /* lookups along each side of a cell with varying coverage */
    SPAN = 1024,     /* cells along a row */
    ROWS = 8,        /* of texels, decoded at a time */
    CHANNELS = 5     /* of a texel: red, green, blue, alpha, metal */
};

struct cell {
    float value[4], square;
};

/* A grid of blocks over the texture, with a border of one cell for what lies beyond if the texture is clamped. */
struct level {
    uint32_t width, height;
    struct cell *cells; /* (width + 2) x (height + 2) */
};

struct kiln_texture_means {
    const struct kiln_scene *scene;
    const struct kiln_texture *texture;
    struct kiln_texture_look look;
    bool linear; /* the filter */
    float codes[256];
    uint32_t count; /* of levels; level i has blocks of 2^(FIRST_LEVEL + i) texels */
    struct level levels[LEVELS];
};

/* ---- texels ---- */

static uint32_t wrapped(int64_t at, uint32_t size, uint32_t wrap)
{
    const int64_t n = size;
    if (at >= 0 && at < n)
        return (uint32_t)at;
    if (wrap == KILN_WRAP_CLAMP)
        return (uint32_t)(at < 0 ? 0 : n - 1);
    const int64_t period = wrap == KILN_WRAP_MIRROR ? 2 * n : n, m = at % period, in = m < 0 ? m + period : m;
    return (uint32_t)(in < n ? in : period - 1 - in);
}

static float metal_of(const struct kiln_texture_means *m, uint64_t texel)
{
    const struct kiln_texture *t = &m->scene->textures[m->look.metal_texture];
    const uint8_t code = m->scene->texels[t->first + 4 * texel + m->look.metal_channel];
    return m->look.metal * (t->srgb && m->look.metal_channel < 3 ? m->codes[code] : (float)code / 255.0f);
}

static void decode(const struct kiln_texture_means *m, int64_t x, int64_t y, float texel[CHANNELS])
{
    const struct kiln_texture *t = m->texture;
    const uint64_t row = wrapped(y, t->height, t->wrap_v), column = wrapped(x, t->width, t->wrap_u);
    const uint8_t *code = m->scene->texels + t->first + 4 * (row * t->width + column);
    for (int c = 0; c < 4; c++)
        texel[c] = t->srgb && c < 3 ? m->codes[code[c]] : (float)code[c] / 255.0f;
    texel[4] = m->look.metal > 0.0f ? metal_of(m, row * t->width + column) : 0.0f;
}

/* Converts colour, alpha and metal to the values that are averaged. */
static void cover(const struct kiln_texture_means *m, const float texel[CHANNELS], float value[4])
{
    const float covered = kiln_coverage(m->look.alpha_mode, m->look.alpha_cutoff, texel[3]);
    for (int c = 0; c < 3; c++)
        value[c] = texel[c] * (1.0f - texel[4]) * covered;
    value[3] = covered;
}

static float square_of(const struct kiln_texture_means *m, const float value[4])
{
    const float light = m->look.alpha_mode == KILN_ALPHA_OPAQUE ? (float)kiln_luminance_of_floats(value) : value[3];
    return light * light;
}

/* Whether the averaged values are linear in the colours, wherever the filter blends these texels. */
static bool covered_alike(const struct kiln_texture_means *m, const float *const texels[], int count)
{
    bool alike = m->look.alpha_mode != KILN_ALPHA_BLEND || texels[0][3] >= 1.0f;
    for (int i = 1; i < count && (m->look.alpha_mode != KILN_ALPHA_OPAQUE || m->look.metal > 0.0f); i++) {
        const bool metal = texels[i][4] < texels[0][4] || texels[i][4] > texels[0][4];
        alike = alike && !metal &&
                (m->look.alpha_mode == KILN_ALPHA_OPAQUE ||
                 (m->look.alpha_mode == KILN_ALPHA_MASK
                      ? (texels[i][3] >= m->look.alpha_cutoff) == (texels[0][3] >= m->look.alpha_cutoff)
                      : texels[i][3] >= 1.0f));
    }
    return alike;
}

/* Bilinear interpolation between four texels, (x, y) in 0..1. */
static void blend(const float *const corner[4], float x, float y, float texel[CHANNELS])
{
    for (int c = 0; c < CHANNELS; c++) {
        const float upper = corner[0][c] + x * (corner[1][c] - corner[0][c]),
                    lower = corner[2][c] + x * (corner[3][c] - corner[2][c]);
        texel[c] = upper + y * (lower - upper);
    }
}

/* Mean over the cell between the centres of four texels. */
static void mean_between(const struct kiln_texture_means *m, const float *const corner[4], float value[4])
{
    float texel[CHANNELS];
    if (covered_alike(m, corner, 4)) {
        blend(corner, 0.5f, 0.5f, texel);
        cover(m, texel, value);
        return;
    }
    memset(value, 0, 4 * sizeof *value);
    for (int i = 0; i < LOOKS * LOOKS; i++) {
        float one[4];
        blend(corner, ((float)(i % LOOKS) + 0.5f) / LOOKS, ((float)(i / LOOKS) + 0.5f) / LOOKS, texel);
        cover(m, texel, one);
        for (int c = 0; c < 4; c++)
            value[c] += one[c] / (LOOKS * LOOKS);
    }
}

/* Mean over the middle texel of 3 x 3 texels. */
static void mean_of_texel(const struct kiln_texture_means *m, const float (*const row[3])[CHANNELS], struct cell *cell)
{
    const float *const all[9] = {row[0][0], row[0][1], row[0][2], row[1][0], row[1][1],
                                 row[1][2], row[2][0], row[2][1], row[2][2]};
    if (!m->linear) {
        cover(m, all[4], cell->value);
    } else if (covered_alike(m, all, 9)) { /* a quarter of each adjacent cell: 1, 6, 1 eighths along each side */
        float texel[CHANNELS];
        for (int c = 0; c < CHANNELS; c++)
            texel[c] = (36.0f * all[4][c] + 6.0f * (all[1][c] + all[3][c] + all[5][c] + all[7][c]) + all[0][c] +
                        all[2][c] + all[6][c] + all[8][c]) /
                       64.0f;
        cover(m, texel, cell->value);
    } else {
        memset(cell->value, 0, sizeof cell->value);
        for (int i = 0; i < LOOKS * LOOKS; i++) {
            const float x = ((float)(i % LOOKS) + 0.5f) / LOOKS - 0.5f, y = ((float)(i / LOOKS) + 0.5f) / LOOKS - 0.5f;
            const int left = x < 0.0f ? 0 : 1, top = y < 0.0f ? 0 : 1;
            const float *const corner[4] = {all[3 * top + left], all[3 * top + left + 1], all[3 * top + 3 + left],
                                            all[3 * top + 4 + left]};
            float texel[CHANNELS], one[4];
            blend(corner, x < 0.0f ? x + 1.0f : x, y < 0.0f ? y + 1.0f : y, texel);
            cover(m, texel, one);
            for (int c = 0; c < 4; c++)
                cell->value[c] += one[c] / (LOOKS * LOOKS);
        }
    }
    cell->square = square_of(m, cell->value);
}

void kiln_texture_means_at(const struct kiln_texture_means *m, double u, double v, float value[4])
{
    float texel[CHANNELS] = {0}, metal[4];
    kiln_texture_sample(m->scene, m->look.texture, (float)u, (float)v, texel);
    if (m->look.metal > 0.0f) {
        kiln_texture_sample(m->scene, m->look.metal_texture, (float)u, (float)v, metal);
        texel[4] = m->look.metal * metal[m->look.metal_channel];
    }
    cover(m, texel, value);
}

/* ---- levels ---- */

static struct cell *cell_at(const struct level *l, int64_t x, int64_t y)
{
    return l->cells + (y + 1) * ((int64_t)l->width + 2) + (x + 1);
}

static void add_cell(struct cell *to, const struct cell *from, double weight)
{
    for (int c = 0; c < 4; c++)
        to->value[c] += (float)weight * from->value[c];
    to->square += (float)weight * from->square;
}

/* Overlap of interval i of n with interval j of m, as a share of the latter; both divide 0..1. */
static double share(uint32_t i, uint32_t n, uint32_t j, uint32_t m)
{
    const double step = (double)n / m, low = fmax(i, j * step), high = fmin(i + 1.0, (j + 1.0) * step);
    return fmax(0.0, high - low) / step;
}
static uint32_t first_of(uint32_t n, uint32_t j, uint32_t m) { return (uint32_t)((uint64_t)j * n / m); }
static uint32_t end_of(uint32_t n, uint32_t j, uint32_t m) { return (uint32_t)((((uint64_t)j + 1) * n + m - 1) / m); }

/* Adds a row of the source to row y of the level, with this weight. */
static void add_row(struct level *l, uint32_t y, const struct cell *from, uint32_t n, double weight)
{
    for (uint32_t x = 0; x < l->width; x++)
        for (uint32_t i = first_of(n, x, l->width); i < end_of(n, x, l->width); i++)
            add_cell(cell_at(l, x, y), from + i, weight * share(i, n, x, l->width));
}

/* Fills row y of the first level from texels. `rows`: room for ROWS of width + 2 texels; `means`: for width cells. */
static void fill_first_row(struct kiln_texture_means *m, uint32_t y, float (*rows)[CHANNELS], struct cell *means)
{
    const struct kiln_texture *t = m->texture;
    struct level *l = &m->levels[0];
    const uint32_t first = first_of(t->height, y, l->height), end = end_of(t->height, y, l->height),
                   stride = t->width + 2;
    for (uint32_t r = 0; r < end - first + 2; r++)
        for (uint32_t x = 0; x < stride; x++)
            decode(m, (int64_t)x - 1, (int64_t)first + r - 1, rows[r * stride + x]);
    for (uint32_t r = 0; r < end - first; r++) {
        for (uint32_t x = 0; x < t->width; x++) {
            const float(*const three[3])[CHANNELS] = {rows + r * stride + x, rows + (r + 1) * stride + x,
                                                      rows + (r + 2) * stride + x};
            mean_of_texel(m, three, means + x);
        }
        add_row(l, y, means, t->width, share(first + r, t->height, y, l->height));
    }
}

static int fill_first(struct kiln_texture_means *m, struct kiln_error *error)
{
    const size_t width = m->texture->width;
    int status = KILN_OK;
#pragma omp parallel
    {
        float(*rows)[CHANNELS] = NULL;
        struct cell *means = NULL;
        struct kiln_error own;
        int done = kiln_allocate_bare(&rows, ROWS * (width + 2), sizeof *rows, "a texture's rows", &own);
        if (done == KILN_OK)
            done = kiln_allocate_bare(&means, width, sizeof *means, "a texture's rows", &own);
#pragma omp for schedule(dynamic, 8)
        for (uint32_t y = 0; y < m->levels[0].height; y++)
            if (done == KILN_OK)
                fill_first_row(m, y, rows, means);
        kiln_free(&rows);
        kiln_free(&means);
        if (done != KILN_OK)
#pragma omp critical(kiln_texture_means)
        {
            status = done;
            *error = own;
        }
    }
    return status;
}

static void fill_next(const struct level *from, struct level *to)
{
    for (uint32_t y = 0; y < to->height; y++)
        for (uint32_t j = first_of(from->height, y, to->height); j < end_of(from->height, y, to->height); j++)
            add_row(to, y, cell_at(from, 0, j), from->width, share(j, from->height, y, to->height));
}

/* Fills a border cell: the mean along an edge of the texture, or the value at its corner. */
static void fill_rim_cell(const struct kiln_texture_means *m, const struct level *l, int64_t x, int64_t y)
{
    enum { ALONG = 16 };
    struct cell *cell = cell_at(l, x, y);
    for (int i = 0; i < ALONG; i++) {
        float one[4];
        kiln_texture_means_at(m, ((double)x + (i + 0.5) / ALONG) / l->width,
                              ((double)y + (i + 0.5) / ALONG) / l->height, one);
        for (int c = 0; c < 4; c++)
            cell->value[c] += one[c] / ALONG;
    }
    cell->square = square_of(m, cell->value);
}

static void fill_rim(const struct kiln_texture_means *m, const struct level *l)
{
    const bool clamped = m->texture->wrap_u == KILN_WRAP_CLAMP || m->texture->wrap_v == KILN_WRAP_CLAMP;
    for (int64_t x = -1; x <= (int64_t)l->width && clamped; x++) {
        fill_rim_cell(m, l, x, -1);
        fill_rim_cell(m, l, x, l->height);
    }
    for (int64_t y = 0; y < (int64_t)l->height && clamped; y++) {
        fill_rim_cell(m, l, -1, y);
        fill_rim_cell(m, l, l->width, y);
    }
}

static int make_levels(struct kiln_texture_means *m, struct kiln_error *error)
{
    uint32_t size = 1u << FIRST_LEVEL;
    int status = KILN_OK;
    for (bool more = true; more && m->count < LEVELS && status == KILN_OK; size *= 2) {
        struct level *l = &m->levels[m->count];
        l->width = (m->texture->width + size - 1) / size;
        l->height = (m->texture->height + size - 1) / size;
        status = kiln_allocate(&l->cells, ((size_t)l->width + 2) * ((size_t)l->height + 2), sizeof *l->cells,
                               "the means of a texture", error);
        if (status == KILN_OK && m->count == 0)
            status = fill_first(m, error);
        else if (status == KILN_OK)
            fill_next(&m->levels[m->count - 1], l);
        if (status == KILN_OK)
            fill_rim(m, l);
        more = l->width > 1 || l->height > 1;
        m->count++;
    }
    return status;
}

int kiln_texture_means_create(struct kiln_texture_means **means, const struct kiln_scene *scene,
                              struct kiln_texture_look look, struct kiln_error *error)
{
    *means = NULL;
    struct kiln_texture_means *m = NULL;
    int status = kiln_allocate(&m, 1, sizeof *m, "the means of a texture", error);
    if (status != KILN_OK)
        return status;
    m->scene = scene;
    m->texture = &scene->textures[look.texture];
    m->look = look;
    m->linear = m->texture->nearest == 0;
    kiln_texture_codes(m->codes);
    status = make_levels(m, error);
    if (status == KILN_OK)
        *means = m;
    else
        kiln_texture_means_destroy(&m);
    return status;
}

void kiln_texture_means_destroy(struct kiln_texture_means **means)
{
    if (*means == NULL)
        return;
    for (uint32_t i = 0; i < (*means)->count; i++)
        kiln_free(&(*means)->levels[i].cells);
    kiln_free(means);
}

/* ---- polygons ---- */

/* Grid of cells for a polygon: x in cells is at u = (x + shift) / scale. */
struct cells {
    const struct kiln_texture_means *m;
    const struct level *level; /* NULL: read from the texture, */
    int finer;                 /* whose texels are cut 2^finer times */
    double scale[2], shift;
    bool fine; /* of cells between texel centres that are partly in the polygon only that part counts */
};

/* Returns the cell of any block, wrapped. */
static const struct cell *block_at(const struct kiln_texture *t, const struct level *l, int64_t x, int64_t y)
{
    const int64_t w = l->width, h = l->height;
    const bool clamp_u = t->wrap_u == KILN_WRAP_CLAMP, clamp_v = t->wrap_v == KILN_WRAP_CLAMP;
    return cell_at(l,
                   clamp_u ? (x < -1  ? -1
                              : x > w ? w
                                      : x)
                           : wrapped(x, l->width, t->wrap_u),
                   clamp_v ? (y < -1  ? -1
                              : y > h ? h
                                      : y)
                           : wrapped(y, l->height, t->wrap_v));
}

static void read_cell(const struct cells *at, int64_t x, int64_t y, struct cell *cell)
{
    const struct kiln_texture_means *m = at->m;
    if (at->level != NULL) {
        *cell = *block_at(m->texture, at->level, x, y);
        return;
    }
    if (at->finer > 0) {
        kiln_texture_means_at(m, ((double)x + 0.5) / at->scale[0], ((double)y + 0.5) / at->scale[1], cell->value);
    } else if (m->linear) {
        float texel[4][CHANNELS];
        for (int k = 0; k < 4; k++)
            decode(m, x + (k & 1), y + (k >> 1), texel[k]);
        const float *const corner[4] = {texel[0], texel[1], texel[2], texel[3]};
        mean_between(m, corner, cell->value);
    } else {
        float texel[CHANNELS];
        decode(m, x, y, texel);
        cover(m, texel, cell->value);
    }
    cell->square = square_of(m, cell->value);
}

/* Adds an edge within one row of cells, from (x0, y0) to (x1, y1), to `covered`, whose prefix sums are the signed areas
 * to the right of the edge. */
static void add_edge(double x0, double y0, double x1, double y1, double *covered)
{
    const double high = y1 - y0, left = fmin(x0, x1), right = fmax(x0, x1);
    const int64_t first = (int64_t)left, last = (int64_t)right;
    const double slope = right > left ? high / (right - left) : 0.0;
    double x = left;
    for (int64_t i = first; i <= last; i++) {
        const double end = i == last ? right : (double)i + 1.0;
        const double part = first == last ? high : (end - x) * slope, middle = 0.5 * (x + end) - (double)i;
        covered[i] += part * (1.0 - middle);
        covered[i + 1] += part * middle;
        x = end;
    }
}

/* A polygon in cell coordinates, relative to its first column. */
struct laid {
    uint32_t corners;
    double x[KILN_TEXTURE_POLYGON], y[KILN_TEXTURE_POLYGON];
    int64_t column, row, columns, rows;
    double twice; /* the area, signed */
};

static void lay_row(const struct laid *p, double row, double *covered)
{
    for (uint32_t i = 0; i < p->corners; i++) {
        const uint32_t j = i + 1 < p->corners ? i + 1 : 0;
        const double ax = p->x[i], ay = p->y[i], bx = p->x[j], by = p->y[j];
        const double from = fmin(fmax(ay, row), row + 1.0), to = fmin(fmax(by, row), row + 1.0);
        if (!(from < to || from > to))
            continue;
        const double slope = (bx - ax) / (by - ay), x0 = from == ay ? ax : ax + (from - ay) * slope,
                     x1 = to == by ? bx : ax + (to - ay) * slope;
        add_edge(fmin(fmax(x0, 0.0), (double)p->columns), from, fmin(fmax(x1, 0.0), (double)p->columns), to, covered);
    }
}

bool kiln_texture_linear(const double uv[3][2], const double corner[3], double value[3])
{
    const double ax = uv[1][0] - uv[0][0], ay = uv[1][1] - uv[0][1], bx = uv[2][0] - uv[0][0], by = uv[2][1] - uv[0][1],
                 twice = ax * by - bx * ay, a = corner[1] - corner[0], b = corner[2] - corner[0];
    value[0] = corner[0], value[1] = value[2] = 0.0;
    if (!(fabs(a) > 0.0 || fabs(b) > 0.0))
        return true;
    value[1] = (a * by - b * ay) / twice;
    value[2] = (b * ax - a * bx) / twice;
    value[0] -= value[1] * uv[0][0] + value[2] * uv[0][1];
    return isfinite(value[0]) && isfinite(value[1]) && isfinite(value[2]);
}

/* Mean around (u, v) over a region of `size`: a single lookup if it is smaller than a texel, else all blocks that may
 * overlap it. */
static void read_about(const struct kiln_texture_means *m, double u, double v, const double size[2], struct cell *cell)
{
    const double texels = fmax(size[0] * m->texture->width, size[1] * m->texture->height);
    *cell = (struct cell){.square = 0.0f};
    if (!(texels > 1.0)) {
        kiln_texture_means_at(m, u, v, cell->value);
        cell->square = square_of(m, cell->value);
        return;
    }
    uint32_t i = 0;
    while (i + 1 < m->count && texels > (double)(1u << (FIRST_LEVEL + i)))
        i++;
    const struct level *l = &m->levels[i];
    const int64_t x = (int64_t)floor(u * l->width - 0.5), y = (int64_t)floor(v * l->height - 0.5);
    for (int k = 0; k < 4; k++)
        add_cell(cell, block_at(m->texture, l, x + (k & 1), y + (k >> 1)), 0.25);
}

/* A cell about (u, v), of that size. */
static void multiply(const struct kiln_texture_means *m, const struct kiln_texture_factor *f, double u, double v,
                     const double size[2], struct cell *cell)
{
    struct cell other = {{1.0f, 1.0f, 1.0f, 1.0f}, 1.0f};
    const bool by_light = m->look.alpha_mode == KILN_ALPHA_OPAQUE;
    const double before = by_light ? kiln_luminance_of_floats(cell->value) : (double)cell->value[3];
    if (f->other != NULL) {
        double there[2], reach[2];
        for (int k = 0; k < 2; k++) {
            there[k] = f->at[k][0] + f->at[k][1] * u + f->at[k][2] * v;
            reach[k] = fabs(f->at[k][1]) * size[0] + fabs(f->at[k][2]) * size[1];
        }
        read_about(f->other, there[0], there[1], reach, &other);
    }
    for (int c = 0; c < 4; c++) {
        const double factor = f->value[c][0] + f->value[c][1] * u + f->value[c][2] * v;
        const float own = f->by_coverage && c < 3 ? cell->value[3] : cell->value[c];
        cell->value[c] = (float)(factor * (double)own * (double)other.value[f->by_other_coverage ? 3 : c]);
    }
    const double after = kiln_luminance_of_floats(cell->value), by = before > 0.0 ? after / before : 0.0;
    const float mean = f->by_other_coverage ? other.value[3] : (float)kiln_luminance_of_floats(other.value);
    const float spread = f->other != NULL && mean > 0.0f ? other.square / (mean * mean) : 1.0f;
    cell->square *= (float)(by * by) * spread;
}

/* Whether a point is in the polygon, whose winding is given. */
static bool holds(const struct laid *p, double winding, double x, double y)
{
    for (uint32_t i = 0; i < p->corners; i++) {
        const uint32_t j = i + 1 < p->corners ? i + 1 : 0;
        if (winding * ((p->x[j] - p->x[i]) * (y - p->y[i]) - (p->y[j] - p->y[i]) * (x - p->x[i])) < 0.0)
            return false;
    }
    return true;
}

/* Mean over the polygon's part of a cell between texel centres that it covers partly. (x, y): the cell relative to the
 * polygon's columns and rows. */
static void read_part(const struct cells *at, const struct laid *p, double winding, int64_t x, int64_t y,
                      struct cell *cell)
{
    const struct kiln_texture_means *m = at->m;
    struct cell sum = {.square = 0.0f};
    uint32_t found = 0;
    for (int i = 0; i < PARTS * PARTS; i++) {
        const double s = (double)x + (i % PARTS + 0.5) / PARTS, t = (double)y + (i / PARTS + 0.5) / PARTS;
        struct cell one;
        if (!holds(p, winding, s, t))
            continue;
        kiln_texture_means_at(m, ((double)p->column + s + at->shift) / at->scale[0],
                              ((double)p->row + t + at->shift) / at->scale[1], one.value);
        one.square = square_of(m, one.value);
        add_cell(&sum, &one, 1.0);
        found++;
    }
    if (found == 0) {
        read_cell(at, p->column + x, p->row + y, cell);
        return;
    }
    *cell = (struct cell){.square = 0.0f};
    add_cell(cell, &sum, 1.0 / found);
}

static void add_row_of(const struct cells *at, const struct laid *p, int64_t row,
                       const struct kiln_texture_factor *factor, double *covered, struct kiln_texture_mean *sum,
                       double *area)
{
    const double size[2] = {1.0 / at->scale[0], 1.0 / at->scale[1]};
    const double winding = p->twice > 0.0 ? 1.0 : -1.0;
    double here = 0.0;
    for (int64_t i = 0; i < p->columns; i++) {
        here += covered[i];
        const double weight = fabs(here);
        struct cell cell;
        if (!(weight > 1e-12))
            continue;
        if (at->fine && weight < 1.0 - 1e-9)
            read_part(at, p, winding, i, row - p->row, &cell);
        else
            read_cell(at, p->column + i, row, &cell);
        if (factor != NULL)
            multiply(at->m, factor, ((double)(p->column + i) + 0.5 + at->shift) / at->scale[0],
                     ((double)row + 0.5 + at->shift) / at->scale[1], size, &cell);
        for (int c = 0; c < 4; c++)
            sum->value[c] += weight * (double)cell.value[c];
        sum->square += weight * (double)cell.square;
        *area += weight;
    }
    memset(covered, 0, ((size_t)p->columns + 2) * sizeof *covered);
}

static bool sum_up(const struct cells *at, const struct laid *p, const struct kiln_texture_factor *factor,
                   struct kiln_texture_mean *mean)
{
    double covered[SPAN + 4], area = 0.0;
    *mean = (struct kiln_texture_mean){.square = 0.0};
    memset(covered, 0, ((size_t)p->columns + 2) * sizeof *covered);
    for (int64_t r = 0; r < p->rows; r++) {
        lay_row(p, (double)r, covered);
        add_row_of(at, p, p->row + r, factor, covered, mean, &area);
    }
    if (!(area > 0.0))
        return false;
    for (int c = 0; c < 4; c++)
        mean->value[c] /= area;
    mean->square /= area;
    return true;
}

/* Chooses the cells for a polygon that spans this number of texels. */
static struct cells choose_cells(const struct kiln_texture_means *m, double span, uint32_t most)
{
    struct cells at = {.m = m, .scale = {m->texture->width, m->texture->height}};
    if (span <= 2.0 * most) {
        while (m->linear && at.finer < FINEST && span * (double)(1u << at.finer) < fmax(4.0, most / 8.0))
            at.finer++;
        at.scale[0] *= (double)(1u << at.finer);
        at.scale[1] *= (double)(1u << at.finer);
        at.shift = m->linear && at.finer == 0 ? 0.5 : 0.0;
        at.fine = m->linear && at.finer == 0 && most >= FINE;
        return at;
    }
    uint32_t i = 0;
    while (i + 1 < m->count && span > (double)most * (double)(1u << (FIRST_LEVEL + i)))
        i++;
    at.level = &m->levels[i];
    at.scale[0] = at.level->width;
    at.scale[1] = at.level->height;
    return at;
}

static bool lay(const struct cells *at, const double (*polygon)[2], uint32_t corners, struct laid *p)
{
    double low[2] = {INFINITY, INFINITY}, high[2] = {-INFINITY, -INFINITY}, twice = 0.0;
    p->corners = corners;
    for (uint32_t i = 0; i < corners; i++) {
        p->x[i] = polygon[i][0] * at->scale[0] - at->shift;
        p->y[i] = polygon[i][1] * at->scale[1] - at->shift;
        low[0] = fmin(low[0], p->x[i]), high[0] = fmax(high[0], p->x[i]);
        low[1] = fmin(low[1], p->y[i]), high[1] = fmax(high[1], p->y[i]);
    }
    if (!(high[0] - low[0] < SPAN && high[1] - low[1] < SPAN && fabs(low[0]) < 1e12 && fabs(low[1]) < 1e12))
        return false;
    const double x = floor(low[0]), y = floor(low[1]);
    for (uint32_t i = 0; i < corners; i++)
        p->x[i] -= x, p->y[i] -= y;
    for (uint32_t i = 1; i + 1 < corners; i++)
        twice += (p->x[i] - p->x[0]) * (p->y[i + 1] - p->y[0]) - (p->x[i + 1] - p->x[0]) * (p->y[i] - p->y[0]);
    p->column = (int64_t)x, p->row = (int64_t)y;
    p->columns = (int64_t)(high[0] - x) + 1, p->rows = (int64_t)(high[1] - y) + 1;
    const double size = fmax(high[0] - low[0], high[1] - low[1]);
    p->twice = twice;
    return fabs(twice) > 1e-9 * size * size;
}

/* Mean of the whole texture, for polygons over so many periods that the partial ones at the border do not matter. */
static bool mean_of_whole(const struct kiln_texture_means *m, const double (*polygon)[2], uint32_t corners,
                          const struct kiln_texture_factor *factor, struct kiln_texture_mean *mean)
{
    if (m->texture->wrap_u == KILN_WRAP_CLAMP || m->texture->wrap_v == KILN_WRAP_CLAMP)
        return false;
    struct cell cell = *cell_at(&m->levels[m->count - 1], 0, 0);
    double u = 0.0, v = 0.0;
    for (uint32_t i = 0; i < corners; i++)
        u += polygon[i][0] / corners, v += polygon[i][1] / corners;
    if (factor != NULL)
        multiply(m, factor, u, v, (const double[2]){1.0, 1.0}, &cell);
    for (int c = 0; c < 4; c++)
        mean->value[c] = (double)cell.value[c];
    mean->square = (double)cell.square;
    return true;
}

bool kiln_texture_means_over(const struct kiln_texture_means *m, const double (*polygon)[2], uint32_t corners,
                             uint32_t most, const struct kiln_texture_factor *factor, struct kiln_texture_mean *mean)
{
    double span = 0.0;
    struct laid p;
    for (uint32_t i = 1; i < corners; i++)
        for (uint32_t j = 0; j < i; j++)
            span = fmax(span, fmax(fabs(polygon[i][0] - polygon[j][0]) * m->texture->width,
                                   fabs(polygon[i][1] - polygon[j][1]) * m->texture->height));
    if (corners < 3 || !isfinite(span))
        return false;
    const struct cells at = choose_cells(m, span, most);
    const double longest = fmax(m->texture->width, m->texture->height);
    if (at.level == &m->levels[m->count - 1] && span > 2.0 * most * longest)
        return mean_of_whole(m, polygon, corners, factor, mean);
    return lay(&at, polygon, corners, &p) && sum_up(&at, &p, factor, mean);
}
