#include "coordinator/bake/divided.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "worker/base/memory.h"
#include "worker/scene/clip.h"
#include "worker/scene/footprint.h"

enum {
    CHUNK_POINTS = 1 << 17,
    SEGMENTS = 2,
    PLACES = 5,
    PAIRS = PLACES * PLACES,
    SIDES = 4,
    TRIAL_RAYS = 2 * PAIRS + SIDES
};
enum { GRID = 2 * (KILN_TILE_SIDE + 1) }; /* lines between the texels of a tile */
enum { NEIGHBOURS = 8, OPEN_RAYS = 16 };
static const double LIFT = 1e-3;                      /* of a texel's side: how far above the surface the rays go */
static const double LEAST_SHARE = 1e-4;               /* of its area that a texel has on the smaller side */
static const int ENDS_WITHIN = 2;                     /* texels: a surface that ends after so many at most is a rim */
static const double OPEN = 1.0;                       /* m: what sees so far is no cavity */
static const double GOLDEN_ANGLE = 2.399963229728653; /* rad */
static const int GOES_ON = 3;                         /* as many times as long: a surface that a rim is nothing to */
static const double LEAST_SLOPE = 0.1;                /* sine of the angle between wall and texel */
static const double NEAR_CORNERS = 0.99; /* from the middle of a side of a texel to its corners: where rays start */
static const double SAME_NORMAL = 0.999; /* cosine: a texel is flat, or a wall's two faces are parallel */

/* The plane of a texel: place (x, y) is origin + x du + y dv, m; rays start at `lift` above it. */
struct texel_plane {
    struct kiln_dvec3 origin, du, dv, normal, lift;
};

/* A line through a texel, in the middle of a wall: on its near side is the texel's main side. Where the wall's two
 * faces are (line[2] of parallels), and a place on either side. */
struct texel_line {
    float line[3], face, far_face;
    double area, other; /* of the main and of the other side, m2 */
    /* m2 of the main and of the other side between the wall's middle and its face: nothing lights them */
    double within, beyond_within;
    bool ends;    /* the texel ends within the wall: there is no place beyond */
    bool goes_on; /* the main side is the smaller one, whose surface goes on */
    float centre[2], beyond[2];
};

/* A texel of this rank that a wall may divide, or does. */
struct candidate {
    struct kiln_point_cursor at;
    size_t tile_run;
    struct texel_plane plane;
    struct texel_line line;
    bool from_beyond; /* rays from beyond the line are asked first: those from this side do not all end in a solid */
    bool stays;       /* nothing has said yet that it divides nothing */
};

struct candidates {
    struct candidate *list;
    size_t count, room;
};

/* What ranks tell each other of a divided texel. */
struct told {
    struct kiln_divided_texel texel;
    float centre[2]; /* of its main side */
    float other;     /* area of its other side, m2 */
};

struct list {
    struct told *told;
    size_t count, room;
    int status;
    struct kiln_error *error;
};

struct segments {
    size_t room;
    struct kiln_vec3 *origins, *directions;
    float *lengths; /* m; 0: none */
    struct kiln_hit *hits;
};

struct search {
    struct kiln_surface *surface;
    const struct kiln_scene *scene;
    const struct kiln_geometry *geometry;
    struct kiln_backend *backend;
    const struct kiln_surface_exchange *exchange;
    const struct kiln_stop *stop;
    uint32_t threads;
    struct candidates found;
    struct list all;
};

/* ---- rays ---- */

static void segments_destroy(struct segments *r)
{
    kiln_free(&r->origins);
    kiln_free(&r->directions);
    kiln_free(&r->lengths);
    kiln_free(&r->hits);
}

static int segments_create(struct segments *r, size_t count, struct kiln_error *error)
{
    int status = kiln_allocate(&r->origins, count, sizeof *r->origins, "rays along texels", error);
    if (status == KILN_OK)
        status = kiln_allocate(&r->directions, count, sizeof *r->directions, "rays along texels", error);
    if (status == KILN_OK)
        status = kiln_allocate(&r->lengths, count, sizeof *r->lengths, "rays along texels", error);
    if (status == KILN_OK)
        status = kiln_allocate(&r->hits, count, sizeof *r->hits, "rays along texels", error);
    r->room = count;
    if (status != KILN_OK)
        segments_destroy(r);
    return status;
}

static struct kiln_dvec3 place_of(const struct texel_plane *p, double x, double y)
{
    return dvec3_add(dvec3_add(p->origin, p->lift), dvec3_add(dvec3_scale(p->du, x), dvec3_scale(p->dv, y)));
}

static void set_segment(struct segments *r, size_t i, struct kiln_dvec3 from, struct kiln_dvec3 to)
{
    const struct kiln_dvec3 d = dvec3_sub(to, from);
    const double length = dvec3_length(d);
    r->origins[i] = vec3_of(from);
    r->directions[i] = length > 0.0 ? vec3_of(dvec3_scale(d, 1.0 / length)) : vec3(1.0f, 0.0f, 0.0f);
    r->lengths[i] = (float)length;
}

static void set_no_segment(struct segments *r, size_t i)
{
    r->origins[i] = vec3(0.0f, 0.0f, 0.0f);
    r->directions[i] = vec3(1.0f, 0.0f, 0.0f);
    r->lengths[i] = 0.0f;
}

/* The first `count` rays, as far as they are long. */
static int trace(const struct segments *r, struct kiln_backend *backend, size_t count, struct kiln_error *error)
{
    return kiln_backend_intersect_within(backend, r->origins, r->directions, r->lengths, count, r->hits, error);
}

static bool meets(const struct segments *r, size_t i)
{
    return r->lengths[i] > 0.0f && r->hits[i].triangle != KILN_NONE && r->hits[i].distance < r->lengths[i];
}

/* ---- texels ---- */

static bool is_flat(const struct search *s, const uint32_t *pieces, uint32_t count)
{
    const struct kiln_vec3 first = kiln_triangle_normal(s->geometry, pieces[0]);
    for (uint32_t i = 1; i < count; i++)
        if ((double)vec3_dot(first, kiln_triangle_normal(s->geometry, pieces[i])) < SAME_NORMAL)
            return false;
    return true;
}

