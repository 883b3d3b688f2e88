#include "coordinator/output/map/regression.h"

#include <math.h>
#include <string.h>

#include "coordinator/output/image.h"
#include "worker/base/memory.h"

enum { SCALES = KILN_NEIGHBOUR_RINGS, LIGHTS = KILN_REGRESSION_LIGHTS, RAW = SCALES };

static const float scales[SCALES] = {0.75f, 1.0f, 1.5f, 2.0f, 3.0f, 4.0f};

/* Of these scales, by their number: the one by which the variance is judged and choices are averaged, and the one
 * over whose weights variances and risks are averaged. */
enum { NARROW = 1, WIDE = 4 };

/* In place of the second moment along an axis on which the neighbours do not extend, relative to the sum of weights. */
static const double ridge = 1e-5;

/* Stein's estimate of one point over its variance is limited to this. */
static const double risk_most = 1000.0;

/* The share of the variance that values must scatter about a fit if they are to tell about the variance. */
static const double scatter_least = 0.25;

/* A fit whose leverage exceeds this is the value itself. */
static const double leverage_most = 0.95;

/* What is known of a point's light. The last three are made by the second sweep. */
struct estimate {
    float luminance, variance; /* as given */
    float square[SCALES];      /* (fit - value)^2; then Stein's estimate over `pooled` */
    float pooled;              /* the mean variance around, lowered as the header says */
    float risk;                /* of the choice: the mean of Stein's estimate, at most `pooled` */
    uint32_t choice;           /* a scale, or RAW */
};

/* Arrays by the points' place in the grid. */
struct regression {
    const struct kiln_neighbour_grid *grid;
    struct kiln_regression_light *lights;
    size_t light_count;
    struct estimate *estimates[LIGHTS];
    float (*values[LIGHTS])[3]; /* as given */
    float (*leverage)[SCALES];
};

/* What one thread works with; arrays by neighbours, or by neighbours of each light. */
struct worker {
    struct kiln_neighbours n;
    float difference[LIGHTS][KILN_NEIGHBOURS_MOST]; /* of their luminance from the point's */
    float factors[KILN_NEIGHBOURS_MOST];
};

/* ---- one fit ---- */

/* Sums over neighbours of weight x 1, x, y, xx, xy, yy; and of weight x (value - own value) x 1, x, y of each light. */
struct moments {
    float one, x, y, xx, xy, yy, v[LIGHTS][3];
};

/* The linear function's value at the point is own value + sum over w_j (a + b x_j + c y_j) (value_j - own value). */
struct fit {
    double a, b, c;
    double leverage;
};

static struct moments gather_moments(const struct worker *w, size_t scale)
{
    const struct kiln_neighbours *n = &w->n;
    const float inverse = 0.25f / (scales[scale] * scales[scale]);
    float one = 0, sx = 0, sy = 0, xx = 0, xy = 0, yy = 0, p = 0, px = 0, py = 0, q = 0, qx = 0, qy = 0;
#pragma omp simd reduction(+ : one, sx, sy, xx, xy, yy, p, px, py, q, qx, qy)
    for (size_t i = 0; i < n->within[scale]; i++) {
        const float x = n->x[i], y = n->y[i], u = 1.0f - (x * x + y * y) * inverse, weight = u * u * n->area[i],
                    wx = weight * x, wy = weight * y, v0 = w->difference[0][i], v1 = w->difference[1][i];
        one += weight;
        sx += wx;
        sy += wy;
        xx += wx * x;
        xy += wx * y;
        yy += wy * y;
        p += weight * v0;
        px += wx * v0;
        py += wy * v0;
        q += weight * v1;
        qx += wx * v1;
        qy += wy * v1;
    }
    return (struct moments){one, sx, sy, xx, xy, yy, {{p, px, py}, {q, qx, qy}}};
}

/* Solves the normal equations for the value at the point, whose own weight is `own` (Cholesky's method). */
static struct fit solve(const struct moments *m, float own)
{
    const double w = (double)m->one + (double)own, x = (double)m->x / w, y = (double)m->y / w;
    /* second moments about the centre of gravity */
    const double xx = (double)m->xx / w - x * x, yy = (double)m->yy / w - y * y, xy = (double)m->xy / w - x * y;
    const double a = fmax(xx, 0.0) + ridge, b = fmax(yy, 0.0) + ridge, determinant = a * b - xy * xy;
    struct fit fit = {.a = 1.0 / w};
    if (determinant > 1e-3 * ridge * fmax(a, b)) {
        fit.b = -(x * b - y * xy) / determinant / w;
        fit.c = -(y * a - x * xy) / determinant / w;
        fit.a -= fit.b * x + fit.c * y;
    }
    fit.leverage = fit.a * (double)own;
    return fit;
}

