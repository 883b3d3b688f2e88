#include "worker/backend/embree/spheres.h"

#include <math.h>

#define SEEN 0.9999          /* of the way from a sphere's middle to a place: rounding puts neither into a surface */
#define SUM_MOST 0x1p61      /* of one chord, in units: what the conversion to a whole number takes */
#define LEAST_DIRECTION 1e-9 /* spacings a metre: along such an axis a part does not move */

/* A part of a path, and its place in the grid: in spacings from probe (0, 0, 0). */
struct way {
    struct walk *walk;
    const struct kiln_probe_spheres *spheres;
    const struct spheres_part *part;
    struct kiln_dvec3 origin, direction; /* of the part */
    double from[3], slope[3];            /* spacings; spacings a metre */
    double reach[3];                     /* spacings: how far along an axis from its number a probe's sphere extends */
    double begin, end;                   /* m: where there are spheres */
};

/* ---- one sphere ---- */

static bool sees(const struct way *w, const struct kiln_sphere *sphere, struct kiln_dvec3 place)
{
    const struct kiln_vec3 middle = vec3(sphere->centre[0], sphere->centre[1], sphere->centre[2]);
    const struct kiln_dvec3 to = dvec3_sub(place, dvec3_of(middle));
    const double length = dvec3_length(to);
    struct RTCRayHit ray;
    float tint[3];
    if (!(length > 0.0))
        return true;
    const struct kiln_vec3 direction = vec3_of(dvec3_scale(to, 1.0 / length));
    w->walk->rays++;
    return !meeting_trace(w->walk->b, w->walk->context, middle, direction, (float)(SEEN * length),
                          kiln_ray_seed(middle, direction), &ray, tint);
}

/* The flux at a distance along the part: less what the body takes that the part lies in, and what tints on the way. */
static void find_flux(const struct way *w, double distance, double flux[3])
{
    const struct spheres_part *part = w->part;
    const struct embree_backend *b = w->walk->b;
    float share[3], tint[3] = {1.0f, 1.0f, 1.0f};
    struct RTCRayHit ray;
    if (part->end == NULL || !meeting_attenuation(part->end, (float)distance, share))
        share[0] = share[1] = share[2] = 1.0f;
    if (embree_tints(b))
        (void)meeting_trace(b, w->walk->context, part->origin, part->direction, (float)distance, part->chance, &ray,
                            tint);
    for (int c = 0; c < 3; c++)
        flux[c] = part->flux[c] * (double)(share[c] * tint[c]);
}

static void add(const struct way *w, size_t sphere, double distance, double chord)
{
    const struct kiln_probe_spheres *s = w->spheres;
    double weights[KILN_SPHERE_WEIGHTS], flux[3];
    uint64_t *sums = s->sums + KILN_SPHERE_SUMS * sphere;
    find_flux(w, distance, flux);
    spheres_weights(dvec3_scale(w->direction, -1.0), weights);
    for (int i = 0; i < KILN_SPHERE_SUMS; i++) {
        const double value = flux[i % 3] * chord * weights[i / 3] / s->unit;
        const uint64_t whole = (uint64_t)llrint(fmax(-SUM_MOST, fmin(value, SUM_MOST)));
        if (whole != 0) {
#pragma omp atomic
            sums[i] += whole;
        }
    }
    const double moment = w->part->relative * chord / (2.0 * s->radius);
    const uint64_t square = (uint64_t)fmin(KILN_SPHERE_MOMENT * moment * moment, KILN_SPHERE_MOMENT_MOST);
#pragma omp atomic
    s->moments[w->part->aim] += square;
}