/* The plane of a point's first piece. False for a texel that is not flat, or a triangle without area. */
static bool find_plane(const struct search *s, const struct kiln_point_cursor *at, struct texel_plane *plane)
{
    const uint32_t *pieces = s->surface->pieces + at->piece;
    struct kiln_texel_triangle local;
    struct kiln_vec3 c[3];
    kiln_texel_triangle(s->scene, s->geometry, pieces[0], &at->place, &local);
    if (!(fabs(kiln_clip_twice_area(local.corner)) > 0.0) ||
        !is_flat(s, pieces, kiln_piece_count(s->surface, at->point)))
        return false;
    const struct kiln_clip_weights w = kiln_clip_weights(local.corner);
    kiln_geometry_corners(s->geometry, pieces[0], c);
    const struct kiln_dvec3 c0 = dvec3_of(c[0]), e1 = dvec3_sub(dvec3_of(c[1]), c0), e2 = dvec3_sub(dvec3_of(c[2]), c0);
    struct kiln_dvec3 along[3];
    for (int i = 0; i < 3; i++)
        along[i] = dvec3_add(dvec3_scale(e1, w.b1[i]), dvec3_scale(e2, w.b2[i]));
    const struct kiln_vec3 front = kiln_triangle_exact_normal(s->scene, s->geometry, pieces[0]);
    const double side = fmin(dvec3_length(along[1]), dvec3_length(along[2])),
                 lift = fmax(LIFT * side, 4.0 * (double)kiln_offset_distance(s->geometry, pieces[0], front));
    plane->normal = dvec3_scale(dvec3_of(front), at->back ? -1.0 : 1.0);
    plane->lift = dvec3_scale(plane->normal, lift);
    plane->origin = dvec3_add(c0, along[0]);
    plane->du = along[1];
    plane->dv = along[2];
    return side > 0.0;
}

/* The corners of a texel's covered part that lie farthest along its diagonals: of a whole texel, its own. */
static void find_ends(const struct search *s, const struct kiln_point_cursor *at, double ends[4][2])
{
    static const double whole[4][2] = {{0, 0}, {1, 1}, {0, 1}, {1, 0}},
                        way[4][2] = {{-1, -1}, {1, 1}, {-1, 1}, {1, -1}};
    memcpy(ends, whole, sizeof whole);
    if (kiln_point_whole(s->surface, at->point))
        return;
    double best[4] = {-INFINITY, -INFINITY, -INFINITY, -INFINITY};
    for (uint32_t i = 0; i < kiln_piece_count(s->surface, at->point); i++) {
        struct kiln_clip_corner polygon[KILN_CLIP_CORNERS];
        struct kiln_texel_triangle local;
        kiln_texel_triangle(s->scene, s->geometry, s->surface->pieces[at->piece + i], &at->place, &local);
        const uint32_t corners = kiln_texel_clip(&local, 0.0, 0.0, 1.0, 1.0, polygon);
        for (uint32_t c = 0; c < corners; c++)
            for (int e = 0; e < 4; e++)
                if (way[e][0] * polygon[c].x + way[e][1] * polygon[c].y > best[e]) {
                    best[e] = way[e][0] * polygon[c].x + way[e][1] * polygon[c].y;
                    ends[e][0] = polygon[c].x;
                    ends[e][1] = polygon[c].y;
                }
    }
}

/* The two rays of a point, `apart` in the arrays, so that a ray's neighbours are those of other points that go the same
 * way. They go nearly from end to end, so that what stands at the texel's rim does not count. */
static void set_diagonals(const struct search *s, const struct kiln_point_cursor *at, struct segments *r, size_t first,
                          size_t apart)
{
    struct texel_plane plane;
    double ends[4][2];
    set_no_segment(r, first);
    set_no_segment(r, first + apart);
    if (!find_plane(s, at, &plane))
        return;
    find_ends(s, at, ends);
    for (int k = 0; k < SEGMENTS; k++) {
        const double *a = ends[2 * k], *b = ends[2 * k + 1];
        const double x0 = a[0] + LIFT * (b[0] - a[0]), y0 = a[1] + LIFT * (b[1] - a[1]),
                     x1 = b[0] - LIFT * (b[0] - a[0]), y1 = b[1] - LIFT * (b[1] - a[1]);
        set_segment(r, first + (size_t)k * apart, place_of(&plane, x0, y0), place_of(&plane, x1, y1));
    }
}

/* ---- lines ---- */

/* The line along which a triangle's plane cuts the one that the rays of a texel lie in; false where they are nearly
 * parallel. */
static bool line_of(const struct search *s, const struct texel_plane *p, uint32_t triangle, float line[3])
{
    struct kiln_vec3 corner[3];
    kiln_geometry_corners(s->geometry, triangle, corner);
    const struct kiln_dvec3 n = dvec3_of(kiln_triangle_normal(s->geometry, triangle));
    if (dvec3_length(dvec3_cross(n, p->normal)) < LEAST_SLOPE)
        return false;
    const double a = dvec3_dot(n, p->du), b = dvec3_dot(n, p->dv), length = hypot(a, b),
                 c = dvec3_dot(n, dvec3_sub(dvec3_of(corner[0]), dvec3_add(p->origin, p->lift)));
    if (!(length > 0.0))
        return false;
    line[0] = (float)(a / length);
    line[1] = (float)(b / length);
    line[2] = (float)(c / length);
    return true;
}

static void turn_line(float line[3])
{
    for (int i = 0; i < 3; i++)
        line[i] = -line[i];
}

static void turn_sides(struct texel_line *l)
{
    const struct texel_line old = *l;
    turn_line(l->line);
    l->face = -old.far_face;
    l->far_face = -old.face;
    l->area = old.other;
    l->other = old.area;
    memcpy(l->centre, old.beyond, sizeof l->centre);
    memcpy(l->beyond, old.centre, sizeof l->beyond);
}

/* The largest of the point's pieces on the near side of the line: its corners, and its centroid. Returns the area of
 * all of them, m2. */
static double near_side(const struct search *s, const struct kiln_point_cursor *at, const float line[3],
                        struct kiln_clip_corner polygon[KILN_CLIP_CORNERS], uint32_t *corners,
                        struct kiln_clip_corner *centroid)
{
    double sum = 0.0, largest = 0.0;
    *corners = 0;
    for (uint32_t i = 0; i < kiln_piece_count(s->surface, at->point); i++) {
        const uint32_t triangle = s->surface->pieces[at->piece + i];
        struct kiln_clip_corner own[KILN_CLIP_CORNERS], middle;
        struct kiln_texel_triangle local;
        kiln_texel_triangle(s->scene, s->geometry, triangle, &at->place, &local);
        const uint32_t count = kiln_clip_line(own, kiln_texel_clip(&local, 0.0, 0.0, 1.0, 1.0, own), line);
        const double area =
            count < 3 ? 0.0
                      : kiln_clip_fraction(own, count, &middle) * kiln_geometry_triangle_area(s->geometry, triangle);
        sum += area;
        if (area > largest) {
            largest = area;
            *corners = count;
            *centroid = middle;
            memcpy(polygon, own, count * sizeof *own);
        }
    }
    return sum;
}

/* Turns the line so that its near side is the larger one, and finds a place on either. False if it leaves next to
 * nothing on one of them. */
