#include "coordinator/output/map/seams.h"

#include <math.h>

#include "coordinator/output/image.h"
#include "coordinator/output/map/stage.h"
#include "worker/base/memory.h"

enum { SIDE = 4, ENTRIES = 2 * SIDE, MOST_ITERATIONS = 200 };

/* A sample, one row of the matrix A: the sum of weight x value over its entries should be 0. Side 1 has negative
 * weights. */
struct sample {
    uint32_t texel[ENTRIES]; /* indices in the map; later the numbers of the unknowns */
    float weight[ENTRIES];
};

struct system {
    struct kiln_map *map;
    const uint32_t *nearest;
    struct sample *samples;
    size_t sample_count, sample_capacity;
    uint32_t *texels; /* texel of each unknown */
    size_t unknown_count;
    double *pull; /* w a of each unknown (seams.h) */
    double *diagonal;
};

/* Working memory of conjugate gradients for one plane. */
struct solver {
    const struct system *system;
    double *x, *residual, *direction, *product, *row; /* one value for each unknown; `row` has one for each sample */
    float *low, *high;                                /* range of the baked values around each unknown */
};

static float luminance_at(const struct kiln_map *map, uint32_t texel)
{
    float rgb[3];
    for (int c = 0; c < 3; c++)
        rgb[c] = map->planes[KILN_MAP_DIRECT + c][texel] + map->planes[KILN_MAP_INDIRECT + c][texel];
    return kiln_rgb_luminance(rgb[0], rgb[1], rgb[2]);
}

/* The four texels and weights of bilinear filtering at the texel coordinate (x, y), clamped at the edge of the image.
 */
static bool footprint(const struct system *s, float x, float y, float sign, uint32_t texel[SIDE], float weight[SIDE])
{
    const float fx = x - 0.5f, fy = y - 0.5f;
    const float bx = floorf(fx), by = floorf(fy);
    for (int k = 0; k < SIDE; k++) {
        const int64_t ix = (int64_t)bx + (k & 1), iy = (int64_t)by + (k >> 1);
        const int64_t cx = ix < 0 ? 0 : ix >= s->map->width ? s->map->width - 1 : ix;
        const int64_t cy = iy < 0 ? 0 : iy >= s->map->height ? s->map->height - 1 : iy;
        const uint32_t index = (uint32_t)(cy * s->map->width + cx);
        texel[k] = s->nearest[index];
        if (texel[k] == KILN_NONE)
            return false;
        weight[k] = sign * ((k & 1) != 0 ? fx - bx : 1.0f - (fx - bx)) * ((k >> 1) != 0 ? fy - by : 1.0f - (fy - by));
    }
    return true;
}

static double side_value(const struct kiln_map *map, const struct sample *sample, int first)
{
    double sum = 0.0;
    for (int k = first; k < first + SIDE; k++)
        sum += fabs((double)sample->weight[k]) * (double)luminance_at(map, sample->texel[k]);
    return sum;
}

static bool is_edge_of_light(const struct kiln_map *map, const struct sample *sample)
{
    const double a = side_value(map, sample, 0), b = side_value(map, sample, SIDE);
    const double low = fmin(a, b), high = fmax(a, b);
    return !(high <= (double)KILN_SEAM_CONTRAST * low) && high > 0.0;
}

static bool same_texels(const struct sample *sample)
{
    for (int k = 0; k < SIDE; k++)
        if (sample->texel[k] != sample->texel[SIDE + k] || sample->weight[k] != -sample->weight[SIDE + k])
            return false;
    return true;
}

