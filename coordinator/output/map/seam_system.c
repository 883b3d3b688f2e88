#include "coordinator/output/map/seam_system.h"

#include <math.h>
#include <omp.h>
#include <string.h>

#include "coordinator/output/image.h"
#include "worker/base/clones.h"
#include "worker/base/memory.h"

enum { SIDE = KILN_SEAM_SIDE, ENTRIES = KILN_SEAM_ENTRIES, MOST_ITERATIONS = 200, MOST_ROUNDS = 4 };

/* In place of the relative area of values that stand for none. */
static const double margin_pull = 0.01;
/* The weight of a value that is held where it is. */
static const double hold = 1e3;

/* Planes that are solved side by side at most. Each is computed as if it were alone: their values stand next to one
 * another, so that what a sample reads of all of them is one place in memory, and the processor's lanes have one each.
 */
enum { LANES_MOST = 8 };
/* Of more unknowns than these one plane after the other is solved: some 500 bytes of each for eight would be much. */
enum { SHARED_MOST = 1 << 17 };

/* Working memory of conjugate gradients for some planes. Arrays have `lanes` numbers for each unknown. */
struct solver {
    const struct kiln_seam_system *system;
    size_t lanes, planes; /* planes: lanes that are in use */
    float *baked;
    double *pull;                                     /* w a of each unknown (seam_system.h) */
    double *diagonal;                                 /* of the matrix */
    double *x, *residual, *direction, *product, *row; /* `row` is of samples in the place of unknowns */
    double *change;                                   /* x where it was found */
    float *low, *high;                                /* range of the baked values around each unknown */
    bool solves[LANES_MOST];                          /* lanes whose change x is sought */
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
    double **doubles[] = {&v->pull, &v->diagonal, &v->x, &v->residual, &v->direction, &v->product, &v->change};
    float **floats[] = {&v->baked, &v->low, &v->high};
    const size_t count = v->system->unknown_count * v->lanes;
    int status = kiln_allocate(&v->row, v->system->sample_count * v->lanes, sizeof(double), "seam samples", error);
    for (size_t i = 0; status == KILN_OK && i < sizeof doubles / sizeof *doubles; i++)
        status = kiln_allocate(doubles[i], count, sizeof(double), "a seam's system", error);
    for (size_t i = 0; status == KILN_OK && i < sizeof floats / sizeof *floats; i++)
        status = kiln_allocate(floats[i], count, sizeof(float), "a seam's system", error);
    return status;
}

static void free_solver(struct solver *v)
{
    kiln_free(&v->baked);
    kiln_free(&v->pull);
    kiln_free(&v->diagonal);
    kiln_free(&v->x);
    kiln_free(&v->residual);
    kiln_free(&v->direction);
    kiln_free(&v->product);
    kiln_free(&v->row);
    kiln_free(&v->change);
    kiln_free(&v->low);
    kiln_free(&v->high);
}

/* Sets pull and diagonal of the lanes. */
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
        const double relative = mean > 0.0 ? (double)s->area[i] / mean : 1.0,
                     pull = KILN_SEAM_WEIGHT * (s->area[i] > 0.0f ? fmax(relative, 0.1) : margin_pull);
        for (size_t l = 0; l < v->lanes; l++)
            v->pull[i * v->lanes + l] = v->diagonal[i * v->lanes + l] = pull;
    }
    /* A value that occurs twice in a sample (through margin texels) has the square of its summed weight on the
     * diagonal. The sum of squares here differs, but is only used in the preconditioner. */
    for (size_t i = 0; i < s->sample_count; i++)
        for (int k = 0; k < ENTRIES; k++)
            for (size_t l = 0; l < v->lanes; l++)
                v->diagonal[s->samples[i].at[k] * v->lanes + l] +=
                    (double)s->samples[i].weight[k] * (double)s->samples[i].weight[k];
}

/* ---- conjugate gradients; `lanes` is a constant where these functions are used ---- */

