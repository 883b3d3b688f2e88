#include "coordinator/view/bmfr.h"

#include <math.h>
#include <string.h>

#include <omp.h>

#include "coordinator/output/image.h"
#include "worker/base/memory.h"

/* Pixels: side of a block; distance between blocks; radius of a window. */
enum { BLOCK = 32, STRIDE = BLOCK / 2, RADIUS = 4 };

/* Indices of columns. Features: 1, normal, position, squared position; the light comes after the features. */
enum { NORMAL = 1, POSITION = 4, SQUARE = 7, FEATURES = 10, COLUMNS = FEATURES + 3, MOST = BLOCK * BLOCK };

/* Least part of a feature's sum of squares that earlier features must leave unexplained; below it the feature is left
 * out. */
static const float explained = 1e-6f;

/* Sums over a window. */
enum { WINDOW_PLANES = 3 };

/* A pixel whose deviation exceeds the mean of its blocks by this factor is an outlier: its fit uses its own variance
 * only. */
static const float outlier = 20.0f;

/* Weighted sums of block fits, for each pixel. */
struct fitted {
    float *light[3], *leverage, *deviation, *weight;
};

/* The filtered pixels of a block, column by column. */
struct block {
    size_t count;
    uint32_t pixel[MOST];
    float weight[MOST];
    float leverage[MOST];
    float deviation; /* the mean of those that are stated */
    float column[COLUMNS][MOST];
};

/* ---- one block ---- */

/* Weight in a block: 1 in the middle, 0 at the borders. The weights of overlapping blocks along an axis sum to 1. */
static float tent(int64_t place) { return (1.0f - fabsf((float)place + 0.5f - (float)STRIDE) / (float)STRIDE); }

static void collect_pixel(const struct kiln_bmfr *p, struct block *b, size_t pixel, float weight)
{
    const size_t i = b->count++;
    b->pixel[i] = (uint32_t)pixel;
    b->weight[i] = weight;
    b->leverage[i] = 0.0f;
    b->column[0][i] = 1.0f;
    for (int c = 0; c < 3; c++) {
        b->column[NORMAL + c][i] = p->normal[c][pixel];
        b->column[POSITION + c][i] = p->position[c][pixel];
        b->column[FEATURES + c][i] = p->light[c][pixel];
    }
}

/* Collects the filtered pixels of the block whose upper left corner is (x, y). */
static void collect(const struct kiln_bmfr *p, int64_t x, int64_t y, struct block *b)
{
    b->count = 0;
    for (int64_t v = y < 0 ? 0 : y; v < y + BLOCK && v < p->height; v++)
        for (int64_t u = x < 0 ? 0 : x; u < x + BLOCK && u < p->width; u++) {
            const size_t pixel = (size_t)v * p->width + (size_t)u;
            if (p->filtered[pixel])
                collect_pixel(p, b, pixel, tent(u - x) * tent(v - y));
        }
}

/* Scales positions to -1 to 1 along the block's longest axis, and squares them. */
static void scale(struct block *b)
{
    float middle[3], radius = 0.0f;
    for (int c = 0; c < 3; c++) {
        const float *at = b->column[POSITION + c];
        float low = at[0], high = at[0];
        for (size_t i = 1; i < b->count; i++) {
            low = at[i] < low ? at[i] : low;
            high = at[i] > high ? at[i] : high;
        }
        middle[c] = 0.5f * (low + high);
        radius = 0.5f * (high - low) > radius ? 0.5f * (high - low) : radius;
    }
    const float factor = radius > 0.0f ? 1.0f / radius : 0.0f;
    for (int c = 0; c < 3; c++)
        for (size_t i = 0; i < b->count; i++) {
            const float at = factor * (b->column[POSITION + c][i] - middle[c]);
            b->column[POSITION + c][i] = at;
            b->column[SQUARE + c][i] = at * at;
        }
}

static float dot(const float *a, const float *b, size_t count)
{
    float sum = 0.0f;
#pragma omp simd reduction(+ : sum)
    for (size_t i = 0; i < count; i++)
        sum += a[i] * b[i];
    return sum;
}

