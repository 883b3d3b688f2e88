#include "coordinator/output/map/seam_system.h"

#include <math.h>

#include "coordinator/output/image.h"
#include "worker/base/memory.h"

enum { SIDE = KILN_SEAM_SIDE, ENTRIES = KILN_SEAM_ENTRIES, MOST_ITERATIONS = 200, MOST_ROUNDS = 4 };

/* In place of the relative area of values that stand for none. */
static const double margin_pull = 0.01;
/* The weight of a value that is held where it is. */
static const double hold = 1e3;

/* Working memory of conjugate gradients for one plane. */
struct solver {
    const struct kiln_seam_system *system;
    double *pull;                                     /* w a of each unknown (seam_system.h) */
    double *diagonal;                                 /* of the matrix */
    double *x, *residual, *direction, *product, *row; /* one value for each unknown; `row` has one for each sample */
    float *low, *high;                                /* range of the baked values around each unknown */
};

int kiln_seam_system_create(struct kiln_seam_system **system, size_t unknown_count, size_t sample_count,
                            uint32_t plane_count, struct kiln_error *error)
{
    int status = kiln_allocate(system, 1, sizeof **system, "a seam's system", error);
    if (status != KILN_OK)
        return status;
    struct kiln_seam_system *s = *system;
    s->unknown_count = unknown_count;
    s->sample_count = sample_count;
    s->plane_count = plane_count;
    status = kiln_allocate(&s->samples, sample_count, sizeof *s->samples, "seam samples", error);
    if (status == KILN_OK)
        status = kiln_allocate(&s->area, unknown_count, sizeof(float), "a seam's texels", error);
    if (status == KILN_OK)
        status = kiln_allocate(&s->planes, plane_count, sizeof *s->planes, "a seam's planes", error);
    for (uint32_t p = 0; status == KILN_OK && p < plane_count; p++)
        status = kiln_allocate(&s->planes[p], unknown_count, sizeof(float), "a seam's texels", error);
    return status;
}

void kiln_seam_system_destroy(struct kiln_seam_system **system)
{
    struct kiln_seam_system *s = *system;
    if (s == NULL)
        return;
    kiln_free(&s->samples);
    kiln_free(&s->area);
    for (uint32_t p = 0; s->planes != NULL && p < s->plane_count; p++)
        kiln_free(&s->planes[p]);
    kiln_free(&s->planes);
    kiln_free(system);
}

static float luminance_at(float *const *planes, uint32_t at)
{
    float rgb[3];
    for (int c = 0; c < 3; c++)
        rgb[c] = planes[KILN_MAP_DIRECT + c][at] + planes[KILN_MAP_INDIRECT + c][at];
    return kiln_rgb_luminance(rgb[0], rgb[1], rgb[2]);
}

static double side_value(float *const *planes, const struct kiln_seam_sample *sample, int first)
{
    double sum = 0.0;
    for (int k = first; k < first + SIDE; k++)
        sum += fabs((double)sample->weight[k]) * (double)luminance_at(planes, sample->at[k]);
    return sum;
}

bool kiln_seam_edge_of_light(float *const *planes, const struct kiln_seam_sample *sample)
{
    const double a = side_value(planes, sample, 0), b = side_value(planes, sample, SIDE);
    const double low = fmin(a, b), high = fmax(a, b);
    return !(high <= (double)KILN_SEAM_CONTRAST * low) && high > 0.0;
}

double kiln_seam_difference(float *const *planes, const struct kiln_seam_sample *samples, size_t count)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; i++) {
        const double difference = side_value(planes, &samples[i], 0) - side_value(planes, &samples[i], SIDE);
        sum += difference * difference;
    }
    return count == 0 ? 0.0 : sqrt(sum / (double)count);
}

static int allocate_solver(struct solver *v, struct kiln_error *error)
{
    double **arrays[] = {&v->pull, &v->diagonal, &v->x, &v->residual, &v->direction, &v->product};
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
    kiln_free(&v->pull);
    kiln_free(&v->diagonal);
    kiln_free(&v->x);
    kiln_free(&v->residual);
    kiln_free(&v->direction);
    kiln_free(&v->product);
    kiln_free(&v->row);
    kiln_free(&v->low);
    kiln_free(&v->high);
}

static void weigh_unknowns(struct solver *v)
{
    const struct kiln_seam_system *s = v->system;
    double mean = 0.0;
    size_t count = 0;
    for (size_t i = 0; i < s->unknown_count; i++) {
        mean += (double)s->area[i];
        count += s->area[i] > 0.0f;
    }
    mean /= (double)count; /* not a number without area; then all weigh the same */
    for (size_t i = 0; i < s->unknown_count; i++) {
        const double relative = mean > 0.0 ? (double)s->area[i] / mean : 1.0;
        v->pull[i] = KILN_SEAM_WEIGHT * (s->area[i] > 0.0f ? fmax(relative, 0.1) : margin_pull);
        v->diagonal[i] = v->pull[i];
    }
    /* A value that occurs twice in a sample (through margin texels) has the square of its summed weight on the
     * diagonal. The sum of squares here differs, but is only used in the preconditioner. */
    for (size_t i = 0; i < s->sample_count; i++)
        for (int k = 0; k < ENTRIES; k++)
            v->diagonal[s->samples[i].at[k]] += (double)s->samples[i].weight[k] * (double)s->samples[i].weight[k];
}

