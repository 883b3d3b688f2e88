#include "coordinator/view/view_seek.h"

#include <stdlib.h>

#include "worker/base/memory.h"

enum {
    PLACES = 1024, /* number of surface points, and the largest number of candidate positions */
    LOOKS = 96,    /* rays from each candidate in all directions; the first points down, the second up */
    CHOSEN = 40,   /* candidates whose views are scored */
    TURNS = 12,    /* horizontal view directions of a candidate */
    TILTS = 2,     /* each horizontal and tilted down */
    WIDE = 32,     /* rays across the picture of a view */
    HIGH = 24,
    VIEW_RAYS = WIDE * HIGH,
    COARSE = 64
};
static const double MOST_ESCAPING = 0.2; /* largest fraction of an enclosed candidate's rays that leave the scene */
static const double LEAST_ENCLOSED =
    0.1; /* least fraction of surface points with enclosed candidates in a closed scene */

struct place {
    size_t number; /* decides the order of candidates of the same value */
    struct kiln_dvec3 position;
    double near, middle; /* distances of its hits, m: 5th percentile and median */
    double height;       /* position between floor and ceiling, 0 to 1 */
    bool roofed;         /* most of the upward rays hit something */
    double worth;        /* its score; 0: not enclosed */
};

struct view {
    struct kiln_view_camera camera;
    double score, distance;
};

/* A sample point on the surfaces: evenly distributed, but denser on small objects. */
struct spot {
    struct kiln_dvec3 position, normal; /* normal: on the side that the spot represents */
    struct kiln_hit hit;                /* a ray that would meet it */
    double light;                       /* 0 to 1 */
};

struct seek {
    const struct kiln_view_source *source;
    struct kiln_view_maps *maps;
    struct kiln_view_rays *rays;
    struct place *places;
    size_t place_count, enclosed, roofed;
    struct spot *spots; /* PLACES */
    size_t spot_count;
    double room;  /* m: distance seen from the widest tenth of the enclosed candidates */
    double light; /* median luminance of irradiance seen from enclosed candidates */
    double box;   /* m: side of the grid cells that distinguish items */
};

/* ---- fixed directions and points ---- */

static double fraction(double x) { return x - floor(x); }

/* The k-th direction: down, up, then a Fibonacci spiral over the sphere. */
static struct kiln_dvec3 look_direction(int k)
{
    if (k < 2)
        return dvec3(0.0, k == 0 ? -1.0 : 1.0, 0.0);
    const double y = 1.0 - 2.0 * ((double)(k - 2) + 0.5) / (LOOKS - 2), r = sqrt(1.0 - y * y),
                 phi = 2.0 * KILN_PI * fraction(k * 0.6180339887498949);
    return dvec3(r * cos(phi), y, r * sin(phi));
}

/* ---- candidate positions ---- */

static double range_area(const struct kiln_geometry *g, uint64_t first, uint64_t count)
{
    double sum = 0.0;
    for (uint64_t t = first; t < first + count; t++)
        sum += kiln_geometry_triangle_area(g, t);
    return sum;
}

/* Starts a ray from the k-th surface point along its normal. On double-sided surfaces the two sides alternate. */
static void leave_surface(const struct seek *s, uint64_t triangle, size_t k)
{
    const struct kiln_geometry *g = s->source->geometry;
    struct kiln_vec3 c[3];
    kiln_geometry_corners(g, triangle, c);
    double u = fraction((double)k * 0.7548776662466927 + 0.5), v = fraction((double)k * 0.5698402909980532 + 0.5);
    if (u + v > 1.0) {
        u = 1.0 - u;
        v = 1.0 - v;
    }
    const struct kiln_vec3 a = vec3_sub(c[1], c[0]), b = vec3_sub(c[2], c[0]);
    const bool other = (g->records[triangle].material & KILN_RECORD_DOUBLE_SIDED) != 0 && k % 2 == 1;
    const struct kiln_vec3 n = vec3_scale(vec3_normalize(vec3_cross(a, b)), other ? -1.0f : 1.0f);
    const struct kiln_vec3 p = vec3_madd(vec3_madd(c[0], a, (float)u), b, (float)v);
    s->rays->origins[k] = vec3_madd(p, n, 4e-6f * g->extent);
    s->rays->directions[k] = n;
    s->spots[k] = (struct spot){
        .position = dvec3_of(p),
        .normal = dvec3_of(n),
        .hit = {
            .triangle = (uint32_t)triangle, .u = (float)u, .v = (float)v, .back = other, .tint = {1.0f, 1.0f, 1.0f}}};
}

