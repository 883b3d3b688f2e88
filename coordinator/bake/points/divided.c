#include "coordinator/bake/points/divided.h"

#include <math.h>
#include <string.h>

#include "coordinator/bake/points/wall_rays.h"
#include "coordinator/bake/points/texel_cells.h"
#include "coordinator/surface/parts.h"
#include "worker/base/memory.h"
#include "worker/pass/validity.h"
#include "worker/scene/clip.h"
#include "worker/scene/footprint.h"

enum { CHUNK_POINTS = 1 << 17, CHUNK_TEXELS = 1 << 12 };
enum { DIAGONALS = 2, SIDES = 4, LINE_RAYS = DIAGONALS + SIDES };
enum { WALLS_MOST = 16 };                 /* most walls that a ray along a texel finds */
enum { GRID = 2 * (KILN_TILE_SIDE + 1) }; /* lines between the texels of a tile */
enum { GLANCES = KILN_CELL_PLACES, RAYS_A_PAIR = 2 * KILN_CELL_PLACES * KILN_CELL_PLACES };
/* rays along the surface; the sight distance is that of the SEEN_COUNT-th longest of them */
enum { SEEN_WAYS = 32, SEEN_COUNT = 7 };
enum { OPEN_RAYS = 8, LOOKS = SEEN_WAYS + KILN_CELL_PLACES * OPEN_RAYS };
enum { UPS = 4 };
static const double LIFT = 1e-3;   /* height of the rays above the surface, in texel sides */
static const double MARGIN = 5e-4; /* least margin, in texel sides */
#define ASIDE 2e-3                 /* distance of the diagonals from the texel's corners, in texel sides */
static const double INSET = 5e-5;  /* distance of the side rays from the texel's sides, in texel sides */
/* offset behind a wall at which a ray goes on, as a fraction of the ray's length */
static const double ON = 1e-5;
static const double LEAST_SLOPE = 0.1;                                /* sine of the angle between wall and texel */
static const double SAME_NORMAL = 0.999;                              /* cosine: a texel is flat */
static const double STRAIGHT = 0.9999;                                /* a line is along a texel's sides */
static const double SEEN = 1.5, SEEN_LEAST = 16.0, SEEN_MOST = 128.0; /* how far is looked: m; texels */
static const double OPEN = 1.0;                                       /* m: what sees so far is no cavity */
/* m: sight along the surface in a room. A hollow wall has less up to a width of 0.4 m, however long and high it is */
static const double WIDE = 0.6;
/* least difference in the visible fraction of sky between outdoors and a room beside it */
static const double MORE_SKY = 0.2;
/* fractions of another place's sight and openness that make a place as good to show */
static const double AS_MUCH = 0.5, AS_OPEN = 0.25;
static const double GOLDEN_ANGLE = 2.399963229728653; /* rad */

/* The plane of a texel: place (x, y) is origin + x du + y dv, m; rays start at `lift` above it. */
struct texel_plane {
    struct kiln_dvec3 origin, du, dv, normal, lift;
};

/* A texel of this rank that walls may divide. */
struct candidate {
    struct kiln_point_cursor at;
    size_t tile_run;
    struct texel_plane plane;
    double margin;
    struct kiln_texel_cells cells;
    float borders[KILN_CUT_FLOATS]; /* lines of walls along its borders: the texel lies where a x + b y <= c */
    uint32_t border_count;
    struct kiln_divided_texel texel;
    struct kiln_subtexels parts;
    bool crossed;      /* a wall crosses its sides; always true for a texel that is covered in part */
    bool shown_chosen; /* subtexel 0 is the one to show */
};

struct search {
    struct kiln_surface *surface;
    const struct kiln_scene *scene;
    const struct kiln_geometry *geometry;
    struct kiln_backend *backend;
    const struct kiln_surface_exchange *exchange;
    const struct kiln_stop *stop;
    uint32_t threads;
    double far;             /* m: more than the scene is wide */
    struct candidate *some; /* list of up to CHUNK_TEXELS candidates, and its length */
    size_t some_count;
    struct kiln_subtexel_set *texels; /* what has been found */
    size_t texel_count, texel_room;
    struct kiln_subtexel_piece *pieces;
    size_t piece_count, piece_room;
};

static int trace(const struct search *s, struct kiln_wall_rays *r, size_t count, struct kiln_error *error)
{
    return count > 0 ? kiln_wall_rays_trace(r, s->scene, s->geometry, s->backend, count, error) : KILN_OK;
}

/* ---- texels ---- */

static struct kiln_dvec3 place_of(const struct texel_plane *p, double x, double y)
{
    return dvec3_add(dvec3_add(p->origin, p->lift), dvec3_add(dvec3_scale(p->du, x), dvec3_scale(p->dv, y)));
}

static struct kiln_texel_pieces pieces_of(const struct search *s, const struct kiln_point_cursor *at)
{
    return (struct kiln_texel_pieces){.scene = s->scene,
                                      .geometry = s->geometry,
                                      .triangles = s->surface->pieces + at->piece,
                                      .count = kiln_piece_count(s->surface, at->point),
                                      .place = &at->place};
}

static bool is_flat(const struct search *s, const uint32_t *pieces, uint32_t count)
{
    const struct kiln_vec3 first = kiln_triangle_normal(s->geometry, pieces[0]);
    for (uint32_t i = 1; i < count; i++)
        if ((double)vec3_dot(first, kiln_triangle_normal(s->geometry, pieces[i])) < SAME_NORMAL)
            return false;
    return true;
}

/* Finds the plane of a point's first piece. Returns false if the texel is not flat, or the triangle has no area. */
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

/* Finds the ends of a texel's diagonals: the corners of its covered part that lie farthest along them. A whole texel
 * has its own corners. */
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

