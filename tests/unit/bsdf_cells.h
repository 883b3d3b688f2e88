/* Draws of scattering functions against their densities: cells of directions, what a density promises of them, and
 * chi-squared. The density is asked for by a function. Include after cmocka.h. */
#ifndef KILN_TESTS_UNIT_BSDF_CELLS_H
#define KILN_TESTS_UNIT_BSDF_CELLS_H

#include <math.h>

#include "shaders/shared/bsdf.h"
#include "tests/unit/bsdf_materials.h"

enum { ALPHAS = 10, ANGLES = 8 };

static const float alphas[ALPHAS] = {0.001f, 0.003f, 0.01f, 0.03f, 0.08f, 0.2f, 0.35f, 0.5f, 0.75f, 1.0f};
static const float degrees[ANGLES] = {0.0f, 15.0f, 30.0f, 45.0f, 60.0f, 70.0f, 80.0f, 85.0f};

static inline struct kiln_vec3 direction(float angle, float turn, bool behind)
{
    const float a = angle * (float)KILN_PI / 180.0f, z = cosf(a);
    return vec3(sinf(a) * cosf(turn), sinf(a) * sinf(turn), behind ? -z : z);
}

enum { RINGS = 18, SECTORS = 8, CELLS = 2 * RINGS * SECTORS, DRAWS = 4096 };

/* Cells about the mirror direction above the face of o, about the direction of smooth refraction beyond it. */
struct chart {
    struct kiln_dvec3 axis, s, t;
    double edges[RINGS + 1]; /* angles from the axis */
    double side;             /* 1: z > 0; -1: z < 0 */
};

static inline struct chart chart_about(struct kiln_vec3 axis, double alpha, double side)
{
    struct chart c = {.axis = dvec3_of(axis), .side = side};
    struct kiln_vec3 s, t;
    kiln_basis(axis, &s, &t);
    c.s = dvec3_of(s);
    c.t = dvec3_of(t);
    const double first = fmin(0.3, 0.3 * alpha);
    for (int k = 1; k <= RINGS; k++)
        c.edges[k] = first * pow(KILN_PI / first, (k - 1) / (RINGS - 1.0));
    return c;
}

static inline struct kiln_dvec3 chart_direction(const struct chart *c, double angle, double turn)
{
    const struct kiln_dvec3 round = dvec3_add(dvec3_scale(c->s, cos(turn)), dvec3_scale(c->t, sin(turn)));
    return dvec3_add(dvec3_scale(c->axis, cos(angle)), dvec3_scale(round, sin(angle)));
}

static inline int chart_cell(const struct chart *c, struct kiln_vec3 i)
{
    const struct kiln_dvec3 w = dvec3_of(i);
    const double x = dvec3_dot(w, c->s), y = dvec3_dot(w, c->t);
    const double angle = atan2(sqrt(x * x + y * y), dvec3_dot(w, c->axis));
    int ring = 0;
    while (ring < RINGS - 1 && angle >= c->edges[ring + 1])
        ring++;
    const int sector = (int)floor((atan2(y, x) / (2.0 * KILN_PI) + 1.0) * SECTORS) % SECTORS;
    return ring * SECTORS + sector;
}

/* The density of drawing i, per steradian. */
typedef double density_of(void *context, struct kiln_vec3 i);

/* The probability of a cell; *whole is false where the horizon cuts it. Near the horizon, where the light comes at
 * cosine z, lobes are narrow across: the sector is cut into pieces. */
