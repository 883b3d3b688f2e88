#include "worker/backend/embree/spheres.h"

#include <math.h>

#define SEEN 0.9999          /* relative length of rays from a sphere's centre; rounding puts no end into a surface */
#define LEAST_DIRECTION 1e-9 /* spacings per metre: along such an axis a ray does not move */

/* A segment of a path in grid coordinates: in spacings from probe (0, 0, 0). */
struct way {
    struct walk *walk;
    const struct kiln_probe_spheres *spheres;
    const struct spheres_part *part;
    struct sphere_chords *chords;
    struct kiln_dvec3 origin, direction; /* of the part */
    double from[3], slope[3];            /* spacings; spacings a metre */
    double begin, end;                   /* m: where there are cells */
    bool alike;                          /* its flux is the same all along */
};

static double less(double a, double b) { return a < b ? a : b; }
static double more(double a, double b) { return a > b ? a : b; }

/* ---- one sphere ---- */

/* Whether a position in a sphere is visible from its centre. */
static bool sees(const struct way *w, size_t number, struct kiln_dvec3 place)
{
    const struct kiln_sphere *sphere = &w->spheres->sphere[number];
    const struct kiln_vec3 middle = vec3(sphere->centre[0], sphere->centre[1], sphere->centre[2]);
    const struct kiln_dvec3 to = dvec3_sub(place, dvec3_of(middle));
    const double length = dvec3_length(to);
    struct RTCRayHit ray;
    float tint[3];
    if (!(length > 0.0) || SEEN * length < (double)w->spheres->clear[number])
        return true;
    const struct kiln_vec3 direction = vec3_of(dvec3_scale(to, 1.0 / length));
    w->walk->rays++;
    return !meeting_trace(w->walk->b, w->walk->context, middle, direction, (float)(SEEN * length),
                          kiln_ray_seed(middle, direction), &ray, tint);
}

/* Flux at a distance along the segment: less absorption in the body around it, times tints on the way. */
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

static void add(const struct way *w, uint32_t sphere, double distance, double chord)
{
    const struct kiln_probe_spheres *s = w->spheres;
    const double moment = w->part->relative * chord / (2.0 * s->radius);
    struct sphere_chord added = {.sphere = sphere, .direction = w->part->direction};
    double changed[3];
    const double *flux = w->alike ? w->part->flux : changed;
    if (!w->alike)
        find_flux(w, distance, changed);
    for (int c = 0; c < 3; c++)
        added.brought[c] = flux[c] * chord;
    sphere_chords_add(w->chords, &added);
    sphere_chords_note(w->chords, s, w->part->aim,
                       (uint64_t)less(KILN_SPHERE_MOMENT * moment * moment, KILN_SPHERE_MOMENT_MOST));
}

static void cross_one(const struct way *w, const struct kiln_sphere *sphere, uint32_t number)
{
    const struct kiln_dvec3 centre =
        dvec3((double)sphere->centre[0], (double)sphere->centre[1], (double)sphere->centre[2]);
    const struct kiln_dvec3 to = dvec3_sub(centre, w->origin);
    const double radius = (double)sphere->radius, middle = dvec3_dot(to, w->direction),
                 square = middle * middle - dvec3_dot(to, to) + radius * radius;
    if (!(square > 0.0))
        return;
    const double half = sqrt(square), begin = more(0.0, middle - half), end = less(w->part->length, middle + half),
                 distance = begin + w->part->pick * (end - begin);
    if (end > begin && sees(w, number, dvec3_add(w->origin, dvec3_scale(w->direction, distance))))
        add(w, number, distance, end - begin);
}

/* ---- which spheres ---- */

/* Clips the interval [*begin, *end] of the segment to [low, high] along an axis; false: nothing is left. */
static bool clip(const struct way *w, int axis, double low, double high, double *begin, double *end)
{
    const double from = w->from[axis], slope = w->slope[axis];
    if (fabs(slope) < LEAST_DIRECTION)
        return from >= low && from <= high;
    const double a = (low - from) / slope, b = (high - from) / slope;
    *begin = more(*begin, less(a, b));
    *end = less(*end, more(a, b));
    return *begin <= *end;
}

