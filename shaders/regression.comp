/* Surface regression for denoising: one sweep over points; thread x processes one point. The sweeps and their formulas
 * equal those of coordinator/output/map/denoise/regression.c, with the same names; neighbours are those of
 * neighbours.c. Sums over neighbours are in the order of the points, so that results depend only on the points. */
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "shaders/kernel.glsl"

KILN_PUSH(kiln_gpu_regression_push);

#include "shaders/real.glsl"

/* The kernel's own constant: the sweep. */
layout(constant_id = 6) const uint SWEEP = 0u;
const uint FIT = 0u, POOL = 1u, RISK = 2u, JUDGE = 3u, SMOOTH = 4u;

KILN_ARRAY(Points, kiln_gpu_regression_point, 4);
KILN_ARRAY(Given, kiln_gpu_regression_given, 4);
KILN_ARRAY(Choices, kiln_gpu_regression_choice, 4);
KILN_ARRAY(Results, kiln_gpu_regression_result, 4);
KILN_ARRAY(Words, uint, 4);
KILN_ARRAY(Floats, float, 4);

const int SCALES = KILN_REGRESSION_SCALES, FITS = KILN_REGRESSION_FITS, RAW = KILN_REGRESSION_RAW, LIGHTS = 2,
          TERMS = 6, NARROW = 1, WIDE = 4, QUADRATIC = FITS - SCALES, QUADRATIC_NARROW = SCALES + 1;
const float scales[SCALES] = {0.75, 1.0, 1.5, 2.0, 3.0, 4.0};
const int scale_of[FITS] = {0, 1, 2, 3, 4, 5, 1, 2, 3, 5};

Points points = Points(push.points);
Words ranges = Words(push.ranges);

/* ---- neighbours ---- */

/* A point whose neighbours are searched. */
struct Middle {
    uint place;
    uint first, end; /* ranges of candidates */
    vec3 at, normal, tangent, bitangent;
    float inverse; /* 1 / size */
};

Middle middle_of(uint place)
{
    Middle m;
    const kiln_gpu_regression_point p = points.at[place];
    const uint cell = Words(push.cells).at[place];
    m.place = place;
    m.first = Words(push.firsts).at[cell];
    m.end = Words(push.firsts).at[cell + 1u];
    m.at = p.position;
    m.normal = p.normal;
    m.inverse = 1.0 / p.size;
    const vec3 n = p.normal;
    const float sign = (floatBitsToUint(n.z) & 0x80000000u) != 0u ? -1.0 : 1.0, s = -1.0 / (sign + n.z),
                q = n.x * n.y * s;
    m.tangent = vec3(1.0 + sign * n.x * n.x * s, sign * q, -sign * n.x);
    m.bitangent = vec3(q, sign + n.y * n.y * s, -n.y);
    return m;
}

/* Whether a candidate is a neighbour within `radius` texels; its coordinates, and its area. */
bool is_near(Middle m, uint place, float radius, out vec2 xy, out float area)
{
    const vec3 d = (points.at[place].position - m.at) * m.inverse;
    const float square = dot(d, d);
    if (!(square < radius * radius) || place == m.place)
        return false;
    const float cosine = dot(points.at[place].normal, m.normal), off = abs(dot(d, m.normal)) - 0.05,
                sine = abs(1.0 - cosine * cosine);
    xy = vec2(dot(d, m.tangent), dot(d, m.bitangent));
    area = points.at[place].area;
    return cosine >= KILN_NEIGHBOUR_COSINE && (off <= 0.0 || off * off <= 0.36 * square * sine);
}

/* For each neighbour j of m within `radius`, with xy and area. */
#define FOR_NEIGHBOURS(m, radius)                                                                                      \
    vec2 xy;                                                                                                           \
    float area;                                                                                                        \
    for (uint range = m.first; range < m.end; range++)                                                                 \
        for (uint j = ranges.at[2u * range]; j < ranges.at[2u * range + 1u]; j++)                                      \
            if (is_near(m, j, radius, xy, area))

/* Square root of weight / area, for a neighbour at a squared distance; 0 outside the kernel. */
float root_weight(float square, float scale) { return max(1.0 - square * (0.25 / (scale * scale)), 0.0); }

float weight_of(vec2 xy, float area, int scale)
{
    const float u = root_weight(dot(xy, xy), scales[scale]);
    return u * u * area;
}

/* ---- one fit ---- */