/* The fit's value - own value, of one light. */
static double fitted(const struct fit *fit, const float v[3])
{
    return fit->a * (double)v[0] + fit->b * (double)v[1] + fit->c * (double)v[2];
}

/* ---- first sweep: fits at all scales ---- */

static void fit_point(const struct regression *r, struct worker *w, size_t place)
{
    struct kiln_neighbours *n = &w->n;
    const float own = r->grid->points[place].area;
    kiln_neighbours_find(n, r->grid, place, KILN_NEIGHBOUR_RADIUS);
    for (size_t l = 0; l < r->light_count; l++) {
        const struct estimate *e = r->estimates[l];
        for (size_t i = 0; i < n->within[SCALES - 1]; i++)
            w->difference[l][i] = e[n->place[i]].luminance - e[place].luminance;
    }
    for (size_t s = 0; s < SCALES; s++) {
        const struct moments m = gather_moments(w, s);
        const struct fit fit = solve(&m, own);
        r->leverage[place][s] = (float)fmin(fmax(fit.leverage, 0.0), 1.0);
        for (size_t l = 0; l < r->light_count; l++) {
            const double away = fitted(&fit, m.v[l]);
            r->estimates[l][place].square[s] = (float)(away * away);
        }
    }
}

static float weight_of(const struct kiln_neighbours *n, size_t i, size_t scale)
{
    const float s = scales[scale], u = 1.0f - (n->x[i] * n->x[i] + n->y[i] * n->y[i]) * 0.25f / (s * s);
    return u * u * n->area[i];
}

/* ---- second sweep: the variance around each point ---- */

/* Weighted sums over a neighbourhood. */
struct spread {
    double weight, leverage, variance[LIGHTS], square[LIGHTS];
};

static void add_spread(const struct regression *r, struct spread *p, size_t place, double weight)
{
    p->weight += weight;
    p->leverage += weight * (double)r->leverage[place][NARROW];
    for (size_t l = 0; l < r->light_count; l++) {
        p->variance[l] += weight * (double)r->estimates[l][place].variance;
        p->square[l] += weight * (double)r->estimates[l][place].square[NARROW];
    }
}

static void pool_variance(const struct regression *r, struct worker *w, size_t place)
{
    struct spread p = {0};
    kiln_neighbours_find(&w->n, r->grid, place, kiln_neighbour_rings[WIDE]);
    add_spread(r, &p, place, (double)r->grid->points[place].area);
    for (size_t i = 0; i < w->n.within[WIDE]; i++)
        add_spread(r, &p, w->n.place[i], (double)weight_of(&w->n, i, WIDE));
    /* the squared distance from a fit has the mean v (1 - 2 l_0 + sum over l_j^2), whose last term is about 0.6 l_0 */
    const double part = 1.0 - 1.4 * p.leverage / p.weight;
    for (size_t l = 0; l < r->light_count; l++) {
        const double scatter = part > scatter_least ? p.square[l] / part : p.variance[l];
        r->estimates[l][place].pooled = (float)(fmin(p.variance[l], scatter) / p.weight);
    }
}

/* ---- third sweep: risks, and the choice ---- */

/* Replaces the squared distances of a point from its fits by Stein's estimates over the variance. */
static void estimate_risks(const struct regression *r, struct worker *w, size_t place)
{
    (void)w;
    for (size_t l = 0; l < r->light_count; l++) {
        struct estimate *e = &r->estimates[l][place];
        for (size_t s = 0; s < SCALES && e->pooled > 0.0f; s++) {
            const double risk = (double)e->square[s] / (double)e->pooled - 1.0 + 2.0 * (double)r->leverage[place][s];
            e->square[s] = (float)fmin(risk, risk_most);
        }
    }
}

/* Weighted sums over a neighbourhood. */
struct pool {
    float weight, leverage[SCALES], risk[LIGHTS][SCALES];
};

static inline void add_to_pool(const struct regression *r, struct pool *p, size_t place, float weight)
{
    p->weight += weight;
    for (size_t s = 0; s < SCALES; s++)
        p->leverage[s] += weight * r->leverage[place][s];
    for (size_t l = 0; l < r->light_count; l++)
        for (size_t s = 0; s < SCALES; s++)
            p->risk[l][s] += weight * r->estimates[l][place].square[s];
}

