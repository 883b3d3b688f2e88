#include "coordinator/output/map/charts/borders.h"

#include <math.h>

#include "coordinator/output/image.h"
#include "coordinator/output/map/bands/bands.h"
#include "coordinator/output/map/bands/slices.h"
#include "coordinator/output/map/charts/claims.h"
#include "coordinator/output/map/stage.h"
#include "worker/base/memory.h"

enum { SIDE = 4, STEPS_A_TEXEL = 4 };
static const float LEAST_WEIGHT =
    /* texels with a smaller bilinear weight are not taken as read, since their influence is invisible */
    1.0f / 1024.0f;

/* Sums over steps: their length, and the length of disturbed ones (borders.h). */
enum { LENGTH, DISTURBED, SUMS };

struct work {
    struct kiln_map *map;
    const struct kiln_chart_graph *graph;
    uint32_t *nearest;
    uint32_t *last; /* last claim of each texel, or KILN_NONE */
    double darkest;
    uint32_t *chart_read; /* per texel: chart whose value it has, once that is chosen */
    double (*rows)[SUMS]; /* of steps in each row */
    struct slice *slices;
    int slice_count;
};

/* A range of rows of the map, processed by one thread: claims of their texels, and results. */
struct slice {
    struct work *work;
    uint32_t first_row, end_row;
    struct kiln_chart_claims claims;
    uint64_t contested, foreign;
};

/* ---- walking borders ---- */

struct step {
    uint32_t texel[SIDE];
    float weight[SIDE];
};

/* The four texels that bilinear filtering reads at (x, y), clamped at the edge of the image. */
static struct step step_at(const struct kiln_map *map, float x, float y)
{
    struct step step;
    const float fx = x - 0.5f, fy = y - 0.5f, bx = floorf(fx), by = floorf(fy);
    for (int k = 0; k < SIDE; k++) {
        const int64_t ix = (int64_t)bx + (k & 1), iy = (int64_t)by + (k >> 1);
        const int64_t cx = ix < 0             ? 0
                           : ix >= map->width ? map->width - 1
                                              : ix,
                      cy = iy < 0              ? 0
                           : iy >= map->height ? map->height - 1
                                               : iy;
        step.texel[k] = (uint32_t)(cy * map->width + cx);
        step.weight[k] = ((k & 1) != 0 ? fx - bx : 1.0f - (fx - bx)) * ((k >> 1) != 0 ? fy - by : 1.0f - (fy - by));
    }
    return step;
}

typedef int (*use_step)(struct slice *, const struct kiln_border_edge *, const struct step *, float,
                        struct kiln_error *);

/* Calls use(slice, border, step, length) at steps along the border, both ends included. */
static int walk(struct slice *s, const struct kiln_border_edge *border, use_step use, struct kiln_error *error)
{
    const float dx = border->texel[1][0] - border->texel[0][0], dy = border->texel[1][1] - border->texel[0][1];
    const float length = hypotf(dx, dy);
    const uint32_t steps = (uint32_t)ceilf((float)STEPS_A_TEXEL * length);
    int status = KILN_OK;
    for (uint32_t i = 0; i <= steps && status == KILN_OK; i++) {
        const float t = (float)i / (float)steps;
        const struct step step = step_at(s->work->map, border->texel[0][0] + t * dx, border->texel[0][1] + t * dy);
        status = use(s, border, &step, (i == 0 || i == steps ? 0.5f : 1.0f) * length / (float)steps, error);
    }
    return status;
}

/* Whether the border may read a texel of the slice's rows. */
static bool comes_near(const struct slice *s, const struct kiln_border_edge *border)
{
    const uint32_t height = s->work->map->height;
    const float low = fminf(border->texel[0][1], border->texel[1][1]),
                high = fmaxf(border->texel[0][1], border->texel[1][1]);
    return (high >= (float)s->first_row - 2.0f && low <= (float)s->end_row + 2.0f) ||
           (s->first_row == 0 && low < 2.0f) || (s->end_row == height && high > (float)height - 2.0f);
}