/* Sums over neighbours of weight x 1, x, y, xx, xy, yy, and for quadratic fits xxx, xxy, xyy, yyy, x4, x3y, xxyy, xy3,
 * y4. */
const int LOW = 6, HIGH = 9;

struct Fit {
    real of[TERMS]; /* factors of 1, x, y, xx, xy, yy */
    real leverage;
};

Fit solve(float m[LOW], float own)
{
    const real ridge = real(1e-5LF);
    const real w = real(m[0]) + real(own), x = real(m[1]) / w, y = real(m[2]) / w;
    const real xx = real(m[3]) / w - x * x, yy = real(m[5]) / w - y * y, xy = real(m[4]) / w - x * y;
    const real a = max(xx, real(0)) + ridge, b = max(yy, real(0)) + ridge, determinant = a * b - xy * xy;
    Fit fit;
    [[unroll]] for (int i = 1; i < TERMS; i++) fit.of[i] = real(0);
    fit.of[0] = 1 / w;
    if (determinant > real(1e-3LF) * ridge * max(a, b)) {
        fit.of[1] = -(x * b - y * xy) / determinant / w;
        fit.of[2] = -(y * a - x * xy) / determinant / w;
        fit.of[0] -= fit.of[1] * x + fit.of[2] * y;
    }
    fit.leverage = fit.of[0] * real(own);
    return fit;
}

/* Moment: the sum of weight x x^a y^b, with order = a + b, and y = b. */
float moment(float low[LOW], float high[HIGH], float own, int order, int y)
{
    switch (order) {
    case 0:
        return low[0] + own;
    case 1:
        return low[1 + y];
    case 2:
        return low[3 + y];
    case 3:
        return high[y];
    default:
        return high[4 + y];
    }
}

Fit solve_quadratic(float low[LOW], float high[HIGH], float own, real radius)
{
    const int power_x[TERMS] = {0, 1, 0, 2, 1, 0}, power_y[TERMS] = {0, 0, 1, 0, 1, 2};
    const real sum = real(low[0]) + real(own), inverse = 1 / radius;
    real powers[5];
    powers[0] = real(1);
    [[unroll]] for (int i = 1; i < 5; i++) powers[i] = powers[i - 1] * inverse;
    real m[TERMS][TERMS], column[TERMS];
    [[unroll]] for (int i = 0; i < TERMS; i++) [[unroll]] for (int j = 0; j <= i; j++)
    {
        const int y = power_y[i] + power_y[j], order = power_x[i] + power_x[j] + y;
        m[i][j] =
            real(moment(low, high, own, order, y)) * powers[order] / sum + (i == j && i > 0 ? real(1e-6LF) : real(0));
        [[unroll]] for (int k = 0; k < j; k++) m[i][j] -= m[i][k] * m[j][k];
        m[i][j] = i == j ? sqrt(max(m[i][j], real(1e-12LF))) : m[i][j] / m[j][j];
    }
    [[unroll]] for (int i = 0; i < TERMS; i++)
    {
        column[i] = i == 0 ? real(1) : real(0);
        [[unroll]] for (int k = 0; k < i; k++) column[i] -= m[i][k] * column[k];
        column[i] /= m[i][i];
    }
    [[unroll]] for (int i = TERMS - 1; i >= 0; i--)
    {
        [[unroll]] for (int k = i + 1; k < TERMS; k++) column[i] -= m[k][i] * column[k];
        column[i] /= m[i][i];
    }
    Fit fit;
    fit.leverage = column[0] / sum * real(own);
    [[unroll]] for (int i = 0; i < TERMS; i++) fit.of[i] = column[i] * powers[power_x[i] + power_y[i]] / sum;
    return fit;
}

/* Sums for the fits of one scale. */
struct Moments {
    float low[LOW], high[HIGH];
};

bool is_quadratic(int scale) { return scale != 0 && scale != 4; }

Moments no_moments()
{
    Moments m;
    [[unroll]] for (int i = 0; i < LOW; i++) m.low[i] = 0.0;
    [[unroll]] for (int i = 0; i < HIGH; i++) m.high[i] = 0.0;
    return m;
}