/* Largest distance of a cell from its grid position that matters, in spacings. */
#define REACH (0.5 + 2.0 * KILN_SPHERE_SLACK)

/* Range of cells along an axis that the interval [begin, end] may meet. */
static void find_range(const struct way *w, int axis, double begin, double end, int64_t range[2])
{
    const struct kiln_sphere_cells *cells = &w->spheres->cells;
    const double a = w->from[axis] + begin * w->slope[axis], b = w->from[axis] + end * w->slope[axis],
                 first = (double)cells->first[axis], last = (double)cells->size[axis] - 1.0;
    /* positive, except at the ends, so truncation rounds down */
    range[0] = (int64_t)(more(0.0, less(a, b) - REACH - first + 1.0));
    range[1] = (int64_t)(less(last, more(a, b) + REACH - first));
}

static void cross_cell(const struct way *w, size_t cell)
{
    const struct kiln_sphere_cells *cells = &w->spheres->cells;
    struct sphere_chords *chords = w->chords;
    for (uint32_t i = cells->begin[cell]; i < cells->begin[cell + 1]; i++) {
        const struct kiln_cell_sphere *of = &cells->spheres[i];
        if (of->again != 0) {
            if (chords->last[of->number] == chords->part)
                continue;
            chords->last[of->number] = chords->part;
        }
        cross_one(w, &of->sphere, of->number);
    }
}

/* Crosses the cells with index `i` along the axis `along` that the segment may meet. */
static void cross_slab(const struct way *w, int along, int64_t i)
{
    const struct kiln_sphere_cells *cells = &w->spheres->cells;
    const double middle = (double)(cells->first[along] + i);
    double begin = w->begin, end = w->end;
    int64_t range[3][2];
    if (!clip(w, along, middle - REACH, middle + REACH, &begin, &end))
        return;
    for (int a = 0; a < 3; a++)
        find_range(w, a, begin, end, range[a]);
    range[along][0] = range[along][1] = i;
    for (int64_t z = range[2][0]; z <= range[2][1]; z++)
        for (int64_t y = range[1][0]; y <= range[1][1]; y++)
            for (int64_t x = range[0][0]; x <= range[0][1]; x++)
                cross_cell(w, (size_t)((z * cells->size[1] + y) * cells->size[0] + x));
}

void spheres_cross(struct walk *walk, const struct kiln_probe_spheres *s, const struct spheres_part *part,
                   struct sphere_chords *chords)
{
    struct way w = {.walk = walk,
                    .spheres = s,
                    .part = part,
                    .chords = chords,
                    .origin = dvec3_of(part->origin),
                    .direction = dvec3_of(part->direction),
                    .end = part->length};
    const double origin[3] = {w.origin.x, w.origin.y, w.origin.z},
                 direction[3] = {w.direction.x, w.direction.y, w.direction.z};
    int along = 0;
    int64_t range[2];
    float share[3];
    for (int a = 0; a < 3; a++) {
        w.from[a] = (origin[a] - s->origin[a]) / s->spacing[a];
        w.slope[a] = direction[a] / s->spacing[a];
        along = fabs(w.slope[a]) > fabs(w.slope[along]) ? a : along;
    }
    for (int a = 0; a < 3; a++) {
        const double first = (double)s->cells.first[a], last = first + (double)s->cells.size[a] - 1.0;
        if (!clip(&w, a, first - REACH, last + REACH, &w.begin, &w.end))
            return;
    }
    chords->part++;
    w.alike = !embree_tints(walk->b) && (part->end == NULL || !meeting_attenuation(part->end, 0.0f, share));
    find_range(&w, along, w.begin, w.end, range);
    for (int64_t i = range[0]; i <= range[1]; i++)
        cross_slab(&w, along, i);
}
