#include "coordinator/output/map/seams/seam_system.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/math/cholesky.h"
#include "coordinator/output/image.h"
#include "worker/base/arena.h"
#include "worker/base/memory.h"

enum { SIDE = KILN_SEAM_SIDE, ENTRIES = KILN_SEAM_ENTRIES, LANES_MOST = KILN_CHOLESKY_LANES, MOST_ROUNDS = 4 };

/* Replaces the relative area of values without surface, such as those in margins. */
static const double margin_pull = 0.01;
/* Weight that fixes a value where it is. */
static const double hold = 1e3;

/* Largest size of a factor, in numbers, unless one plane alone needs more. */
enum { MOST_NUMBERS = 1 << 24 };
/* Systems of fewer unknowns are solved by one thread. */
enum { ALONE = 1 << 10 };

/* Connected components of the system, here called parts: unknowns and samples that are connected through samples. */
struct parts {
    size_t count;
    uint32_t *part_of; /* part of each unknown; while joining, another unknown of its part, or itself */
    uint32_t *unknowns, *samples;
    size_t *first, *first_sample; /* where each part begins in these lists, and the end */
    uint32_t *order;              /* parts sorted by size, the largest first */
    struct kiln_arena arena;
};

/* Terms that contain an unknown u: terms[first[u]] to terms[first[u + 1] - 1], in the order of samples. */
struct readers {
    uint32_t *first;
    struct term {
        uint32_t sample;
        float weight;
    } * terms;
};

/* One part with some of its planes, one in each lane. Unknowns are numbered in the order of elimination. Arrays with
 * values have `lanes` numbers per unknown. */
struct solver {
    const struct kiln_seam_system *system;
    size_t unknown_count, sample_count, lanes, planes; /* planes: lanes that are in use */
    uint32_t *unknowns;                                /* their numbers in the system */
    struct kiln_seam_sample *samples;
    struct readers readers;
    struct kiln_elimination elimination;
    struct kiln_cholesky factor;
    double *pull, *diagonal; /* per unknown: w a (seam_system.h); diagonal of A^T A */
    float *baked;
    float *low, *high; /* range of the baked values around each unknown */
    bool *pinned;
    double *change, *next;   /* x - baked: current one, and result of the present round */
    double *row;             /* A baked, per sample */
    bool solves[LANES_MOST]; /* lanes still to solve; no lanes with values that are not finite */
    struct kiln_arena arena;
};