void add_moments(inout Moments m, vec2 p, float weight, bool quadratic)
{
    const float wx = weight * p.x, wy = weight * p.y, xx = wx * p.x, yy = wy * p.y;
    m.low[0] += weight;
    m.low[1] += wx;
    m.low[2] += wy;
    m.low[3] += xx;
    m.low[4] += wx * p.y;
    m.low[5] += yy;
    if (!quadratic)
        return;
    m.high[0] += xx * p.x;
    m.high[1] += xx * p.y;
    m.high[2] += yy * p.x;
    m.high[3] += yy * p.y;
    m.high[4] += xx * p.x * p.x;
    m.high[5] += xx * p.x * p.y;
    m.high[6] += xx * p.y * p.y;
    m.high[7] += yy * p.x * p.y;
    m.high[8] += yy * p.y * p.y;
}

Fit make_fit(Moments m, int fit, float own)
{
    if (fit < SCALES)
        return solve(m.low, own);
    return solve_quadratic(m.low, m.high, own, real(2.0 * scales[scale_of[fit]]));
}

/* ---- what lies in memory ---- */

Floats fits_from(uint place)
{
    return Floats(push.fits + uint64_t(place) * uint64_t((1u + push.lights) * uint(FITS) * 4u));
}

/* Index of light l of a point; if there is no second light, that of the first. */
uint light_of(uint place, int light) { return place * push.lights + min(uint(light), push.lights - 1u); }

kiln_gpu_regression_given given(uint place, int light)
{
    return Given(push.given + uint64_t(light_of(place, light)) * 20ul).at[0];
}

Choices choice(uint place, int light) { return Choices(push.choices + uint64_t(light_of(place, light)) * 16ul); }

bool is_there(int light) { return uint(light) < push.lights; }

/* ---- the sweeps ---- */

void fit_point(uint place)
{
    const Middle m = middle_of(place);
    const float own = points.at[place].area, value0 = given(place, 0).luminance, value1 = given(place, 1).luminance;
    Moments sums[SCALES];
    vec2 by[SCALES][TERMS]; /* sums of weight x the fit's terms x (value - own value) of both lights */
    [[unroll]] for (int s = 0; s < SCALES; s++)
    {
        sums[s] = no_moments();
        [[unroll]] for (int i = 0; i < TERMS; i++) by[s][i] = vec2(0.0);
    }
    FOR_NEIGHBOURS(m, KILN_NEIGHBOUR_RADIUS)
    {
        const vec2 difference = vec2(given(j, 0).luminance - value0, given(j, 1).luminance - value1);
        [[unroll]] for (int s = 0; s < SCALES; s++)
        {
            const float weight = weight_of(xy, area, s);
            if (!(weight > 0.0))
                continue;
            const vec2 d = weight * difference;
            add_moments(sums[s], xy, weight, is_quadratic(s));
            by[s][0] += d;
            by[s][1] += d * xy.x;
            by[s][2] += d * xy.y;
            if (is_quadratic(s)) {
                by[s][3] += d * xy.x * xy.x;
                by[s][4] += d * xy.x * xy.y;
                by[s][5] += d * xy.y * xy.y;
            }
        }
    }
    Floats out_fits = fits_from(place);
    [[unroll]] for (int f = 0; f < FITS; f++)
    {
        const Fit fit = make_fit(sums[scale_of[f]], f, own);
        real away0 = real(0), away1 = real(0);
        [[unroll]] for (int i = 0; i < TERMS; i++)
        {
            away0 += fit.of[i] * real(by[scale_of[f]][i].x);
            away1 += fit.of[i] * real(by[scale_of[f]][i].y);
        }
        out_fits.at[f] = float(clamp(fit.leverage, real(0), real(1)));
        out_fits.at[FITS + f] = float(away0 * away0);
        if (is_there(1))
            out_fits.at[2 * FITS + f] = float(away1 * away1);
    }
}