/* The scale of the least risk of one light. */
static void choose(struct estimate *e, const struct pool *p, size_t light)
{
    float least = 1.0f;
    e->choice = RAW;
    for (size_t s = 0; s < SCALES && e->pooled > 0.0f; s++) {
        const float risk = p->risk[light][s] / p->weight;
        if (p->leverage[s] < (float)leverage_most * p->weight && risk < least) {
            least = risk;
            e->choice = (uint32_t)s;
        }
    }
    e->risk = fmaxf(least, 0.0f) * e->pooled;
}

static void judge_point(const struct regression *r, struct worker *w, size_t place)
{
    struct pool pool = {0};
    kiln_neighbours_find(&w->n, r->grid, place, kiln_neighbour_rings[WIDE]);
    add_to_pool(r, &pool, place, r->grid->points[place].area);
    for (size_t i = 0; i < w->n.within[WIDE]; i++)
        add_to_pool(r, &pool, w->n.place[i], weight_of(&w->n, i, WIDE));
    for (size_t l = 0; l < r->light_count; l++)
        choose(&r->estimates[l][place], &pool, l);
}

/* ---- fourth sweep: the mean of the chosen fits ---- */

/* The choices around a point. */
struct shares {
    double of[SCALES + 1], risk; /* risk: the mean of theirs */
    size_t largest;              /* scale that has a share; RAW: none has */
};

static void add_share(struct shares *shares, const struct estimate *e, double weight)
{
    shares->of[e->choice] += weight;
    shares->risk += weight * (double)e->risk;
}

static struct shares share_choices(const struct estimate *e, const struct kiln_neighbours *n, size_t place, float own)
{
    struct shares shares = {.largest = RAW};
    double sum = (double)own;
    add_share(&shares, &e[place], (double)own);
    for (size_t i = 0; i < n->within[NARROW]; i++) {
        const double weight = (double)weight_of(n, i, NARROW);
        add_share(&shares, &e[n->place[i]], weight);
        sum += weight;
    }
    shares.risk /= sum;
    for (size_t s = 0; s <= SCALES; s++) {
        shares.of[s] /= sum;
        if (s < SCALES && shares.of[s] > 0.0)
            shares.largest = s;
    }
    return shares;
}

/* Factors of the neighbours' values in the result. */
static void add_factors(const struct kiln_neighbours *n, size_t scale, const struct fit *fit, double share,
                        float *factors)
{
    const float a = (float)(share * fit->a), b = (float)(share * fit->b), c = (float)(share * fit->c),
                s = scales[scale], inverse = 0.25f / (s * s);
#pragma omp simd
    for (size_t i = 0; i < n->within[scale]; i++) {
        const float x = n->x[i], y = n->y[i], u = 1.0f - (x * x + y * y) * inverse;
        factors[i] += u * u * n->area[i] * (a + b * x + c * y);
    }
}

/* Adds up the values of one light. Returns the variance of the sum. */
static double add_up(const struct regression *r, size_t light, const struct worker *w, size_t count, size_t place)
{
    const float(*values)[3] = (const float(*)[3])r->values[light], *at = values[place];
    const struct estimate *e = r->estimates[light];
    double sum[3] = {0}, own = 1.0, variance = 0.0;
    for (size_t i = 0; i < count; i++) {
        const double factor = (double)w->factors[i];
        const float *value = values[w->n.place[i]];
        for (int c = 0; c < 3; c++)
            sum[c] += factor * (double)(value[c] - at[c]);
        own -= factor;
        variance += factor * factor * (double)e[w->n.place[i]].pooled;
    }
    for (int c = 0; c < 3; c++)
        r->lights[light].rgb[c][r->grid->points[place].index] = fmaxf((float)((double)at[c] + sum[c]), 0.0f);
    return variance + own * own * (double)e[place].pooled;
}

static void smooth_light(const struct regression *r, size_t light, struct worker *w, size_t place)
{
    const float own = r->grid->points[place].area, pooled = r->estimates[light][place].pooled;
    const struct shares shares = share_choices(r->estimates[light], &w->n, place, own);
    const size_t count = shares.largest < RAW ? w->n.within[shares.largest] : 0;
    memset(w->factors, 0, count * sizeof *w->factors);
    for (size_t s = 0; s < SCALES; s++) {
        if (!(shares.of[s] > 0.0))
            continue;
        const struct moments m = gather_moments(w, s);
        const struct fit fit = solve(&m, own);
        if (fit.leverage < leverage_most)
            add_factors(&w->n, s, &fit, shares.of[s], w->factors);
    }
    const double variance = add_up(r, light, w, count, place);
    r->lights[light].variance[r->grid->points[place].index] = (float)fmin(fmax(shares.risk, variance), (double)pooled);
}