static void cross_one(const struct way *w, size_t number)
{
    const struct kiln_sphere *sphere = &w->spheres->sphere[number];
    const struct kiln_dvec3 centre =
        dvec3((double)sphere->centre[0], (double)sphere->centre[1], (double)sphere->centre[2]);
    const struct kiln_dvec3 to = dvec3_sub(centre, w->origin);
    const double radius = (double)sphere->radius, middle = dvec3_dot(to, w->direction),
                 square = middle * middle - dvec3_dot(to, to) + radius * radius;
    if (!(radius > 0.0) || !(square > 0.0))
        return;
    const double half = sqrt(square), begin = fmax(0.0, middle - half), end = fmin(w->part->length, middle + half),
                 distance = begin + w->part->pick * (end - begin);
    if (end > begin && sees(w, sphere, dvec3_add(w->origin, dvec3_scale(w->direction, distance))))
        add(w, number, distance, end - begin);
}

/* ---- which spheres ---- */

/* Where the part is within `reach` of the range [low, high] along an axis, of [*begin, *end]; false: nowhere. */
static bool clip(const struct way *w, int axis, double low, double high, double *begin, double *end)
{
    const double from = w->from[axis], slope = w->slope[axis], reach = w->reach[axis];
    if (fabs(slope) < LEAST_DIRECTION)
        return from >= low - reach && from <= high + reach;
    const double a = (low - reach - from) / slope, b = (high + reach - from) / slope;
    *begin = fmax(*begin, fmin(a, b));
    *end = fmin(*end, fmax(a, b));
    return *begin <= *end;
}

/* The numbers of probes along an axis whose spheres the stretch [begin, end] may meet. */
static void find_range(const struct way *w, int axis, double begin, double end, int64_t range[2])
{
    const double a = w->from[axis] + begin * w->slope[axis], b = w->from[axis] + end * w->slope[axis],
                 most = (double)w->spheres->size[axis] - 1.0;
    range[0] = (int64_t)fmax(0.0, ceil(fmin(a, b) - w->reach[axis]));
    range[1] = (int64_t)fmin(most, floor(fmax(a, b) + w->reach[axis]));
}

/* The probes of number `i` along the axis `along`, near the stretch of the part where their spheres may be. */
static void cross_slab(const struct way *w, int along, int64_t i)
{
    const struct kiln_probe_spheres *s = w->spheres;
    double begin = w->begin, end = w->end;
    int64_t range[3][2];
    if (!clip(w, along, (double)i, (double)i, &begin, &end))
        return;
    for (int a = 0; a < 3; a++)
        find_range(w, a, begin, end, range[a]);
    range[along][0] = range[along][1] = i;
    for (int64_t z = range[2][0]; z <= range[2][1]; z++)
        for (int64_t y = range[1][0]; y <= range[1][1]; y++)
            for (int64_t x = range[0][0]; x <= range[0][1]; x++) {
                const uint64_t probe = ((uint64_t)z * s->size[1] + (uint64_t)y) * s->size[0] + (uint64_t)x;
                if (probe - s->first < s->count)
                    cross_one(w, (size_t)(probe - s->first));
            }
}

void spheres_cross(struct walk *walk, const struct kiln_probe_spheres *s, const struct spheres_part *part)
{
    struct way w = {.walk = walk,
                    .spheres = s,
                    .part = part,
                    .origin = dvec3_of(part->origin),
                    .direction = dvec3_of(part->direction),
                    .end = part->length};
    const double origin[3] = {w.origin.x, w.origin.y, w.origin.z},
                 direction[3] = {w.direction.x, w.direction.y, w.direction.z};
    int along = 0;
    int64_t range[2];
    for (int a = 0; a < 3; a++) {
        w.from[a] = (origin[a] - s->origin[a]) / s->spacing[a];
        w.slope[a] = direction[a] / s->spacing[a];
        w.reach[a] = 0.5 + s->radius / s->spacing[a];
        along = fabs(w.slope[a]) > fabs(w.slope[along]) ? a : along;
    }
    for (int a = 0; a < 3; a++)
        if (!clip(&w, a, 0.0, (double)s->size[a] - 1.0, &w.begin, &w.end))
            return;
    find_range(&w, along, w.begin, w.end, range);
    for (int64_t i = range[0]; i <= range[1]; i++)
        cross_slab(&w, along, i);
}