/* Finds the point of the texel `step` away in x and y. In an octree: of the leaf there, in the same layer or in one
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

/* Returns the distance from a wall, in texel sides, within which rounding may put a ray's hit on the wrong side. */
static double margin_of(const struct search *s, const struct kiln_point_cursor *at, const struct texel_plane *p)
{
    const struct kiln_lightmap *map = &s->surface->lightmaps[at->map];
    const double side = fmin(dvec3_length(p->du), dvec3_length(p->dv)),
                 far = fmax(fabs(p->origin.x), fmax(fabs(p->origin.y), fabs(p->origin.z)));
    const uint32_t texels = at->leaves                 ? at->place.x | at->place.y | at->place.layer
                            : map->width > map->height ? map->width
                                                       : map->height;
    return fmin(MARGIN + 16.0 * 0x1p-24 * far / side + 0x1p-21 * (double)texels, 0.1);
}

/* Sets the two rays of a point along its texel's diagonals, `apart` apart in the arrays, so that neighbouring rays have
 * similar directions. For whole texels the rays start and end a little outside, so that they also meet walls on the
 * border. */
static void set_diagonals(const struct search *s, const struct kiln_point_cursor *at, struct kiln_wall_rays *r,
                          size_t first, size_t apart)
{
    struct texel_plane plane;
    double ends[4][2];
    kiln_wall_rays_set_none(r, first);
    kiln_wall_rays_set_none(r, first + apart);
    if (!find_plane(s, at, &plane))
        return;
    /* the diagonals avoid the corners, where walls meet: which wall a ray hits there would be chance */
    static const double beside_corners[4][2] = {
        {0.0, ASIDE}, {1.0, 1.0 - 1.5 * ASIDE}, {ASIDE, 1.0}, {1.0 - 1.5 * ASIDE, 0.0}};
    const bool whole = kiln_point_whole(s->surface, at->point);
    if (whole)
        memcpy(ends, beside_corners, sizeof ends);
    else
        find_ends(s, at, ends);
    const double beyond = whole ? 2.0 * margin_of(s, at, &plane) : -INSET;
    for (int k = 0; k < DIAGONALS; k++) {
        const double *a = ends[2 * k], *b = ends[2 * k + 1], x = beyond * (b[0] - a[0]), y = beyond * (b[1] - a[1]);
        kiln_wall_rays_set(r, first + (size_t)k * apart, place_of(&plane, a[0] - x, a[1] - y),
                           place_of(&plane, b[0] + x, b[1] + y));
    }
}

/* ---- the lines of walls ---- */

/* Intersects a triangle's plane with the plane of a texel's rays. Returns false if they are nearly parallel. */
static bool line_of(const struct search *s, const struct texel_plane *p, uint32_t triangle, double line[3])
{
    struct kiln_vec3 corner[3];
    kiln_geometry_corners(s->geometry, triangle, corner);
    const struct kiln_dvec3 n = dvec3_of(kiln_triangle_normal(s->geometry, triangle));
    if (dvec3_length(dvec3_cross(n, p->normal)) < LEAST_SLOPE)
        return false;
    const double a = dvec3_dot(n, p->du), b = dvec3_dot(n, p->dv), length = hypot(a, b),
                 c = dvec3_dot(n, dvec3_sub(dvec3_of(corner[0]), p->origin));
    if (!(length > 0.0))
        return false;
    line[0] = a / length;
    line[1] = b / length;
    line[2] = c / length;
    return true;
}

/* The step to the texel beyond a line along a side of the texel; false: it is no such line, or cuts the texel. */
static bool step_beyond(const double line[3], double margin, int step[2], double *sign)
{
    const bool along_y = fabs(line[0]) > STRAIGHT, along_x = fabs(line[1]) > STRAIGHT;
    const double place = along_y ? line[2] / line[0] : line[2] / line[1]; /* where it cuts the axis */
    if ((!along_y && !along_x) || (fabs(place) > margin && fabs(place - 1.0) > margin))
        return false;
    const int way = fabs(place) > margin ? 1 : -1;
    step[0] = along_y ? way : 0;
    step[1] = along_y ? 0 : way;
    *sign = (along_y ? line[0] : line[1]) * way > 0.0 ? 1.0 : -1.0;
    return true;
}

/* Adds a wall along the texel's border, provided that the surface goes on beyond. */
static void add_border(const struct search *s, struct candidate *c, const double line[3], const int step[2],
                       double sign)
{
    if (c->border_count == SIDES || neighbour(s->surface, &c->at, step).at == KILN_NO_POINT)
        return;
    for (uint32_t i = 0; i < c->border_count; i++)
        if (fabs((double)c->borders[3 * i] - sign * line[0]) + fabs((double)c->borders[3 * i + 1] - sign * line[1]) <
            1.0)
            return;
    for (int i = 0; i < 3; i++)
        c->borders[3 * c->border_count + (uint32_t)i] = (float)(sign * line[i]);
    c->border_count++;
}

static void add_wall(const struct search *s, struct candidate *c, uint32_t triangle)
{
    double line[3], sign;
    int step[2];
    if (!line_of(s, &c->plane, triangle, line))
        return;
    if (kiln_point_whole(s->surface, c->at.point) && step_beyond(line, c->margin, step, &sign))
        add_border(s, c, line, step, sign);
    else
        kiln_texel_cells_add_line(&c->cells, line[0], line[1], line[2]);
}

/* The rays that find the walls on a texel: its diagonals and sides. Where it is covered in part its sides lie
 * elsewhere.
 */
static void set_line_rays(const struct search *s, const struct candidate *c, struct kiln_wall_rays *r, size_t first)
{
    static const double corner[SIDES + 1][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}, {0, 0}};
    set_diagonals(s, &c->at, r, first, 1);
    for (size_t k = 0; k < SIDES; k++) {
        const double *a = corner[k], *b = corner[k + 1], scale = 1.0 - 2.0 * INSET;
        kiln_wall_rays_set_none(r, first + DIAGONALS + k);
        if (kiln_point_whole(s->surface, c->at.point))
            kiln_wall_rays_set(r, first + DIAGONALS + k,
                               place_of(&c->plane, INSET + scale * a[0], INSET + scale * a[1]),
                               place_of(&c->plane, INSET + scale * b[0], INSET + scale * b[1]));
    }
}

/* Adds the walls that the rays have met. Rays that met one are kept, shortened to the rest behind the wall; returns
 * their number. `of`: for each ray twice its candidate's index, plus 1 if it runs along a side. */