static bool has_row(const struct slice *s, uint32_t texel)
{
    const uint32_t row = texel / s->work->map->width;
    return row >= s->first_row && row < s->end_row;
}

/* Processes all borders in all slices. Each slice visits those that come near its rows, in their order. */
static int walk_all(struct work *w, use_step use, struct kiln_error *error)
{
    int status = KILN_OK;
#pragma omp parallel for num_threads(w->slice_count) schedule(static)
    for (int t = 0; t < w->slice_count; t++) {
        struct kiln_error mine = {{0}};
        int walked = KILN_OK;
        for (size_t i = 0; i < w->graph->border_count && walked == KILN_OK; i++)
            if (comes_near(&w->slices[t], &w->graph->borders[i]))
                walked = walk(&w->slices[t], &w->graph->borders[i], use, &mine);
        if (walked != KILN_OK)
#pragma omp critical(kiln_borders_walk)
            status = kiln_fail(error, walked, "%s", mine.message);
    }
    return status;
}

/* ---- claims ---- */

/* Adds claims for the texels of a step, except the texels of the chart itself. */
static int claim_step(struct slice *s, const struct kiln_border_edge *border, const struct step *step, float length,
                      struct kiln_error *error)
{
    int status = KILN_OK;
    for (int k = 0; k < SIDE && status == KILN_OK; k++)
        if (step->weight[k] >= LEAST_WEIGHT && has_row(s, step->texel[k]) &&
            s->work->map->chart[step->texel[k]] != border->chart)
            status = kiln_chart_claims_add(&s->claims, s->work->map, &s->work->last[step->texel[k]], step->texel[k],
                                           border->chart, step->weight[k] * step->weight[k] * length, error);
    return status;
}

/* ---- assignment ---- */

static double luminance_at(const struct kiln_map *map, uint32_t texel)
{
    float rgb[3];
    for (int c = 0; c < 3; c++)
        rgb[c] = map->planes[KILN_MAP_DIRECT + c][texel] + map->planes[KILN_MAP_INDIRECT + c][texel];
    return (double)kiln_rgb_luminance(rgb[0], rgb[1], rgb[2]);
}

/* Sum of the squared relative errors of all charts that read the texel, if it holds `value`. */
static double error_of(struct slice *s, uint32_t texel, double value)
{
    const struct work *w = s->work;
    const uint32_t last = w->last[texel];
    double sum = 0.0;
    for (uint32_t c = kiln_chart_claims_first(&s->claims, last); c != KILN_NONE;
         c = kiln_chart_claims_next(&s->claims, last, c)) {
        const struct kiln_chart_claim *claim = &s->claims.claims[c];
        s->claims.looked_at++;
        if (claim->source == KILN_NONE)
            continue;
        const double own = luminance_at(w->map, claim->source), off = (value - own) / fmax(own, w->darkest);
        sum += (double)claim->weight * off * off;
    }
    return sum;
}

/* Errors of the sources of a texel's claims. A source is one of the texels around. */
struct source_errors {
    size_t count;
    uint32_t source[KILN_CLAIMS_AROUND];
    double error[KILN_CLAIMS_AROUND];
};

/* The error if the texel holds the value of that source: computed once for each source. */
static double error_of_source(struct slice *s, struct source_errors *known, uint32_t texel, uint32_t source)
{
    size_t i = 0;
    while (i < known->count && known->source[i] != source)
        i++;
    if (i == known->count) {
        known->source[i] = source;
        known->error[i] = error_of(s, texel, luminance_at(s->work->map, source));
        known->count++;
    }
    return known->error[i];
}

/* The source with the least error; among equals that of the chart with the largest weight, then the first. KILN_NONE:
 * no chart has a source. */