static bool settle_line(const struct search *s, const struct kiln_point_cursor *at, struct texel_line *l)
{
    struct kiln_clip_corner polygon[KILN_CLIP_CORNERS], centre, beyond;
    const float other[3] = {-l->line[0], -l->line[1], -l->line[2]};
    uint32_t corners;
    const double near = near_side(s, at, l->line, polygon, &corners, &centre),
                 far = near_side(s, at, other, polygon, &corners, &beyond);
    if (!(fmin(near, far) > LEAST_SHARE * (near + far)))
        return false;
    l->area = near;
    l->other = far;
    l->centre[0] = (float)centre.x, l->centre[1] = (float)centre.y;
    l->beyond[0] = (float)beyond.x, l->beyond[1] = (float)beyond.y;
    if (near < far)
        turn_sides(l);
    return true;
}

/* ---- whether a wall divides a texel ---- */

/* Places on the near side of the line: by the corners of its largest piece. */
static void spread_places(const struct search *s, const struct candidate *c, const float line[3],
                          struct kiln_dvec3 places[PLACES])
{
    struct kiln_clip_corner polygon[KILN_CLIP_CORNERS], centre = {0};
    uint32_t corners;
    (void)near_side(s, &c->at, line, polygon, &corners, &centre);
    for (uint32_t k = 0; k < PLACES; k++) {
        const struct kiln_clip_corner *corner = corners > 0 ? &polygon[k * corners / PLACES] : &centre;
        places[k] = place_of(&c->plane, centre.x + NEAR_CORNERS * (corner->x - centre.x),
                             centre.y + NEAR_CORNERS * (corner->y - centre.y));
    }
}

/* Places on both sides of a candidate's line. */
static void spread_all(const struct search *s, const struct candidate *c, struct kiln_dvec3 here[PLACES],
                       struct kiln_dvec3 there[PLACES])
{
    const float other[3] = {-c->line.line[0], -c->line.line[1], -c->line.line[2]};
    spread_places(s, c, c->line.line, here);
    spread_places(s, c, other, there);
}

/* Rays along the sides of a texel: the parts of the lines of set_grid that it has. */
static void set_sides(const struct candidate *c, struct segments *r, size_t first)
{
    const uint32_t x = c->at.place.x % KILN_TILE_SIDE, y = c->at.place.y % KILN_TILE_SIDE;
    const double x0 = x == 0 ? LIFT : 0.0, x1 = x == KILN_TILE_SIDE - 1 ? 1.0 - LIFT : 1.0, y0 = y == 0 ? LIFT : 0.0,
                 y1 = y == KILN_TILE_SIDE - 1 ? 1.0 - LIFT : 1.0;
    const struct kiln_dvec3 corner[SIDES] = {place_of(&c->plane, x0, y0), place_of(&c->plane, x1, y0),
                                             place_of(&c->plane, x1, y1), place_of(&c->plane, x0, y1)};
    for (size_t k = 0; k < SIDES; k++)
        set_segment(r, first + k, corner[k], corner[(k + 1) % SIDES]);
}

/* Some of the rays of a trial: if one of them meets nothing, the wall divides nothing. */
static void set_glance(const struct search *s, const struct candidate *c, struct segments *r, size_t first)
{
    struct kiln_dvec3 here[PLACES], there[PLACES];
    spread_all(s, c, here, there);
    for (size_t k = 0; k < PLACES; k++)
        set_segment(r, first + k, here[k], there[k]);
}

static void set_trial(const struct search *s, const struct candidate *c, struct segments *r, size_t first)
{
    struct kiln_dvec3 here[PLACES], there[PLACES];
    spread_all(s, c, here, there);
    for (size_t k = 0; k < PAIRS; k++) {
        set_segment(r, first + 2 * k, here[k / PLACES], there[k % PLACES]);
        set_segment(r, first + 2 * k + 1, there[k % PLACES], here[k / PLACES]);
    }
    set_sides(c, r, first + 2 * (size_t)PAIRS);
}

/* The rays of a trial that go one way. */
static void set_one_way(const struct search *s, const struct candidate *c, struct segments *r, size_t first)
{
    struct kiln_dvec3 here[PLACES], there[PLACES];
    spread_all(s, c, here, there);
    const struct kiln_dvec3 *from = c->from_beyond ? there : here, *to = c->from_beyond ? here : there;
    for (size_t k = 0; k < PAIRS; k++)
        set_segment(r, first + k, from[k / PLACES], to[k % PLACES]);
}

static bool is_inside(const struct search *s, const struct kiln_hit *hit)
{
    return hit->back && kiln_geometry_is_solid(s->geometry, hit->triangle);
}

/* What of either side is between the middle of the wall and its face; a place beyond the far face. */
static void measure_wall(const struct search *s, struct candidate *c)
{
    struct texel_line *l = &c->line;
    const float face[3] = {l->line[0], l->line[1], l->face}, other[3] = {-l->line[0], -l->line[1], -l->far_face};
    struct kiln_clip_corner polygon[KILN_CLIP_CORNERS], centre, beyond;
    uint32_t corners;
    l->within = near_side(s, &c->at, l->line, polygon, &corners, &centre) -
                near_side(s, &c->at, face, polygon, &corners, &centre);
    const double outside = near_side(s, &c->at, other, polygon, &corners, &beyond);
    l->beyond_within = fmax(0.0, l->other - outside);
    l->ends = !(outside > 0.0);
    if (!l->ends) {
        l->beyond[0] = (float)beyond.x;
        l->beyond[1] = (float)beyond.y;
    }
}

/* The line in the middle of the wall, between its two faces where these are parallel. */
static bool middle_line(const struct search *s, struct candidate *c, const struct kiln_hit *hit,
                        const struct kiln_hit *back)
{
    float one[3], two[3], *line = c->line.line;
    if (!line_of(s, &c->plane, hit->triangle, one) || !line_of(s, &c->plane, back->triangle, two))
        return false;
    if (one[0] * line[0] + one[1] * line[1] < 0.0f)
        turn_line(one);
    if (two[0] * line[0] + two[1] * line[1] < 0.0f)
        turn_line(two);
    const bool parallel = (double)(one[0] * two[0] + one[1] * two[1]) > SAME_NORMAL;
    for (int i = 0; i < 3; i++)
        line[i] = parallel ? 0.5f * (one[i] + two[i]) : one[i];
    c->line.face = parallel ? one[2] : line[2];
    c->line.far_face = parallel ? two[2] : line[2];
    if (!settle_line(s, &c->at, &c->line))
        return false;
    c->line.face = fminf(c->line.face, line[2]);
    c->line.far_face = fmaxf(c->line.far_face, line[2]);
    measure_wall(s, c);
    return true;
}