static int sample_edge(struct system *s, const struct kiln_seam_edge *edge, struct kiln_error *error)
{
    float longest = 0.0f;
    for (int side = 0; side < 2; side++) {
        const float length = hypotf(edge->texel[side][1][0] - edge->texel[side][0][0],
                                    edge->texel[side][1][1] - edge->texel[side][0][1]);
        longest = fmaxf(longest, length);
    }
    const size_t count = (size_t)ceilf(2.0f * longest);
    int status =
        kiln_grow(&s->samples, &s->sample_capacity, s->sample_count + count, sizeof *s->samples, "seam samples", error);
    for (size_t i = 0; status == KILN_OK && i < count; i++) {
        const float t = ((float)i + 0.5f) / (float)count;
        struct sample sample;
        bool inside = true;
        for (int side = 0; side < 2; side++) {
            const float *from = edge->texel[side][0], *to = edge->texel[side][1];
            inside =
                inside && footprint(s, from[0] + t * (to[0] - from[0]), from[1] + t * (to[1] - from[1]),
                                    side == 0 ? 1.0f : -1.0f, sample.texel + SIDE * side, sample.weight + SIDE * side);
        }
        if (inside && !same_texels(&sample) && !is_edge_of_light(s->map, &sample))
            s->samples[s->sample_count++] = sample;
    }
    return status;
}

/* Root mean square of the difference in luminance over all samples, whose entries must be texels. */
static double measure(const struct system *s)
{
    double sum = 0.0;
    for (size_t i = 0; i < s->sample_count; i++) {
        const double difference = side_value(s->map, &s->samples[i], 0) - side_value(s->map, &s->samples[i], SIDE);
        sum += difference * difference;
    }
    return s->sample_count == 0 ? 0.0 : sqrt(sum / (double)s->sample_count);
}

static double mean_luminance(const struct kiln_map *map)
{
    const size_t count = kiln_map_texels(map);
    double sum = 0.0;
    size_t used = 0;
    for (size_t i = 0; i < count; i++)
        if (map->state[i] != KILN_TEXEL_MARGIN) {
            sum += (double)luminance_at(map, (uint32_t)i);
            used++;
        }
    return used == 0 ? 0.0 : sum / (double)used;
}

static int number_unknowns(struct system *s, struct kiln_error *error)
{
    const size_t texels = kiln_map_texels(s->map);
    uint32_t *number = NULL;
    int status = kiln_allocate(&number, texels, sizeof *number, "a seam's texels", error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < s->sample_count; i++)
        for (int k = 0; k < ENTRIES; k++)
            number[s->samples[i].texel[k]] = 1;
    for (size_t i = 0; i < texels; i++)
        s->unknown_count += number[i];
    status = kiln_allocate(&s->texels, s->unknown_count, sizeof *s->texels, "a seam's texels", error);
    uint32_t next = 0;
    for (size_t i = 0; status == KILN_OK && i < texels; i++)
        if (number[i] != 0) {
            s->texels[next] = (uint32_t)i;
            number[i] = next++;
        }
    for (size_t i = 0; status == KILN_OK && i < s->sample_count; i++)
        for (int k = 0; k < ENTRIES; k++)
            s->samples[i].texel[k] = number[s->samples[i].texel[k]];
    kiln_free(&number);
    return status;
}

static int allocate_solver(struct solver *v, struct kiln_error *error)
{
    double **arrays[] = {&v->x, &v->residual, &v->direction, &v->product};
    const size_t unknowns = v->system->unknown_count;
    int status = kiln_allocate(&v->row, v->system->sample_count, sizeof(double), "seam samples", error);
    for (size_t i = 0; status == KILN_OK && i < sizeof arrays / sizeof *arrays; i++)
        status = kiln_allocate(arrays[i], unknowns, sizeof(double), "a seam's system", error);
    if (status == KILN_OK)
        status = kiln_allocate(&v->low, unknowns, sizeof(float), "a seam's system", error);
    if (status == KILN_OK)
        status = kiln_allocate(&v->high, unknowns, sizeof(float), "a seam's system", error);
    return status;
}

static void free_solver(struct solver *v)
{
    kiln_free(&v->x);
    kiln_free(&v->residual);
    kiln_free(&v->direction);
    kiln_free(&v->product);
    kiln_free(&v->row);
    kiln_free(&v->low);
    kiln_free(&v->high);
}