#define LANE_CODE static inline __attribute__((always_inline))

/* row = A x `of` */
LANE_CODE void apply_rows(const struct solver *v, const size_t lanes, const double *restrict of, double *restrict row)
{
    const struct kiln_seam_system *s = v->system;
    for (size_t i = 0; i < s->sample_count; i++) {
        double sum[LANES_MOST] = {0.0};
        for (int k = 0; k < ENTRIES; k++) {
            const double weight = (double)s->samples[i].weight[k], *values = of + s->samples[i].at[k] * lanes;
#pragma omp simd
            for (size_t l = 0; l < lanes; l++)
                sum[l] += weight * values[l];
        }
        for (size_t l = 0; l < lanes; l++)
            row[i * lanes + l] = sum[l];
    }
}

/* out += sign x A^T row */
LANE_CODE void add_transposed(const struct solver *v, const size_t lanes, double sign, const double *restrict row,
                              double *restrict out)
{
    const struct kiln_seam_system *s = v->system;
    for (size_t i = 0; i < s->sample_count; i++)
        for (int k = 0; k < ENTRIES; k++) {
            const double weight = sign * (double)s->samples[i].weight[k];
            double *values = out + s->samples[i].at[k] * lanes;
#pragma omp simd
            for (size_t l = 0; l < lanes; l++)
                values[l] += weight * row[i * lanes + l];
        }
}

/* Sets residual and direction to those of x = 0, and the preconditioned norm of the residual. */
LANE_CODE void begin_lanes(struct solver *v, const size_t lanes, double norm[LANES_MOST])
{
    const size_t count = v->system->unknown_count * lanes;
    double sum[LANES_MOST] = {0.0};
    for (size_t i = 0; i < count; i++) {
        v->direction[i] = (double)v->baked[i];
        v->residual[i] = v->x[i] = 0.0;
    }
    apply_rows(v, lanes, v->direction, v->row);
    add_transposed(v, lanes, -1.0, v->row, v->residual);
    for (size_t i = 0; i < count; i += lanes)
        for (size_t l = 0; l < lanes; l++) {
            v->direction[i + l] = v->residual[i + l] / v->diagonal[i + l];
            sum[l] += v->residual[i + l] * v->residual[i + l] / v->diagonal[i + l];
        }
    memcpy(norm, sum, sizeof sum);
}

/* product = (A^T A + diag(pull)) direction. Gives direction x product. */
LANE_CODE void multiply(struct solver *v, const size_t lanes, double curvature[LANES_MOST])
{
    const size_t count = v->system->unknown_count * lanes;
    double sum[LANES_MOST] = {0.0};
    apply_rows(v, lanes, v->direction, v->row);
#pragma omp simd
    for (size_t i = 0; i < count; i++)
        v->product[i] = v->pull[i] * v->direction[i];
    add_transposed(v, lanes, 1.0, v->row, v->product);
    for (size_t i = 0; i < count; i += lanes)
#pragma omp simd
        for (size_t l = 0; l < lanes; l++)
            sum[l] += v->direction[i + l] * v->product[i + l];
    memcpy(curvature, sum, sizeof sum);
}

/* Goes a step along the direction. Gives the preconditioned norm of the residual. */
LANE_CODE void go(struct solver *v, const size_t lanes, const double step[LANES_MOST], double norm[LANES_MOST])
{
    double *restrict x = v->x, *restrict residual = v->residual, sum[LANES_MOST] = {0.0};
    const double *restrict direction = v->direction, *restrict product = v->product, *restrict diagonal = v->diagonal;
    for (size_t i = 0; i < v->system->unknown_count * lanes; i += lanes)
#pragma omp simd
        for (size_t l = 0; l < lanes; l++) {
            const double left = residual[i + l] - step[l] * product[i + l];
            x[i + l] += step[l] * direction[i + l];
            residual[i + l] = left;
            sum[l] += left * left / diagonal[i + l];
        }
    memcpy(norm, sum, sizeof sum);
}