static size_t take_walls(struct search *s, struct kiln_wall_rays *r, uint32_t *of, size_t count)
{
    size_t kept = 0;
    for (size_t i = 0; i < count; i++) {
        const float begin = r->hits[i].distance + (float)ON * r->lengths[i];
        if (!r->meets[i])
            continue;
        struct candidate *c = &s->some[of[i] / 2];
        c->crossed = c->crossed || of[i] % 2 != 0;
        add_wall(s, c, r->hits[i].triangle);
        if (begin >= r->lengths[i])
            continue;
        r->origins[kept] = vec3_madd(r->origins[i], r->directions[i], begin);
        r->directions[kept] = r->directions[i];
        r->lengths[kept] = r->lengths[i] - begin;
        of[kept++] = of[i];
    }
    return kept;
}

static int find_lines(struct search *s, struct kiln_error *error)
{
    struct kiln_wall_rays r;
    uint32_t *of = NULL;
    size_t count = LINE_RAYS * s->some_count;
    int status;
    KILN_TRY(kiln_wall_rays_create(&r, count, error));
    KILN_TRY(kiln_allocate(&of, count, sizeof *of, "rays along texels", error));
    for (size_t i = 0; i < count; i++)
        of[i] = (uint32_t)(i / LINE_RAYS * 2 + (i % LINE_RAYS >= DIAGONALS));
    for (size_t i = 0; i < s->some_count; i++)
        set_line_rays(s, &s->some[i], &r, LINE_RAYS * i);
    for (int round = 0; round < WALLS_MOST && count > 0; round++) {
        KILN_TRY(trace(s, &r, count, error));
        count = take_walls(s, &r, of, count);
    }
end:
    kiln_free(&of);
    kiln_wall_rays_destroy(&r);
    return status;
}

/* Cuts the candidates along their lines. Drops those that no line cuts, and those whose sides no wall crosses: an
 * obstacle in the middle of a texel divides nothing. So the result does not depend on whether the texel lies in an
 * empty tile run (find_empty). */
static void cut_all(struct search *s)
{
    size_t kept = 0;
#pragma omp parallel for schedule(dynamic, 16) num_threads((int)s->threads)
    for (size_t i = 0; i < s->some_count; i++) {
        const struct kiln_texel_pieces pieces = pieces_of(s, &s->some[i].at);
        kiln_texel_cells_cut(&s->some[i].cells, &pieces);
    }
    for (size_t i = 0; i < s->some_count; i++)
        if ((s->some[i].cells.count > 1 && s->some[i].crossed) || s->some[i].border_count > 0) {
            s->some[kept] = s->some[i];
            kept++;
        }
    s->some_count = kept;
}

/* ---- joining the cells that light passes between ---- */

/* Two cells of a candidate on opposite sides of one line, not joined so far. */
struct pair {
    struct candidate *of;
    uint32_t cell[2];
};

struct pairs {
    struct pair *list;
    size_t count, room;
};

static int list_pairs(struct search *s, struct pairs *pairs, struct kiln_error *error)
{
    pairs->count = 0;
    for (size_t i = 0; i < s->some_count; i++) {
        const struct kiln_texel_cells *cells = &s->some[i].cells;
        struct pair pair = {.of = &s->some[i]};
        for (uint32_t k = 0; kiln_texel_cells_pair(cells, k, pair.cell); k++) {
            if (cells->cell[pair.cell[0]].joined == cells->cell[pair.cell[1]].joined)
                continue;
            const int status = kiln_grow(&pairs->list, &pairs->room, pairs->count + 1, sizeof *pairs->list,
                                         "the cells of texels", error);
            if (status != KILN_OK)
                return status;
            pairs->list[pairs->count++] = pair;
        }
    }
    return KILN_OK;
}

static void set_between(const struct pair *p, uint32_t from, uint32_t i, uint32_t j, struct kiln_wall_rays *r,
                        size_t ray)
{
    const struct candidate *c = p->of;
    const double *a = c->cells.cell[p->cell[from]].place[i], *b = c->cells.cell[p->cell[1 - from]].place[j];
    kiln_wall_rays_set(r, ray, place_of(&c->plane, a[0], a[1]), place_of(&c->plane, b[0], b[1]));
}

/* Sets a few rays between the cells of a pair. They are enough to join most pairs that no wall separates. */
static void set_glances(const struct pair *p, struct kiln_wall_rays *r, size_t first)
{
    for (uint32_t k = 0; k < GLANCES; k++)
        set_between(p, 0, k, k, r, first + k);
}

/* Sets the rays between all places of both cells, in both directions. */
static void set_all(const struct pair *p, struct kiln_wall_rays *r, size_t first)
{
    for (uint32_t k = 0; k < RAYS_A_PAIR / 2; k++)
        for (uint32_t from = 0; from < 2; from++)
            set_between(p, from, k / KILN_CELL_PLACES, k % KILN_CELL_PLACES, r, first + 2 * k + from);
}

/* A way of asking pairs. */
struct question {
    size_t rays; /* of a pair */
    void (*set)(const struct pair *p, struct kiln_wall_rays *r, size_t first);
};

/* Joins the cells of each pair that has a ray which meets no wall. */
static int ask(struct search *s, const struct question *q, const struct pairs *pairs, struct kiln_error *error)
{
    const size_t most = CHUNK_POINTS / q->rays;
    struct kiln_wall_rays r;
    int status = kiln_wall_rays_create(&r, q->rays * (pairs->count < most ? pairs->count : most), error);
    for (size_t done = 0, some; done < pairs->count && status == KILN_OK; done += some) {
        some = pairs->count - done < most ? pairs->count - done : most;
#pragma omp parallel for schedule(dynamic, 16) num_threads((int)s->threads)
        for (size_t i = 0; i < some; i++)
            q->set(&pairs->list[done + i], &r, q->rays * i);
        status = trace(s, &r, q->rays * some, error);
        for (size_t i = 0; i < q->rays * some && status == KILN_OK; i++) {
            const struct pair *p = &pairs->list[done + i / q->rays];
            if (!r.meets[i])
                kiln_texel_cells_join(&p->of->cells, p->cell[0], p->cell[1]);
        }
    }
    kiln_wall_rays_destroy(&r);
    return status;
}

