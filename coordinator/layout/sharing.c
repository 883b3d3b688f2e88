#include "coordinator/layout/sharing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/layout/padding.h"
#include "coordinator/layout/raster.h"
#include "worker/base/arena.h"
#include "worker/base/disjoint_sets.h"
#include "worker/base/memory.h"

/* least depth at which a triangle covers a texel; largest difference of edges that counts as rounding; texels */
static const double TOUCH = 1e-3, ROUNDING = 1.0 / 16.0;

enum { OWNERS_MAX = 1 << 22 }; /* texels that are looked at at once, in whole rows */

/* An edge that two charts have in common in space. */
struct kiln_seam {
    uint32_t chart[2];
    double apart[2]; /* largest distance of its ends in the layout, along u and along v */
};

/* ---- seams ---- */

/* An edge at the border of a chart, its ends sorted by position. */
struct border {
    struct kiln_vec3 at[2];
    struct kiln_vec2 uv[2];
    uint32_t chart, number;
};

static int compare_floats(float a, float b) { return (a > b) - (a < b); }

static int compare_places(struct kiln_vec3 a, struct kiln_vec3 b)
{
    const int x = compare_floats(a.x, b.x), y = compare_floats(a.y, b.y);
    return x != 0 ? x : y != 0 ? y : compare_floats(a.z, b.z);
}

static int compare_ends(const struct border *a, const struct border *b)
{
    const int first = compare_places(a->at[0], b->at[0]);
    return first != 0 ? first : compare_places(a->at[1], b->at[1]);
}

static int compare_borders(const void *a, const void *b)
{
    const struct border *p = a, *q = b;
    const int ends = compare_ends(p, q);
    return ends != 0 ? ends : (p->number > q->number) - (p->number < q->number);
}

static struct border border_of(const struct kiln_sharing *s, const struct kiln_vec3 *positions, size_t edge)
{
    const uint32_t *c = s->triangles + edge / 3 * 3;
    const uint32_t v[2] = {c[edge % 3], c[(edge + 1) % 3]};
    const int turned = compare_places(positions[v[0]], positions[v[1]]) > 0;
    struct border border = {.chart = s->chart[edge / 3], .number = (uint32_t)edge};
    for (int k = 0; k < 2; k++) {
        border.at[k] = positions[v[k ^ turned]];
        border.uv[k] = s->uv[v[k ^ turned]];
    }
    return border;
}

static struct kiln_seam seam_of(const struct border *a, const struct border *b)
{
    struct kiln_seam seam = {.chart = {a->chart, b->chart}};
    for (int k = 0; k < 2; k++) {
        seam.apart[0] = fmax(seam.apart[0], fabs((double)a->uv[k].x - (double)b->uv[k].x));
        seam.apart[1] = fmax(seam.apart[1], fabs((double)a->uv[k].y - (double)b->uv[k].y));
    }
    return seam;
}

/* Lists the seams. Each border edge makes one with the edge before it that has the same ends; several edges at one
 * place make a chain. */
static int list_seams(struct kiln_sharing *s, const struct kiln_vec3 *positions, const uint8_t *borders,
                      struct kiln_error *error)
{
    struct border *all = NULL;
    size_t count = 0;
    for (size_t t = 0; t < s->triangle_count; t++)
        count += (size_t)__builtin_popcount(borders[t]);
    int status = kiln_allocate(&all, count, sizeof *all, "borders of charts", error);
    if (status == KILN_OK)
        status = kiln_arena_allocate(&s->arena, &s->seams, count, sizeof *s->seams, "borders of charts", error);
    count = 0;
    for (size_t e = 0; e < 3 * s->triangle_count && status == KILN_OK; e++)
        if ((borders[e / 3] >> (e % 3) & 1u) != 0)
            all[count++] = border_of(s, positions, e);
    if (status == KILN_OK && count > 0)
        qsort(all, count, sizeof *all, compare_borders);
    for (size_t i = 1; i < count; i++)
        if (compare_ends(&all[i - 1], &all[i]) == 0 && all[i - 1].chart != all[i].chart)
            s->seams[s->seam_count++] = seam_of(&all[i - 1], &all[i]);
    kiln_free(&all);
    return status;
}