LANE_CODE void turn(struct solver *v, const size_t lanes, const double part[LANES_MOST])
{
    double *restrict direction = v->direction;
    const double *restrict residual = v->residual, *restrict diagonal = v->diagonal;
    for (size_t i = 0; i < v->system->unknown_count * lanes; i += lanes)
#pragma omp simd
        for (size_t l = 0; l < lanes; l++)
            direction[i + l] = residual[i + l] / diagonal[i + l] + part[l] * direction[i + l];
}

static void keep_change(struct solver *v, size_t lane)
{
    for (size_t i = lane; i < v->system->unknown_count * v->lanes; i += v->lanes)
        v->change[i] = v->x[i];
}

/* Solves (A^T A + diag(pull)) x = -A^T A baked for the change x, in each lane by itself: what a lane goes on to do when
 * it has arrived is not used. */
LANE_CODE void conjugate_gradients(struct solver *v, const size_t lanes)
{
    double norm[LANES_MOST], next[LANES_MOST], step[LANES_MOST], part[LANES_MOST], curvature[LANES_MOST],
        enough[LANES_MOST];
    bool goes[LANES_MOST];
    begin_lanes(v, lanes, norm);
    for (size_t l = 0; l < lanes; l++)
        enough[l] = norm[l] * 1e-14;
    memcpy(goes, v->solves, sizeof goes);
    for (int iteration = 0;; iteration++) {
        bool any = false;
        for (size_t l = 0; l < lanes; l++) {
            if (goes[l] && !(iteration < MOST_ITERATIONS && norm[l] > enough[l])) {
                keep_change(v, l);
                goes[l] = false;
            }
            any = any || goes[l];
        }
        if (!any)
            return;
        multiply(v, lanes, curvature);
        for (size_t l = 0; l < lanes; l++)
            step[l] = norm[l] / curvature[l];
        go(v, lanes, step, next);
        for (size_t l = 0; l < lanes; l++)
            part[l] = next[l] / norm[l];
        turn(v, lanes, part);
        memcpy(norm, next, sizeof norm);
    }
}

KILN_CLONES static void conjugate_gradients_1(struct solver *v) { conjugate_gradients(v, 1); }
KILN_CLONES static void conjugate_gradients_2(struct solver *v) { conjugate_gradients(v, 2); }
KILN_CLONES static void conjugate_gradients_4(struct solver *v) { conjugate_gradients(v, 4); }
KILN_CLONES static void conjugate_gradients_8(struct solver *v) { conjugate_gradients(v, 8); }

static void solve_lanes(struct solver *v)
{
    if (v->lanes == 1)
        conjugate_gradients_1(v);
    else if (v->lanes == 2)
        conjugate_gradients_2(v);
    else if (v->lanes == 4)
        conjugate_gradients_4(v);
    else
        conjugate_gradients_8(v);
}

/* ---- ranges ---- */

static void find_ranges(struct solver *v)
{
    const struct kiln_seam_system *s = v->system;
    const size_t lanes = v->lanes, bytes = s->unknown_count * lanes * sizeof *v->baked;
    memcpy(v->low, v->baked, bytes);
    memcpy(v->high, v->baked, bytes);
    for (size_t i = 0; i < s->sample_count; i++)
        for (size_t l = 0; l < v->planes; l++) {
            float low = INFINITY, high = -INFINITY;
            for (int k = 0; k < ENTRIES; k++) {
                const float value = v->baked[s->samples[i].at[k] * lanes + l];
                low = fminf(low, value);
                high = fmaxf(high, value);
            }
            for (int k = 0; k < ENTRIES; k++) {
                const size_t u = s->samples[i].at[k] * lanes + l;
                v->low[u] = fminf(v->low[u], low);
                v->high[u] = fmaxf(v->high[u], high);
            }
        }
}