static inline double cell_probability(const struct chart *c, int cell, double z, density_of *density, void *context,
                                      bool *whole)
{
    static const double place[4] = {0.06943184, 0.33000948, 0.66999052, 0.93056816};
    static const double share[4] = {0.17392742, 0.32607258, 0.32607258, 0.17392742};
    const int pieces = 1 + (int)(0.4 / fmax(fabs(z), 0.02));
    const double low = c->edges[cell / SECTORS], wide = c->edges[cell / SECTORS + 1] - low;
    const double turn = 2.0 * KILN_PI / SECTORS, from = turn * (cell % SECTORS);
    double sum = 0.0;
    *whole = true;
    for (int a = 0; a < 4; a++) /* corners */
        *whole = *whole && chart_direction(c, low + (a & 1) * wide, from + (a >> 1) * turn).z * c->side > 0.0;
    for (int a = 0; a < 16 * pieces; a++) {
        const double angle = low + place[a & 3] * wide;
        const double at = from + turn * (place[a >> 2 & 3] + (a >> 4)) / pieces;
        const struct kiln_dvec3 i = chart_direction(c, angle, at);
        if (i.z * c->side > 0.0)
            sum += share[a & 3] * share[a >> 2 & 3] * sin(angle) * density(context, vec3_of(i));
        else
            *whole = false;
    }
    return sum * wide * turn / pieces;
}

/* Returns by how many standard deviations chi-squared of so many degrees of freedom lies above its mean (Wilson and
 * Hilferty, "The Distribution of Chi-square", PNAS 1931). */
static inline double deviations(double squared, int freedom)
{
    const double b = 2.0 / (9.0 * freedom);
    return (cbrt(squared / freedom) - (1.0 - b)) / sqrt(b);
}

struct fit {
    double deviations; /* of draws from densities */
    double total;      /* integral of the density, with the share of draws that end */
};

/* Counts of DRAWS draws by cell: those that a density promises, and those that have come. */
struct cells {
    struct chart charts[2];
    double wanted[CELLS + 1];
    unsigned found[CELLS + 1], ended;
    bool whole[CELLS];
};

static inline void cells_expect(struct cells *c, double z, density_of *density, void *context)
{
    for (int k = 0; k < CELLS; k++)
        c->wanted[k] =
            DRAWS * cell_probability(&c->charts[k / (CELLS / 2)], k % (CELLS / 2), z, density, context, &c->whole[k]);
}

static inline void cells_count(struct cells *c, struct kiln_vec3 i, bool drawn)
{
    const int half = (double)i.z * c->charts[0].side > 0.0 ? 0 : 1;
    if (drawn)
        c->found[half * (CELLS / 2) + chart_cell(&c->charts[half], i)]++;
    else
        c->ended++;
}

static inline struct fit cells_judge(struct cells *c)
{
    double squared = 0.0, total = (double)c->ended / DRAWS;
    int freedom = 0;
    c->wanted[CELLS] = DRAWS; /* the rest in one */
    c->found[CELLS] = DRAWS;
    for (int k = 0; k < CELLS; k++) {
        total += c->wanted[k] / DRAWS;
        if (!c->whole[k] || c->wanted[k] < 10.0)
            continue;
        squared += (c->found[k] - c->wanted[k]) * (c->found[k] - c->wanted[k]) / c->wanted[k];
        c->wanted[CELLS] -= c->wanted[k];
        c->found[CELLS] -= c->found[k];
        freedom++;
    }
    if (c->wanted[CELLS] >= 10.0)
        squared += (c->found[CELLS] - c->wanted[CELLS]) * (c->found[CELLS] - c->wanted[CELLS]) / c->wanted[CELLS];
    return (struct fit){freedom < 2 ? 0.0 : deviations(squared, freedom), total};
}

/* Cells for light that comes from o: about where a mirror sends it, and where smooth glass lets it through. */
static inline void cells_place(struct cells *c, const struct kiln_bsdf_lobes *l, float alpha, struct kiln_vec3 o)
{
    const bool behind = o.z < 0.0f;
    struct kiln_vec3 beyond = vec3(-o.x, -o.y, -o.z);
    if (l->p.thin_wall == 0u) {
        const float eta = kiln_bsdf_eta(l->p, !behind).y, through = kiln_refracted_cosine(fabsf(o.z), eta);
        if (through > 0.0f)
            beyond = vec3(-o.x / eta, -o.y / eta, behind ? through : -through);
    }
    const double side = behind ? -1.0 : 1.0;
    *c = (struct cells){
        .charts = {chart_about(vec3(-o.x, -o.y, o.z), (double)alpha, side), chart_about(beyond, (double)alpha, -side)}};
}

static inline double apart(double a, double b) { return fabs(a - b) / fmax(fmax(fabs(a), fabs(b)), 1e-30); }

#endif