static int join_cells(struct search *s, struct kiln_error *error)
{
    static const struct question questions[] = {{GLANCES, set_glances}, {RAYS_A_PAIR, set_all}};
    struct pairs pairs = {0};
    int status = KILN_OK;
    for (size_t i = 0; i < sizeof questions / sizeof *questions && status == KILN_OK; i++) {
        status = list_pairs(s, &pairs, error);
        if (status == KILN_OK)
            status = ask(s, &questions[i], &pairs, error);
    }
    kiln_free(&pairs.list);
    return status;
}

/* ---- which cells are buried ---- */

/* Rays from the middle of each cell, along the normal and around it: longer than the scene is wide. */
static void set_ups(const struct search *s, const struct candidate *c, struct kiln_wall_rays *r, size_t first)
{
    static const double turn[UPS][2] = {{0.0, 0.0},
                                        {(double)KILN_BURIED_ACROSS, 0.0},
                                        {-(double)KILN_BURIED_HALF, (double)KILN_BURIED_SIDE},
                                        {-(double)KILN_BURIED_HALF, -(double)KILN_BURIED_SIDE}};
    const struct kiln_dvec3 n = c->plane.normal, u = dvec3_scale(c->plane.du, 1.0 / dvec3_length(c->plane.du)),
                            v = dvec3_cross(n, u);
    for (uint32_t i = 0; i < KILN_CELLS_MOST; i++)
        for (int k = 0; k < UPS; k++, first++) {
            kiln_wall_rays_set_none(r, first);
            if (i >= c->cells.count)
                continue;
            const struct kiln_dvec3 from = place_of(&c->plane, c->cells.cell[i].centre[0], c->cells.cell[i].centre[1]),
                                    aside = dvec3_add(dvec3_scale(u, turn[k][0]), dvec3_scale(v, turn[k][1])),
                                    way = k == 0 ? n : dvec3_add(aside, dvec3_scale(n, (double)KILN_BURIED_ALONG));
            kiln_wall_rays_set(r, first, from, dvec3_add(from, dvec3_scale(way, s->far)));
        }
}

/* Marks the cells that are buried: all their rays meet backs of solids. The validity pass uses the same test. */
static int find_buried(struct search *s, struct kiln_error *error)
{
    const size_t rays = (size_t)KILN_CELLS_MOST * UPS;
    struct kiln_wall_rays r;
    int status;
    KILN_TRY(kiln_wall_rays_create(&r, rays * s->some_count, error));
    for (size_t i = 0; i < s->some_count; i++)
        set_ups(s, &s->some[i], &r, rays * i);
    KILN_TRY(trace(s, &r, rays * s->some_count, error));
    for (size_t i = 0; i < s->some_count; i++)
        for (uint32_t cell = 0; cell < s->some[i].cells.count; cell++) {
            bool buried = true;
            for (size_t k = 0; k < UPS; k++)
                buried = buried && kiln_wall_rays_inside(&r, s->geometry, rays * i + UPS * (size_t)cell + k);
            s->some[i].cells.cell[cell].buried = buried;
        }
end:
    kiln_wall_rays_destroy(&r);
    return status;
}

/* Drops the candidates whose cells are all joined, unless a wall stands on their border. */
static void drop_joined(struct search *s)
{
    size_t kept = 0;
    for (size_t i = 0; i < s->some_count; i++) {
        bool apart = s->some[i].border_count > 0;
        for (uint32_t cell = 0; cell < s->some[i].cells.count; cell++)
            apart = apart || s->some[i].cells.cell[cell].joined != 0;
        if (!apart)
            continue;
        s->some[kept] = s->some[i];
        kept++;
    }
    s->some_count = kept;
}

/* ---- parts ---- */

static void make_parts(const struct search *s, struct candidate *c)
{
    const struct kiln_texel_pieces pieces = pieces_of(s, &c->at);
    kiln_subtexels_make(&c->cells, &pieces, c->margin, c->borders, c->border_count, &c->texel, &c->parts);
}

static void make_all_parts(struct search *s)
{
    size_t kept = 0;
#pragma omp parallel for schedule(dynamic, 16) num_threads((int)s->threads)
    for (size_t i = 0; i < s->some_count; i++)
        make_parts(s, &s->some[i]);
    for (size_t i = 0; i < s->some_count; i++)
        if (s->some[i].parts.count > 0) {
            s->some[kept] = s->some[i];
            kept++;
        }
    s->some_count = kept;
}

/* ---- which part is shown ---- */

static void way_of(int k, double way[2])
{
    const double angle = 2.0 * 3.14159265358979323846 * (k + 0.5) / SEEN_WAYS;
    way[0] = cos(angle);
    way[1] = sin(angle);
}

/* Views: candidates for the place to show. They are the cells of a texel's parts. Once part 0 is chosen, they are its
 * cells and the middles of neighbouring texels behind walls. */
enum { VIEWS = KILN_CELLS_MOST + KILN_NEIGHBOUR_TEXELS };
static uint32_t part_of_cell(const struct candidate *c, uint32_t cell)
{
    return kiln_cut_subtexel(c->texel.codes[0], c->texel.codes[1], c->cells.cell[cell].code);
}

static bool view_of(const struct search *s, const struct candidate *c, uint32_t i, double from[2])
{
    if (i < KILN_CELLS_MOST) {
        if (i >= c->cells.count || part_of_cell(c, i) >= (c->shown_chosen ? 1 : c->parts.count))
            return false;
        memcpy(from, c->cells.cell[i].centre, 2 * sizeof *from);
        return true;
    }
    int step[2];
    kiln_neighbour_texel(i - KILN_CELLS_MOST, step);
    from[0] = 0.5 + step[0];
    from[1] = 0.5 + step[1];
    return c->shown_chosen && kiln_divided_subtexel(&c->texel, (float)from[0], (float)from[1]) != 0 &&
           neighbour(s->surface, &c->at, step).at != KILN_NO_POINT;
}

/* The shorter side of the texel, m. */
static double side_of(const struct candidate *c) { return fmin(dvec3_length(c->plane.du), dvec3_length(c->plane.dv)); }

