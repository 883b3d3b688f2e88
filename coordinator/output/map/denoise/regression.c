#include "coordinator/output/map/denoise/regression.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "coordinator/output/image.h"
#include "coordinator/output/map/denoise/regression_device.h"
#include "worker/base/clones.h"
#include "worker/base/memory.h"

/* Fits: a linear one at each scale, and quadratic ones after them. */
enum {
    SCALES = KILN_NEIGHBOUR_RINGS,
    FITS = SCALES + 4,
    LIGHTS = KILN_REGRESSION_LIGHTS,
    RAW = KILN_REGRESSION_RAW,
    TERMS = 6,
    HIGHEST = 5, /* one more than the highest order of moments */
    FAR = 3      /* largest distance of points that the first sweep visits */
};
_Static_assert(SCALES == KILN_REGRESSION_SCALES && FITS == KILN_REGRESSION_FITS, "fits of shaders/regression.comp");

static const float scales[SCALES] = {0.75f, 1.0f, 1.5f, 2.0f, 3.0f, 4.0f};
static const size_t scale_of[FITS] = {0, 1, 2, 3, 4, 5, 1, 2, 3, 5};

/* Indices of two scales. NARROW: its fit estimates the variance, and its weights average the choices. WIDE: its weights
 * average variances and risks. */
enum { NARROW = 1, WIDE = 4 };

/* Replaces the second moment along an axis on which the neighbours have no extent; relative to the sum of weights. */
static const double ridge = 1e-5;

/* Ridge added to the moments of a quadratic fit, relative to the sum of weights; lengths are in kernel radii. */
static const double ridge_quadratic = 1e-6;

/* Upper limit of Stein's estimate of one point's risk, relative to the variance. */
static const double risk_most = 1000.0;

/* Largest risk, relative to the variance, with which a fit may be chosen. A fit that removes less noise lies far from
 * the values compared to their noise (up to the limit of risks): even a small step towards it would be bias. */
static const float risk_worth = 0.9f;

/* Least scatter of the values about a fit, as a share of the variance, from which the variance can be estimated. */
static const double scatter_least = 0.25;

/* Least value of (fit - value)^2 over the variance. */
static const float square_least = 1e-6f;

/* Largest leverage of a usable fit; above it the fit just reproduces the value. */
static const double leverage_most = 0.95;

/* Estimate of a point's light. */
struct estimate {
    union {
        float luminance; /* as given */
        float noise;     /* after the last sweep: variance of the result */
    };
    union {
        float variance; /* as given */
        float bias;     /* after the last sweep: squared bias, the excess of the choices' risk over the noise */
    };
    float pooled;    /* mean variance of the neighbourhood, lowered as in regression.h */
    float risk;      /* risk of the choice: mean of Stein's estimate, at most `pooled` */
    float part;      /* step from the value (0) towards the chosen fit (1) */
    uint32_t choice; /* a fit, or RAW */
};

/* Numbers of a point that are summed over neighbours: the leverage of each fit, then of each light (fit - value)^2, or
 * Stein's risk estimate over `pooled`, of each fit. The last one is 1. They lie side by side, so that sums of all are
 * vectorized, whatever they are. */
enum { LEVERAGE = 0, SQUARE = FITS, ONE = 31, NUMBERS = 32, LANES = 8, VECTORS = NUMBERS / LANES };
typedef float floats __attribute__((vector_size(LANES * sizeof(float))));
_Static_assert(SQUARE + LIGHTS * FITS <= ONE, "the numbers of a point");

/* Arrays by the points' place in the grid. */
struct regression {
    const struct kiln_neighbour_grid *grid;
    struct kiln_regression_light *lights;
    size_t light_count;
    struct estimate *estimates[LIGHTS];
    float (*values[LIGHTS])[4]; /* as given; the last one is `pooled` */
    float *others[LIGHTS];      /* likewise: of each point three of each */
    float (*numbers)[NUMBERS];
    struct kiln_neighbours_kept kept;             /* from the first sweep for the others */
    const struct kiln_regression_subdomain *part; /* NULL: all points are here */
};

/* Scratch data of one thread; arrays have an entry per neighbour, or per light and neighbour. */
struct worker {
    struct kiln_neighbours n;
    float difference[LIGHTS][KILN_NEIGHBOURS_ROOM]; /* of their luminance from the point's */
    float factors[KILN_NEIGHBOURS_ROOM];
    double *sums;                 /* of other light: three of each */
    double powers[FITS][HIGHEST]; /* 1 / radius of each fit's kernel, to the powers 0, 1, ... */
};

/* ---- one fit ---- */

/* Sums over neighbours of weight x 1, x, y, xx, xy, yy; and of weight x (value - own value) x 1, x, y of each light. */
struct moments {
    float one, x, y, xx, xy, yy, v[LIGHTS][3];
};

/* Coefficients of a fit. Its value at the point is own value + sum over w_j (a + b x_j + c y_j + d x_j^2 + e x_j y_j +
 * f y_j^2) (value_j - own value). */