static void smooth_point(const struct regression *r, struct worker *w, size_t place)
{
    kiln_neighbours_find(&w->n, r->grid, place, KILN_NEIGHBOUR_RADIUS);
    for (size_t l = 0; l < r->light_count; l++)
        smooth_light(r, l, w, place);
}

/* ---- sweeps ---- */

/* Calls `visit` for all points, by several threads. */
static int sweep(const struct regression *r, float radius,
                 void (*visit)(const struct regression *, struct worker *, size_t), struct kiln_error *error)
{
    int status = KILN_OK;
#pragma omp parallel
    {
        struct worker *w = NULL;
        struct kiln_error mine = {{0}};
        const int made = kiln_allocate(&w, 1, sizeof *w, "the neighbours of a point", &mine);
#pragma omp for schedule(dynamic, 8)
        for (size_t cell = 0; cell < r->grid->cell_count; cell++) {
            if (made != KILN_OK)
                continue;
            kiln_neighbours_collect(&w->n, r->grid, cell, radius);
            for (size_t place = r->grid->first[cell]; place < r->grid->first[cell + 1]; place++)
                visit(r, w, place);
        }
        kiln_free(&w);
        if (made != KILN_OK)
#pragma omp critical(kiln_regression_sweep)
            status = kiln_fail(error, made, "%s", mine.message);
    }
    return status;
}

static int take_values(struct regression *r, struct kiln_error *error)
{
    const size_t count = r->grid->count;
    int status = kiln_allocate(&r->leverage, count, sizeof *r->leverage, "the regression", error);
    for (size_t l = 0; status == KILN_OK && l < r->light_count; l++) {
        status = kiln_allocate(&r->estimates[l], count, sizeof(struct estimate), "the regression", error);
        if (status == KILN_OK)
            status = kiln_allocate(&r->values[l], count, sizeof(float[3]), "the regression", error);
        for (size_t i = 0; status == KILN_OK && i < count; i++) {
            const uint32_t index = r->grid->points[i].index;
            float *rgb = r->values[l][i];
            for (int c = 0; c < 3; c++)
                rgb[c] = r->lights[l].rgb[c][index];
            r->estimates[l][i].luminance = kiln_rgb_luminance(rgb[0], rgb[1], rgb[2]);
            r->estimates[l][i].variance = r->lights[l].variance[index];
        }
    }
    return status;
}

static void sum_up(const struct regression *r)
{
    for (size_t l = 0; l < r->light_count; l++) {
        struct kiln_regression_light *light = &r->lights[l];
        light->before = light->after = 0.0;
        for (size_t i = 0; i < r->grid->count; i++) {
            const struct kiln_neighbour_point *p = &r->grid->points[i];
            light->before += (double)p->area * (double)r->estimates[l][i].pooled;
            light->after += (double)p->area * (double)light->variance[p->index];
        }
    }
}

int kiln_regression_run(const struct kiln_neighbour_grid *grid, struct kiln_regression_light *lights, size_t count,
                        struct kiln_error *error)
{
    struct regression r = {.grid = grid, .lights = lights, .light_count = count};
    int status = take_values(&r, error);
    if (status == KILN_OK)
        status = sweep(&r, KILN_NEIGHBOUR_RADIUS, fit_point, error);
    if (status == KILN_OK)
        status = sweep(&r, kiln_neighbour_rings[WIDE], pool_variance, error);
    if (status == KILN_OK)
        status = sweep(&r, 0.0f, estimate_risks, error);
    if (status == KILN_OK)
        status = sweep(&r, kiln_neighbour_rings[WIDE], judge_point, error);
    if (status == KILN_OK)
        status = sweep(&r, KILN_NEIGHBOUR_RADIUS, smooth_point, error);
    if (status == KILN_OK)
        sum_up(&r);
    for (size_t l = 0; l < count; l++) {
        kiln_free(&r.estimates[l]);
        kiln_free(&r.values[l]);
    }
    kiln_free(&r.leverage);
    return status;
}