int kiln_sharing_open(struct kiln_sharing *sharing, const struct kiln_vec3 *positions, const struct kiln_vec2 *uv,
                      size_t vertex_count, const uint32_t *triangles, size_t triangle_count, struct kiln_error *error)
{
    uint8_t *borders = NULL;
    kiln_sharing_close(sharing);
    *sharing = (struct kiln_sharing){.uv = uv, .triangles = triangles, .triangle_count = triangle_count};
    int status = kiln_arena_allocate(&sharing->arena, &sharing->chart, triangle_count, sizeof *sharing->chart,
                                     "the charts of a layout", error);
    KILN_TRY(status);
    KILN_TRY(kiln_allocate(&borders, triangle_count, 1, "the charts of a layout", error));
    KILN_TRY(kiln_padding_charts(positions, uv, vertex_count, triangles, triangle_count, sharing->chart, borders,
                                 &sharing->chart_count, error));
    KILN_TRY(kiln_arena_allocate(&sharing->arena, &sharing->joined, sharing->chart_count, sizeof *sharing->joined,
                                 "the charts of a layout", error));
    KILN_TRY(list_seams(sharing, positions, borders, error));
end:
    kiln_free(&borders);
    return status;
}

void kiln_sharing_close(struct kiln_sharing *sharing) { kiln_arena_release(&sharing->arena); }

/* Joins the charts that go on in each other in a lightmap of scale[0] x scale[1] texels. */
static void join_charts(struct kiln_sharing *s, const double scale[2])
{
    kiln_sets_begin(s->joined, s->chart_count);
    for (size_t i = 0; i < s->seam_count; i++) {
        const struct kiln_seam *seam = &s->seams[i];
        if (seam->apart[0] * scale[0] <= ROUNDING && seam->apart[1] * scale[1] <= ROUNDING)
            kiln_sets_join(s->joined, seam->chart[0], seam->chart[1]);
    }
    for (uint32_t c = 0; c < s->chart_count; c++)
        s->joined[c] = kiln_sets_root(s->joined, c);
}

/* ---- texels ---- */

/* owner of a texel with several charts: no number of a chart + 1 */
static const uint32_t SEVERAL = UINT32_MAX;

/* The rows low .. high-1 of the lightmap. */
struct strip {
    uint32_t *owners; /* per texel: its chart + 1; 0: none; SEVERAL */
    uint32_t width, low, high, chart;
    uint64_t shared;
};

/* kiln_raster_taker for a struct strip */
static void take_run(void *taker, uint32_t y, uint32_t first, uint32_t end)
{
    struct strip *strip = taker;
    uint32_t *row = strip->owners + (size_t)(y - strip->low) * strip->width;
    for (uint32_t x = first; x < end; x++) {
        if (row[x] == 0) {
            row[x] = strip->chart;
        } else if (row[x] != strip->chart && row[x] != SEVERAL) {
            row[x] = SEVERAL;
            strip->shared++;
        }
    }
}

static void corners_of(const struct kiln_sharing *s, size_t triangle, const double scale[2], double corner[3][2])
{
    for (size_t k = 0; k < 3; k++) {
        const struct kiln_vec2 uv = s->uv[s->triangles[3 * triangle + k]];
        corner[k][0] = scale[0] * (double)uv.x;
        corner[k][1] = scale[1] * (double)uv.y;
    }
}

static void cover_strip(const struct kiln_sharing *s, struct strip *strip, uint32_t height, const double scale[2])
{
    for (size_t i = 0; i < s->triangle_count; i++) {
        double c[3][2];
        corners_of(s, i, scale, c);
        if ((c[1][0] - c[0][0]) * (c[2][1] - c[0][1]) == (c[1][1] - c[0][1]) * (c[2][0] - c[0][0]))
            continue;
        strip->chart = s->joined[s->chart[i]] + 1;
        kiln_raster_rows((const double(*)[2])c, TOUCH, strip->width, height, strip->low, strip->high, take_run, strip);
    }
}

int kiln_sharing_count(struct kiln_sharing *sharing, uint32_t width, uint32_t height, uint32_t shift, uint64_t *texels,
                       struct kiln_error *error)
{
    const double scale[2] = {(double)width / (double)(1u << shift), (double)height / (double)(1u << shift)};
    const uint32_t across = (width - 1) / (1u << shift) + 1, down = (height - 1) / (1u << shift) + 1;
    const uint32_t most = across < OWNERS_MAX ? OWNERS_MAX / across : 1, rows = down < most ? down : most;
    struct strip strip = {.width = across};
    *texels = 0;
    const int status = kiln_arena_grow(&sharing->arena, &sharing->owners, &sharing->owner_capacity,
                                       (size_t)rows * across, sizeof *sharing->owners, "the texels of a layout", error);
    strip.owners = sharing->owners;
    join_charts(sharing, scale);
    for (strip.low = 0; strip.low < down && status == KILN_OK; strip.low += rows) {
        strip.high = down - strip.low < rows ? down : strip.low + rows;
        memset(strip.owners, 0, (size_t)rows * across * sizeof *strip.owners);
        cover_strip(sharing, &strip, down, scale);
    }
    *texels = strip.shared;
    return status;
}