/* row = A x `of` */
static void apply_rows(const struct solver *v, const double *of)
{
    const struct kiln_seam_system *s = v->system;
    for (size_t i = 0; i < s->sample_count; i++) {
        double sum = 0.0;
        for (int k = 0; k < ENTRIES; k++)
            sum += (double)s->samples[i].weight[k] * of[s->samples[i].at[k]];
        v->row[i] = sum;
    }
}

/* out += sign x A^T row */
static void add_transposed(const struct solver *v, double sign, double *out)
{
    const struct kiln_seam_system *s = v->system;
    for (size_t i = 0; i < s->sample_count; i++)
        for (int k = 0; k < ENTRIES; k++)
            out[s->samples[i].at[k]] += sign * (double)s->samples[i].weight[k] * v->row[i];
}

static double preconditioned_norm(const struct solver *v)
{
    double sum = 0.0;
    for (size_t i = 0; i < v->system->unknown_count; i++)
        sum += v->residual[i] * v->residual[i] / v->diagonal[i];
    return sum;
}

/* Solves (A^T A + diag(pull)) x = -A^T A baked for the change x. */
static void conjugate_gradients(struct solver *v, const float *plane)
{
    const struct kiln_seam_system *s = v->system;
    for (size_t i = 0; i < s->unknown_count; i++) {
        v->x[i] = (double)plane[i];
        v->residual[i] = 0.0;
    }
    apply_rows(v, v->x);
    add_transposed(v, -1.0, v->residual);
    for (size_t i = 0; i < s->unknown_count; i++) {
        v->x[i] = 0.0;
        v->direction[i] = v->residual[i] / v->diagonal[i];
    }
    double norm = preconditioned_norm(v);
    const double enough = norm * 1e-14;
    for (int iteration = 0; iteration < MOST_ITERATIONS && norm > enough; iteration++) {
        apply_rows(v, v->direction);
        for (size_t i = 0; i < s->unknown_count; i++)
            v->product[i] = v->pull[i] * v->direction[i];
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
            v->direction[i] = v->residual[i] / v->diagonal[i] + next / norm * v->direction[i];
        norm = next;
    }
}

static void find_ranges(struct solver *v, const float *plane)
{
    const struct kiln_seam_system *s = v->system;
    for (size_t i = 0; i < s->unknown_count; i++)
        v->low[i] = v->high[i] = plane[i];
    for (size_t i = 0; i < s->sample_count; i++) {
        float low = INFINITY, high = -INFINITY;
        for (int k = 0; k < ENTRIES; k++) {
            const float value = plane[s->samples[i].at[k]];
            low = fminf(low, value);
            high = fmaxf(high, value);
        }
        for (int k = 0; k < ENTRIES; k++) {
            const uint32_t u = s->samples[i].at[k];
            v->low[u] = fminf(v->low[u], low);
            v->high[u] = fmaxf(v->high[u], high);
        }
    }
}

/* Takes the change x, and holds those values at the ends of their ranges that it leads beyond. Returns whether there
 * are any: what the others are depends on them. */
static bool hold_values(struct solver *v, float *plane)
{
    const struct kiln_seam_system *s = v->system;
    bool any = false;
    for (size_t i = 0; i < s->unknown_count; i++) {
        const float value = (float)((double)plane[i] + v->x[i]), within = fmaxf(v->low[i], fminf(v->high[i], value));
        if (value == within)
            continue;
        plane[i] = within;
        v->diagonal[i] += hold - v->pull[i];
        v->pull[i] = hold;
        any = true;
    }
    return any;
}

static int solve_plane(const struct kiln_seam_system *s, float *plane, struct kiln_error *error)
{
    struct solver v = {.system = s};
    const int status = allocate_solver(&v, error);
    if (status == KILN_OK) {
        weigh_unknowns(&v);
        find_ranges(&v, plane);
        conjugate_gradients(&v, plane);
        for (int round = 0; round < MOST_ROUNDS && hold_values(&v, plane); round++)
            conjugate_gradients(&v, plane);
        for (size_t i = 0; i < s->unknown_count; i++) {
            const float value = (float)((double)plane[i] + v.x[i]);
            plane[i] = fmaxf(v.low[i], fminf(v.high[i], value));
        }
    }
    free_solver(&v);
    return status;
}

int kiln_seam_system_solve(struct kiln_seam_system *s, uint32_t first, uint32_t step, struct kiln_error *error)
{
    int status = KILN_OK;
    if (s->unknown_count == 0 || s->sample_count == 0)
        return KILN_OK;
#pragma omp parallel for schedule(dynamic, 1)
    for (uint32_t p = first; p < s->plane_count; p += step) {
        struct kiln_error mine = {{0}};
        const int result = solve_plane(s, s->planes[p], &mine);
        if (result == KILN_OK)
            continue;
#pragma omp critical(kiln_solve_planes)
        status = kiln_fail(error, result, "%s", mine.message);
    }
    return status;
}