/* State of the spreading: point k lies where the running sum of weights passes k. */
struct spread {
    double sum, step;
    size_t count;
};

static void spread_range(const struct seek *s, struct spread *spread, uint64_t first, uint64_t count, double weight)
{
    for (uint64_t t = first; t < first + count; t++) {
        spread->sum += weight * kiln_geometry_triangle_area(s->source->geometry, t);
        while (spread->count < PLACES && spread->sum > ((double)spread->count + 0.5) * spread->step)
            leave_surface(s, t, spread->count++);
    }
}

/* Starts rays 0..count-1 at points that are spread over the opaque surfaces. */
static int spread_points(const struct seek *s, size_t *count, struct kiln_error *error)
{
    const struct kiln_geometry *g = s->source->geometry;
    const size_t objects = s->source->scene->object_count;
    struct spread spread = {0};
    double *areas = NULL;
    const int status = kiln_allocate(&areas, objects, sizeof *areas, "areas of objects", error);
    for (size_t o = 0; status == KILN_OK && o < objects; o++) {
        areas[o] = range_area(g, g->ranges[o].opaque_first, g->ranges[o].opaque_count);
        spread.step += pow(areas[o], 0.25) / PLACES;
    }
    for (size_t o = 0; status == KILN_OK && o < objects; o++)
        if (areas[o] > 0.0)
            spread_range(s, &spread, g->ranges[o].opaque_first, g->ranges[o].opaque_count, pow(areas[o], -0.75));
    kiln_free(&areas);
    *count = spread.count;
    return status;
}

/* Adds the candidate above a surface point, unless its ray hits nothing or a back. */
static void stand(struct seek *s, size_t ray)
{
    const struct kiln_hit *hit = &s->rays->hits[ray];
    if (!kiln_view_is_seen(s->source, hit))
        return;
    const double share = 0.3 + 0.3 * fraction((double)ray * 0.6180339887498949);
    s->places[s->place_count].number = s->place_count;
    s->places[s->place_count++].position =
        dvec3_add(dvec3_of(s->rays->origins[ray]),
                  dvec3_scale(dvec3_of(s->rays->directions[ray]), share * (double)hit->distance));
}

static int find_places(struct seek *s, struct kiln_error *error)
{
    size_t count;
    int status;
    KILN_TRY(spread_points(s, &count, error));
    KILN_TRY(
        kiln_backend_intersect(s->source->backend, s->rays->origins, s->rays->directions, count, s->rays->hits, error));
    for (size_t i = 0; i < count; i++)
        stand(s, i);
end:
    s->spot_count = count;
    return status;
}

/* ---- properties of a candidate ---- */