struct fit {
    double a, b, c, d, e, f;
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
    const double a = (xx > 0.0 ? xx : 0.0) + ridge, b = (yy > 0.0 ? yy : 0.0) + ridge, determinant = a * b - xy * xy;
    struct fit fit = {.a = 1.0 / w};
    if (determinant > 1e-3 * ridge * (a > b ? a : b)) {
        fit.b = -(x * b - y * xy) / determinant / w;
        fit.c = -(y * a - x * xy) / determinant / w;
        fit.a -= fit.b * x + fit.c * y;
    }
    fit.leverage = fit.a * (double)own;
    return fit;
}

/* Sums over neighbours of weight x the monomials of third and fourth order, by the power of y; and of weight x (value -
 * own value) x xx, xy, yy of each light. */
struct high_moments {
    float third[4], fourth[5], v[LIGHTS][3];
};

static struct high_moments gather_high_moments(const struct worker *w, size_t scale)
{
    const struct kiln_neighbours *n = &w->n;
    const float inverse = 0.25f / (scales[scale] * scales[scale]);
    float xxx = 0, xxy = 0, xyy = 0, yyy = 0, x4 = 0, x3y = 0, xxyy = 0, xy3 = 0, y4 = 0, pxx = 0, pxy = 0, pyy = 0,
          qxx = 0, qxy = 0, qyy = 0;
#pragma omp simd reduction(+ : xxx, xxy, xyy, yyy, x4, x3y, xxyy, xy3, y4, pxx, pxy, pyy, qxx, qxy, qyy)
    for (size_t i = 0; i < n->within[scale]; i++) {
        const float x = n->x[i], y = n->y[i], u = 1.0f - (x * x + y * y) * inverse, weight = u * u * n->area[i],
                    xx = weight * x * x, xy = weight * x * y, yy = weight * y * y, v0 = w->difference[0][i],
                    v1 = w->difference[1][i];
        xxx += xx * x;
        xxy += xx * y;
        xyy += yy * x;
        yyy += yy * y;
        x4 += xx * x * x;
        x3y += xx * x * y;
        xxyy += xx * y * y;
        xy3 += yy * x * y;
        y4 += yy * y * y;
        pxx += xx * v0;
        pxy += xy * v0;
        pyy += yy * v0;
        qxx += xx * v1;
        qxy += xy * v1;
        qyy += yy * v1;
    }
    return (struct high_moments){{xxx, xxy, xyy, yyy}, {x4, x3y, xxyy, xy3, y4}, {{pxx, pxy, pyy}, {qxx, qxy, qyy}}};
}

/* Number of quadratic fits. They are solved together in SIMD lanes: one fit, or all of a point. */
enum { QUADRATIC = FITS - SCALES };

/* Normal equations of quadratic fits, and the first columns of their inverses; each entry has all lanes. */
struct equations {
    double sum[QUADRATIC], matrix[TERMS][TERMS][QUADRATIC], column[TERMS][QUADRATIC];
};

static const int power_x[TERMS] = {0, 1, 0, 2, 1, 0}, power_y[TERMS] = {0, 0, 1, 0, 1, 2};

/* Sets a lane. Lengths are divided by the kernel's radius, moments by the sum of weights. */
static void set_equations(struct equations *e, size_t lane, const struct moments *m, const struct high_moments *h,
                          float own, const double *powers)
{
    const float *const orders[] = {(const float[]){m->one + own}, (const float[]){m->x, m->y},
                                   (const float[]){m->xx, m->xy, m->yy}, h->third, h->fourth};
    e->sum[lane] = (double)m->one + (double)own;
    for (int i = 0; i < TERMS; i++)
        for (int j = 0; j <= i; j++) {
            const int y = power_y[i] + power_y[j], order = power_x[i] + power_x[j] + y;
            e->matrix[i][j][lane] = (double)orders[order][y] * powers[order];
        }
}

/* Solves the equations from their lower triangles, which are overwritten (Cholesky's method). Callers pass `lanes` as a
 * constant. */
static inline __attribute__((always_inline)) void solve_lanes(struct equations *e, const size_t lanes)
{
    for (int i = 0; i < TERMS; i++)
        for (int j = 0; j <= i; j++) {
            double sum[QUADRATIC];
            for (size_t l = 0; l < lanes; l++)
                sum[l] = e->matrix[i][j][l] / e->sum[l] + (i == j && i > 0 ? ridge_quadratic : 0.0);
            for (int k = 0; k < j; k++)
                for (size_t l = 0; l < lanes; l++)
                    sum[l] -= e->matrix[i][k][l] * e->matrix[j][k][l];
            for (size_t l = 0; l < lanes; l++)
                e->matrix[i][j][l] = i == j ? sqrt(sum[l] > 1e-12 ? sum[l] : 1e-12) : sum[l] / e->matrix[j][j][l];
        }
    for (int i = 0; i < TERMS; i++) {
        double column[QUADRATIC];
        for (size_t l = 0; l < lanes; l++)
            column[l] = i == 0 ? 1.0 : 0.0;
        for (int k = 0; k < i; k++)
            for (size_t l = 0; l < lanes; l++)
                column[l] -= e->matrix[i][k][l] * e->column[k][l];
        for (size_t l = 0; l < lanes; l++)
            e->column[i][l] = column[l] / e->matrix[i][i][l];
    }
    for (int i = TERMS - 1; i >= 0; i--) {
        for (int k = i + 1; k < TERMS; k++)
            for (size_t l = 0; l < lanes; l++)
                e->column[i][l] -= e->matrix[k][i][l] * e->column[k][l];
        for (size_t l = 0; l < lanes; l++)
            e->column[i][l] /= e->matrix[i][i][l];
    }
}