int kiln_seam_system_create(struct kiln_seam_system **system, size_t unknown_count, size_t sample_count,
                            uint32_t plane_count, struct kiln_error *error)
{
    int status;
    KILN_TRY(kiln_allocate(system, 1, sizeof **system, "a seam's system", error));
    struct kiln_seam_system *s = *system;
    s->unknown_count = unknown_count;
    s->sample_count = sample_count;
    s->plane_count = plane_count;
    KILN_TRY(kiln_allocate(&s->samples, sample_count, sizeof *s->samples, "seam samples", error));
    KILN_TRY(kiln_allocate(&s->area, unknown_count, sizeof(float), "a seam's texels", error));
    KILN_TRY(kiln_allocate(&s->planes, plane_count, sizeof *s->planes, "a seam's planes", error));
    for (uint32_t p = 0; p < plane_count; p++)
        KILN_TRY(kiln_allocate(&s->planes[p], unknown_count, sizeof(float), "a seam's texels", error));
end:
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

static void free_solver(struct solver *v)
{
    kiln_free(&v->readers.first);
    kiln_free(&v->readers.terms);
    kiln_elimination_destroy(&v->elimination);
    kiln_cholesky_destroy(&v->factor);
    kiln_free(&v->baked);
    kiln_free(&v->low);
    kiln_free(&v->high);
    kiln_arena_release(&v->arena);
}

/* ---- parts ---- */

static uint32_t leader_of(uint32_t *leader, uint32_t u)
{
    while (leader[u] != u)
        u = leader[u] = leader[leader[u]];
    return u;
}

/* Each unknown gets the number of its part; parts are numbered by their least unknowns. */
static void number_parts(struct parts *p, const struct kiln_seam_system *s)
{
    for (uint32_t u = 0; u < s->unknown_count; u++)
        p->part_of[u] = u;
    for (size_t i = 0; i < s->sample_count; i++)
        for (int k = 1; k < ENTRIES; k++) {
            const uint32_t a = leader_of(p->part_of, s->samples[i].at[0]),
                           b = leader_of(p->part_of, s->samples[i].at[k]);
            p->part_of[a > b ? a : b] = a > b ? b : a;
        }
    for (uint32_t u = 0; u < s->unknown_count; u++) /* a part's least unknown comes first and has its number by now */
        p->part_of[u] = p->part_of[u] == u ? (uint32_t)p->count++ : p->part_of[p->part_of[u]];
}

/* Lists the numbers 0 to count - 1 by parts. first[part] is where those of a part begin. */
static void list_by_parts(size_t *first, size_t parts, uint32_t *list, const uint32_t *part_of, size_t count)
{
    for (size_t i = 0; i < count; i++)
        first[part_of[i] + 1]++;
    for (size_t p = 0; p < parts; p++)
        first[p + 1] += first[p];
    for (size_t i = 0; i < count; i++)
        list[first[part_of[i]]++] = (uint32_t)i;
    for (size_t p = parts; p > 0; p--)
        first[p] = first[p - 1];
    first[0] = 0;
}

static int compare_sizes(const void *a, const void *b, void *context)
{
    const struct parts *p = context;
    const uint32_t i = *(const uint32_t *)a, j = *(const uint32_t *)b;
    const size_t m = p->first[i + 1] - p->first[i], n = p->first[j + 1] - p->first[j];
    return m != n ? (m < n ? 1 : -1) : i < j ? -1 : i > j;
}

static int list_samples(struct parts *p, const struct kiln_seam_system *s, struct kiln_error *error)
{
    uint32_t *part_of = NULL;
    const int status = kiln_allocate_bare(&part_of, s->sample_count, sizeof *part_of, "a seam's system", error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < s->sample_count; i++)
        part_of[i] = p->part_of[s->samples[i].at[0]];
    list_by_parts(p->first_sample, p->count, p->samples, part_of, s->sample_count);
    kiln_free(&part_of);
    return KILN_OK;
}

static int list_parts(struct parts *p, const struct kiln_seam_system *s, struct kiln_error *error)
{
    const char *what = "a seam's system";
    int status = kiln_arena_allocate_bare(&p->arena, &p->part_of, s->unknown_count, sizeof *p->part_of, what, error);
    if (status != KILN_OK)
        return status;
    number_parts(p, s);
    KILN_TRY(kiln_arena_allocate_bare(&p->arena, &p->unknowns, s->unknown_count, sizeof *p->unknowns, what, error));
    KILN_TRY(kiln_arena_allocate_bare(&p->arena, &p->samples, s->sample_count, sizeof *p->samples, what, error));
    KILN_TRY(kiln_allocate(&p->first, p->count + 1, sizeof *p->first, what, error));
    KILN_TRY(kiln_arena_allocate(&p->arena, &p->first_sample, p->count + 1, sizeof *p->first_sample, what, error));
    KILN_TRY(kiln_arena_allocate_bare(&p->arena, &p->order, p->count, sizeof *p->order, what, error));
end:
    if (status != KILN_OK)
        return status;
    list_by_parts(p->first, p->count, p->unknowns, p->part_of, s->unknown_count);
    for (size_t i = 0; i < p->count; i++)
        p->order[i] = (uint32_t)i;
    qsort_r(p->order, p->count, sizeof *p->order, compare_sizes, p);
    return list_samples(p, s, error);
}

static void free_parts(struct parts *p)
{
    kiln_free(&p->first);
    kiln_arena_release(&p->arena);
}

/* ---- the matrix of a part ---- */

static int list_readers(struct solver *v, struct kiln_error *error)
{
    struct readers *r = &v->readers;
    int status = kiln_allocate(&r->first, v->unknown_count + 1, sizeof *r->first, "a seam's system", error);
    if (status == KILN_OK)
        status = kiln_allocate_bare(&r->terms, v->sample_count * ENTRIES, sizeof *r->terms, "a seam's system", error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < v->sample_count; i++)
        for (int k = 0; k < ENTRIES; k++)
            r->first[v->samples[i].at[k]]++;
    for (size_t u = 0, sum = 0; u <= v->unknown_count; u++) /* where the terms end */
        r->first[u] = (uint32_t)(sum += r->first[u]);
    for (size_t i = v->sample_count; i-- > 0;)
        for (int k = ENTRIES; k-- > 0;)
            r->terms[--r->first[v->samples[i].at[k]]] = (struct term){(uint32_t)i, v->samples[i].weight[k]};
    return KILN_OK;
}

/* Copies the part's samples, and numbers its unknowns in the order of elimination. */
static int order_unknowns(struct solver *v, const uint32_t *unknowns, const uint32_t *samples, uint32_t *number,
                          struct kiln_error *error)
{
    const char *what = "a seam's system";
    uint32_t *cliques = NULL;
    int status;
    KILN_TRY(kiln_arena_allocate_bare(&v->arena, &v->unknowns, v->unknown_count, sizeof *v->unknowns, what, error));
    KILN_TRY(kiln_arena_allocate_bare(&v->arena, &v->samples, v->sample_count, sizeof *v->samples, what, error));
    KILN_TRY(kiln_allocate_bare(&cliques, v->sample_count * ENTRIES, sizeof *cliques, what, error));
end:
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < v->unknown_count; i++)
        number[unknowns[i]] = (uint32_t)i;
    for (size_t i = 0; i < v->sample_count; i++) {
        v->samples[i] = v->system->samples[samples[i]];
        for (int k = 0; k < ENTRIES; k++)
            cliques[i * ENTRIES + (size_t)k] = number[v->samples[i].at[k]];
    }
    status = kiln_elimination_create(&v->elimination, v->unknown_count, cliques, v->sample_count, ENTRIES, error);
    for (size_t i = 0; status == KILN_OK && i < v->unknown_count; i++)
        v->unknowns[v->elimination.place[i]] = unknowns[i];
    for (size_t i = 0; status == KILN_OK && i < v->sample_count * ENTRIES; i++)
        v->samples[i / ENTRIES].at[i % ENTRIES] = v->elimination.place[cliques[i]];
    kiln_free(&cliques);
    return status;
}