/* Projects the light onto the features and subtracts it: residuals are left in the light's columns. */
static void project(struct block *b)
{
    float before[FEATURES];
    for (int f = 0; f < FEATURES; f++)
        before[f] = dot(b->column[f], b->column[f], b->count);
    for (int f = 0; f < FEATURES; f++) {
        float *q = b->column[f];
        const float square = dot(q, q, b->count);
        if (!(square > explained * before[f]))
            continue;
        const float inverse = 1.0f / sqrtf(square);
        for (size_t i = 0; i < b->count; i++) {
            q[i] *= inverse;
            b->leverage[i] += q[i] * q[i];
        }
        for (int k = f + 1; k < COLUMNS; k++) {
            const float part = dot(q, b->column[k], b->count);
#pragma omp simd
            for (size_t i = 0; i < b->count; i++)
                b->column[k][i] -= part * q[i];
        }
    }
}

/* Fits a block and adds the fit to its pixels. Negative values of a fit become 0. */
static void fit_block(const struct kiln_bmfr *p, const struct fitted *sum, int64_t x, int64_t y, struct block *b)
{
    collect(p, x, y, b);
    if (b->count == 0)
        return;
    scale(b);
    project(b);
    b->deviation = 0.0f;
    for (size_t i = 0; i < b->count; i++)
        b->deviation += p->deviation[b->pixel[i]] / (float)b->count;
    for (size_t i = 0; i < b->count; i++) {
        const size_t pixel = b->pixel[i];
        for (int c = 0; c < 3; c++)
            sum->light[c][pixel] += b->weight[i] * fmaxf(p->light[c][pixel] - b->column[FEATURES + c][i], 0.0f);
        sum->leverage[pixel] += b->weight[i] * b->leverage[i];
        sum->deviation[pixel] += b->weight[i] * b->deviation;
        sum->weight[pixel] += b->weight[i];
    }
}

/* Fits all blocks in four turns. Blocks of one turn do not overlap, so that sums have a fixed order. */
static void fit_all(const struct kiln_bmfr *p, const struct fitted *sum, struct block *blocks)
{
    const int64_t left = (int64_t)(p->shift[0] % STRIDE) + STRIDE, up = (int64_t)(p->shift[1] % STRIDE) + STRIDE;
    for (int64_t turn = 0; turn < 4; turn++) {
        const int64_t x = turn % 2 * STRIDE - left, y = turn / 2 * STRIDE - up;
        const int64_t across = (p->width - x + BLOCK - 1) / BLOCK, down = (p->height - y + BLOCK - 1) / BLOCK;
#pragma omp parallel for schedule(dynamic, 1)
        for (int64_t i = 0; i < across * down; i++)
            fit_block(p, sum, x + i % across * BLOCK, y + i / across * BLOCK, &blocks[omp_get_thread_num()]);
    }
}

/* ---- from light to fit ---- */

/* Luminance of fit - light, f - y, of a filtered pixel. */
static float away_at(const struct kiln_bmfr *p, const struct fitted *fit, size_t i)
{
    return kiln_rgb_luminance(fit->light[0][i] - p->light[0][i], fit->light[1][i] - p->light[1][i],
                              fit->light[2][i] - p->light[2][i]);
}

/* Whether a pixel is an outlier, for which only its own variance is used. */
static bool is_outlier(const struct kiln_bmfr *p, const struct fitted *fit, size_t i)
{
    return p->deviation[i] > outlier * fit->deviation[i];
}