KILN_CLONES static void solve_all(struct equations *e) { solve_lanes(e, QUADRATIC); }

static void solve_one(struct equations *e) { solve_lanes(e, 1); }

/* As `solve`, for the quadratic function of a lane. */
static struct fit fit_of(const struct equations *e, size_t lane, float own, const double *powers)
{
    double column[TERMS];
    for (int i = 0; i < TERMS; i++)
        column[i] = e->column[i][lane] * (powers[power_x[i] + power_y[i]] / e->sum[lane]);
    return (struct fit){column[0], column[1], column[2], column[3], column[4], column[5], column[0] * (double)own};
}

/* Both kinds of moments of a fit. The high orders are for quadratic fits only. */
struct sums {
    struct moments low;
    struct high_moments high;
};

/* Makes a fit from scratch. */
static struct fit make_fit(const struct worker *w, size_t fit, float own)
{
    const size_t scale = scale_of[fit];
    const struct moments low = gather_moments(w, scale);
    if (fit < SCALES)
        return solve(&low, own);
    const struct high_moments high = gather_high_moments(w, scale);
    struct equations equations;
    set_equations(&equations, 0, &low, &high, own, w->powers[fit]);
    solve_one(&equations);
    return fit_of(&equations, 0, own, w->powers[fit]);
}

/* The fit's value - own value, of one light. */
static double fitted(const struct fit *fit, size_t light, const struct sums *sums)
{
    const float *v = sums->low.v[light], *high = sums->high.v[light];
    return fit->a * (double)v[0] + fit->b * (double)v[1] + fit->c * (double)v[2] + fit->d * (double)high[0] +
           fit->e * (double)high[1] + fit->f * (double)high[2];
}

/* ---- first sweep: all fits ---- */

/* Takes what a fit says of a point. */
static void take_fit(const struct regression *r, size_t place, size_t f, const struct fit *fit, const struct sums *sums)
{
    const double leverage = fit->leverage > 0.0 ? fit->leverage : 0.0;
    r->numbers[place][LEVERAGE + f] = (float)(leverage < 1.0 ? leverage : 1.0);
    for (size_t l = 0; l < r->light_count; l++) {
        const double away = fitted(fit, l, sums);
        r->numbers[place][SQUARE + l * FITS + f] = (float)(away * away);
    }
}

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
    struct sums sums[SCALES];
    struct equations equations;
    for (size_t s = 0; s < SCALES; s++)
        sums[s] = (struct sums){.low = gather_moments(w, s)};
    for (size_t f = 0; f < SCALES; f++) {
        const struct fit fit = solve(&sums[f].low, own);
        take_fit(r, place, f, &fit, &sums[f]);
    }
    for (size_t q = 0; q < QUADRATIC; q++) {
        struct sums *at = &sums[scale_of[SCALES + q]];
        at->high = gather_high_moments(w, scale_of[SCALES + q]);
        set_equations(&equations, q, &at->low, &at->high, own, w->powers[SCALES + q]);
    }
    solve_all(&equations);
    for (size_t f = SCALES; f < FITS; f++) {
        const struct fit fit = fit_of(&equations, f - SCALES, own, w->powers[f]);
        take_fit(r, place, f, &fit, &sums[scale_of[f]]);
    }
}

static float weight_of(const struct kiln_neighbours *n, size_t i, size_t scale)
{
    const float s = scales[scale], u = 1.0f - (n->x[i] * n->x[i] + n->y[i] * n->y[i]) * 0.25f / (s * s);
    return u * u * n->area[i];
}

/* Sets the factors to the weights of a scale. */
static inline __attribute__((always_inline)) void set_weights(struct worker *w, size_t scale)
{
#pragma omp simd
    for (size_t i = 0; i < w->n.within[scale]; i++)
        w->factors[i] = weight_of(&w->n, i, scale);
}

/* ---- second sweep: the variance around each point ---- */

/* Fits that estimate the variance: a linear one, and a quadratic one, about which curved light scatters only by its
 * noise. The mean squared distance between value and fit is v (1 - 2 l_0 + sum over l_j^2), where l are leverages.
 * `leverages`: the last two terms together, in units of -l_0, on a regular grid. */