/* How far it is looked, in texels. */
static double sight_of(const struct candidate *c) { return fmin(fmax(SEEN / side_of(c), SEEN_LEAST), SEEN_MOST); }

/* The p-th of KILN_CELL_PLACES places of a view that rays upwards start from. */
static void open_place(const struct candidate *c, uint32_t view, const double from[2], uint32_t p, double place[2])
{
    static const double aside[KILN_CELL_PLACES][2] = {{0, 0}, {-0.4, -0.4}, {0.4, -0.4}, {-0.4, 0.4}, {0.4, 0.4}};
    for (int i = 0; i < 2; i++)
        place[i] = view < KILN_CELLS_MOST ? c->cells.cell[view].place[p][i] : from[i] + aside[p][i];
}

/* Sets rays upwards from a place, with cosine-distributed directions. */
static void set_ups_from(const struct search *s, const struct candidate *c, const double from[2],
                         struct kiln_wall_rays *r, size_t first)
{
    const struct kiln_dvec3 n = c->plane.normal, u = dvec3_scale(c->plane.du, 1.0 / dvec3_length(c->plane.du)),
                            v = dvec3_cross(n, u), place = place_of(&c->plane, from[0], from[1]);
    for (int k = 0; k < OPEN_RAYS; k++, first++) {
        const double square = (k + 0.5) / OPEN_RAYS, radius = sqrt(square), angle = GOLDEN_ANGLE * k;
        const struct kiln_dvec3 aside =
            dvec3_add(dvec3_scale(u, radius * cos(angle)), dvec3_scale(v, radius * sin(angle)));
        kiln_wall_rays_set(r, first, place,
                           dvec3_add(place, dvec3_scale(dvec3_add(aside, dvec3_scale(n, sqrt(1.0 - square))), s->far)));
    }
}

/* Sets the rays of a view: along the surface, and upwards. */
static void set_looks(const struct search *s, const struct candidate *c, uint32_t view, const double from[2],
                      struct kiln_wall_rays *r, size_t first)
{
    const double far = sight_of(c);
    const struct kiln_dvec3 place = place_of(&c->plane, from[0], from[1]);
    for (int k = 0; k < SEEN_WAYS; k++, first++) {
        double way[2];
        way_of(k, way);
        kiln_wall_rays_set(r, first, place, place_of(&c->plane, from[0] + far * way[0], from[1] + far * way[1]));
    }
    for (uint32_t p = 0; p < KILN_CELL_PLACES; p++, first += OPEN_RAYS) {
        double start[2];
        open_place(c, view, from, p, start);
        set_ups_from(s, c, start, r, first);
    }
}

/* Returns for how many texels the surface goes on in a direction; at most `most`. */
static double texels_on(const struct search *s, const struct candidate *c, const double from[2], const double way[2],
                        double most)
{
    for (double t = 1.0; t < most; t += 1.0) {
        const int step[2] = {(int)floor(from[0] + t * way[0]), (int)floor(from[1] + t * way[1])};
        if ((step[0] != 0 || step[1] != 0) && neighbour(s->surface, &c->at, step).at == KILN_NO_POINT)
            return t;
    }
    return most;
}

/* Inserts a number into a descending list of the `count` largest so far. */
static void keep_longest(double *longest, int count, double number)
{
    int at = count;
    for (; at > 0 && longest[at - 1] < number; at--)
        if (at < count)
            longest[at] = longest[at - 1];
    if (at < count)
        longest[at] = number;
}

/* Results of the rays of a view. All members are 0 for a part that does not exist. */
struct seen {
    /* sight distance along the surface, texels: the longest rays reach at least so far. In the corner of a room a
     * quarter of all rays is long; on a rim few are */
    double along;
    double wide; /* the same, m */
    /* openness of its most open place, m: a quarter of the rays upwards is free at least so far; at most OPEN */
    double open;
    double escapes; /* fraction of the rays upwards from that place that reach the sky */
};

/* Evaluates the rays upwards from a place, and keeps them if it is the most open place so far. Of two equally open
 * places the one that sees less of the sky is kept. */
static void look_up(const struct kiln_wall_rays *r, size_t first, struct seen *seen)
{
    double open[OPEN_RAYS / 4] = {0.0}, escapes = 0.0;
    for (size_t i = first; i < first + OPEN_RAYS; i++) {
        keep_longest(open, OPEN_RAYS / 4, r->meets[i] ? (double)r->hits[i].distance : OPEN);
        escapes += r->meets[i] ? 0.0 : 1.0 / OPEN_RAYS;
    }
    const double far = fmin(open[OPEN_RAYS / 4 - 1], OPEN);
    if (far > seen->open || (far >= seen->open && escapes < seen->escapes)) {
        seen->open = far;
        seen->escapes = escapes;
    }
}

/* Evaluates the rays of a view. `first`: index of its first ray (set_looks). */
static struct seen seen_from(const struct search *s, const struct candidate *c, const double from[2],
                             const struct kiln_wall_rays *r, size_t first)
{
    const double far = sight_of(c);
    double along[SEEN_COUNT] = {0.0}, way[2];
    for (size_t k = 0, i = first; k < SEEN_WAYS; k++, i++) {
        way_of((int)k, way);
        const double free = r->meets[i] ? far * (double)(r->hits[i].distance / r->lengths[i]) : far;
        keep_longest(along, SEEN_COUNT, texels_on(s, c, from, way, free));
    }
    const double sight = along[SEEN_COUNT - 1];
    struct seen seen = {sight, sight * side_of(c), 0.0, 1.0};
    for (uint32_t p = 0; p < KILN_CELL_PLACES; p++)
        look_up(r, first + SEEN_WAYS + OPEN_RAYS * (size_t)p, &seen);
    return seen;
}

/* Whether a place lies in a room and another outdoors: a room is open, and sees less of the sky. A place that is narrow
 * and sees no sky at all lies inside a hollow wall: beside a room without a ceiling, or in a garden, that is no room.
 */
static bool is_room_beside(struct seen a, struct seen outdoors)
{
    return a.open >= OPEN && (a.wide >= WIDE || a.escapes > 0.0) && a.escapes < outdoors.escapes - MORE_SKY;
}