/* Takes the change x, and holds those values at the ends of their ranges that it leads beyond. Returns whether there
 * are any: what the others are depends on them. */
static bool hold_values(struct solver *v, size_t lane)
{
    bool any = false;
    for (size_t i = lane; i < v->system->unknown_count * v->lanes; i += v->lanes) {
        const float value = (float)((double)v->baked[i] + v->change[i]),
                    within = fmaxf(v->low[i], fminf(v->high[i], value));
        if (value == within)
            continue;
        v->baked[i] = within;
        v->diagonal[i] += hold - v->pull[i];
        v->pull[i] = hold;
        any = true;
    }
    return any;
}

/* ---- planes ---- */

/* Moves the planes to the lanes, or back. */
static void move_planes(struct solver *v, uint32_t first, uint32_t step, bool back)
{
    const struct kiln_seam_system *s = v->system;
    for (size_t l = 0; l < v->planes; l++) {
        float *plane = s->planes[first + l * step];
        for (size_t i = 0; i < s->unknown_count; i++) {
            float *value = &v->baked[i * v->lanes + l];
            if (back)
                plane[i] = *value;
            else
                *value = plane[i];
        }
    }
}

/* Solves lanes again of which values had to be held, a few times. */
static void solve_and_hold(struct solver *v)
{
    bool any = true;
    for (size_t l = 0; l < v->planes; l++)
        v->solves[l] = true;
    solve_lanes(v);
    for (int round = 0; round < MOST_ROUNDS && any; round++) {
        any = false;
        for (size_t l = 0; l < v->planes; l++) {
            v->solves[l] = v->solves[l] && hold_values(v, l);
            any = any || v->solves[l];
        }
        if (any)
            solve_lanes(v);
    }
}

/* Solves every `step`-th plane from the first one on, so many of them. */
static int solve_planes(const struct kiln_seam_system *s, uint32_t first, uint32_t step, size_t count, size_t lanes,
                        struct kiln_error *error)
{
    struct solver v = {.system = s, .lanes = lanes, .planes = count};
    const int status = allocate_solver(&v, error);
    if (status == KILN_OK) {
        move_planes(&v, first, step, false);
        weigh_unknowns(&v);
        find_ranges(&v);
        solve_and_hold(&v);
        for (size_t i = 0; i < s->unknown_count * lanes; i++) {
            const float value = (float)((double)v.baked[i] + v.change[i]);
            v.baked[i] = fmaxf(v.low[i], fminf(v.high[i], value));
        }
        move_planes(&v, first, step, true);
    }
    free_solver(&v);
    return status;
}

/* Lanes with which so many planes are solved by so many threads. */
static size_t choose_lanes(size_t unknowns, size_t planes, size_t threads)
{
    if (unknowns > SHARED_MOST)
        return 1;
    const size_t each = (planes + threads - 1) / threads;
    return each <= 2 ? each : each <= 4 ? 4 : LANES_MOST;
}

int kiln_seam_system_solve(struct kiln_seam_system *s, uint32_t first, uint32_t step, struct kiln_error *error)
{
    int status = KILN_OK;
    if (s->unknown_count == 0 || s->sample_count == 0 || first >= s->plane_count)
        return KILN_OK;
    const size_t planes = (s->plane_count - first + step - 1) / step,
                 lanes = choose_lanes(s->unknown_count, planes, (size_t)omp_get_max_threads());
#pragma omp parallel for schedule(dynamic, 1)
    for (size_t p = 0; p < planes; p += lanes) {
        struct kiln_error mine = {{0}};
        const int result =
            solve_planes(s, first + (uint32_t)p * step, step, planes - p < lanes ? planes - p : lanes, lanes, &mine);
        if (result == KILN_OK)
            continue;
#pragma omp critical(kiln_solve_planes)
        status = kiln_fail(error, result, "%s", mine.message);
    }
    return status;
}