enum { JUDGES = 2, QUADRATIC_NARROW = SCALES + 1 };
static const struct {
    size_t fit;
    double leverages;
} judges[JUDGES] = {{NARROW, 1.4}, {QUADRATIC_NARROW, 1.24}};

/* Weighted sums over a neighbourhood that estimate its variance: of weights, of the leverages of the judges, and of
 * each light the variance and the squared distances from the judges. */
enum { WEIGHT, OF_JUDGES, OF_LIGHT = OF_JUDGES + JUDGES, OF_LIGHTS = 1 + JUDGES, SUMS = OF_LIGHT + LIGHTS * OF_LIGHTS };

static inline __attribute__((always_inline)) void add_spread(const struct regression *r, double sums[SUMS],
                                                             size_t place, double weight)
{
    const float *numbers = r->numbers[place];
    sums[WEIGHT] += weight;
    for (size_t k = 0; k < JUDGES; k++)
        sums[OF_JUDGES + k] += weight * (double)numbers[LEVERAGE + judges[k].fit];
    for (size_t l = 0; l < r->light_count; l++) {
        double *of = sums + OF_LIGHT + l * OF_LIGHTS;
        of[0] += weight * (double)r->estimates[l][place].variance;
        for (size_t k = 0; k < JUDGES; k++)
            of[1 + k] += weight * (double)numbers[SQUARE + l * FITS + judges[k].fit];
    }
}

KILN_CLONES static void sum_spread(const struct regression *r, struct worker *w, double sums[SUMS], size_t place)
{
    set_weights(w, WIDE);
    add_spread(r, sums, place, (double)r->grid->points[place].area);
    for (size_t i = 0; i < w->n.within[WIDE]; i++)
        add_spread(r, sums, w->n.place[i], (double)w->factors[i]);
}

static void pool_variance(const struct regression *r, struct worker *w, size_t place)
{
    double sums[SUMS] = {0};
    kiln_neighbours_find(&w->n, r->grid, place, kiln_neighbour_rings[WIDE]);
    sum_spread(r, w, sums, place);
    for (size_t l = 0; l < r->light_count; l++) {
        const double *of = sums + OF_LIGHT + l * OF_LIGHTS;
        double variance = of[0];
        for (size_t k = 0; k < JUDGES; k++) {
            const double part = 1.0 - judges[k].leverages * sums[OF_JUDGES + k] / sums[WEIGHT];
            if (part > scatter_least)
                variance = fmin(variance, of[1 + k] / part);
        }
        r->estimates[l][place].pooled = r->values[l][place][3] = (float)(variance / sums[WEIGHT]);
    }
}

/* ---- third sweep: risks, and the choice ---- */

/* Replaces the squared distances of a point from its fits by Stein's estimates over the variance. */
static void estimate_risk(float pooled, const float leverage[FITS], float square[FITS])
{
    for (size_t f = 0; f < FITS && pooled > 0.0f; f++) {
        const double risk = (double)square[f] / (double)pooled - 1.0 + 2.0 * (double)leverage[f];
        square[f] = (float)(risk < risk_most ? risk : risk_most);
    }
}

static void estimate_risks(const struct regression *r)
{
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < r->grid->count; i++)
        for (size_t l = 0; l < r->light_count; l++)
            estimate_risk(r->estimates[l][i].pooled, r->numbers[i] + LEVERAGE, r->numbers[i] + SQUARE + l * FITS);
}

/* Sums up the numbers of a neighbourhood with the weights of a scale. */
KILN_CLONES static void sum_numbers(const struct regression *r, struct worker *w, size_t scale, size_t place,
                                    float sums[NUMBERS])
{
    floats all[VECTORS], of;
    set_weights(w, scale);
    for (size_t v = 0; v < VECTORS; v++) {
        memcpy(&of, r->numbers[place] + v * LANES, sizeof of);
        all[v] = of * r->grid->points[place].area;
    }
    for (size_t i = 0; i < w->n.within[scale]; i++) {
        const float *numbers = r->numbers[w->n.place[i]];
        for (size_t v = 0; v < VECTORS; v++) {
            memcpy(&of, numbers + v * LANES, sizeof of);
            all[v] += of * w->factors[i];
        }
    }
    memcpy(sums, all, sizeof all);
}

/* Chooses the fit with the least risk for one light, and the step towards it. */
static void choose(struct estimate *e, const float sums[NUMBERS], size_t light)
{
    float least = risk_worth;
    e->choice = RAW;
    e->part = 0.0f;
    for (size_t f = 0; f < FITS && e->pooled > 0.0f; f++) {
        const float free = 1.0f - sums[LEVERAGE + f] / sums[ONE];
        /* the mean of (fit - value)^2 over the variance; not quite 0 */
        const float square = fmaxf(sums[SQUARE + light * FITS + f] / sums[ONE] - 1.0f + 2.0f * free, square_least);
        const float part = fminf(free / square, 1.0f), risk = 1.0f + part * (part * square - 2.0f * free);
        if (free > 1.0f - (float)leverage_most && risk < least) {
            least = risk;
            e->choice = (uint32_t)f;
            e->part = part;
        }
    }
    e->risk = (e->choice == RAW ? 1.0f : fmaxf(least, 0.0f)) * e->pooled;
}