/* Computes column u of A^T A. `column`: scratch that is 0 before and after. */
static void make_column(struct solver *v, size_t u, double *column)
{
    const struct kiln_elimination *e = &v->elimination;
    const struct term *terms = v->readers.terms;
    for (size_t t = v->readers.first[u]; t < v->readers.first[u + 1]; t++) {
        const struct kiln_seam_sample *sample = &v->samples[terms[t].sample];
        for (int k = 0; k < ENTRIES; k++)
            column[sample->at[k]] += (double)terms[t].weight * (double)sample->weight[k];
    }
    v->diagonal[u] = column[u];
    for (size_t k = e->first[u]; k < e->first[u + 1]; k++)
        v->factor.matrix[k] = column[e->rows[e->first_row[u] + (k - e->first[u])]];
    for (size_t t = v->readers.first[u]; t < v->readers.first[u + 1]; t++)
        for (int k = 0; k < ENTRIES; k++)
            column[v->samples[terms[t].sample].at[k]] = 0.0;
}

static int make_matrix(struct solver *v, struct kiln_error *error)
{
    double *column = NULL;
    const int status = kiln_allocate(&column, v->unknown_count, sizeof *column, "a seam's system", error);
    for (size_t u = 0; status == KILN_OK && u < v->unknown_count; u++)
        make_column(v, u, column);
    kiln_free(&column);
    return status;
}

/* ---- the solution ---- */

/* Keeps the result in lanes that are still being solved; others keep their earlier result. */
static void keep_change(struct solver *v)
{
    for (size_t u = 0; u < v->unknown_count; u++)
        for (size_t l = 0; l < v->lanes; l++)
            if (v->solves[l])
                v->change[u * v->lanes + l] = v->next[u * v->lanes + l];
}

/* Solves (A^T A + diag(pull)) change = -A^T A baked, separately in each lane. */
static void find_change(struct solver *v)
{
    const size_t lanes = v->lanes;
    for (size_t i = 0; i < v->sample_count; i++)
        for (size_t l = 0; l < lanes; l++) {
            double sum = 0.0;
            for (int k = 0; k < ENTRIES; k++)
                sum += (double)v->samples[i].weight[k] * (double)v->baked[v->samples[i].at[k] * lanes + l];
            v->row[i * lanes + l] = sum;
        }
    for (size_t u = 0; u < v->unknown_count; u++)
        for (size_t l = 0; l < lanes; l++) {
            double sum = 0.0;
            for (size_t t = v->readers.first[u]; t < v->readers.first[u + 1]; t++)
                sum -= (double)v->readers.terms[t].weight * v->row[v->readers.terms[t].sample * lanes + l];
            v->next[u * lanes + l] = sum;
            v->factor.diagonal[u * lanes + l] = v->diagonal[u] + (v->pinned[u * lanes + l] ? hold : v->pull[u]);
        }
    kiln_cholesky_factorize(&v->factor);
    kiln_cholesky_solve(&v->factor, v->next);
    keep_change(v);
}