static uint32_t choose_source(struct slice *s, uint32_t texel)
{
    const uint32_t last = s->work->last[texel];
    struct source_errors known = {.count = 0};
    uint32_t best = KILN_NONE;
    double least = INFINITY;
    float most = 0.0f;
    for (uint32_t c = kiln_chart_claims_first(&s->claims, last); c != KILN_NONE;
         c = kiln_chart_claims_next(&s->claims, last, c)) {
        const struct kiln_chart_claim *claim = &s->claims.claims[c];
        if (claim->source == KILN_NONE)
            continue;
        const double error = error_of_source(s, &known, texel, claim->source);
        if (best != KILN_NONE && !(error < least || (error == least && claim->weight > most)))
            continue;
        best = claim->source;
        least = error;
        most = claim->weight;
    }
    return best;
}

/* Finds the lower bound of values that errors are divided by: a thousandth of the mean. */
static int find_darkest(const struct kiln_map *map, double *darkest, struct kiln_error *error)
{
    double mean = 0.0;
    const int status = kiln_map_mean_luminance(map, &mean, error);
    *darkest = mean > 0.0 ? 1e-3 * mean : 1.0;
    return status;
}

/* Sets `nearest` of the slice's texels. */
static void choose_slice(struct slice *s)
{
    const struct work *w = s->work;
    const struct kiln_map *map = w->map;
    for (size_t i = (size_t)s->first_row * map->width; i < (size_t)s->end_row * map->width; i++) {
        const uint32_t last = w->last[i], first = kiln_chart_claims_first(&s->claims, last);
        if (first == KILN_NONE)
            continue;
        if (map->state[i] != KILN_TEXEL_MARGIN) {
            for (uint32_t c = first; c != KILN_NONE; c = kiln_chart_claims_next(&s->claims, last, c))
                s->foreign++;
            continue;
        }
        const bool several = first != last;
        const uint32_t source = several ? choose_source(s, (uint32_t)i) : s->claims.claims[first].source;
        s->contested += several;
        if (source != KILN_NONE)
            w->nearest[i] = source;
    }
}

static void choose_all(struct work *w)
{
#pragma omp parallel for num_threads(w->slice_count) schedule(static)
    for (int t = 0; t < w->slice_count; t++)
        choose_slice(&w->slices[t]);
}

/* Measures a step. It is counted in the row of its first texel. */
static int measure_step(struct slice *s, const struct kiln_border_edge *border, const struct step *step, float length,
                        struct kiln_error *error)
{
    (void)error;
    const struct work *w = s->work;
    bool disturbed = false;
    if (!has_row(s, step->texel[0]))
        return KILN_OK;
    for (int k = 0; k < SIDE; k++)
        disturbed = disturbed || (step->weight[k] >= LEAST_WEIGHT && w->nearest[step->texel[k]] != KILN_NONE &&
                                  w->chart_read[step->texel[k]] != border->chart);
    double *row = w->rows[step->texel[0] / w->map->width - w->map->first_row];
    row[LENGTH] += (double)length;
    row[DISTURBED] += disturbed ? (double)length : 0.0;
    return KILN_OK;
}

/* Finds the chart whose value each texel has, for the map's rows and for the row below, which steps read. */
static int find_charts(struct work *w, struct kiln_error *error)
{
    const struct kiln_map *map = w->map;
#pragma omp parallel for schedule(static) if (kiln_map_texels(map) > KILN_IMAGE_ALONE)
    for (size_t i = kiln_map_first(map); i < kiln_map_end(map); i++)
        w->chart_read[i] = w->nearest[i] != KILN_NONE ? map->chart[w->nearest[i]] : KILN_NONE;
    int status = kiln_bands_halo_of(map, w->chart_read, sizeof *w->chart_read, 1, error);
    if (status == KILN_OK)
        status = kiln_bands_halo_of(map, w->nearest, sizeof *w->nearest, 1, error);
    return status;
}