/* Whether something stands on a side of the texel. Of texels that are covered in part the sides do not count. */
static bool sides_meet(const struct search *s, const struct candidate *c, const struct segments *r, size_t first)
{
    bool met = !kiln_point_whole(s->surface, c->at.point);
    for (size_t k = 0; k < SIDES; k++)
        met = met || meets(r, first + k);
    return met;
}

/* Whether nothing goes from side to side. What starts inside of something is left out. */
static bool is_divided(const struct search *s, struct candidate *c, const struct segments *r, size_t first)
{
    size_t apart = PAIRS;
    if (!sides_meet(s, c, r, first + 2 * (size_t)PAIRS))
        return false;
    for (size_t k = 0; k < PAIRS; k++) {
        const size_t there = first + 2 * k, back = there + 1;
        if (!meets(r, there) || !meets(r, back))
            return false;
        if (apart == PAIRS && !is_inside(s, &r->hits[there]) && !is_inside(s, &r->hits[back]))
            apart = k;
    }
    return apart < PAIRS && middle_line(s, c, &r->hits[first + 2 * apart], &r->hits[first + 2 * apart + 1]);
}

static bool all_meet(const struct segments *r, size_t first, size_t count)
{
    bool all = true;
    for (size_t i = first; i < first + count; i++)
        all = all && meets(r, i);
    return all;
}

static bool all_end_inside(const struct search *s, const struct segments *r, size_t first, size_t count)
{
    bool all = true;
    for (size_t i = first; i < first + count; i++)
        all = all && is_inside(s, &r->hits[i]);
    return all;
}

/* By the rays of set_glance. */
static bool is_hidden(const struct search *s, struct candidate *c, const struct segments *r, size_t first)
{
    c->from_beyond = !all_end_inside(s, r, first, PLACES);
    return all_meet(r, first, PLACES);
}

/* By the rays of set_one_way: a side from which all of them end in a solid is one that is left out. */
static bool may_divide(const struct search *s, struct candidate *c, const struct segments *r, size_t first)
{
    (void)c;
    return all_meet(r, first, PAIRS) && !all_end_inside(s, r, first, PAIRS);
}

/* A way of asking candidates: `rays` of each. */
struct sieve {
    size_t rays;
    void (*set)(const struct search *s, const struct candidate *c, struct segments *r, size_t first);
    bool (*stays)(const struct search *s, struct candidate *c, const struct segments *r, size_t first);
};