void pool_variance(uint place)
{
    const Middle m = middle_of(place);
    const int second = is_there(1) ? 2 * FITS : FITS;
    Floats here = fits_from(place);
    float weight = points.at[place].area;
    vec2 leverage = weight * vec2(here.at[NARROW], here.at[QUADRATIC_NARROW]); /* of both fits */
    vec2 variance = weight * vec2(given(place, 0).variance, given(place, 1).variance),
         square = weight * vec2(here.at[FITS + NARROW], here.at[second + NARROW]),
         curved = weight * vec2(here.at[FITS + QUADRATIC_NARROW], here.at[second + QUADRATIC_NARROW]);
    FOR_NEIGHBOURS(m, 2.0 * scales[WIDE])
    {
        const float w = weight_of(xy, area, WIDE);
        Floats fits = fits_from(j);
        weight += w;
        leverage += w * vec2(fits.at[NARROW], fits.at[QUADRATIC_NARROW]);
        variance += w * vec2(given(j, 0).variance, given(j, 1).variance);
        square += w * vec2(fits.at[FITS + NARROW], fits.at[second + NARROW]);
        curved += w * vec2(fits.at[FITS + QUADRATIC_NARROW], fits.at[second + QUADRATIC_NARROW]);
    }
    const vec2 part = 1.0 - vec2(1.4, 1.24) * leverage / weight;
    const vec2 scatter = min(part.x > 0.25 ? square / part.x : variance, part.y > 0.25 ? curved / part.y : variance),
               pooled = min(variance, scatter) / weight;
    choice(place, 0).at[0].pooled = pooled.x;
    if (is_there(1))
        choice(place, 1).at[0].pooled = pooled.y;
}

void estimate_risks(uint place)
{
    Floats fits = fits_from(place);
    for (int l = 0; l < LIGHTS && is_there(l); l++) {
        const float pooled = choice(place, l).at[0].pooled;
        for (int f = 0; f < FITS && pooled > 0.0; f++) {
            const int at = (1 + l) * FITS + f;
            fits.at[at] = min(fits.at[at] / pooled - 1.0 + 2.0 * fits.at[f], 1000.0);
        }
    }
}

void choose(uint place, int light, float weight, float leverage[FITS], float risks[FITS])
{
    kiln_gpu_regression_choice e = choice(place, light).at[0];
    float least = 0.9;
    e.choice = uint(RAW);
    e.part = 0.0;
    [[unroll]] for (int f = 0; f < FITS; f++)
    {
        const float free = 1.0 - leverage[f] / weight, square = max(risks[f] / weight - 1.0 + 2.0 * free, 1e-6);
        const float part = min(free / square, 1.0), risk = 1.0 + part * (part * square - 2.0 * free);
        if (e.pooled > 0.0 && free > 1.0 - 0.95 && risk < least) {
            least = risk;
            e.choice = uint(f);
            e.part = part;
        }
    }
    e.risk = (e.choice == uint(RAW) ? 1.0 : max(least, 0.0)) * e.pooled;
    choice(place, light).at[0] = e;
}

void judge_point(uint place)
{
    const Middle m = middle_of(place);
    float weight = points.at[place].area, leverage[FITS], risk0[FITS], risk1[FITS];
    const int second = is_there(1) ? 2 * FITS : FITS;
    [[unroll]] for (int f = 0; f < FITS; f++)
    {
        leverage[f] = weight * fits_from(place).at[f];
        risk0[f] = weight * fits_from(place).at[FITS + f];
        risk1[f] = weight * fits_from(place).at[second + f];
    }
    FOR_NEIGHBOURS(m, 2.0 * scales[WIDE])
    {
        const float w = weight_of(xy, area, WIDE);
        Floats fits = fits_from(j);
        weight += w;
        [[unroll]] for (int f = 0; f < FITS; f++)
        {
            leverage[f] += w * fits.at[f];
            risk0[f] += w * fits.at[FITS + f];
            risk1[f] += w * fits.at[second + f];
        }
    }
    choose(place, 0, weight, leverage, risk0);
    if (is_there(1))
        choose(place, 1, weight, leverage, risk1);
}

/* Shares of the fits chosen around a point, for both lights. */
struct Shares {
    vec2 of[FITS], risk;
};

void add_share(inout Shares shares, uint place, float weight)
{
    const kiln_gpu_regression_choice a = choice(place, 0).at[0], b = choice(place, 1).at[0];
    [[unroll]] for (int f = 0; f < FITS; f++) shares.of[f] +=
        weight * vec2(a.choice == uint(f) ? a.part : 0.0, b.choice == uint(f) ? b.part : 0.0);
    shares.risk += weight * vec2(a.risk, b.risk);
}

Shares share_choices(Middle m, float own)
{
    Shares shares;
    float sum = own;
    shares.risk = vec2(0.0);
    [[unroll]] for (int f = 0; f < FITS; f++) shares.of[f] = vec2(0.0);
    add_share(shares, m.place, own);
    FOR_NEIGHBOURS(m, 2.0 * scales[NARROW])
    {
        const float weight = weight_of(xy, area, NARROW);
        if (weight > 0.0) {
            add_share(shares, j, weight);
            sum += weight;
        }
    }
    shares.risk /= sum;
    [[unroll]] for (int f = 0; f < FITS; f++) shares.of[f] /= sum;
    return shares;
}