static int compare_doubles(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double luminance_at(const struct seek *s, const struct kiln_hit *hit)
{
    float rgb[3];
    kiln_view_irradiance(s->maps, hit, rgb);
    return (double)kiln_rgb_luminance(rgb[0], rgb[1], rgb[2]);
}

/* Weight of the light at a hit: low for a back that shows the light of its front, since the back may be dark. */
static double trust(const struct seek *s, const struct kiln_hit *hit)
{
    return kiln_view_shows_front(s->maps, hit) ? 0.3 : 1.0;
}

static void judge_place(const struct seek *s, struct place *p, size_t first)
{
    double distances[LOOKS];
    int met = 0, behind = 0, above = 0, above_met = 0;
    double lit = 0.0;
    for (int k = 0; k < LOOKS; k++) {
        const struct kiln_hit *hit = &s->rays->hits[first + (size_t)k];
        const bool up = s->rays->directions[first + (size_t)k].y > 0.8f;
        above += up;
        above_met += up && hit->triangle != KILN_NONE;
        if (hit->triangle == KILN_NONE)
            continue;
        distances[met++] = (double)hit->distance;
        if (!kiln_view_is_seen(s->source, hit))
            behind++;
        else if (luminance_at(s, hit) > 0.0)
            lit += trust(s, hit);
    }
    p->worth = 0.0;
    if (LOOKS - met > MOST_ESCAPING * LOOKS || behind > 1 || lit < 0.25 * met)
        return;
    const struct kiln_hit *down = &s->rays->hits[first], *up = &s->rays->hits[first + 1];
    p->height = down->triangle == KILN_NONE ? 1.0
                : up->triangle == KILN_NONE ? 0.0
                                            : (double)down->distance / ((double)down->distance + (double)up->distance);
    qsort(distances, (size_t)met, sizeof *distances, compare_doubles);
    p->near = distances[met / 20];
    p->middle = distances[met / 2];
    p->roofed = 2 * above_met > above;
    p->worth = lit / LOOKS * fmin(1.0, 4.0 * p->near / p->middle) * sqrt(p->middle);
}

/* Removes nooks, such as the insides of cupboards and teapots, which are enclosed too. */
static void leave_out_nooks(struct seek *s)
{
    for (size_t i = 0; i < s->place_count; i++) {
        struct place *p = &s->places[i];
        if (p->middle < 0.35 * s->room || p->near < 0.04 * s->room)
            p->worth = 0.0;
        s->enclosed += p->worth > 0.0;
        s->roofed += p->worth > 0.0 && p->roofed;
    }
}

/* Measures `room` and `light` over the enclosed candidates. */
static int take_measure(struct seek *s, struct kiln_error *error)
{
    double *values = NULL;
    size_t count = 0, lights = 0;
    int status = kiln_allocate(&values, (size_t)PLACES * LOOKS, sizeof *values, "medians", error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < s->place_count; i++)
        if (s->places[i].worth > 0.0)
            values[count++] = s->places[i].middle;
    if (count > 0) {
        qsort(values, count, sizeof *values, compare_doubles);
        s->room = values[count * 9 / 10];
    }
    leave_out_nooks(s);
    for (size_t i = 0; i < s->place_count; i++)
        for (size_t k = i * LOOKS; s->places[i].worth > 0.0 && k < (i + 1) * LOOKS; k++)
            if (kiln_view_is_seen(s->source, &s->rays->hits[k]))
                values[lights++] = luminance_at(s, &s->rays->hits[k]);
    if (lights > 0) {
        qsort(values, lights, sizeof *values, compare_doubles);
        s->light = values[lights / 2];
    }
    kiln_free(&values);
    return KILN_OK;
}

static int judge_places(struct seek *s, struct kiln_error *error)
{
    const size_t count = s->place_count * LOOKS;
    for (size_t i = 0; i < count; i++) {
        s->rays->origins[i] = vec3_of(s->places[i / LOOKS].position);
        s->rays->directions[i] = vec3_of(look_direction((int)(i % LOOKS)));
    }
    int status =
        kiln_backend_intersect(s->source->backend, s->rays->origins, s->rays->directions, count, s->rays->hits, error);
    if (status == KILN_OK)
        status = kiln_view_maps_load(s->maps, s->rays->hits, count, error);
    for (size_t i = 0; status == KILN_OK && i < s->place_count; i++)
        judge_place(s, &s->places[i], i * LOOKS);
    return status == KILN_OK ? take_measure(s, error) : status;
}

/* Whether 80 % of the enclosed candidates are visible from a point outside, as in a box with an open front. */
static int is_open_to(struct seek *s, struct kiln_dvec3 outside, bool *open, struct kiln_error *error)
{
    size_t count = 0, seen = 0;
    for (size_t i = 0; i < s->place_count; i++) {
        if (!(s->places[i].worth > 0.0))
            continue;
        const struct kiln_dvec3 way = dvec3_sub(s->places[i].position, outside);
        s->rays->origins[count] = vec3_of(outside);
        s->rays->directions[count] = vec3_of(dvec3_scale(way, 1.0 / dvec3_length(way)));
        s->rays->passed[count++] = (float)dvec3_length(way);
    }
    const int status =
        kiln_backend_intersect(s->source->backend, s->rays->origins, s->rays->directions, count, s->rays->hits, error);
    for (size_t i = 0; status == KILN_OK && i < count; i++)
        seen += s->rays->hits[i].triangle == KILN_NONE || s->rays->hits[i].distance >= s->rays->passed[i];
    *open = 5 * seen > 4 * count;
    return status;
}

/* ---- views ---- */

static int compare_places(const void *a, const void *b)
{
    const struct place *p = a, *q = b;
    const int by_worth = (p->worth < q->worth) - (p->worth > q->worth);
    return by_worth != 0 ? by_worth : (p->number > q->number) - (p->number < q->number);
}

/* Moves the best candidates to the front, without those too close to a better one; returns their number. */
static size_t choose_places(struct seek *s)
{
    size_t chosen = 0;
    qsort(s->places, s->place_count, sizeof *s->places, compare_places);
    for (size_t i = 0; i < s->place_count && chosen < CHOSEN && s->places[i].worth > 0.0; i++) {
        bool apart = true;
        for (size_t k = 0; k < chosen && apart; k++)
            apart = dvec3_length(dvec3_sub(s->places[i].position, s->places[k].position)) > 0.2 * s->room;
        if (apart)
            s->places[chosen++] = s->places[i];
    }
    return chosen;
}

static void point_view(const struct place *p, const struct kiln_view_camera *lens, int turn, int tilt,
                       struct kiln_view_camera *camera)
{
    const double phi = 2.0 * KILN_PI * (turn + 0.25) / TURNS, down = tilt == 0 ? 0.02 : 0.22;
    *camera = *lens;
    camera->position = p->position;
    kiln_view_look(camera, dvec3(cos(phi) * cos(down), -sin(down), sin(phi) * cos(down)));
}

static void aim_rays(const struct seek *s, const struct kiln_view_camera *c, size_t first)
{
    for (size_t i = 0; i < VIEW_RAYS; i++) {
        const double x = ((double)(i % WIDE) + 0.5) / WIDE * 2.0 - 1.0,
                     y = 1.0 - ((double)(i / WIDE) + 0.5) / HIGH * 2.0;
        const struct kiln_dvec3 way = dvec3_add(
            c->forward, dvec3_add(dvec3_scale(c->right, x * c->extent_x), dvec3_scale(c->up, y * c->extent_y)));
        s->rays->origins[first + i] = vec3_of(c->position);
        s->rays->directions[first + i] = vec3_of(dvec3_scale(way, 1.0 / dvec3_length(way)));
    }
}

struct thing {
    uint64_t key;
    double share;
};

static int compare_things(const void *a, const void *b)
{
    const struct thing *t = a, *u = b;
    return (t->key > u->key) - (t->key < u->key);
}

/* Number of the axis direction, of six, that a surface faces. */
static uint64_t side_of(const struct kiln_geometry *g, uint64_t triangle)
{
    struct kiln_vec3 c[3];
    kiln_geometry_corners(g, triangle, c);
    return kiln_view_side(vec3_cross(vec3_sub(c[1], c[0]), vec3_sub(c[2], c[0])));
}

/* Identifies the item that a ray shows, and its weight. Items are distinguished by a hash; a collision only lowers the
 * entropy a little. */
static struct thing thing_at(const struct seek *s, size_t ray)
{
    const struct kiln_geometry *g = s->source->geometry;
    const struct kiln_hit *hit = &s->rays->hits[ray];
    const struct kiln_hit_record *record = &g->records[hit->triangle];
    const struct kiln_vec3 p = vec3_madd(s->rays->origins[ray], s->rays->directions[ray], hit->distance);
    const double box = s->box;
    const uint64_t x = (uint64_t)(int64_t)floor((double)p.x / box), y = (uint64_t)(int64_t)floor((double)p.y / box),
                   z = (uint64_t)(int64_t)floor((double)p.z / box);
    const uint64_t key = ((x * 0x9e3779b97f4a7c15u + y) * 0xc2b2ae3d27d4eb4fu + z) * 0x165667b19e3779f9u +
                         record->object * 6u + side_of(g, hit->triangle);
    const double light = (record->material & KILN_RECORD_EMITS) != 0 || !(s->light > 0.0)
                             ? 1.0
                             : fmin(1.0, luminance_at(s, hit) / (0.3 * s->light));
    const double reach = s->room > 0.0 ? fmin(1.0, (double)hit->distance / (0.4 * s->room)) : 1.0;
    return (struct thing){key, trust(s, hit) * light * reach * reach / VIEW_RAYS};
}

/* Viewpoint entropy of rays first..first+VIEW_RAYS-1. */
static double entropy(const struct seek *s, size_t first)
{
    struct thing things[VIEW_RAYS];
    size_t count = 0;
    double sum = 0.0;
    for (size_t i = first; i < first + VIEW_RAYS; i++)
        if (kiln_view_is_seen(s->source, &s->rays->hits[i]))
            things[count++] = thing_at(s, i);
    qsort(things, count, sizeof *things, compare_things);
    for (size_t i = 0; i < count;) {
        double share = 0.0;
        const uint64_t key = things[i].key;
        for (; i < count && things[i].key == key; i++)
            share += things[i].share;
        sum -= share > 0.0 ? share * log(share) : 0.0;
    }
    return sum;
}

/* Fraction of the picture, 0 to 1, that is not too close to the eye. */
static double openness(const struct seek *s, size_t first)
{
    double sum = 0.0;
    for (size_t i = first; i < first + VIEW_RAYS; i++)
        sum += kiln_view_is_seen(s->source, &s->rays->hits[i]) ? fmin(1.0, (double)s->rays->hits[i].distance / s->room)
                                                               : 0.0;
    return sum / VIEW_RAYS;
}

/* Computes the light at each spot, from 0 up to the median of enclosed candidates. */
static int light_spots(struct seek *s, struct kiln_error *error)
{
    for (size_t i = 0; i < s->spot_count; i++)
        s->rays->hits[i] = s->spots[i].hit;
    const int status = kiln_view_maps_load(s->maps, s->rays->hits, s->spot_count, error);
    for (size_t i = 0; status == KILN_OK && i < s->spot_count; i++)
        s->spots[i].light = trust(s, &s->spots[i].hit) *
                            (s->light > 0.0 ? fmin(1.0, luminance_at(s, &s->spots[i].hit) / s->light) : 1.0);
    return status;
}

/* Finds the spots visible from the eye, in any direction. */
static int see_spots(struct seek *s, struct kiln_dvec3 eye, bool *seen, struct kiln_error *error)
{
    for (size_t i = 0; i < s->spot_count; i++) {
        const struct kiln_dvec3 way = dvec3_sub(s->spots[i].position, eye);
        const double distance = dvec3_length(way);
        seen[i] = dvec3_dot(way, s->spots[i].normal) < 0.0 && distance > 0.0;
        s->rays->origins[i] = vec3_of(eye);
        s->rays->directions[i] = vec3_of(dvec3_scale(way, 1.0 / fmax(distance, 1e-30)));
        s->rays->passed[i] = (float)distance;
    }
    const int status = kiln_backend_intersect(s->source->backend, s->rays->origins, s->rays->directions, s->spot_count,
                                              s->rays->hits, error);
    for (size_t i = 0; status == KILN_OK && i < s->spot_count; i++)
        seen[i] = seen[i] &&
                  (s->rays->hits[i].triangle == KILN_NONE || s->rays->hits[i].distance > 0.999f * s->rays->passed[i]);
    return status;
}

/* Share of all light on the spots that a view shows. `seen`: spots visible from its eye. */
static double shown(const struct seek *s, const bool *seen, const struct kiln_view_camera *c)
{
    double sum = 0.0;
    for (size_t i = 0; i < s->spot_count; i++) {
        const struct kiln_dvec3 way = dvec3_sub(s->spots[i].position, c->position);
        const double depth = dvec3_dot(way, c->forward);
        if (seen[i] && depth > 0.0 && fabs(dvec3_dot(way, c->right)) < depth * c->extent_x &&
            fabs(dvec3_dot(way, c->up)) < depth * c->extent_y)
            sum += s->spots[i].light;
    }
    return sum / (double)s->spot_count;
}

/* Prefers eyes in the lower half of a room, and none at the ceiling. */
static double comfort(double height) { return 1.0 - fmin(0.8, 1.5 * fmax(0.0, fmax(0.2 - height, height - 0.55))); }

/* Scores the views of one candidate and updates the best view. */
static int try_views(struct seek *s, const struct place *place, const struct kiln_view_camera *lens, struct view *best,
                     struct kiln_error *error)
{
    struct kiln_view_camera cameras[TURNS * TILTS];
    double scores[TURNS * TILTS];
    bool seen[PLACES];
    int status = see_spots(s, place->position, seen, error);
    for (int v = 0; v < TURNS * TILTS; v++) {
        point_view(place, lens, v / TILTS, v % TILTS, &cameras[v]);
        aim_rays(s, &cameras[v], (size_t)v * VIEW_RAYS);
    }
    const size_t count = (size_t)TURNS * TILTS * VIEW_RAYS;
    if (status == KILN_OK)
        status = kiln_backend_intersect(s->source->backend, s->rays->origins, s->rays->directions, count, s->rays->hits,
                                        error);
    if (status == KILN_OK)
        status = kiln_view_maps_load(s->maps, s->rays->hits, count, error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for schedule(dynamic, 1)
    for (int v = 0; v < TURNS * TILTS; v++)
        scores[v] = comfort(place->height) * openness(s, (size_t)v * VIEW_RAYS) * entropy(s, (size_t)v * VIEW_RAYS) *
                    shown(s, seen, &cameras[v]);
    for (int v = 0; v < TURNS * TILTS; v++)
        if (scores[v] > best->score)
            *best = (struct view){.camera = cameras[v], .score = scores[v], .distance = place->middle};
    return KILN_OK;
}

static int find_view(struct seek *s, struct kiln_view_camera *camera, bool *found, double *distance,
                     struct kiln_error *error)
{
    struct view best = {0};
    const size_t chosen = choose_places(s);
    int status = light_spots(s, error);
    for (size_t i = 0; status == KILN_OK && i < chosen; i++)
        status = try_views(s, &s->places[i], camera, &best, error);
    *found = status == KILN_OK && best.score > 0.0;
    if (*found) {
        *camera = best.camera;
        *distance = best.distance;
    }
    return status;
}

/* Computes the median irradiance at the visible hits of rays 0..count-1. */
static int measure_light(struct seek *s, size_t count, struct kiln_error *error)
{
    double *values = NULL;
    size_t lights = 0;
    const int status = kiln_allocate(&values, count, sizeof *values, "medians", error);
    for (size_t i = 0; status == KILN_OK && i < count; i++)
        if (kiln_view_is_seen(s->source, &s->rays->hits[i]))
            values[lights++] = luminance_at(s, &s->rays->hits[i]);
    if (status == KILN_OK && lights > 0)
        qsort(values, lights, sizeof *values, compare_doubles);
    s->light = lights > 0 ? values[lights / 2] : 0.0;
    kiln_free(&values);
    return status;
}

/* Finds the best camera outside the scene, with a slight preference for the first. */
static int compare_outside(struct seek *s, const struct kiln_view_camera *outside, size_t count, size_t *best,
                           struct kiln_error *error)
{
    const struct kiln_geometry *g = s->source->geometry;
    double most = 0.0;
    for (size_t v = 0; v < count; v++)
        aim_rays(s, &outside[v], v * VIEW_RAYS);
    int status;
    KILN_TRY(kiln_backend_intersect(s->source->backend, s->rays->origins, s->rays->directions, count * VIEW_RAYS,
                                    s->rays->hits, error));
    KILN_TRY(kiln_view_maps_load(s->maps, s->rays->hits, count * VIEW_RAYS, error));
    KILN_TRY(measure_light(s, count * VIEW_RAYS, error));
end:
    s->box = 0.1 * (double)vec3_length(vec3_sub(g->bounds_max, g->bounds_min));
    s->room = 0.0; /* outside, nothing counts as too close */
    *best = 0;
    for (size_t v = 0; status == KILN_OK && v < count; v++) {
        const double score = entropy(s, v * VIEW_RAYS) * (v == 0 ? 1.1 : 1.0);
        if (score > most) {
            most = score;
            *best = v;
        }
    }
    return status;
}

int kiln_view_seek(const struct kiln_view_source *source, const struct kiln_view_camera *outside, size_t outside_count,
                   struct kiln_view_camera *camera, bool *found, size_t *best, double *distance,
                   struct kiln_error *error)
{
    struct seek s = {.source = source};
    bool open = true;
    *found = false;
    *best = 0;
    if (source->geometry->triangle_count == 0)
        return KILN_OK;
    int status = kiln_allocate(&s.places, PLACES, sizeof *s.places, "candidate viewpoints", error);
    if (status == KILN_OK)
        status = kiln_allocate(&s.spots, PLACES, sizeof *s.spots, "points of surfaces", error);
    if (status == KILN_OK)
        status = kiln_view_maps_create(&s.maps, source, COARSE, error);
    if (status == KILN_OK)
        status = kiln_view_rays_create(&s.rays, (size_t)PLACES * LOOKS, error);
    if (status == KILN_OK)
        status = compare_outside(&s, outside, outside_count, best, error);
    if (status == KILN_OK)
        status = find_places(&s, error);
    if (status == KILN_OK)
        status = judge_places(&s, error);
    const bool closed = status == KILN_OK && (double)s.enclosed >= LEAST_ENCLOSED * PLACES &&
                        2 * s.roofed > s.enclosed && s.light > 0.0;
    s.box = s.room;
    if (closed)
        status = is_open_to(&s, outside[*best].position, &open, error);
    if (closed && status == KILN_OK && !open)
        status = find_view(&s, camera, found, distance, error);
    kiln_view_rays_destroy(&s.rays);
    kiln_view_maps_destroy(&s.maps);
    kiln_free(&s.places);
    kiln_free(&s.spots);
    return status;
}