static void judge_point(const struct regression *r, struct worker *w, size_t place)
{
    float sums[NUMBERS];
    kiln_neighbours_find(&w->n, r->grid, place, kiln_neighbour_rings[WIDE]);
    sum_numbers(r, w, WIDE, place, sums);
    for (size_t l = 0; l < r->light_count; l++)
        choose(&r->estimates[l][place], sums, l);
}

/* ---- fourth sweep: the mean of the chosen fits ---- */

/* The choices around a point. */
struct shares {
    double of[FITS + 1], risk; /* risk: the mean of theirs */
    size_t largest;            /* largest scale of a fit that has a share; SCALES: no fit has one */
};

static void add_share(struct shares *shares, const struct estimate *e, double weight)
{
    shares->of[e->choice] += weight * (double)e->part;
    shares->of[RAW] += weight * (1.0 - (double)e->part);
    shares->risk += weight * (double)e->risk;
}

static struct shares share_choices(const struct estimate *e, const struct kiln_neighbours *n, size_t place, float own)
{
    struct shares shares = {.largest = SCALES};
    double sum = (double)own;
    add_share(&shares, &e[place], (double)own);
    for (size_t i = 0; i < n->within[NARROW]; i++) {
        const double weight = (double)weight_of(n, i, NARROW);
        add_share(&shares, &e[n->place[i]], weight);
        sum += weight;
    }
    shares.risk /= sum;
    for (size_t f = 0; f <= FITS; f++) {
        shares.of[f] /= sum;
        if (f < FITS && shares.of[f] > 0.0 && (shares.largest == SCALES || shares.largest < scale_of[f]))
            shares.largest = scale_of[f];
    }
    return shares;
}

/* Adds a fit's share to the weights of the neighbours' values in the result. */
KILN_CLONES static void add_factors(const struct kiln_neighbours *n, size_t scale, const struct fit *fit, double share,
                                    float *factors)
{
    const float a = (float)(share * fit->a), b = (float)(share * fit->b), c = (float)(share * fit->c),
                d = (float)(share * fit->d), e = (float)(share * fit->e), f = (float)(share * fit->f),
                inverse = 0.25f / (scales[scale] * scales[scale]);
#pragma omp simd
    for (size_t i = 0; i < n->within[scale]; i++) {
        const float x = n->x[i], y = n->y[i], u = 1.0f - (x * x + y * y) * inverse;
        factors[i] += u * u * n->area[i] * (a + b * x + c * y + (d * x + e * y) * x + f * y * y);
    }
}

/* Four numbers in a SIMD vector. Each operation gives the same bits as with single numbers. */
typedef float float4 __attribute__((vector_size(16)));
typedef double double4 __attribute__((vector_size(32)));

/* Sums up the weighted values of one light. Returns the variance of the sum. */
KILN_CLONES static double add_up(const struct regression *r, size_t light, const struct worker *w, size_t count,
                                 size_t place)
{
    const float(*values)[4] = (const float(*)[4])r->values[light], *at = values[place];
    const float4 from = {at[0], at[1], at[2], 0.0f};
    double4 sum = {0};
    double own = 1.0;
    float4 value;
    for (size_t i = 0; i < count; i++) {
        const double factor = (double)w->factors[i];
        memcpy(&value, values[w->n.place[i]], sizeof value);
        sum += (double4){factor, factor, factor, factor * factor} * __builtin_convertvector(value - from, double4);
        own -= factor;
    }
    for (int c = 0; c < 3; c++)
        r->lights[light].rgb[c][r->grid->points[place].index] = fmaxf((float)((double)at[c] + sum[c]), 0.0f);
    return sum[3] + own * own * (double)at[3];
}

/* The same sum of other light. */
static void add_up_others(const struct regression *r, size_t light, const struct worker *w, size_t count, size_t place)
{
    const struct kiln_regression_light *of = &r->lights[light];
    const size_t numbers = 3 * of->other_count, index = r->grid->points[place].index;
    const float *at = r->others[light] + place * numbers;
    memset(w->sums, 0, numbers * sizeof *w->sums);
    for (size_t i = 0; i < count; i++) {
        const double factor = (double)w->factors[i];
        const float *value = r->others[light] + w->n.place[i] * numbers;
        for (size_t k = 0; k < numbers; k++)
            w->sums[k] += factor * (double)(value[k] - at[k]);
    }
    double below[3] = {0};
    for (size_t k = 0; k < numbers; k++) {
        w->sums[k] += (double)at[k];
        below[k % 3] += w->sums[k];
    }
    for (size_t c = 0; c < 3; c++) /* what has been stopped at 0 is the last one's */
        if (!(of->rgb[c][index] > 0.0f) && below[c] < 0.0)
            w->sums[numbers - 3 + c] -= below[c];
    for (size_t k = 0; k < numbers; k++)
        of->others[k / 3][k % 3][index] = (float)w->sums[k];
}