/* Whether a place is less worth to be shown than another: it lies in a cavity, outdoors beside a room, or on a rim. */
static bool is_less(struct seen a, struct seen than)
{
    if (a.open < AS_OPEN * than.open || than.open < AS_OPEN * a.open)
        return a.open < than.open;
    if (is_room_beside(a, than) || is_room_beside(than, a))
        return is_room_beside(than, a);
    return a.along < AS_MUCH * than.along;
}

/* Returns the best view of a part's cells. */
static struct seen seen_of_part(const struct candidate *c, uint32_t part, const struct seen seen[VIEWS],
                                const bool there[VIEWS])
{
    struct seen most = {0.0, 0.0, 0.0, 1.0};
    for (uint32_t i = 0; i < c->cells.count; i++)
        if (there[i] && part_of_cell(c, i) == part && is_less(most, seen[i]))
            most = seen[i];
    return most;
}

/* Chooses the part to show: the largest one that no other part's view beats. Parts are sorted by falling area. */
static void choose_shown(struct candidate *c, const struct seen seen[VIEWS], const bool there[VIEWS])
{
    struct seen of[KILN_SUBTEXELS];
    uint32_t shown = 0;
    for (uint32_t k = 0; k < c->parts.count; k++)
        of[k] = seen_of_part(c, k, seen, there);
    for (bool less = true; less && shown + 1 < c->parts.count; shown += less) {
        less = false;
        for (uint32_t k = 0; k < c->parts.count; k++)
            less = less || is_less(of[shown], of[k]);
    }
    kiln_subtexels_show(&c->texel, &c->parts, shown);
}

/* Marks the neighbours that may be rims beside the subtexel that is shown. */
static void find_rims(struct candidate *c, const struct seen seen[VIEWS], const bool there[VIEWS])
{
    const uint32_t x = (uint32_t)lround(4095.0 * fmin(fmax(c->parts.centre[0][0], 0.0), 1.0)),
                   y = (uint32_t)lround(4095.0 * fmin(fmax(c->parts.centre[0][1], 0.0), 1.0));
    const struct seen own = seen_of_part(c, 0, seen, there);
    c->texel.shown = x << 8 | y << 20;
    for (uint32_t i = KILN_CELLS_MOST; i < VIEWS; i++)
        if (there[i] && is_less(seen[i], own))
            c->texel.shown |= 1u << (i - KILN_CELLS_MOST);
}

/* A view, and what it belongs to. */
struct view {
    struct candidate *of;
    uint32_t number;
    double from[2];
};

/* Lists the views of all candidates, those of one candidate together. A candidate with a single view is left out: there
 * is nothing to compare it with. */
static int list_views(struct search *s, struct view **views, size_t *count, struct kiln_error *error)
{
    const int status = kiln_allocate(views, VIEWS * s->some_count, sizeof **views, "views along texels", error);
    *count = 0;
    for (size_t i = 0; i < s->some_count && status == KILN_OK; i++) {
        const size_t before = *count;
        for (uint32_t k = 0; k < VIEWS; k++) {
            struct view view = {.of = &s->some[i], .number = k};
            if (view_of(s, view.of, k, view.from))
                (*views)[(*count)++] = view;
        }
        if (*count == before + 1)
            *count = before;
    }
    return status;
}

/* Evaluates the views of one candidate, which begin at `views`; the list has `count` more. */
static void take_views(const struct search *s, const struct view *views, size_t count, const struct kiln_wall_rays *r,
                       size_t first, struct seen seen[VIEWS], bool there[VIEWS])
{
    memset(there, 0, VIEWS * sizeof *there);
    for (size_t taken = 0; taken < count && views[taken].of == views->of; taken++) {
        const struct view *view = &views[taken];
        seen[view->number] = seen_from(s, view->of, view->from, r, first + LOOKS * taken);
        there[view->number] = true;
    }
}

/* Traces and evaluates the views of all candidates: first to choose the part to show, then (`shown`) to find rims. */
static int look_along(struct search *s, bool shown, struct kiln_error *error)
{
    struct view *views = NULL;
    struct kiln_wall_rays r = {0};
    size_t count;
    int status;
    KILN_TRY(list_views(s, &views, &count, error));
    KILN_TRY(kiln_wall_rays_create(&r, LOOKS * count, error));
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < count; i++)
        set_looks(s, views[i].of, views[i].number, views[i].from, &r, LOOKS * i);
    KILN_TRY(trace(s, &r, LOOKS * count, error));
#pragma omp parallel for schedule(dynamic, 64)
    for (size_t i = 0; i < count; i++) {
        struct seen seen[VIEWS];
        bool there[VIEWS];
        struct candidate *c = views[i].of;
        if (i > 0 && views[i - 1].of == c)
            continue; /* looked at with its first view */
        take_views(s, views + i, count - i, &r, LOOKS * i, seen, there);
        if (shown)
            find_rims(c, seen, there);
        else
            choose_shown(c, seen, there);
    }
end:
    kiln_free(&views);
    kiln_wall_rays_destroy(&r);
    return status;
}

/* Chooses the part of each candidate to show, and finds the rims beside it. */
static int choose_views(struct search *s, struct kiln_error *error)
{
    static const struct seen none[VIEWS];
    static const bool nowhere[VIEWS];
    int status = look_along(s, false, error);
    for (size_t i = 0; i < s->some_count; i++) {
        s->some[i].shown_chosen = true;
        find_rims(&s->some[i], none, nowhere);
    }
    if (status == KILN_OK)
        status = look_along(s, true, error);
    return status;
}

/* ---- what has been found ---- */

static int keep_pieces(struct search *s, const struct candidate *c, struct kiln_error *error)
{
    const struct kiln_texel_pieces pieces = pieces_of(s, &c->at);
    for (uint32_t part = 0; part < c->parts.count; part++)
        for (uint32_t i = 0; i < pieces.count; i++) {
            const double area = kiln_subtexel_area(&c->texel, part, &pieces, pieces.triangles[i]);
            if (!(area > 0.0))
                continue;
            const int status =
                kiln_grow(&s->pieces, &s->piece_room, s->piece_count + 1, sizeof *s->pieces, "divided texels", error);
            if (status != KILN_OK)
                return status;
            s->pieces[s->piece_count++] = (struct kiln_subtexel_piece){
                .point = c->texel.part[0].at, .part = part, .triangle = pieces.triangles[i], .area = area};
        }
    return KILN_OK;
}

