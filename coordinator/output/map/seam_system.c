#include "coordinator/output/map/seam_system.h"

#include <math.h>
#include <omp.h>
#include <string.h>

#include "coordinator/output/image.h"
#include "coordinator/output/map/team.h"
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

/* Where several threads work on the same planes: unknowns of each, at least, and lanes, at least. */
enum { ENOUGH = 1 << 12, TEAM_LANES = 4, TEAM_LEAST = 5 };

/* What reads an unknown: terms[first[u]] to terms[first[u + 1]] in the order of samples. So every unknown is summed by
 * one thread, in that order. */
struct readers {
    uint32_t *first;
    struct term {
        uint32_t sample;
        float weight;
    } * terms;
};

/* Working memory of conjugate gradients for some planes. Arrays have `lanes` numbers for each unknown. */
struct solver {
    const struct kiln_seam_system *system;
    const struct readers *readers;
    size_t lanes, planes; /* planes: lanes that are in use */
    int threads;          /* that work on them */
    float *baked;
    double *pull;                                     /* w a of each unknown (seam_system.h) */
    double *diagonal;                                 /* of the matrix */
    double *x, *residual, *direction, *product, *row; /* `row` is of samples in the place of unknowns */
    double *change;                                   /* x where it was found; the next solution begins with it */
    float *low, *high;                                /* range of the baked values around each unknown */
    bool solves[LANES_MOST];                          /* lanes whose change x is sought */
    bool again;                                       /* some values are held now that were not before */
    double enough[LANES_MOST];                        /* the norm of the residual that is small enough */
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
            v->pull[i * v->lanes + l] = pull;
    }
    /* A value that occurs twice in a sample (through margin texels) has the square of its summed weight on the
     * diagonal. The sum of squares here differs, but is only used in the preconditioner. */
#pragma omp parallel for schedule(static) num_threads(v->threads) if (v->threads > 1)
    for (size_t i = 0; i < s->unknown_count; i++) {
        double diagonal = v->pull[i * v->lanes];
        for (size_t k = v->readers->first[i]; k < v->readers->first[i + 1]; k++)
            diagonal += (double)v->readers->terms[k].weight * (double)v->readers->terms[k].weight;
        for (size_t l = 0; l < v->lanes; l++)
            v->diagonal[i * v->lanes + l] = diagonal;
    }
}

/* ---- conjugate gradients, by the threads of a team; `lanes` is a constant where these functions are used ---- */

#define LANE_CODE static inline __attribute__((always_inline))