static void smooth_light(const struct regression *r, size_t light, struct worker *w, size_t place)
{
    const float own = r->grid->points[place].area;
    const struct shares shares = share_choices(r->estimates[light], &w->n, place, own);
    const size_t count = shares.largest < SCALES ? w->n.within[shares.largest] : 0;
    memset(w->factors, 0, count * sizeof *w->factors);
    for (size_t f = 0; f < FITS; f++) {
        if (!(shares.of[f] > 0.0))
            continue;
        const struct fit fit = make_fit(w, f, own);
        if (fit.leverage < leverage_most)
            add_factors(&w->n, scale_of[f], &fit, shares.of[f], w->factors);
    }
    const double variance = add_up(r, light, w, count, place);
    if (r->lights[light].other_count > 0)
        add_up_others(r, light, w, count, place);
    r->estimates[light][place].noise = (float)variance;
    r->estimates[light][place].bias = (float)fmax(shares.risk - variance, 0.0);
}

static void smooth_point(const struct regression *r, struct worker *w, size_t place)
{
    kiln_neighbours_find(&w->n, r->grid, place, KILN_NEIGHBOUR_RADIUS);
    for (size_t l = 0; l < r->light_count; l++)
        smooth_light(r, l, w, place);
}

/* ---- sweeps ---- */

static size_t most_others(const struct regression *r)
{
    size_t most = 0;
    for (size_t l = 0; l < r->light_count; l++)
        most = r->lights[l].other_count > most ? r->lights[l].other_count : most;
    return most;
}

static void set_powers(struct worker *w)
{
    for (size_t f = 0; f < FITS; f++)
        for (int k = 0; k < HIGHEST; k++)
            w->powers[f][k] = pow(1.0 / (2.0 * (double)scales[scale_of[f]]), k);
}

/* Whether a cell lies too far from own points for a sweep, which visits points with a distance of at most `far`. */
static bool is_too_far(const struct regression *r, size_t cell, uint8_t far)
{
    return r->part != NULL && r->part->far[r->grid->points[r->grid->first[cell]].index] > far;
}

/* Calls `visit` in several threads for all points whose distance is at most `far`. The first sweep keeps neighbours. */
static int sweep(struct regression *r, float radius, uint8_t far,
                 void (*visit)(const struct regression *, struct worker *, size_t), struct kiln_error *error)
{
    int status = KILN_OK;
#pragma omp parallel
    {
        struct worker *w = NULL;
        struct kiln_error mine = {{0}};
        int made = kiln_allocate(&w, 1, sizeof *w, "the neighbours of a point", &mine);
        if (made == KILN_OK)
            set_powers(w);
        if (made == KILN_OK)
            made = kiln_allocate(&w->sums, 3 * most_others(r) + 1, sizeof *w->sums, "the neighbours of a point", &mine);
#pragma omp for schedule(dynamic, 8)
        for (size_t cell = 0; cell < r->grid->cell_count; cell++) {
            if (made != KILN_OK || is_too_far(r, cell, far))
                continue;
            kiln_neighbours_collect_kept(&w->n, r->grid, &r->kept, cell, radius);
            for (size_t place = r->grid->first[cell]; place < r->grid->first[cell + 1]; place++)
                visit(r, w, place);
            if (visit == fit_point && !is_too_far(r, cell, FAR - 1))
                kiln_neighbours_keep(&w->n, &r->kept, cell);
        }
        if (w != NULL)
            kiln_free(&w->sums);
        kiln_free(&w);
        if (made != KILN_OK)
#pragma omp critical(kiln_regression_sweep)
            status = kiln_fail(error, made, "%s", mine.message);
    }
    return status;
}

static int take_others(struct regression *r, size_t light, struct kiln_error *error)
{
    const struct kiln_regression_light *of = &r->lights[light];
    const size_t numbers = 3 * of->other_count;
    if (numbers == 0)
        return KILN_OK;
    const int status =
        kiln_allocate_bare(&r->others[light], r->grid->count * numbers, sizeof(float), "the regression", error);
#pragma omp parallel for if (status == KILN_OK)
    for (size_t i = 0; i < (status == KILN_OK ? r->grid->count : 0); i++)
        for (size_t k = 0; k < numbers; k++)
            r->others[light][i * numbers + k] = of->others[k / 3][k % 3][r->grid->points[i].index];
    return status;
}