static void weigh_unknowns(struct system *s)
{
    double mean = 0.0;
    for (size_t i = 0; i < s->unknown_count; i++)
        mean += (double)s->map->area[s->texels[i]];
    mean /= (double)s->unknown_count;
    for (size_t i = 0; i < s->unknown_count; i++) {
        const double relative = mean > 0.0 ? (double)s->map->area[s->texels[i]] / mean : 1.0;
        s->pull[i] = KILN_SEAM_WEIGHT * fmax(relative, 0.1);
        s->diagonal[i] = s->pull[i];
    }
    /* A texel that occurs twice in a sample (through margin texels) has the square of its summed weight on the
     * diagonal. The sum of squares here differs, but is only used in the preconditioner. */
    for (size_t i = 0; i < s->sample_count; i++)
        for (int k = 0; k < ENTRIES; k++)
            s->diagonal[s->samples[i].texel[k]] += (double)s->samples[i].weight[k] * (double)s->samples[i].weight[k];
}

/* row = A x `of` */
static void apply_rows(const struct solver *v, const double *of)
{
    const struct system *s = v->system;
    for (size_t i = 0; i < s->sample_count; i++) {
        double sum = 0.0;
        for (int k = 0; k < ENTRIES; k++)
            sum += (double)s->samples[i].weight[k] * of[s->samples[i].texel[k]];
        v->row[i] = sum;
    }
}

/* out += sign x A^T row */
static void add_transposed(const struct solver *v, double sign, double *out)
{
    const struct system *s = v->system;
    for (size_t i = 0; i < s->sample_count; i++)
        for (int k = 0; k < ENTRIES; k++)
            out[s->samples[i].texel[k]] += sign * (double)s->samples[i].weight[k] * v->row[i];
}

static double preconditioned_norm(const struct solver *v)
{
    double sum = 0.0;
    for (size_t i = 0; i < v->system->unknown_count; i++)
        sum += v->residual[i] * v->residual[i] / v->system->diagonal[i];
    return sum;
}

/* Solves (A^T A + diag(pull)) x = -A^T A baked for the change x. */
static void conjugate_gradients(struct solver *v, const float *plane)
{
    const struct system *s = v->system;
    for (size_t i = 0; i < s->unknown_count; i++) {
        v->x[i] = (double)plane[s->texels[i]];
        v->residual[i] = 0.0;
    }
    apply_rows(v, v->x);
    add_transposed(v, -1.0, v->residual);
    for (size_t i = 0; i < s->unknown_count; i++) {
        v->x[i] = 0.0;
        v->direction[i] = v->residual[i] / s->diagonal[i];
    }
    double norm = preconditioned_norm(v);
    const double enough = norm * 1e-14;
    for (int iteration = 0; iteration < MOST_ITERATIONS && norm > enough; iteration++) {
        apply_rows(v, v->direction);
        for (size_t i = 0; i < s->unknown_count; i++)
            v->product[i] = s->pull[i] * v->direction[i];
        add_transposed(v, 1.0, v->product);
        double curvature = 0.0;
        for (size_t i = 0; i < s->unknown_count; i++)
            curvature += v->direction[i] * v->product[i];
        const double step = norm / curvature;
        for (size_t i = 0; i < s->unknown_count; i++) {
            v->x[i] += step * v->direction[i];
            v->residual[i] -= step * v->product[i];
        }
        const double next = preconditioned_norm(v);
        for (size_t i = 0; i < s->unknown_count; i++)
            v->direction[i] = v->residual[i] / s->diagonal[i] + next / norm * v->direction[i];
        norm = next;
    }
}

static void find_ranges(struct solver *v, const float *plane)
{
    const struct system *s = v->system;
    for (size_t i = 0; i < s->unknown_count; i++)
        v->low[i] = v->high[i] = plane[s->texels[i]];
    for (size_t i = 0; i < s->sample_count; i++) {
        float low = INFINITY, high = -INFINITY;
        for (int k = 0; k < ENTRIES; k++) {
            const float value = plane[s->texels[s->samples[i].texel[k]]];
            low = fminf(low, value);
            high = fmaxf(high, value);
        }
        for (int k = 0; k < ENTRIES; k++) {
            const uint32_t u = s->samples[i].texel[k];
            v->low[u] = fminf(v->low[u], low);
            v->high[u] = fmaxf(v->high[u], high);
        }
    }
}