static int keep(struct search *s, struct candidate *c, struct kiln_error *error)
{
    const struct kiln_surface *surface = s->surface;
    const struct kiln_lightmap *map = &surface->lightmaps[c->at.map];
    const struct kiln_tile_run *run = &surface->tile_runs[c->tile_run];
    const int status =
        kiln_grow(&s->texels, &s->texel_room, s->texel_count + 1, sizeof *s->texels, "divided texels", error);
    if (status != KILN_OK)
        return status;
    struct kiln_subtexel_set *t = &s->texels[s->texel_count++];
    c->texel.part[0] = kiln_global_of_own(surface, c->at.point);
    c->texel.tile = map->tile_first + run->tile;
    c->texel.bit = kiln_morton8(c->at.x % KILN_TILE_SIDE, c->at.y % KILN_TILE_SIDE);
    *t = (struct kiln_subtexel_set){
        .divided = c->texel, .count = c->parts.count, .map = run->map, .tile = run->tile, .cell = run->cell};
    for (uint32_t k = 0; k < c->parts.count; k++)
        t->area[k] = (float)c->parts.area[k];
    memcpy(t->albedo, surface->albedo + 3 * c->at.point.at, sizeof t->albedo);
    return keep_pieces(s, c, error);
}

/* Divides the candidates into parts by their walls, keeps the results, and empties the list. */
static int divide_some(struct search *s, struct kiln_error *error)
{
    int status;
    KILN_TRY(s->some_count > 0 ? find_lines(s, error) : KILN_OK);
    cut_all(s);
    if (s->some_count > 0)
        KILN_TRY(join_cells(s, error));
    drop_joined(s);
    if (s->some_count > 0)
        KILN_TRY(find_buried(s, error));
    make_all_parts(s);
    if (s->some_count > 0)
        KILN_TRY(choose_views(s, error));
    for (size_t i = 0; i < s->some_count; i++)
        KILN_TRY(keep(s, &s->some[i], error));
end:
    s->some_count = 0;
    return status;
}

/* ---- all texels of this rank ---- */

/* Whether one triangle holds the whole square of a tile. */
static bool holds_tile(const struct search *s, uint32_t triangle, const struct kiln_point_cursor *at)
{
    const double side = KILN_TILE_SIDE;
    double corner[3][2], local[3][2];
    kiln_geometry_map_corners(s->scene, s->geometry, triangle, at->place.shift, corner);
    kiln_clip_local(corner, at->tile_x, at->tile_y, local);
    return fabs(kiln_clip_twice_area(local)) > 0.0 &&
           kiln_clip_classify(local, 0.0, 0.0, side, side) == KILN_CLIP_INSIDE;
}

/* Whether a tile run is plain: it lies on one triangle, which covers its whole tile. So the answer does not depend on
 * how spatial cells cut the tile into runs. */
static bool is_plain(const struct search *s, size_t run)
{
    const struct kiln_surface *surface = s->surface;
    const struct kiln_tile_run *f = &surface->tile_runs[run];
    const uint32_t *pieces = surface->pieces + surface->piece_base[run];
    const struct kiln_point_cursor at = kiln_point_first(surface, run);
    if (surface->piece_base[run + 1] - surface->piece_base[run] != f->count ||
        (at.leaves ? f->count < KILN_TILE_TEXELS : !holds_tile(s, pieces[0], &at)))
        return false;
    for (uint64_t k = 0, own = kiln_own_of_global(surface, f->first).at; k < f->count; k++)
        if (!kiln_point_whole(surface, (struct kiln_own_point){own + k}) || pieces[k] != pieces[0])
            return false;
    return true;
}

/* Sets the rays of a plain tile run, along the lines between its texels and from a little outside of it. If none of
 * them hits anything, no wall divides a texel of the run, since such a wall would cross the texel's sides. */
static void set_grid(const struct search *s, size_t run, struct kiln_wall_rays *r, size_t first)
{
    struct kiln_point_cursor at = kiln_point_first(s->surface, run);
    struct texel_plane p;
    if (!at.leaves) { /* start at the tile's corner, whatever texel the run begins with */
        at.place.x = at.tile_x;
        at.place.y = at.tile_y;
    }
    const bool known = find_plane(s, &at, &p);
    const double beyond = known ? 2.0 * margin_of(s, &at, &p) : 0.0, end = KILN_TILE_SIDE + beyond;
    for (size_t k = 0; k < GRID; k++) {
        const double line = fmin(fmax((double)(k / 2), INSET), KILN_TILE_SIDE - INSET);
        if (!known)
            kiln_wall_rays_set_none(r, first + k);
        else if (k % 2 == 0)
            kiln_wall_rays_set(r, first + k, place_of(&p, -beyond, line), place_of(&p, end, line));
        else
            kiln_wall_rays_set(r, first + k, place_of(&p, line, -beyond), place_of(&p, line, end));
    }
}