/* Copies the given values, and allocates the results. */
static int take_values(struct regression *r, struct kiln_error *error)
{
    const size_t count = r->grid->count;
    int status = KILN_OK;
    for (size_t l = 0; status == KILN_OK && l < r->light_count; l++) {
        status = kiln_allocate_bare(&r->estimates[l], count, sizeof(struct estimate), "the regression", error);
        if (status == KILN_OK)
            status = kiln_allocate_bare(&r->values[l], count, sizeof(float[4]), "the regression", error);
        if (status != KILN_OK)
            return status;
#pragma omp parallel for
        for (size_t i = 0; i < count; i++) {
            r->estimates[l][i] = (struct estimate){.pooled = 0.0f};
            for (int c = 0; c < 3; c++)
                r->values[l][i][c] = r->lights[l].rgb[c][r->grid->points[i].index];
            r->values[l][i][3] = 0.0f;
        }
    }
    return status;
}

static float luminance_of(const struct regression *r, size_t light, size_t place)
{
    const float *rgb = r->values[light][place];
    return kiln_rgb_luminance(rgb[0], rgb[1], rgb[2]);
}

/* Sets the estimates for the first sweep. */
static int begin_estimates(struct regression *r, struct kiln_error *error)
{
    const size_t count = r->grid->count;
    int status = kiln_allocate_bare(&r->numbers, count, sizeof *r->numbers, "the regression", error);
#pragma omp parallel for if (status == KILN_OK)
    for (size_t i = 0; i < (status == KILN_OK ? count : 0); i++) {
        memset(r->numbers[i], 0, sizeof r->numbers[i]);
        r->numbers[i][ONE] = 1.0f;
    }
    for (size_t l = 0; status == KILN_OK && l < r->light_count; l++) {
        status = take_others(r, l, error);
#pragma omp parallel for if (status == KILN_OK)
        for (size_t i = 0; i < count; i++) {
            r->estimates[l][i].luminance = luminance_of(r, l, i);
            r->estimates[l][i].variance = r->lights[l].variance[r->grid->points[i].index];
        }
    }
    return status;
}

/* Terms to sum over points, each x the point's area: squared bias, pooled variance, remaining squared error. */
enum { BIAS, POOLED, LEFT };

static double term_of(const struct regression *r, size_t light, size_t place, int term)
{
    const struct kiln_neighbour_point *p = &r->grid->points[place];
    const struct estimate *e = &r->estimates[light][place];
    const float value = term == BIAS ? e->bias : term == POOLED ? e->pooled : r->lights[light].variance[p->index];
    return (double)p->area * (double)value;
}

/* Whether a point is counted here. */
static bool is_own(const struct regression *r, size_t place)
{
    return r->part == NULL || r->grid->points[place].index < r->part->own;
}

/* Whether other ranks have other parts of the surface. */
static bool is_shared(const struct kiln_regression_subdomain *part) { return part != NULL && part->agree != NULL; }

static size_t count_of(const struct regression *r) { return r->grid != NULL ? r->grid->count : 0; }

static int find_most(const struct regression *r, size_t light, int term, double *most, struct kiln_error *error)
{
    double here = 0.0;
#pragma omp parallel for reduction(max : here)
    for (size_t i = 0; i < count_of(r); i++)
        if (is_own(r, i))
            here = fmax(here, term_of(r, light, i, term));
    *most = here;
    return is_shared(r->part) ? r->part->most(r->part->context, most, 1, error) : KILN_OK;
}

/* The sum of a term over all points. */
static int sum_up(const struct regression *r, size_t light, int term, double *sum, struct kiln_error *error)
{
    double most = 0.0;
    uint64_t low = 0, high = 0; /* low 32 bits of the numbers, and the rest */
    int status = find_most(r, light, term, &most, error);
    *sum = most;
    if (status != KILN_OK || !(most > 0.0) || !isfinite(most) || !isnormal(0x1p62 / most))
        return status;
#pragma omp parallel for reduction(+ : low, high)
    for (size_t i = 0; i < count_of(r); i++)
        if (is_own(r, i)) {
            const uint64_t number = (uint64_t)(fmax(term_of(r, light, i, term), 0.0) * (0x1p62 / most));
            low += number & UINT32_MAX;
            high += number >> 32;
        }
    uint64_t parts[2] = {low, high};
    if (is_shared(r->part))
        status = r->part->sum(r->part->context, parts, 2, error);
    *sum = ((double)parts[0] + (double)parts[1] * 0x1p32) * (most * 0x1p-62);
    return status;
}

/* Computes the remaining variance at all points, and its sum. */
static int state(const struct regression *r, size_t light, struct kiln_error *error)
{
    struct kiln_regression_light *of = &r->lights[light];
    double bias = 0.0;
    int status = sum_up(r, light, BIAS, &bias, error);
    if (status == KILN_OK)
        status = sum_up(r, light, POOLED, &of->before, error);
    /* mean squared bias over mean pooled variance */
    const float mean = of->before > 0.0 ? (float)(bias / of->before) : 0.0f;
#pragma omp parallel for if (status == KILN_OK)
    for (size_t i = 0; i < (status == KILN_OK ? count_of(r) : 0); i++) {
        const struct estimate *e = &r->estimates[light][i];
        of->variance[r->grid->points[i].index] = fminf(e->noise + fmaxf(e->bias, mean * e->pooled), e->pooled);
    }
    return status == KILN_OK ? sum_up(r, light, LEFT, &of->after, error) : status;
}