static int solve_plane(const struct system *s, float *plane, struct kiln_error *error)
{
    struct solver v = {.system = s};
    const int status = allocate_solver(&v, error);
    if (status == KILN_OK) {
        find_ranges(&v, plane);
        conjugate_gradients(&v, plane);
        for (size_t i = 0; i < s->unknown_count; i++) {
            const float value = (float)((double)plane[s->texels[i]] + v.x[i]);
            plane[s->texels[i]] = fmaxf(v.low[i], fminf(v.high[i], value));
        }
    }
    free_solver(&v);
    return status;
}

/* Solves the planes that are to be smoothed, in parallel. */
static int solve_planes(const struct system *s, struct kiln_error *error)
{
    int status = KILN_OK;
#pragma omp parallel for schedule(dynamic, 1)
    for (uint32_t p = 0; p < s->map->has.count; p++) {
        struct kiln_error mine = {{0}};
        const int result = s->map->has.smooth[p] ? solve_plane(s, s->map->planes[p], &mine) : KILN_OK;
        if (result == KILN_OK)
            continue;
#pragma omp critical(kiln_solve_planes)
        status = kiln_fail(error, result, "%s", mine.message);
    }
    return status;
}

static void destroy_system(struct system *s)
{
    kiln_free(&s->samples);
    kiln_free(&s->texels);
    kiln_free(&s->pull);
    kiln_free(&s->diagonal);
}

static int solve(struct system *s, struct kiln_error *error)
{
    int status = number_unknowns(s, error);
    if (status == KILN_OK)
        status = kiln_allocate(&s->pull, s->unknown_count, sizeof *s->pull, "a seam's system", error);
    if (status == KILN_OK)
        status = kiln_allocate(&s->diagonal, s->unknown_count, sizeof *s->diagonal, "a seam's system", error);
    if (status != KILN_OK)
        return status;
    weigh_unknowns(s);
    status = solve_planes(s, error);
    for (size_t i = 0; i < s->sample_count; i++) /* turn unknowns back into texels, to measure again */
        for (int k = 0; k < ENTRIES; k++)
            s->samples[i].texel[k] = s->texels[s->samples[i].texel[k]];
    return status;
}

int kiln_seams_smooth(struct kiln_map *map, const struct kiln_chart_graph *graph, const uint32_t *nearest, bool smooth,
                      struct kiln_seam_report *report, struct kiln_error *error)
{
    struct system s = {.map = map, .nearest = nearest};
    int status = KILN_OK;
    for (size_t i = 0; status == KILN_OK && i < graph->edge_count; i++)
        status = sample_edge(&s, &graph->edges[i], error);
    *report = (struct kiln_seam_report){.samples = s.sample_count, .mean = mean_luminance(map)};
    if (status == KILN_OK && s.sample_count > 0) {
        const double unit = report->mean > 0.0 ? 1.0 / report->mean : 0.0;
        report->difference_before = report->difference_after = unit * measure(&s);
        if (smooth && report->difference_before > 0.0) {
            status = solve(&s, error);
            report->difference_after = unit * measure(&s);
        }
    }
    destroy_system(&s);
    return status;
}

static int run(struct kiln_map_work *work, struct kiln_error *error)
{
    struct kiln_seam_report seams;
    const bool smooth = work->params->stitch;
    const int status = kiln_seams_smooth(work->map, work->graph, work->nearest, smooth, &seams, error);
    work->report->seam_difference_before = seams.difference_before;
    work->report->seam_difference_after = seams.difference_after;
    return status;
}

const struct kiln_map_stage kiln_map_stage_seams = {
    .name = "seams", .features = KILN_MAP_CHARTS | KILN_MAP_NEAREST, .run = run};