static void find_ranges(struct solver *v, size_t lane)
{
    const size_t lanes = v->lanes;
    for (size_t u = lane; u < v->unknown_count * lanes; u += lanes)
        v->low[u] = v->high[u] = v->baked[u];
    for (size_t i = 0; i < v->sample_count; i++) {
        float low = INFINITY, high = -INFINITY;
        for (int k = 0; k < ENTRIES; k++) {
            const float value = v->baked[v->samples[i].at[k] * lanes + lane];
            low = fminf(low, value);
            high = fmaxf(high, value);
        }
        for (int k = 0; k < ENTRIES; k++) {
            const size_t u = v->samples[i].at[k] * lanes + lane;
            v->low[u] = fminf(v->low[u], low);
            v->high[u] = fmaxf(v->high[u], high);
        }
    }
}

/* Fixes values that would leave their range at its nearest end. Returns whether any was not fixed there before: then
 * the others must be solved again. */
static bool hold_values(struct solver *v, size_t lane)
{
    bool any = false;
    for (size_t i = lane; i < v->unknown_count * v->lanes; i += v->lanes) {
        const float value = (float)((double)v->baked[i] + v->change[i]),
                    within = fmaxf(v->low[i], fminf(v->high[i], value));
        if (value == within || (v->pinned[i] && v->baked[i] == within))
            continue;
        v->baked[i] = within;
        v->pinned[i] = true;
        any = true;
    }
    return any;
}

/* Solves all lanes; where values had to be fixed, solves again, a few times. */
static void solve_and_hold(struct solver *v)
{
    bool any = true;
    kiln_cholesky_forget(&v->factor);
    for (int round = 0; round <= MOST_ROUNDS && any; round++) {
        find_change(v);
        any = false;
        for (size_t l = 0; l < v->lanes && round < MOST_ROUNDS; l++) {
            v->solves[l] = v->solves[l] && hold_values(v, l);
            any = any || v->solves[l];
        }
    }
}

/* ---- planes ---- */

/* Number of lanes for `planes` planes, with a factor of `entries` entries. */
static size_t lanes_for(size_t planes, size_t entries)
{
    size_t sets = (planes + LANES_MOST - 1) / LANES_MOST;
    while (sets < planes && kiln_cholesky_lanes((planes + sets - 1) / sets) * entries > MOST_NUMBERS)
        sets++;
    return kiln_cholesky_lanes((planes + sets - 1) / sets);
}

/* Copies a plane into a lane. A lane with a value that is not finite is not solved. */
static void take_plane(struct solver *v, size_t lane, const float *plane)
{
    v->solves[lane] = true;
    for (size_t i = 0, at = lane; i < v->unknown_count; i++, at += v->lanes) {
        v->baked[at] = plane[v->unknowns[i]];
        v->change[at] = 0.0;
        v->pinned[at] = false;
        v->solves[lane] = v->solves[lane] && isfinite(v->baked[at]);
    }
    find_ranges(v, lane);
}

/* Writes a lane back to its plane: baked values plus change, clamped to their ranges. */
static void give_plane(const struct solver *v, size_t lane, float *plane)
{
    for (size_t i = 0, at = lane; i < v->unknown_count; i++, at += v->lanes) {
        const float value = (float)((double)v->baked[at] + v->change[at]);
        if (isfinite(v->baked[at]))
            plane[v->unknowns[i]] = fmaxf(v->low[at], fminf(v->high[at], value));
    }
}

static int allocate_lanes(struct solver *v, struct kiln_error *error)
{
    const char *what = "a seam's system";
    const size_t count = v->unknown_count * v->lanes;
    float **floats[] = {&v->baked, &v->low, &v->high};
    int status;
    KILN_TRY(kiln_arena_allocate(&v->arena, &v->row, v->sample_count * v->lanes, sizeof *v->row, what, error));
    KILN_TRY(kiln_arena_allocate(&v->arena, &v->change, count, sizeof *v->change, what, error));
    KILN_TRY(kiln_arena_allocate(&v->arena, &v->next, count, sizeof *v->next, what, error));
    KILN_TRY(kiln_arena_allocate(&v->arena, &v->pinned, count, sizeof *v->pinned, what, error));
    for (size_t i = 0; i < sizeof floats / sizeof *floats; i++)
        KILN_TRY(kiln_allocate(floats[i], count, sizeof **floats[i], what, error));
    KILN_TRY(kiln_arena_allocate_bare(&v->arena, &v->pull, v->unknown_count, sizeof *v->pull, what, error));
    KILN_TRY(kiln_arena_allocate_bare(&v->arena, &v->diagonal, v->unknown_count, sizeof *v->diagonal, what, error));
    KILN_TRY(kiln_cholesky_create(&v->factor, &v->elimination, v->lanes, error));
end:
    return status;
}