/* ---- all sweeps over the points that are here ---- */

static int run_sweeps(struct regression *r, struct kiln_error *error)
{
    int status;
    KILN_TRY(begin_estimates(r, error));
    KILN_TRY(kiln_neighbours_kept_create(&r->kept, r->grid, KILN_REGRESSION_KEPT, error));
    KILN_TRY(sweep(r, KILN_NEIGHBOUR_RADIUS, FAR, fit_point, error));
    KILN_TRY(sweep(r, kiln_neighbour_rings[WIDE], 2, pool_variance, error));
    estimate_risks(r);
    KILN_TRY(sweep(r, kiln_neighbour_rings[WIDE], 1, judge_point, error));
    KILN_TRY(sweep(r, KILN_NEIGHBOUR_RADIUS, 0, smooth_point, error));
end:
    kiln_neighbours_kept_release(&r->kept);
    return status;
}

static void give_points(void *context, size_t first, size_t count, struct kiln_gpu_regression_point *points,
                        struct kiln_gpu_regression_given *given)
{
    const struct regression *r = context;
#pragma omp parallel for
    for (size_t i = 0; i < count; i++) {
        const struct kiln_neighbour_point *p = &r->grid->points[first + i];
        points[i] = (struct kiln_gpu_regression_point){.position = {p->position[0], p->position[1], p->position[2]},
                                                       .normal = {p->normal[0], p->normal[1], p->normal[2]},
                                                       .area = p->area,
                                                       .size = p->size};
        for (size_t l = 0; l < r->light_count; l++) {
            const float *rgb = r->values[l][first + i];
            given[i * r->light_count + l] =
                (struct kiln_gpu_regression_given){.rgb = {rgb[0], rgb[1], rgb[2]},
                                                   .luminance = luminance_of(r, l, first + i),
                                                   .variance = r->lights[l].variance[p->index]};
        }
    }
}

static void take_results(void *context, size_t first, size_t count, const struct kiln_gpu_regression_result *results)
{
    const struct regression *r = context;
#pragma omp parallel for
    for (size_t i = 0; i < count; i++)
        for (size_t l = 0; l < r->light_count; l++) {
            const struct kiln_gpu_regression_result *from = &results[i * r->light_count + l];
            struct estimate *e = &r->estimates[l][first + i];
            const size_t index = r->grid->points[first + i].index;
            e->noise = from->noise;
            e->bias = from->bias;
            e->pooled = from->pooled;
            r->lights[l].rgb[0][index] = from->rgb.x;
            r->lights[l].rgb[1][index] = from->rgb.y;
            r->lights[l].rgb[2][index] = from->rgb.z;
        }
}

/* Runs all sweeps on the device instead of run_sweeps. *done: whether it did. It does not if there is no device, or if
 * there is other light (most_others), which the device does not support. */
static int run_on_device(struct regression *r, struct kiln_regression_device *device, bool *done,
                         struct kiln_error *error)
{
    struct kiln_neighbour_ranges ranges;
    *done = false;
    if (device == NULL || most_others(r) > 0)
        return KILN_OK;
    int status = kiln_neighbour_ranges_list(&ranges, r->grid, error);
    const struct kiln_regression_work work = {.count = (uint32_t)r->grid->count,
                                              .lights = (uint32_t)r->light_count,
                                              .cells = ranges.cells,
                                              .cell_count = r->grid->cell_count,
                                              .first = ranges.first,
                                              .ranges = (const uint32_t(*)[2])ranges.ranges,
                                              .give = give_points,
                                              .take = take_results,
                                              .context = r};
    if (status == KILN_OK)
        status = kiln_regression_device_run(device, &work, done, error);
    kiln_neighbour_ranges_release(&ranges);
    return status;
}

static int run_here(struct regression *r, struct kiln_regression_device *device, struct kiln_error *error)
{
    bool done;
    int status = take_values(r, error);
    if (status == KILN_OK)
        status = run_on_device(r, device, &done, error);
    return status == KILN_OK && !done ? run_sweeps(r, error) : status;
}

int kiln_regression_run(const struct kiln_neighbour_grid *grid, struct kiln_regression_light *lights, size_t count,
                        const struct kiln_regression_subdomain *part, struct kiln_regression_device *device,
                        struct kiln_error *error)
{
    struct regression r = {.grid = grid, .lights = lights, .light_count = count, .part = part};
    int status = grid != NULL ? run_here(&r, device, error) : KILN_OK;
    if (is_shared(part))
        status = part->agree(part->context, status, error);
    for (size_t l = 0; l < count; l++) {
        if (status == KILN_OK)
            status = state(&r, l, error);
        kiln_free(&r.estimates[l]);
        kiln_free(&r.values[l]);
        kiln_free(&r.others[l]);
    }
    kiln_free(&r.numbers);
    return status;
}