/* Sums over a row's windows: of v and (f - y)^2, and the number of pixels. */
static void sum_row(const struct kiln_bmfr *p, const struct fitted *fit, uint32_t y, float *const rows[WINDOW_PLANES])
{
    for (uint32_t x = 0; x < p->width; x++) {
        const size_t row = (size_t)y * p->width, to = x + RADIUS < p->width ? x + RADIUS : p->width - 1;
        float sums[WINDOW_PLANES] = {0.0f, 0.0f, 0.0f};
        for (size_t i = row + (x > RADIUS ? x - RADIUS : 0); i <= row + to; i++) {
            if (!p->filtered[i] || is_outlier(p, fit, i))
                continue;
            const float away = away_at(p, fit, i);
            sums[0] += p->deviation[i] * p->deviation[i];
            sums[1] += away * away;
            sums[2] += 1.0f;
        }
        for (int k = 0; k < WINDOW_PLANES; k++)
            rows[k][row + x] = sums[k];
    }
}

static float sum_column(const struct kiln_bmfr *p, const float *rows, uint32_t x, uint32_t y)
{
    const uint32_t to = y + RADIUS < p->height ? y + RADIUS : p->height - 1;
    float sum = 0.0f;
    for (uint32_t v = y > RADIUS ? y - RADIUS : 0; v <= to; v++)
        sum += rows[(size_t)v * p->width + x];
    return sum;
}

/* Divides the sums of each pixel by their weight. */
static void divide(const struct kiln_bmfr *p, const struct fitted *fit)
{
    const size_t count = (size_t)p->width * p->height;
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < count; i++) {
        const float part = fit->weight[i] > 0.0f ? 1.0f / fit->weight[i] : 0.0f;
        fit->leverage[i] *= part;
        fit->deviation[i] *= part;
        for (int c = 0; c < 3; c++)
            fit->light[c][i] *= part;
    }
}

/* Step of a pixel from its light (0) to its fit (1). */
static float part_of(const struct kiln_bmfr *p, const struct fitted *fit, float *const rows[WINDOW_PLANES], uint32_t x,
                     uint32_t y)
{
    const size_t i = (size_t)y * p->width + x;
    const float noise = sum_column(p, rows[0], x, y), away = sum_column(p, rows[1], x, y),
                own = p->deviation[i] * p->deviation[i] * sum_column(p, rows[2], x, y),
                variance = is_outlier(p, fit, i) ? own : noise, bias = away > noise ? away - noise : 0.0f,
                part = (1.0f - fit->leverage[i]) * variance / (variance + bias);
    return isfinite(part) ? part : 0.0f;
}

/* Moves the light towards the fit. `rows`: room for the sums along rows. */
static void shrink(const struct kiln_bmfr *p, const struct fitted *fit, float *const rows[WINDOW_PLANES])
{
#pragma omp parallel for schedule(dynamic, 4)
    for (uint32_t y = 0; y < p->height; y++)
        sum_row(p, fit, y, rows);
#pragma omp parallel for schedule(dynamic, 4)
    for (uint32_t y = 0; y < p->height; y++)
        for (uint32_t x = 0; x < p->width; x++) {
            const size_t i = (size_t)y * p->width + x;
            const float part = p->filtered[i] ? part_of(p, fit, rows, x, y) : 0.0f;
            for (int c = 0; c < 3 && part > 0.0f; c++)
                p->light[c][i] += part * (fit->light[c][i] - p->light[c][i]);
        }
}

int kiln_bmfr_run(const struct kiln_bmfr *picture, struct kiln_error *error)
{
    enum { PLANES = 6 + WINDOW_PLANES };
    const size_t count = (size_t)picture->width * picture->height;
    struct block *blocks = NULL;
    float *planes[PLANES] = {NULL};
    int status;
    KILN_TRY(kiln_allocate(&blocks, (size_t)omp_get_max_threads(), sizeof *blocks, "blocks of a view", error));
    for (int i = 0; i < PLANES; i++)
        KILN_TRY(kiln_allocate(&planes[i], count, sizeof **planes, "the fit of a view", error));
    const struct fitted sum = {{planes[0], planes[1], planes[2]}, planes[3], planes[4], planes[5]};
    fit_all(picture, &sum, blocks);
    divide(picture, &sum);
    shrink(picture, &sum, planes + 6);
end:
    for (int i = 0; i < PLANES; i++)
        kiln_free(&planes[i]);
    kiln_free(&blocks);
    return status;
}