/* Factors of the terms in the result, by scale, for both lights. */
struct Factors {
    vec2 of[SCALES][TERMS];
    float reach; /* texels: beyond, all are 0 */
};

Factors find_factors(Middle m, Shares shares, float own)
{
    Factors factors;
    Moments sums[SCALES];
    factors.reach = 0.0;
    [[unroll]] for (int s = 0; s < SCALES; s++)
    {
        sums[s] = no_moments();
        [[unroll]] for (int i = 0; i < TERMS; i++) factors.of[s][i] = vec2(0.0);
    }
    [[unroll]] for (int f = 0; f < FITS; f++) if (shares.of[f].x > 0.0 || shares.of[f].y > 0.0) factors.reach =
        max(factors.reach, 2.0 * scales[scale_of[f]]);
    FOR_NEIGHBOURS(m, factors.reach)
    {
        [[unroll]] for (int s = 0; s < SCALES; s++)
        {
            const float weight = weight_of(xy, area, s);
            if (weight > 0.0)
                add_moments(sums[s], xy, weight, is_quadratic(s));
        }
    }
    [[unroll]] for (int f = 0; f < FITS; f++)
    {
        const vec2 share = shares.of[f];
        if (!(share.x > 0.0) && !(share.y > 0.0))
            continue;
        const Fit fit = make_fit(sums[scale_of[f]], f, own);
        if (fit.leverage < real(0.95LF)) [[unroll]]
            for (int i = 0; i < TERMS; i++)
                factors.of[scale_of[f]][i] += share * float(fit.of[i]);
    }
    return factors;
}

vec2 factor_of(Factors factors, vec2 p, float area)
{
    vec2 factor = vec2(0.0);
    [[unroll]] for (int s = 0; s < SCALES; s++)
    {
        const float weight = weight_of(p, area, s);
        const vec2 linear = factors.of[s][0] + factors.of[s][1] * p.x + factors.of[s][2] * p.y;
        if (weight > 0.0)
            factor += weight * (is_quadratic(s) ? linear + (factors.of[s][3] * p.x + factors.of[s][4] * p.y) * p.x +
                                                      factors.of[s][5] * p.y * p.y
                                                : linear);
    }
    return factor;
}

void give(uint place, int light, vec3 sum, float noise, float risk)
{
    kiln_gpu_regression_result r;
    r.rgb = max(given(place, light).rgb + sum, vec3(0.0));
    r.noise = noise;
    r.bias = max(risk - noise, 0.0);
    r.pooled = choice(place, light).at[0].pooled;
    Results(push.results + uint64_t(light_of(place, light)) * 24ul).at[0] = r;
}

void smooth_point(uint place)
{
    const Middle m = middle_of(place);
    const float own_area = points.at[place].area;
    const Shares shares = share_choices(m, own_area);
    const Factors factors = find_factors(m, shares, own_area);
    const vec3 at0 = given(place, 0).rgb, at1 = given(place, 1).rgb;
    vec3 sum0 = vec3(0.0), sum1 = vec3(0.0);
    vec2 own = vec2(1.0), variance = vec2(0.0);
    FOR_NEIGHBOURS(m, factors.reach)
    {
        const vec2 factor = factor_of(factors, xy, area);
        sum0 += factor.x * (given(j, 0).rgb - at0);
        sum1 += factor.y * (given(j, 1).rgb - at1);
        own -= factor;
        variance += factor * factor * vec2(choice(j, 0).at[0].pooled, choice(j, 1).at[0].pooled);
    }
    variance += own * own * vec2(choice(place, 0).at[0].pooled, choice(place, 1).at[0].pooled);
    give(place, 0, sum0, variance.x, shares.risk.x);
    if (is_there(1))
        give(place, 1, sum1, variance.y, shares.risk.y);
}

void kiln_kernel(uint x, uint y)
{
    const uint place = push.first + x;
    if (x >= push.count || y > 0u)
        return;
    if (SWEEP == FIT)
        fit_point(place);
    else if (SWEEP == POOL)
        pool_variance(place);
    else if (SWEEP == RISK)
        estimate_risks(place);
    else if (SWEEP == JUDGE)
        judge_point(place);
    else
        smooth_point(place);
}

#include "shaders/main.glsl"