/* row = A x `of` */
LANE_CODE void apply_rows(const struct solver *v, const struct kiln_team_member *m, const size_t lanes,
                          const double *restrict of)
{
    const struct kiln_seam_system *s = v->system;
    double *restrict row = v->row;
    size_t begin, end;
    kiln_team_part(m, s->sample_count, &begin, &end);
    for (size_t i = begin; i < end; i++) {
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

/* sum += sign x A^T row, of one unknown */
LANE_CODE void add_transposed(const struct solver *v, const size_t lanes, size_t unknown, double sign,
                              double sum[LANES_MOST])
{
    const struct term *terms = v->readers->terms;
    for (size_t k = v->readers->first[unknown]; k < v->readers->first[unknown + 1]; k++) {
        const double weight = sign * (double)terms[k].weight, *row = v->row + terms[k].sample * lanes;
#pragma omp simd
        for (size_t l = 0; l < lanes; l++)
            sum[l] += weight * row[l];
    }
}

/* Adds up the products, times `factor` unless that is NULL. */
LANE_CODE void add_up(const struct solver *v, struct kiln_team_member *m, const size_t lanes,
                      const double *restrict factor, double sums[LANES_MOST])
{
    const double *restrict product = v->product;
    double sum[LANES_MOST], *shared = kiln_team_begin_sum(m);
    size_t begin, end;
    kiln_team_part(m, v->system->unknown_count, &begin, &end);
    memcpy(sum, shared, sizeof sum);
    for (size_t i = begin * lanes; i < end * lanes; i += lanes)
#pragma omp simd
        for (size_t l = 0; l < lanes; l++)
            sum[l] += factor != NULL ? factor[i + l] * product[i + l] : product[i + l];
    memcpy(shared, sum, sizeof sum);
    kiln_team_end_sum(m);
    memcpy(sums, shared, sizeof sum);
}

/* Begins with x as it was found before, at first 0: sets residual and direction, and the preconditioned norm of the
 * residual. */
LANE_CODE void begin_lanes(struct solver *v, struct kiln_team_member *m, const size_t lanes, double norm[LANES_MOST])
{
    size_t begin, end;
    kiln_team_part(m, v->system->unknown_count, &begin, &end);
    for (size_t i = begin * lanes; i < end * lanes; i++) {
        v->x[i] = v->change[i];
        v->direction[i] = (double)v->baked[i] + v->x[i];
    }
    kiln_team_meet(m);
    apply_rows(v, m, lanes, v->direction);
    kiln_team_meet(m);
    for (size_t u = begin; u < end; u++) {
        double left[LANES_MOST] = {0.0};
        add_transposed(v, lanes, u, -1.0, left);
        for (size_t l = 0, i = u * lanes; l < lanes; l++, i++) {
            const double residual = left[l] - v->pull[i] * v->x[i];
            v->residual[i] = residual;
            v->direction[i] = residual / v->diagonal[i];
            v->product[i] = residual * residual / v->diagonal[i];
        }
    }
    add_up(v, m, lanes, NULL, norm);
}

/* product = (A^T A + diag(pull)) direction. Gives direction x product. Few lanes are added up on the way, by a thread
 * that is alone; more would not fit into registers. */
LANE_CODE void multiply(struct solver *v, struct kiln_team_member *m, const size_t lanes, double curvature[LANES_MOST])
{
    const bool few = lanes < TEAM_LANES;
    const double *restrict pull = v->pull, *restrict direction = v->direction;
    double *restrict product = v->product, total[LANES_MOST] = {0.0};
    size_t begin, end;
    kiln_team_part(m, v->system->unknown_count, &begin, &end);
    kiln_team_meet(m);
    apply_rows(v, m, lanes, v->direction);
    kiln_team_meet(m);
    for (size_t u = begin; u < end; u++) {
        double sum[LANES_MOST] = {0.0};
        for (size_t l = 0; l < lanes; l++)
            sum[l] = pull[u * lanes + l] * direction[u * lanes + l];
        add_transposed(v, lanes, u, 1.0, sum);
        for (size_t l = 0; l < lanes; l++) {
            product[u * lanes + l] = sum[l];
            if (few)
                total[l] += direction[u * lanes + l] * sum[l];
        }
    }
    memcpy(curvature, total, sizeof total);
    if (!few)
        add_up(v, m, lanes, v->direction, curvature);
}

/* The residual after a step along the direction. Gives its preconditioned norm. */
LANE_CODE void find_residual(struct solver *v, struct kiln_team_member *m, const size_t lanes,
                             const double step[LANES_MOST], double norm[LANES_MOST])
{
    const bool few = lanes < TEAM_LANES;
    double *restrict residual = v->residual, *restrict product = v->product, total[LANES_MOST] = {0.0};
    const double *restrict diagonal = v->diagonal;
    size_t begin, end;
    kiln_team_part(m, v->system->unknown_count, &begin, &end);
    for (size_t i = begin * lanes; i < end * lanes; i += lanes)
#pragma omp simd
        for (size_t l = 0; l < lanes; l++) {
            const double left = residual[i + l] - step[l] * product[i + l], term = left * left / diagonal[i + l];
            residual[i + l] = left;
            if (few)
                total[l] += term;
            else
                product[i + l] = term;
        }
    memcpy(norm, total, sizeof total);
    if (!few)
        add_up(v, m, lanes, NULL, norm);
}

/* Goes the step, and turns. */
LANE_CODE void go(struct solver *v, const struct kiln_team_member *m, const size_t lanes, const double step[LANES_MOST],
                  const double part[LANES_MOST])
{
    double *restrict direction = v->direction, *restrict x = v->x;
    const double *restrict residual = v->residual, *restrict diagonal = v->diagonal;
    size_t begin, end;
    kiln_team_part(m, v->system->unknown_count, &begin, &end);
    for (size_t i = begin * lanes; i < end * lanes; i += lanes)
#pragma omp simd
        for (size_t l = 0; l < lanes; l++) {
            const double along = direction[i + l];
            x[i + l] += step[l] * along;
            direction[i + l] = residual[i + l] / diagonal[i + l] + part[l] * along;
        }
}

static void keep_change(struct solver *v, const struct kiln_team_member *m, size_t lane)
{
    size_t begin, end;
    kiln_team_part(m, v->system->unknown_count, &begin, &end);
    for (size_t i = begin * v->lanes + lane; i < end * v->lanes; i += v->lanes)
        v->change[i] = v->x[i];
}

/* Solves (A^T A + diag(pull)) x = -A^T A baked for the change x, in each lane by itself: what a lane goes on to do when
 * it has arrived is not used. */
LANE_CODE void conjugate_gradients(struct solver *v, struct kiln_team_member *m, const size_t lanes)
{
    double norm[LANES_MOST], next[LANES_MOST], step[LANES_MOST], part[LANES_MOST], curvature[LANES_MOST],
        enough[LANES_MOST] = {0.0};
    bool goes[LANES_MOST];
    begin_lanes(v, m, lanes, norm);
    for (size_t l = 0; l < lanes; l++)
        enough[l] = v->again ? v->enough[l] : norm[l] * 1e-14;
    if (m->thread == 0 && !v->again)
        memcpy(v->enough, enough, sizeof enough);
    memcpy(goes, v->solves, sizeof goes);
    for (int iteration = 0;; iteration++) {
        bool any = false;
        for (size_t l = 0; l < lanes; l++) {
            if (goes[l] && !(iteration < MOST_ITERATIONS && norm[l] > enough[l])) {
                keep_change(v, m, l);
                goes[l] = false;
            }
            any = any || goes[l];
        }
        if (!any)
            return;
        multiply(v, m, lanes, curvature);
        for (size_t l = 0; l < lanes; l++)
            step[l] = norm[l] / curvature[l];
        find_residual(v, m, lanes, step, next);
        for (size_t l = 0; l < lanes; l++)
            part[l] = next[l] / norm[l];
        go(v, m, lanes, step, part);
        memcpy(norm, next, sizeof norm);
    }
}

#define LANES(count)                                                                                                   \
    KILN_CLONES static void conjugate_gradients_##count(struct solver *v, struct kiln_team_member *m)                  \
    {                                                                                                                  \
        conjugate_gradients(v, m, count);                                                                              \
    }
LANES(1)
LANES(2)
LANES(4)
LANES(6)
LANES(8)

static void solve_part(struct solver *v, struct kiln_team_member *m)
{
    if (v->lanes == 1)
        conjugate_gradients_1(v, m);
    else if (v->lanes == 2)
        conjugate_gradients_2(v, m);
    else if (v->lanes == 4)
        conjugate_gradients_4(v, m);
    else if (v->lanes == 6)
        conjugate_gradients_6(v, m);
    else
        conjugate_gradients_8(v, m);
}

/* The team is as large as the threads that there are. */
static void solve_lanes(struct solver *v)
{
    struct kiln_team team = {.threads = 1};
    if (v->threads == 1) {
        solve_part(v, &(struct kiln_team_member){.team = &team});
        return;
    }
#pragma omp parallel num_threads(v->threads)
    {
#pragma omp single
        team.threads = (unsigned)omp_get_num_threads();
        struct kiln_team_member member = {.team = &team, .thread = (unsigned)omp_get_thread_num()};
        solve_part(v, &member);
    }
}

/* ---- ranges ---- */

static void find_ranges(struct solver *v, size_t lane)
{
    const struct kiln_seam_system *s = v->system;
    const size_t lanes = v->lanes;
    for (size_t u = lane; u < s->unknown_count * lanes; u += lanes)
        v->low[u] = v->high[u] = v->baked[u];
    for (size_t i = 0; i < s->sample_count; i++) {
        float low = INFINITY, high = -INFINITY;
        for (int k = 0; k < ENTRIES; k++) {
            const float value = v->baked[s->samples[i].at[k] * lanes + lane];
            low = fminf(low, value);
            high = fmaxf(high, value);
        }
        for (int k = 0; k < ENTRIES; k++) {
            const size_t u = s->samples[i].at[k] * lanes + lane;
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
        v->change[i] = 0.0;
        v->diagonal[i] += hold - v->pull[i];
        v->pull[i] = hold;
        any = true;
    }
    return any;
}

/* ---- planes ---- */

/* Takes a plane into a lane. */
static void take_plane(struct solver *v, size_t lane, const float *plane)
{
    for (size_t i = 0; i < v->system->unknown_count; i++)
        v->baked[i * v->lanes + lane] = plane[i];
    find_ranges(v, lane);
}

/* The plane is that of a lane with its change, within the ranges. */
static void give_plane(const struct solver *v, size_t lane, float *plane)
{
    for (size_t i = 0; i < v->system->unknown_count; i++) {
        const size_t at = i * v->lanes + lane;
        const float value = (float)((double)v->baked[at] + v->change[at]);
        plane[i] = fmaxf(v->low[at], fminf(v->high[at], value));
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
#pragma omp parallel for schedule(dynamic, 1) num_threads(v->threads) reduction(|| : any) if (v->threads > 1)
        for (size_t l = 0; l < v->planes; l++) {
            v->solves[l] = v->solves[l] && hold_values(v, l);
            any = any || v->solves[l];
        }
        v->again = true;
        if (any)
            solve_lanes(v);
    }
}

/* How a system's planes are solved: `at_once` sets of `lanes` planes, each by so many threads. */
struct way {
    size_t lanes;
    int at_once, threads;
};

/* Solves every `step`-th plane from the first one on, so many of them. */
static int solve_planes(const struct kiln_seam_system *s, const struct readers *readers, const struct way *way,
                        uint32_t first, uint32_t step, size_t count, struct kiln_error *error)
{
    struct solver v = {.system = s, .readers = readers, .lanes = way->lanes, .planes = count, .threads = way->threads};
    const int status = allocate_solver(&v, error);
    if (status == KILN_OK) {
        weigh_unknowns(&v);
#pragma omp parallel for schedule(dynamic, 1) num_threads(v.threads) if (v.threads > 1)
        for (size_t l = 0; l < count; l++)
            take_plane(&v, l, s->planes[first + l * step]);
        solve_and_hold(&v);
#pragma omp parallel for schedule(dynamic, 1) num_threads(v.threads) if (v.threads > 1)
        for (size_t l = 0; l < count; l++)
            give_plane(&v, l, s->planes[first + l * step]);
    }
    free_solver(&v);
    return status;
}

/* Lanes for so many planes. */
static size_t lanes_for(size_t planes) { return planes <= 2 ? planes : planes <= 4 ? 4 : planes <= 6 ? 6 : LANES_MOST; }

/* Few threads have planes of their own. Many have all planes together, and unknowns of their own: so all of them have
 * something to do, and what a sample reads of all planes is in one place. In neither way more planes are under way than
 * there are threads, if they take much memory. */
static struct way choose_way(size_t unknowns, size_t planes, size_t threads)
{
    const size_t enough = unknowns / ENOUGH, team = threads < enough ? threads : enough,
                 each = (planes + threads - 1) / threads;
    const bool large = unknowns > SHARED_MOST;
    if (team < (large ? TEAM_LANES : TEAM_LEAST) || planes >= LANES_MOST * threads || (large && planes < TEAM_LANES))
        return (struct way){large && each > 2 ? 2 : lanes_for(each), (int)threads, 1};
    const size_t most = lanes_for(planes < TEAM_LANES ? TEAM_LANES : planes),
                 lanes = large && team < most ? TEAM_LANES : most;
    return (struct way){lanes, 1, (int)team};
}

static void free_readers(struct readers *r)
{
    kiln_free(&r->first);
    kiln_free(&r->terms);
}

static int list_readers(struct readers *r, const struct kiln_seam_system *s, struct kiln_error *error)
{
    int status = kiln_allocate(&r->first, s->unknown_count + 1, sizeof *r->first, "a seam's system", error);
    if (status == KILN_OK)
        status = kiln_allocate_bare(&r->terms, s->sample_count * ENTRIES, sizeof *r->terms, "a seam's system", error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < s->sample_count; i++)
        for (int k = 0; k < ENTRIES; k++)
            r->first[s->samples[i].at[k]]++;
    for (size_t u = 0, sum = 0; u <= s->unknown_count; u++) /* where the terms end */
        r->first[u] = (uint32_t)(sum += r->first[u]);
    for (size_t i = s->sample_count; i-- > 0;)
        for (int k = ENTRIES; k-- > 0;)
            r->terms[--r->first[s->samples[i].at[k]]] = (struct term){(uint32_t)i, s->samples[i].weight[k]};
    return KILN_OK;
}

int kiln_seam_system_solve(struct kiln_seam_system *s, uint32_t first, uint32_t step, struct kiln_error *error)
{
    struct readers readers = {NULL};
    if (s->unknown_count == 0 || s->sample_count == 0 || first >= s->plane_count)
        return KILN_OK;
    if (s->sample_count > UINT32_MAX / ENTRIES)
        return kiln_fail(error, KILN_SYSTEM, "%zu samples at seams are too many to solve; use --no-stitch",
                         s->sample_count);
    const size_t planes = (s->plane_count - first + step - 1) / step;
    const struct way way = choose_way(s->unknown_count, planes, (size_t)omp_get_max_threads());
    int status = list_readers(&readers, s, error);
    const size_t sets = status == KILN_OK ? planes : 0;
#pragma omp parallel for schedule(dynamic, 1) num_threads(way.at_once) if (way.at_once > 1)
    for (size_t p = 0; p < sets; p += way.lanes) {
        struct kiln_error mine = {{0}};
        const int result = solve_planes(s, &readers, &way, first + (uint32_t)p * step, step,
                                        planes - p < way.lanes ? planes - p : way.lanes, &mine);
        if (result == KILN_OK)
            continue;
#pragma omp critical(kiln_solve_planes)
        status = kiln_fail(error, result, "%s", mine.message);
    }
    free_readers(&readers);
    return status;
}