/* Finds the plain tile runs among [begin, end) that nothing stands on: 1 in `empty`. */
static int find_empty(struct search *s, size_t begin, size_t end, struct kiln_wall_rays *r, size_t *ray, uint8_t *empty,
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
    const int status = trace(s, r, rays, error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for schedule(dynamic, 64) num_threads((int)s->threads)
    for (size_t f = begin; f < end; f++)
        for (size_t k = 0; k < GRID && empty[f - begin] != 0; k++)
            empty[f - begin] = !r->meets[ray[f - begin] + k];
    return KILN_OK;
}

/* Traces the diagonals of all points of the tile runs [begin, end), except those of empty runs. */
static int trace_diagonals(struct search *s, size_t begin, size_t end, struct kiln_wall_rays *r, size_t *ray,
                           const uint8_t *empty, struct kiln_error *error)
{
    const struct kiln_surface *surface = s->surface;
    size_t rays = 0;
    for (size_t f = begin; f < end; f++) {
        ray[f - begin] = rays;
        rays += empty[f - begin] != 0 ? 0 : DIAGONALS * (size_t)surface->tile_runs[f].count;
    }
#pragma omp parallel for schedule(dynamic, 16) num_threads((int)s->threads)
    for (size_t f = begin; f < end; f++) {
        const uint32_t points = surface->tile_runs[f].count;
        struct kiln_point_cursor at = kiln_point_first(surface, f);
        for (uint32_t k = 0; k < points && empty[f - begin] == 0; k++, kiln_point_next(surface, &at))
            set_diagonals(s, &at, r, ray[f - begin] + k, points);
    }
    return trace(s, r, rays, error);
}

/* Adds candidates: texels that walls may divide. They are the points of a tile run whose diagonals meet walls. A full
 * list of candidates is processed at once (divide_some). `first`: index of the run's first ray. */
static int look_at_run(struct search *s, size_t run, const struct kiln_wall_rays *r, size_t first,
                       struct kiln_error *error)
{
    const uint32_t points = s->surface->tile_runs[run].count;
    struct kiln_point_cursor at = kiln_point_first(s->surface, run);
    int status = KILN_OK;
    for (uint32_t k = 0; k < points && status == KILN_OK; k++, kiln_point_next(s->surface, &at)) {
        const size_t ray = first + k;
        const bool met =
            (r->lengths[ray] > 0.0f && r->meets[ray]) || (r->lengths[ray + points] > 0.0f && r->meets[ray + points]);
        struct candidate *c = &s->some[s->some_count];
        if (!met)
            continue;
        *c = (struct candidate){.at = at, .tile_run = run, .crossed = !kiln_point_whole(s->surface, at.point)};
        if (!find_plane(s, &at, &c->plane))
            continue;
        c->margin = margin_of(s, &at, &c->plane);
        if (++s->some_count == CHUNK_TEXELS)
            status = divide_some(s, error);
    }
    return status;
}

/* Finds the candidates of the tile runs [begin, end); the arrays have room for their rays. */
static int look_at(struct search *s, size_t begin, size_t end, struct kiln_wall_rays *r, struct kiln_error *error)
{
    size_t *ray = NULL;
    uint8_t *empty = NULL;
    int status;
    KILN_TRY(kiln_allocate(&ray, end - begin, sizeof *ray, "rays along texels", error));
    KILN_TRY(kiln_allocate(&empty, end - begin, 1, "rays along texels", error));
    KILN_TRY(find_empty(s, begin, end, r, ray, empty, error));
    KILN_TRY(trace_diagonals(s, begin, end, r, ray, empty, error));
    for (size_t f = begin; f < end; f++)
        if (empty[f - begin] == 0)
            KILN_TRY(look_at_run(s, f, r, ray[f - begin], error));
end:
    kiln_free(&ray);
    kiln_free(&empty);
    return status;
}

static int look_at_all(struct search *s, struct kiln_error *error)
{
    const struct kiln_surface *surface = s->surface;
    const size_t runs = surface->tile_run_count;
    struct kiln_wall_rays r = {0};
    const size_t diagonals = DIAGONALS * (size_t)(surface->count < CHUNK_POINTS ? surface->count : CHUNK_POINTS),
                 grids = GRID * (runs < CHUNK_POINTS / GRID ? runs : CHUNK_POINTS / GRID);
    int status;
    KILN_TRY(kiln_wall_rays_create(&r, diagonals > grids ? diagonals : grids, error));
    KILN_TRY(kiln_allocate(&s->some, CHUNK_TEXELS, sizeof *s->some, "texels at walls", error));
    for (size_t begin = 0, end; begin < runs; begin = end) {
        uint64_t points = 0;
        for (end = begin;
             end < runs && points + surface->tile_runs[end].count <= CHUNK_POINTS && end - begin < CHUNK_POINTS / GRID;
             end++)
            points += surface->tile_runs[end].count;
        KILN_TRY(kiln_stop_asked(s->stop) ? kiln_give_up(error) : look_at(s, begin, end, &r, error));
    }
    KILN_TRY(divide_some(s, error));
end:
    kiln_wall_rays_destroy(&r);
    kiln_free(&s->some);
    return status;
}

/* ---- all ranks ---- */

/* Records of all ranks. */
struct list {
    void *records;
    size_t count, room, size;
    int status;
    struct kiln_error *error;
};

static void take_records(void *taker, const void *records, size_t count)
{
    struct list *list = taker;
    if (list->status == KILN_OK)
        list->status =
            kiln_grow(&list->records, &list->room, list->count + count, list->size, "divided texels", list->error);
    if (list->status != KILN_OK || count == 0)
        return;
    memcpy((char *)list->records + list->count * list->size, records, count * list->size);
    list->count += count;
}

/* Collective. Replaces this rank's records by those of all ranks. */
static int gather(const struct search *s, int status, void *pointer, size_t *count, size_t size,
                  struct kiln_error *error)
{
    struct list list = {.size = size, .error = error};
    void *own;
    memcpy(&own, pointer, sizeof own);
    if (s->exchange == NULL)
        return status;
    status = s->exchange->allgather(s->exchange->context, status, own, *count, size, take_records, &list, error);
    if (status == KILN_OK)
        status = s->exchange->agree(s->exchange->context, list.status, error);
    kiln_free(&own);
    memcpy(pointer, &list.records, sizeof list.records);
    *count = list.count;
    return status;
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
                       .threads = threads,
                       .far = 2.0 * (double)vec3_length(vec3_sub(geometry->bounds_max, geometry->bounds_min))};
    int status = look_at_all(&s, error);
    status = gather(&s, status, &s.texels, &s.texel_count, sizeof *s.texels, error);
    status = gather(&s, status, &s.pieces, &s.piece_count, sizeof *s.pieces, error);
    if (status == KILN_OK)
        status = kiln_surface_add_subtexels(surface, s.texels, s.texel_count, s.pieces, s.piece_count, error);
    if (exchange != NULL)
        status = exchange->agree(exchange->context, status, error);
    kiln_free(&s.texels);
    kiln_free(&s.pieces);
    return status;
}