/* Measures the borders, and adds up the results of all bands. */
static int report_all(struct work *w, struct kiln_border_report *report, struct kiln_error *error)
{
    double sums[SUMS];
    uint64_t counts[3] = {0};
    for (int t = 0; t < w->slice_count; t++) {
        counts[0] += w->slices[t].contested;
        counts[1] += w->slices[t].foreign;
        counts[2] += w->slices[t].claims.looked_at;
    }
    int status;
    KILN_TRY(kiln_bands_fetch(w->map, w->nearest, error));
    KILN_TRY(find_charts(w, error));
    KILN_TRY(kiln_bands_agree(w->map, walk_all(w, measure_step, error), error));
    KILN_TRY(kiln_bands_sum(w->map, w->rows[0], SUMS, sums, error));
    KILN_TRY(kiln_bands_count(w->map, counts, 3, error));
end:
    if (status != KILN_OK)
        return status;
    *report = (struct kiln_border_report){counts[0], counts[1], counts[2], sums[LENGTH], sums[DISTURBED]};
    return KILN_OK;
}

static int make_slices(struct work *w, struct kiln_error *error)
{
    const struct kiln_map *map = w->map;
    const uint32_t rows = kiln_map_rows(map);
    const int most = kiln_slices((size_t)rows * map->width);
    w->slice_count = most <= (int64_t)rows ? most : 1;
    const int status = kiln_allocate(&w->slices, (size_t)w->slice_count, sizeof *w->slices, "borders of charts", error);
    for (int t = 0; t < w->slice_count && status == KILN_OK; t++) {
        size_t begin, end;
        kiln_slice(w->slice_count, t, rows, &begin, &end);
        w->slices[t] = (struct slice){
            .work = w, .first_row = map->first_row + (uint32_t)begin, .end_row = map->first_row + (uint32_t)end};
    }
    return status;
}

static int make_work(struct work *w, struct kiln_error *error)
{
    const struct kiln_map *map = w->map;
    int status;
    KILN_TRY(make_slices(w, error));
    KILN_TRY(kiln_map_allocate(map, &w->last, sizeof *w->last, "texels at borders of charts", error));
    KILN_TRY(kiln_allocate(&w->rows, kiln_map_rows(map), sizeof *w->rows, "borders of charts", error));
end:
    if (status != KILN_OK)
        return status;
#pragma omp parallel for schedule(static) if (kiln_map_texels(map) > KILN_IMAGE_ALONE)
    for (size_t i = kiln_map_first(map); i < kiln_map_end(map); i++)
        w->last[i] = KILN_NONE;
    return KILN_OK;
}

static void drop_work(struct work *w)
{
    kiln_map_free(w->map, &w->last, sizeof *w->last);
    kiln_free(&w->rows);
    for (int t = 0; w->slices != NULL && t < w->slice_count; t++)
        kiln_chart_claims_free(&w->slices[t].claims);
    kiln_free(&w->slices);
}

int kiln_borders_assign(struct kiln_map *map, const struct kiln_chart_graph *graph, uint32_t *nearest,
                        struct kiln_border_report *report, struct kiln_error *error)
{
    struct work w = {.map = map, .graph = graph, .nearest = nearest, .darkest = 1.0};
    *report = (struct kiln_border_report){0};
    int status = make_work(&w, error);
    if (status == KILN_OK)
        status = walk_all(&w, claim_step, error);
    if ((status = kiln_bands_agree(map, status, error)) == KILN_OK)
        status = find_darkest(map, &w.darkest, error);
    if (status == KILN_OK) {
        choose_all(&w);
        w.chart_read = w.last; /* claims are of no more use */
        status = report_all(&w, report, error);
    }
    drop_work(&w);
    return status;
}

static int run(struct kiln_map_work *work, struct kiln_error *error)
{
    struct kiln_border_report borders;
    int status = kiln_bands_halo(work->map, KILN_BANDS_PLANES, KILN_BANDS_HALO, error);
    if (status == KILN_OK)
        status = kiln_borders_assign(work->map, work->graph, work->nearest, &borders, error);
    if (status != KILN_OK)
        return status;
    work->report->contested = borders.contested;
    work->report->foreign = borders.foreign;
    work->report->border = borders.length;
    work->report->border_disturbed = borders.length_disturbed;
    return status;
}

const struct kiln_map_stage kiln_map_stage_borders = {
    .name = "borders", .features = KILN_MAP_CHARTS | KILN_MAP_NEAREST, .run = run};