/* Sets the weight that pulls each value to its baked one. mean: mean area. */
static void weigh_unknowns(struct solver *v, double mean)
{
    for (size_t u = 0; u < v->unknown_count; u++) {
        const double area = (double)v->system->area[v->unknowns[u]], relative = mean > 0.0 ? area / mean : 1.0;
        v->pull[u] = KILN_SEAM_WEIGHT * (area > 0.0 ? fmax(relative, 0.1) : margin_pull);
    }
}

/* NaN if no value has area; then all have the same weight. */
static double mean_area(const struct kiln_seam_system *s)
{
    double sum = 0.0;
    size_t count = 0;
    for (size_t i = 0; i < s->unknown_count; i++) {
        sum += (double)s->area[i];
        count += s->area[i] > 0.0f;
    }
    return sum / (double)count;
}

/* The planes first, first + step, ...; `count` of them. */
struct planes {
    size_t first, step, count;
};

static void solve_sets(struct solver *v, const struct planes *planes)
{
    for (size_t first = 0; first < planes->count; first += v->lanes) {
        v->planes = planes->count - first < v->lanes ? planes->count - first : v->lanes;
        memset(v->solves, 0, sizeof v->solves);
        for (size_t l = 0; l < v->planes; l++)
            take_plane(v, l, v->system->planes[planes->first + (first + l) * planes->step]);
        solve_and_hold(v);
        for (size_t l = 0; l < v->planes; l++)
            give_plane(v, l, v->system->planes[planes->first + (first + l) * planes->step]);
    }
}

static int solve_part(const struct kiln_seam_system *s, const struct parts *p, uint32_t part, uint32_t *number,
                      const struct planes *planes, double mean, struct kiln_error *error)
{
    const size_t first = p->first[part], first_sample = p->first_sample[part];
    struct solver v = {.system = s,
                       .unknown_count = p->first[part + 1] - first,
                       .sample_count = p->first_sample[part + 1] - first_sample};
    if (v.sample_count == 0)
        return KILN_OK;
    int status;
    KILN_TRY(order_unknowns(&v, p->unknowns + first, p->samples + first_sample, number, error));
    v.lanes = lanes_for(planes->count, kiln_elimination_entries(&v.elimination));
    KILN_TRY(allocate_lanes(&v, error));
    KILN_TRY(list_readers(&v, error));
    KILN_TRY(make_matrix(&v, error));
    weigh_unknowns(&v, mean);
    solve_sets(&v, planes);
end:
    free_solver(&v);
    return status;
}

/* Each part by one thread, the largest first. */
static int solve_parts(const struct kiln_seam_system *s, const struct parts *p, const struct planes *planes,
                       struct kiln_error *error)
{
    const double mean = mean_area(s);
    uint32_t *number = NULL;
    int status = kiln_allocate_bare(&number, s->unknown_count, sizeof *number, "a seam's system", error);
    const size_t count = status == KILN_OK ? p->count : 0;
#pragma omp parallel for schedule(dynamic, 1) if (s->unknown_count > ALONE)
    for (size_t i = 0; i < count; i++) {
        struct kiln_error mine = {{0}};
        const int result = solve_part(s, p, p->order[i], number, planes, mean, &mine);
        if (result == KILN_OK)
            continue;
#pragma omp critical(kiln_solve_parts)
        status = kiln_fail(error, result, "%s", mine.message);
    }
    kiln_free(&number);
    return status;
}

int kiln_seam_system_solve(struct kiln_seam_system *s, uint32_t first, uint32_t step, struct kiln_error *error)
{
    struct parts parts = {0};
    if (s->unknown_count == 0 || s->sample_count == 0 || first >= s->plane_count)
        return KILN_OK;
    if (s->sample_count > UINT32_MAX / ENTRIES)
        return kiln_fail(error, KILN_SYSTEM, "%zu samples at seams are too many to solve; use --no-stitch",
                         s->sample_count);
    const struct planes planes = {first, step, (s->plane_count - first + step - 1) / step};
    int status = list_parts(&parts, s, error);
    if (status == KILN_OK)
        status = solve_parts(s, &parts, &planes, error);
    free_parts(&parts);
    return status;
}