/* Asks `some` candidates, whose rays fit. */
static int ask(const struct search *s, const struct sieve *by, struct candidate *list, size_t some, struct segments *r,
               struct kiln_error *error)
{
#pragma omp parallel for schedule(dynamic, 16) num_threads((int)s->threads)
    for (size_t i = 0; i < some; i++)
        by->set(s, &list[i], r, i * by->rays);
    const int status = trace(r, s->backend, some * by->rays, error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for schedule(dynamic, 16) num_threads((int)s->threads)
    for (size_t i = 0; i < some; i++)
        list[i].stays = by->stays(s, &list[i], r, i * by->rays);
    return KILN_OK;
}

/* Drops the candidates that do not stay. */
static int sift(const struct search *s, const struct sieve *by, struct candidates *c, struct segments *r,
                struct kiln_error *error)
{
    const size_t most = r->room / by->rays;
    size_t kept = 0;
    int status = KILN_OK;
    for (size_t done = 0, some; status == KILN_OK && done < c->count; done += some) {
        some = c->count - done < most ? c->count - done : most;
        status = ask(s, by, c->list + done, some, r, error);
    }
    for (size_t i = 0; status == KILN_OK && i < c->count; i++)
        if (c->list[i].stays)
            c->list[kept++] = c->list[i];
    c->count = kept;
    return status;
}

/* Leaves those that divide their texels. Few rays say of most that they do not: for both ways of a pair must meet a
 * wall from outside. */
static int try_candidates(const struct search *s, struct candidates *c, struct segments *r, struct kiln_error *error)
{
    static const struct sieve sieves[] = {
        {PLACES, set_glance, is_hidden}, {PAIRS, set_one_way, may_divide}, {TRIAL_RAYS, set_trial, is_divided}};
    int status = KILN_OK;
    for (size_t i = 0; status == KILN_OK && i < sizeof sieves / sizeof *sieves; i++)
        status = sift(s, &sieves[i], c, r, error);
    return status;
}

/* ---- all texels of this rank ---- */

static bool is_same_line(const struct texel_line *a, const struct texel_line *b)
{
    return memcmp(a->line, b->line, sizeof a->line) == 0;
}

/* Writes the candidates of one point: the planes that its rays have met. Returns their number, SEGMENTS at most. */
static size_t point_candidates(const struct search *s, const struct kiln_point_cursor *at, size_t tile_run,
                               const struct segments *r, size_t first, size_t apart, struct candidate *list)
{
    size_t count = 0;
    for (size_t k = 0; k < SEGMENTS; k++) {
        const size_t ray = first + k * apart;
        struct candidate *new = &list[count];
        if (!meets(r, ray))
            continue;
        *new = (struct candidate){.at = *at, .tile_run = tile_run};
        if (find_plane(s, at, &new->plane) && line_of(s, &new->plane, r->hits[ray].triangle, new->line.line) &&
            settle_line(s, at, &new->line) && (count == 0 || !is_same_line(&list[0].line, &new->line)))
            count++;
    }
    return count;
}

/* Keeps what divides, one for each point, in order. */
static int keep_divided(struct search *s, const struct candidates *c, struct kiln_error *error)
{
    struct candidates *f = &s->found;
    for (size_t i = 0; i < c->count; i++) {
        if (f->count > 0 && f->list[f->count - 1].at.point.at == c->list[i].at.point.at)
            continue;
        const int status = kiln_grow(&f->list, &f->room, f->count + 1, sizeof *f->list, "divided texels", error);
        if (status != KILN_OK)
            return status;
        f->list[f->count++] = c->list[i];
    }
    return KILN_OK;
}

/* Whether a tile run is all of its tile and lies on one triangle. */
static bool is_plain(const struct search *s, size_t run)
{
    const struct kiln_surface *surface = s->surface;
    const struct kiln_tile_run *f = &surface->tile_runs[run];
    const uint32_t *pieces = surface->pieces + surface->piece_base[run];
    if (f->count < KILN_TILE_TEXELS || surface->piece_base[run + 1] - surface->piece_base[run] != KILN_TILE_TEXELS)
        return false;
    for (uint64_t k = 0, own = kiln_own_of_global(surface, f->first).at; k < KILN_TILE_TEXELS; k++)
        if (!kiln_point_whole(surface, (struct kiln_own_point){own + k}) || pieces[k] != pieces[0])
            return false;
    return true;
}

/* The rays of a plain tile run, along the lines between its texels: a wall that divides a texel crosses the texel's
 * sides (sides_meet), so that no texel of a tile run is divided where they meet nothing. */
static void set_grid(const struct search *s, size_t run, struct segments *r, size_t first)
{
    const struct kiln_point_cursor at = kiln_point_first(s->surface, run);
    struct texel_plane p;
    if (!find_plane(s, &at, &p)) {
        for (size_t k = 0; k < GRID; k++)
            set_no_segment(r, first + k);
        return;
    }
    for (size_t k = 0; k < GRID; k++) {
        const double line = fmin(fmax((double)(k / 2), LIFT), KILN_TILE_SIDE - LIFT), end = KILN_TILE_SIDE - LIFT;
        if (k % 2 == 0)
            set_segment(r, first + k, place_of(&p, LIFT, line), place_of(&p, end, line));
        else
            set_segment(r, first + k, place_of(&p, line, LIFT), place_of(&p, line, end));
    }
}

/* Finds the plain tile runs among [begin, end) that nothing stands on: 1 in `empty`. */
static int find_empty(struct search *s, size_t begin, size_t end, struct segments *r, size_t *ray, uint8_t *empty,
                      struct kiln_error *error)
{
    size_t rays = 0;
#pragma omp parallel for schedule(dynamic, 64) num_threads((int)s->threads)
    for (size_t f = begin; f < end; f++)
        empty[f - begin] = is_plain(s, f);
    for (size_t f = begin; f < end; f++) {
        ray[f - begin] = rays;
        rays += empty[f - begin] != 0 ? GRID : 0;
    }
#pragma omp parallel for schedule(dynamic, 16) num_threads((int)s->threads)
    for (size_t f = begin; f < end; f++)
        if (empty[f - begin] != 0)
            set_grid(s, f, r, ray[f - begin]);
    const int status = trace(r, s->backend, rays, error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for schedule(dynamic, 64) num_threads((int)s->threads)
    for (size_t f = begin; f < end; f++)
        for (size_t k = 0; k < GRID && empty[f - begin] != 0; k++)
            empty[f - begin] = !meets(r, ray[f - begin] + k);
    return KILN_OK;
}

/* Traces the rays of all points of the tile runs [begin, end) but for empty ones. */
static int trace_diagonals(struct search *s, size_t begin, size_t end, struct segments *r, size_t *ray,
                           const uint8_t *empty, struct kiln_error *error)
{
    const struct kiln_surface *surface = s->surface;
    size_t rays = 0;
    for (size_t f = begin; f < end; f++) {
        ray[f - begin] = rays;
        rays += empty[f - begin] != 0 ? 0 : SEGMENTS * (size_t)surface->tile_runs[f].count;
    }
#pragma omp parallel for schedule(dynamic, 16) num_threads((int)s->threads)
    for (size_t f = begin; f < end; f++) {
        const uint32_t points = surface->tile_runs[f].count;
        struct kiln_point_cursor at = kiln_point_first(surface, f);
        for (uint32_t k = 0; k < points && empty[f - begin] == 0; k++, kiln_point_next(surface, &at))
            set_diagonals(s, &at, r, ray[f - begin] + k, points);
    }
    return trace(r, s->backend, rays, error);
}

/* How many rays of the points of a tile run have met something, `first` being the first. */
static size_t count_met(const struct search *s, size_t run, const struct segments *r, size_t first)
{
    const size_t rays = SEGMENTS * (size_t)s->surface->tile_runs[run].count;
    size_t met = 0;
    for (size_t i = first; i < first + rays; i++)
        met += meets(r, i);
    return met;
}

/* Writes the candidates of a tile run; returns their number. */
static size_t run_candidates(const struct search *s, size_t run, const struct segments *r, size_t first,
                             struct candidate *list)
{
    struct kiln_point_cursor at = kiln_point_first(s->surface, run);
    const uint32_t points = s->surface->tile_runs[run].count;
    size_t count = 0;
    for (uint32_t k = 0; k < points; k++, kiln_point_next(s->surface, &at), first++)
        if (meets(r, first) || meets(r, first + points))
            count += point_candidates(s, &at, run, r, first, points, list + count);
    return count;
}

/* The candidates of the tile runs [begin, end) but for empty ones, in order. */
static int find_candidates(const struct search *s, size_t begin, size_t end, const struct segments *r,
                           const size_t *ray, const uint8_t *empty, struct candidates *c, struct kiln_error *error)
{
    const size_t runs = end - begin;
    size_t *place = NULL, *counts = NULL;
    int status = kiln_allocate(&place, runs + 1, sizeof *place, "texels at walls", error);
    if (status == KILN_OK)
        status = kiln_allocate(&counts, runs, sizeof *counts, "texels at walls", error);
    if (status != KILN_OK)
        goto end;
#pragma omp parallel for schedule(dynamic, 64) num_threads((int)s->threads)
    for (size_t f = 0; f < runs; f++)
        place[f + 1] = empty[f] != 0 ? 0 : count_met(s, begin + f, r, ray[f]);
    for (size_t f = 0; f < runs; f++)
        place[f + 1] += place[f];
    status = kiln_grow(&c->list, &c->room, place[runs], sizeof *c->list, "texels at walls", error);
    if (status != KILN_OK)
        goto end;
    c->count = 0;
#pragma omp parallel for schedule(dynamic, 16) num_threads((int)s->threads)
    for (size_t f = 0; f < runs; f++)
        if (place[f + 1] > place[f])
            counts[f] = run_candidates(s, begin + f, r, ray[f], c->list + place[f]);
    for (size_t f = 0; f < runs; f++)
        for (size_t i = 0; i < counts[f]; i++)
            c->list[c->count++] = c->list[place[f] + i];
end:
    kiln_free(&place);
    kiln_free(&counts);
    return status;
}

/* Looks at tile runs [begin, end), whose rays fit; `c`: room for candidates. */
static int look_at(struct search *s, size_t begin, size_t end, struct segments *r, struct candidates *c,
                   struct kiln_error *error)
{
    size_t *ray = NULL;
    uint8_t *empty = NULL;
    int status = kiln_allocate(&ray, end - begin, sizeof *ray, "rays along texels", error);
    if (status == KILN_OK)
        status = kiln_allocate(&empty, end - begin, 1, "rays along texels", error);
    if (status == KILN_OK)
        status = find_empty(s, begin, end, r, ray, empty, error);
    if (status == KILN_OK)
        status = trace_diagonals(s, begin, end, r, ray, empty, error);
    if (status == KILN_OK)
        status = find_candidates(s, begin, end, r, ray, empty, c, error);
    if (status == KILN_OK && c->count > 0)
        status = try_candidates(s, c, r, error);
    if (status == KILN_OK)
        status = keep_divided(s, c, error);
    kiln_free(&ray);
    kiln_free(&empty);
    return status;
}

static int look_at_all(struct search *s, struct kiln_error *error)
{
    const struct kiln_surface *surface = s->surface;
    const size_t runs = surface->tile_run_count;
    struct candidates c = {0};
    struct segments r = {0};
    const size_t rays = SEGMENTS * (size_t)(surface->count < CHUNK_POINTS ? surface->count : CHUNK_POINTS);
    int status = segments_create(&r, rays > TRIAL_RAYS ? rays : TRIAL_RAYS, error);
    for (size_t begin = 0, end; status == KILN_OK && begin < runs; begin = end) {
        uint64_t points = 0;
        for (end = begin; end < runs && points + surface->tile_runs[end].count <= CHUNK_POINTS; end++)
            points += surface->tile_runs[end].count;
        status = kiln_stop_asked(s->stop) ? kiln_give_up(error) : look_at(s, begin, end, &r, &c, error);
    }
    kiln_free(&c.list);
    segments_destroy(&r);
    return status;
}

/* ---- what lies beyond ---- */

static int by_point(const void *a, const void *b)
{
    const struct told *x = a, *y = b;
    return x->texel.point.at < y->texel.point.at ? -1 : x->texel.point.at > y->texel.point.at ? 1 : 0;
}

static void take_told(void *taker, const void *records, size_t count)
{
    struct list *list = taker;
    if (list->status == KILN_OK)
        list->status =
            kiln_grow(&list->told, &list->room, list->count + count, sizeof *list->told, "divided texels", list->error);
    if (list->status != KILN_OK)
        return;
    memcpy(list->told + list->count, records, count * sizeof *list->told);
    list->count += count;
}

/* Collective. All ranks' divided texels, by point. */
static int tell_all(struct search *s, int status, const struct told *own, size_t count, struct kiln_error *error)
{
    s->all.count = 0;
    s->all.status = KILN_OK;
    s->all.error = error;
    if (s->exchange != NULL) {
        status =
            s->exchange->allgather(s->exchange->context, status, own, count, sizeof *own, take_told, &s->all, error);
        if (status == KILN_OK)
            status = s->exchange->agree(s->exchange->context, s->all.status, error);
    } else if (status == KILN_OK && count > 0) {
        take_told(&s->all, own, count);
        status = s->all.status;
    }
    if (status == KILN_OK && s->all.count > 0)
        qsort(s->all.told, s->all.count, sizeof *s->all.told, by_point);
    return status;
}

/* A place of the point's texel that its light is from. */
static void centre_of(const struct search *s, struct kiln_global_point point, double centre[2])
{
    const struct told key = {.texel = {.point = point}};
    const struct told *found =
        s->all.count > 0 ? bsearch(&key, s->all.told, s->all.count, sizeof *s->all.told, by_point) : NULL;
    centre[0] = found != NULL ? (double)found->centre[0] : 0.5;
    centre[1] = found != NULL ? (double)found->centre[1] : 0.5;
}

/* The point of the texel so many steps away in x and y; of octrees, of the leaf there in the same layer or in one
 * beside it. */
static struct kiln_global_point neighbour(const struct kiln_surface *s, const struct kiln_point_cursor *at,
                                          const int step[2])
{
    static const int layers[3] = {0, -1, 1};
    const struct kiln_lightmap *map = &s->lightmaps[at->map];
    const int64_t x = (int64_t)at->place.x + step[0], y = (int64_t)at->place.y + step[1];
    struct kiln_global_point point = {KILN_NO_POINT};
    if (x < 0 || y < 0 || (!at->leaves && (x >= map->width || y >= map->height)))
        return point;
    if (!at->leaves)
        return kiln_surface_find(s, at->map, (uint32_t)x, (uint32_t)y);
    for (int i = 0; i < 3 && point.at == KILN_NO_POINT; i++)
        point = kiln_surface_find_leaf(s, at->map, (uint32_t)x, (uint32_t)y,
                                       (uint32_t)((int64_t)at->place.layer + layers[i]));
    return point;
}

/* Texels that the surface goes on for from a point across its line, on the near side (-1) or beyond (1): no more than
 * `most`. */
static int texels_on(const struct search *s, const struct candidate *c, int side, int most)
{
    const double a = side * (double)c->line.line[0], b = side * (double)c->line.line[1], along = fmax(fabs(a), fabs(b));
    int count = 0;
    while (count < most) {
        const int step[2] = {(int)lround((count + 1) * a / along), (int)lround((count + 1) * b / along)};
        if (neighbour(s->surface, &c->at, step).at == KILN_NO_POINT)
            break;
        count++;
    }
    return count;
}

/* Two rays of a texel whose main side may be a rim: from beyond along the surface, which nothing may stand on up to the
 * last texel that it has to go on for; and from beyond to the wall. */
static void set_rim(const struct search *s, const struct candidate *c, struct segments *r, size_t first)
{
    const struct texel_line *l = &c->line;
    const int rim = texels_on(s, c, -1, ENDS_WITHIN + 1), far = GOES_ON * (rim + 1);
    set_no_segment(r, first);
    set_no_segment(r, first + 1);
    if (c->at.leaves || l->ends || rim > ENDS_WITHIN || texels_on(s, c, 1, far) < far)
        return;
    const double along = fmax(fabs((double)l->line[0]), fabs((double)l->line[1])), steps = (far - 0.5) / along;
    const struct kiln_dvec3 from = place_of(&c->plane, (double)l->beyond[0], (double)l->beyond[1]);
    set_segment(r, first, from,
                place_of(&c->plane, 0.5 + steps * (double)l->line[0], 0.5 + steps * (double)l->line[1]));
    set_segment(r, first + 1, from, place_of(&c->plane, (double)l->centre[0], (double)l->centre[1]));
}

/* Rays over the hemisphere of a place, as many from each part of it as a matt surface sees of it. */
static void set_hemisphere(const struct candidate *c, const float place[2], struct segments *r, size_t first)
{
    const struct kiln_dvec3 from = place_of(&c->plane, (double)place[0], (double)place[1]), n = c->plane.normal,
                            u = dvec3_scale(c->plane.du, 1.0 / dvec3_length(c->plane.du)), v = dvec3_cross(n, u);
    for (size_t k = 0; k < OPEN_RAYS; k++) {
        const double square = ((double)k + 0.5) / OPEN_RAYS, radius = sqrt(square), angle = GOLDEN_ANGLE * (double)k;
        const struct kiln_dvec3 d =
            dvec3_add(dvec3_add(dvec3_scale(u, radius * cos(angle)), dvec3_scale(v, radius * sin(angle))),
                      dvec3_scale(n, sqrt(1.0 - square)));
        set_segment(r, first + k, from, dvec3_add(from, d));
    }
}

static int by_distance(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return x < y ? -1 : x > y ? 1 : 0;
}

/* m: as far as a quarter of a place's rays see at least. */
static double openness(const struct segments *r, size_t first)
{
    double distance[OPEN_RAYS];
    for (size_t k = 0; k < OPEN_RAYS; k++)
        distance[k] = r->hits[first + k].triangle != KILN_NONE ? (double)r->hits[first + k].distance : INFINITY;
    qsort(distance, OPEN_RAYS, sizeof *distance, by_distance);
    return distance[OPEN_RAYS - OPEN_RAYS / 4];
}

/* Whether a texel's main side is the rim of a surface that goes on: by the rays of set_rim. What starts inside of a
 * solid stays the other side. */
static bool is_rim(const struct search *s, const struct segments *r, size_t first)
{
    return r->lengths[first] > 0.0f && !meets(r, first) && meets(r, first + 1) && !is_inside(s, &r->hits[first + 1]);
}

/* Of the candidates in `rims`: makes the smaller side of a texel its main side where the next texel on it is the more
 * open place, or open enough. */
static int turn_rims(struct search *s, const size_t *rims, size_t count, struct kiln_error *error)
{
    struct candidate *list = s->found.list;
    struct segments r = {0};
    int status = count > 0 ? segments_create(&r, 2 * OPEN_RAYS * count, error) : KILN_OK;
    for (size_t i = 0; status == KILN_OK && i < count; i++) {
        const struct texel_line *l = &list[rims[i]].line; /* the next texel beyond is out of what may be a groove */
        const float along = fmaxf(fabsf(l->line[0]), fabsf(l->line[1])),
                    next[2] = {0.5f + l->line[0] / along, 0.5f + l->line[1] / along};
        set_hemisphere(&list[rims[i]], l->centre, &r, 2 * OPEN_RAYS * i);
        set_hemisphere(&list[rims[i]], next, &r, 2 * OPEN_RAYS * i + OPEN_RAYS);
    }
    if (status == KILN_OK && count > 0)
        status = kiln_backend_intersect(s->backend, r.origins, r.directions, 2 * OPEN_RAYS * count, r.hits, error);
    for (size_t i = 0; status == KILN_OK && i < count; i++) {
        const double rim = openness(&r, 2 * OPEN_RAYS * i), far = openness(&r, 2 * OPEN_RAYS * i + OPEN_RAYS);
        if (far < fmin(rim, OPEN))
            continue;
        turn_sides(&list[rims[i]].line);
        measure_wall(s, &list[rims[i]]);
        list[rims[i]].line.goes_on = true;
    }
    segments_destroy(&r);
    return status;
}

/* Makes the smaller side of a texel its main side where the larger is the rim of a surface that goes on at the other
 * side: what a wall's end leaves outdoors. */
static int choose_sides(struct search *s, struct kiln_error *error)
{
    const struct candidates *f = &s->found;
    struct segments r = {0};
    size_t *rims = NULL, count = 0;
    if (f->count == 0)
        return KILN_OK;
    int status = segments_create(&r, 2 * f->count, error);
    if (status == KILN_OK)
        status = kiln_allocate(&rims, f->count, sizeof *rims, "divided texels", error);
    if (status == KILN_OK) {
#pragma omp parallel for schedule(dynamic, 16) num_threads((int)s->threads)
        for (size_t i = 0; i < f->count; i++)
            set_rim(s, &f->list[i], &r, 2 * i);
        status = trace(&r, s->backend, 2 * f->count, error);
    }
    for (size_t i = 0; status == KILN_OK && i < f->count; i++)
        if (is_rim(s, &r, 2 * i))
            rims[count++] = i;
    if (status == KILN_OK)
        status = turn_rims(s, rims, count, error);
    kiln_free(&rims);
    segments_destroy(&r);
    return status;
}

/* The neighbours of a divided texel whose light is from beyond the line; a ray to each. */
static void set_neighbours(const struct search *s, const struct candidate *c, struct segments *r, size_t first,
                           struct kiln_global_point *points)
{
    static const int step[NEIGHBOURS][2] = {{1, 0}, {-1, 0}, {0, 1}, {0, -1}, {1, 1}, {-1, 1}, {1, -1}, {-1, -1}};
    const struct kiln_dvec3 from = place_of(&c->plane, (double)c->line.beyond[0], (double)c->line.beyond[1]);
    for (size_t k = 0; k < NEIGHBOURS; k++) {
        double centre[2];
        set_no_segment(r, first + k);
        points[k] = neighbour(s->surface, &c->at, step[k]);
        if (points[k].at == KILN_NO_POINT)
            continue;
        centre_of(s, points[k], centre);
        centre[0] += step[k][0];
        centre[1] += step[k][1];
        if ((double)c->line.line[0] * centre[0] + (double)c->line.line[1] * centre[1] > (double)c->line.line[2])
            set_segment(r, first + k, from, place_of(&c->plane, centre[0], centre[1]));
        else
            points[k].at = KILN_NO_POINT;
    }
}

/* Writes to `own` the divided texels of this rank that have a neighbour beyond the wall; *count of them. */
static int find_neighbours(const struct search *s, struct told *own, size_t *count, struct kiln_error *error)
{
    const struct candidates *f = &s->found;
    struct kiln_global_point *points = NULL;
    struct segments r = {0};
    *count = 0;
    int status = segments_create(&r, f->count * NEIGHBOURS, error);
    if (status == KILN_OK)
        status = kiln_allocate(&points, f->count * NEIGHBOURS, sizeof *points, "divided texels", error);
    for (size_t i = 0; status == KILN_OK && i < f->count; i++)
        set_neighbours(s, &f->list[i], &r, i * NEIGHBOURS, points + i * NEIGHBOURS);
    if (status == KILN_OK)
        status = trace(&r, s->backend, f->count * NEIGHBOURS, error);
    for (size_t i = 0; status == KILN_OK && i < f->count; i++) {
        size_t k = i * NEIGHBOURS;
        const size_t end = k + NEIGHBOURS;
        while (k < end && (points[k].at == KILN_NO_POINT || meets(&r, k)))
            k++;
        if (k == end && !f->list[i].line.ends && !f->list[i].line.goes_on)
            continue;
        own[*count] = own[i];
        own[*count].texel.beyond = k < end ? points[k] : own[i].texel.point;
        ++*count;
    }
    segments_destroy(&r);
    kiln_free(&points);
    return status;
}

/* ---- the map of the surface ---- */

static int by_tile(const void *a, const void *b)
{
    const struct told *x = a, *y = b;
    return x->texel.tile < y->texel.tile ? -1 : x->texel.tile > y->texel.tile ? 1 : by_point(a, b);
}

/* Entries of `splits` of a tile: 0 if it has a single tile run. */
static uint64_t parts_of(const struct kiln_surface *s, const struct kiln_tile *tile)
{
    uint64_t parts = 0;
    if ((tile->first & KILN_TILE_SPLIT) != 0)
        for (uint64_t seen = 0; seen != tile->mask; parts++)
            seen |= s->splits[(tile->first & ~KILN_TILE_SPLIT) + parts].mask;
    return parts;
}

/* Gives the tiles of divided texels new entries, of these before the others, at the end of `splits`. */
static int enter(struct search *s, struct kiln_error *error)
{
    struct kiln_surface *surface = s->surface;
    struct list *all = &s->all;
    uint64_t end = surface->split_count, room = surface->split_count + all->count;
    struct kiln_split_tile_run *splits = NULL;
    for (size_t i = 0; i < all->count; i++)
        surface->divided[i] = all->told[i].texel;
    surface->divided_count = all->count;
    for (size_t i = 0; i < all->count; i++)
        all->told[i].texel.point.at = i; /* from here on: index in `divided` */
    qsort(all->told, all->count, sizeof *all->told, by_tile);
    for (size_t i = 0; i < all->count; i++)
        if (i == 0 || all->told[i].texel.tile != all->told[i - 1].texel.tile) {
            const uint64_t parts = parts_of(surface, &surface->tiles[all->told[i].texel.tile]);
            room += parts > 0 ? parts : 1;
        }
    const int status = kiln_allocate(&splits, room, sizeof *splits, "the split lightmap tiles", error);
    if (status != KILN_OK)
        return status;
    if (end > 0)
        memcpy(splits, surface->splits, end * sizeof *splits);
    for (size_t i = 0; i < all->count;) {
        struct kiln_tile *tile = &surface->tiles[all->told[i].texel.tile];
        const uint64_t number = all->told[i].texel.tile, begin = end, parts = parts_of(surface, tile);
        for (; i < all->count && all->told[i].texel.tile == number; i++)
            splits[end++] = (struct kiln_split_tile_run){1ull << all->told[i].texel.bit,
                                                         {KILN_TILE_SPLIT | all->told[i].texel.point.at}};
        for (uint64_t k = 0; k < parts; k++)
            splits[end++] = surface->splits[(tile->first & ~KILN_TILE_SPLIT) + k];
        if (parts == 0)
            splits[end++] = (struct kiln_split_tile_run){tile->mask, {tile->first}};
        tile->first = KILN_TILE_SPLIT | begin;
    }
    kiln_free(&surface->splits);
    surface->splits = splits;
    surface->split_count = end;
    return KILN_OK;
}

/* The fractions of area of the own divided points. */
static void cut_areas(const struct search *s)
{
    for (size_t i = 0; i < s->found.count; i++) {
        const struct kiln_point_cursor *at = &s->found.list[i].at;
        const uint32_t pieces = kiln_piece_count(s->surface, at->point);
        struct kiln_footprint f;
        double total = 0.0, sum = 0.0;
        if (pieces == 1 || kiln_surface_divided(s->surface, kiln_global_of_own(s->surface, at->point)) == NULL)
            continue;
        kiln_footprint_prepare(&f, s->scene, s->geometry, s->surface, at);
        for (uint32_t k = 0; k < pieces; k++)
            total += kiln_footprint_piece_area(&f, k);
        for (uint32_t k = 0; k + 1 < pieces && total > 0.0; k++) {
            sum += kiln_footprint_piece_area(&f, k);
            s->surface->area_cdf[at->cdf + k] = (float)fmin(sum / total, 1.0);
        }
    }
}

/* The area of each other side goes to the point that stands in for it, so that sums over areas have its light. */
static void move_areas(const struct search *s)
{
    struct kiln_surface *surface = s->surface;
    for (size_t i = 0; i < s->all.count; i++) {
        const struct told *t = &s->all.told[i];
        if (t->texel.point.at == t->texel.beyond.at)
            continue;
        if (t->texel.point.at - surface->first.at < surface->count)
            surface->area[kiln_own_of_global(surface, t->texel.point).at] -= t->other;
        if (t->texel.beyond.at - surface->first.at < surface->count)
            surface->area[kiln_own_of_global(surface, t->texel.beyond).at] += t->other;
    }
}

/* ---- all of it ---- */

static void describe(const struct search *s, struct told *own)
{
    for (size_t i = 0; i < s->found.count; i++) {
        const struct candidate *c = &s->found.list[i];
        const struct kiln_lightmap *map = &s->surface->lightmaps[c->at.map];
        own[i] = (struct told){.texel = {.point = kiln_global_of_own(s->surface, c->at.point),
                                         .face = {c->line.line[0], c->line.line[1], c->line.face},
                                         .middle = c->line.line[2],
                                         .within = (float)c->line.within,
                                         .beyond_within = (float)c->line.beyond_within,
                                         .bit = kiln_morton8(c->at.x % KILN_TILE_SIDE, c->at.y % KILN_TILE_SIDE),
                                         .tile = map->tile_first + kiln_tile_of(c->at.x, c->at.y, map->tiles_x)},
                               .centre = {c->line.centre[0], c->line.centre[1]},
                               .other = (float)c->line.other};
    }
}

int kiln_divide_texels(struct kiln_surface *surface, const struct kiln_scene *scene,
                       const struct kiln_geometry *geometry, struct kiln_backend *backend, uint32_t threads,
                       const struct kiln_surface_exchange *exchange, const struct kiln_stop *stop,
                       struct kiln_error *error)
{
    struct search s = {.surface = surface,
                       .scene = scene,
                       .geometry = geometry,
                       .backend = backend,
                       .exchange = exchange,
                       .stop = stop,
                       .threads = threads};
    struct told *own = NULL;
    size_t count = 0;
    int status = look_at_all(&s, error);
    if (status == KILN_OK)
        status = choose_sides(&s, error);
    if (status == KILN_OK)
        status = kiln_allocate(&own, s.found.count, sizeof *own, "divided texels", error);
    if (status == KILN_OK)
        describe(&s, own);
    status = tell_all(&s, status, own, s.found.count, error);
    if (status == KILN_OK && s.all.count > 0) {
        status = find_neighbours(&s, own, &count, error);
        status = tell_all(&s, status, own, count, error);
    }
    if (status == KILN_OK && s.all.count > 0) {
        status = kiln_allocate(&surface->divided, s.all.count, sizeof *surface->divided, "divided texels", error);
        if (status == KILN_OK) {
            move_areas(&s);
            status = enter(&s, error);
        }
        if (status == KILN_OK)
            cut_areas(&s);
        if (exchange != NULL)
            status = exchange->agree(exchange->context, status, error);
    }
    kiln_free(&own);
    kiln_free(&s.found.list);
    kiln_free(&s.all.told);
    return status;
}
