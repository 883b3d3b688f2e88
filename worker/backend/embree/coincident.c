#include "worker/backend/embree/coincident.h"

#include <math.h>

#include "shaders/shared/surface.h"
#include "worker/scene/footprint.h"
#include "worker/scene/texture.h"

/* ---- triangles that may coincide with others ---- */

/* Values of embree_backend.coincides. Below APART: unknown, and the number of hits at which a front was searched so
 * far. */
enum { APART = UINT16_MAX - 1, COINCIDES };
/* Number of such hits after which the whole triangle is searched for a partner: FEW if few triangles are near it, else
 * MOST. Triangles that passes of light hit so often are hit much more often later. Measured in Sponza: with larger
 * numbers the passes of light lose the time that surface points and validity gain. */
enum { PLACES_FEW = 4, PLACES_MOST = 1024 };

/* Cosine between the normals of opposite planes, at most; with a larger angle they coincide only within seven times
 * KILN_COINCIDENT of a line. */
#define PARALLEL (-0.99)
/* Least height of a triangle with a reliable normal, as a multiple of KILN_COINCIDENT. */
#define HEIGHT_LEAST 64.0
/* Largest distance, in margins, between the boxes of triangles that may coincide, with all errors of hits and
 * barycentric coordinates. */
#define BOX_MARGINS 8.0

/* A triangle in one plane. */
struct flat {
    struct kiln_dvec3 corner[3], normal; /* normal: as long as twice the area */
    double length;                       /* of the normal */
    bool low;                            /* see HEIGHT_LEAST */
};

/* fmin and fmax would become calls into the mathematics library here. */
static inline double least_of(double a, double b) { return a < b ? a : b; }
static inline double most_of(double a, double b) { return a > b ? a : b; }

/* The square of the longest edge. */
static double most_square(const struct flat *f)
{
    double most = 0.0;
    for (int i = 0; i < 3; i++) {
        const struct kiln_dvec3 edge = dvec3_sub(f->corner[(i + 1) % 3], f->corner[i]);
        most = most_of(most, dvec3_dot(edge, edge));
    }
    return most;
}

static void corners_of(const struct kiln_geometry *g, uint32_t triangle, struct kiln_dvec3 corner[3])
{
    struct kiln_vec3 at[3];
    kiln_geometry_corners(g, triangle, at);
    for (int i = 0; i < 3; i++)
        corner[i] = dvec3_of(at[i]);
}

static struct flat flat_of(const struct kiln_dvec3 corner[3], double margin)
{
    struct flat f = {.corner = {corner[0], corner[1], corner[2]}};
    f.normal = dvec3_cross(dvec3_sub(f.corner[1], f.corner[0]), dvec3_sub(f.corner[2], f.corner[0]));
    f.length = sqrt(dvec3_dot(f.normal, f.normal));
    f.low = f.length < HEIGHT_LEAST * margin * sqrt(most_square(&f));
    return f;
}

/* Whether all corners of one triangle are on one side of the other's plane, farther away than the margin. */
static bool is_beside(const struct flat *one, const struct flat *other, double margin)
{
    double least = INFINITY, most = -INFINITY;
    for (int i = 0; i < 3; i++) {
        const double height = dvec3_dot(other->normal, dvec3_sub(one->corner[i], other->corner[0]));
        least = least_of(least, height);
        most = most_of(most, height);
    }
    return least > margin * other->length || most < -margin * other->length;
}

struct box {
    double low[3], high[3];
};

static struct box box_of(const struct kiln_dvec3 corner[3])
{
    struct box box;
    const double at[3][3] = {{corner[0].x, corner[1].x, corner[2].x},
                             {corner[0].y, corner[1].y, corner[2].y},
                             {corner[0].z, corner[1].z, corner[2].z}};
    for (int axis = 0; axis < 3; axis++) {
        box.low[axis] = least_of(at[axis][0], least_of(at[axis][1], at[axis][2]));
        box.high[axis] = most_of(at[axis][0], most_of(at[axis][1], at[axis][2]));
    }
    return box;
}

static inline bool is_axis_far(float a, float b, float c, double low, double high)
{
    const float more = a > b ? a : b, less = a < b ? a : b, most = more > c ? more : c, least = less < c ? less : c;
    return (double)least > high || (double)most < low;
}

/* Whether the triangle's box is farther than `gap` from box b. */
static bool is_far(const struct kiln_vec3 at[3], const struct box *b, double gap)
{
    return is_axis_far(at[0].x, at[1].x, at[2].x, b->low[0] - gap, b->high[0] + gap) ||
           is_axis_far(at[0].y, at[1].y, at[2].y, b->low[1] - gap, b->high[1] + gap) ||
           is_axis_far(at[0].z, at[1].z, at[2].z, b->low[2] - gap, b->high[2] + gap);
}

/* MANY: largest number of triangles in a sphere that is searched at once. If more are in the sphere around a triangle,
 * those around its four quarters are searched instead, recursively down to DEEPEST: the sphere around a very large
 * triangle would contain the whole scene. */
enum { MANY = 1024, DEEPEST = 6 };

struct partner_search {
    const struct embree_backend *b;
    uint32_t triangle;
    struct flat own;
    struct box box; /* of the part searched: the own triangle, or a piece of it */
    double margin;  /* m */
    size_t met;     /* triangles in this sphere */
    size_t limit;   /* of them */
    size_t all;     /* triangles in all spheres before */
    bool found;
};

/* Callback of Embree's point query, for each triangle whose box is near. True: the search is over. */
static bool consider_partner(struct RTCPointQueryFunctionArguments *arguments)
{
    struct partner_search *s = arguments->userPtr;
    const uint32_t triangle = embree_triangle(s->b, arguments->geomID, arguments->primID);
    if (s->met++ == s->limit) {
        arguments->query->radius = 0.0f;
        return true;
    }
    if (triangle == s->triangle)
        return false;
    struct kiln_vec3 at[3];
    kiln_geometry_corners(s->b->params.geometry, triangle, at);
    if (is_far(at, &s->box, BOX_MARGINS * s->margin))
        return false;
    struct kiln_dvec3 corner[3];
    corners_of(s->b->params.geometry, triangle, corner);
    const struct flat other = flat_of(corner, s->margin);
    const bool opposite =
        s->own.low || other.low || dvec3_dot(s->own.normal, other.normal) <= PARALLEL * s->own.length * other.length;
    if (!(other.length > 0.0) || !opposite || is_beside(&s->own, &other, s->margin) ||
        is_beside(&other, &s->own, s->margin))
        return false;
    s->found = true;
    arguments->query->radius = 0.0f;
    return true;
}

/* Searches the sphere around a piece. Returns whether all triangles in it were tested, or the search is over. */
static bool search_sphere(struct partner_search *s, const struct kiln_dvec3 c[3], size_t limit)
{
    struct RTCPointQuery query = {.x = (float)((c[0].x + c[1].x + c[2].x) / 3.0),
                                  .y = (float)((c[0].y + c[1].y + c[2].y) / 3.0),
                                  .z = (float)((c[0].z + c[1].z + c[2].z) / 3.0)};
    double radius = 0.0;
    for (int i = 0; i < 3; i++) {
        const struct kiln_dvec3 way = dvec3_sub(c[i], dvec3((double)query.x, (double)query.y, (double)query.z));
        radius = fmax(radius, sqrt(dvec3_dot(way, way)));
    }
    query.radius = (float)(radius * (1.0 + 1e-6) + s->margin);
    s->box = box_of(c);
    s->met = 0;
    s->limit = limit;
    struct RTCPointQueryContext round;
    rtcInitPointQueryContext(&round);
    (void)rtcPointQuery(s->b->scene, &query, &round, consider_partner, s);
    s->all += s->met;
    return s->found || s->met <= limit;
}

static struct kiln_dvec3 middle_of(struct kiln_dvec3 a, struct kiln_dvec3 b)
{
    return dvec3_scale(dvec3_add(a, b), 0.5);
}

/* Searches the sphere around a piece; if it has too many triangles, those around its quarters. */
static bool search_pieces(struct partner_search *s, const struct kiln_dvec3 c[3], int depth)
{
    if (search_sphere(s, c, MANY))
        return true;
    if (depth == DEEPEST || s->all > s->b->params.geometry->triangle_count)
        return false;
    const struct kiln_dvec3 a = middle_of(c[1], c[2]), b = middle_of(c[2], c[0]), d = middle_of(c[0], c[1]),
                            quarters[4][3] = {{c[0], d, b}, {d, c[1], a}, {b, a, c[2]}, {a, b, d}};
    bool complete = true;
    for (int i = 0; i < 4 && complete && !s->found; i++)
        complete = search_pieces(s, quarters[i], depth + 1);
    return complete;
}

static struct partner_search search_of(const struct embree_backend *b, uint32_t triangle, struct kiln_dvec3 corner[3])
{
    const double margin = 2.0 * (double)(KILN_COINCIDENT * b->params.geometry->extent);
    corners_of(b->params.geometry, triangle, corner);
    return (struct partner_search){.b = b, .triangle = triangle, .own = flat_of(corner, margin), .margin = margin};
}

/* Whether a front may coincide anywhere with the back of this triangle, by the planes of triangles near it. Where
 * triangles are dense all around it, a single sphere is cheaper than its pieces. */
static bool find_partner(const struct embree_backend *b, uint32_t triangle)
{
    struct kiln_dvec3 corner[3];
    struct partner_search s = search_of(b, triangle, corner);
    if (!search_pieces(&s, corner, 0))
        (void)search_sphere(&s, corner, SIZE_MAX);
    return s.found;
}

static void keep(const struct embree_backend *b, uint32_t triangle, bool found)
{
    __atomic_store_n(&b->coincides[triangle], found ? COINCIDES : APART, __ATOMIC_RELAXED);
}

/* Cached result of find_partner. Threads that search at the same time find the same. */
static bool may_coincide(const struct embree_backend *b, uint32_t triangle)
{
    if (__atomic_load_n(&b->coincides[triangle], __ATOMIC_RELAXED) < APART)
        keep(b, triangle, find_partner(b, triangle));
    return __atomic_load_n(&b->coincides[triangle], __ATOMIC_RELAXED) == COINCIDES;
}

/* Whether to search for a front at the hit itself first; then may_coincide is needed only where there is one. Hits of
 * threads at the same time may count once. */
static bool is_place_first(const struct embree_backend *b, uint32_t triangle)
{
    const uint16_t places = __atomic_load_n(&b->coincides[triangle], __ATOMIC_RELAXED);
    if (places >= PLACES_MOST)
        return false;
    if (places == PLACES_FEW) {
        struct kiln_dvec3 corner[3];
        struct partner_search s = search_of(b, triangle, corner);
        if (search_sphere(&s, corner, MANY)) {
            keep(b, triangle, s.found);
            return false;
        }
    }
    __atomic_store_n(&b->coincides[triangle], (uint16_t)(places + 1), __ATOMIC_RELAXED);
    return true;
}

/* ---- the front, or the back ---- */

struct face_search {
    const struct embree_backend *b;
    const struct embree_context *context;
    uint32_t lane; /* of the context's seeds */
    bool back;     /* searches for the back of a solid, else for a front */
    struct kiln_dvec3 place, direction;
    double margin; /* m */
    float gap;     /* m: BOX_MARGINS of them */
    double inside; /* least barycentric weight in the best face so far */
    struct RTCHit *hit;
};

/* Whether a ray of the context hits the triangle at (u, v), or passes through. */
static bool is_there(const struct face_search *s, uint32_t triangle, float u, float v)
{
    const struct kiln_geometry *g = s->b->params.geometry;
    const struct kiln_scene *scene = s->b->params.scene;
    if (triangle < g->opaque_count)
        return true;
    if (s->context->question == EMBREE_SOLID)
        return (g->records[triangle].material & KILN_RECORD_CLEAR) == 0;
    float b1, b2;
    kiln_geometry_stored_barycentrics(scene, g, triangle, u, v, &b1, &b2);
    const struct kiln_mesh *mesh = &scene->meshes[scene->objects[g->records[triangle].object].mesh];
    const float opacity = kiln_surface_opacity(scene, mesh, g->stored_triangle[triangle], b1, b2);
    return embree_blends(s->b) ? kiln_is_there(s->context->seed[s->lane], triangle, opacity) : opacity > 0.0f;
}

/* Whether the hit's position is farther than `gap` from the triangle's box. */
static inline bool is_outside(const struct kiln_vec3 corner[3], struct kiln_vec3 place, float gap)
{
    const float at[3][3] = {{corner[0].x - place.x, corner[1].x - place.x, corner[2].x - place.x},
                            {corner[0].y - place.y, corner[1].y - place.y, corner[2].y - place.y},
                            {corner[0].z - place.z, corner[1].z - place.z, corner[2].z - place.z}};
    bool outside = false;
    for (int axis = 0; axis < 3; axis++) {
        const float *a = at[axis];
        outside = outside || (a[0] > gap && a[1] > gap && a[2] > gap) || (a[0] < -gap && a[1] < -gap && a[2] < -gap);
    }
    return outside;
}

/* Callback of Embree's point query, for each triangle in a leaf with one whose box is near the position. */
static bool consider_face(struct RTCPointQueryFunctionArguments *arguments)
{
    struct face_search *s = arguments->userPtr;
    struct kiln_vec3 corner[3];
    const uint32_t triangle = embree_triangle(s->b, arguments->geomID, arguments->primID);
    kiln_geometry_corners(s->b->params.geometry, triangle, corner);
    if (is_outside(corner, vec3_of(s->place), s->gap))
        return false;
    const struct kiln_dvec3 a = dvec3_of(corner[0]), to_b = dvec3_sub(dvec3_of(corner[1]), a),
                            to_c = dvec3_sub(dvec3_of(corner[2]), a), at = dvec3_sub(s->place, a);
    const struct kiln_dvec3 normal = dvec3_cross(to_b, to_c);
    const double square = dvec3_dot(normal, normal), height = dvec3_dot(normal, at),
                 along = dvec3_dot(normal, s->direction);
    if (!(s->back ? along > 0.0 : along < 0.0) || height * height > s->margin * s->margin * square)
        return false;
    if (s->back && !kiln_geometry_is_solid(s->b->params.geometry, triangle))
        return false;
    const double u = dvec3_dot(normal, dvec3_cross(at, to_c)) / square,
                 v = dvec3_dot(normal, dvec3_cross(to_b, at)) / square, inside = fmin(fmin(u, v), 1.0 - u - v);
    if (!(inside > s->inside) || !is_there(s, triangle, (float)u, (float)v))
        return false;
    s->inside = inside;
    s->hit->u = (float)fmin(fmax(u, 0.0), 1.0), s->hit->v = (float)fmin(fmax(v, 0.0), 1.0);
    s->hit->Ng_x = (float)normal.x, s->hit->Ng_y = (float)normal.y, s->hit->Ng_z = (float)normal.z;
    s->hit->geomID = arguments->geomID;
    s->hit->primID = arguments->primID;
    return false;
}

/* Searches for a coincident face at `hit` of a ray in this direction, and replaces the hit by it. False: none. */
static bool find_face(const struct embree_backend *b, const struct embree_context *context, uint32_t lane, bool back,
                      struct kiln_vec3 direction, struct RTCHit *hit)
{
    const struct kiln_geometry *g = b->params.geometry;
    const uint32_t triangle = embree_triangle(b, hit->geomID, hit->primID);
    struct face_search s = {.b = b,
                            .context = context,
                            .lane = lane,
                            .back = back,
                            .place = dvec3_of(kiln_triangle_position(g, triangle, hit->u, hit->v)),
                            .direction = dvec3_of(direction),
                            .margin = (double)(KILN_COINCIDENT * g->extent),
                            .gap = (float)BOX_MARGINS * KILN_COINCIDENT * g->extent,
                            .inside = -(double)KILN_COINCIDENT,
                            .hit = hit};
    struct RTCPointQuery query = {
        .x = (float)s.place.x, .y = (float)s.place.y, .z = (float)s.place.z, .radius = KILN_COINCIDENT * g->extent};
    struct RTCPointQueryContext round;
    rtcInitPointQueryContext(&round);
    (void)rtcPointQuery(b->scene, &query, &round, consider_face, &s);
    return s.inside > -(double)KILN_COINCIDENT;
}

bool embree_coincides(const struct embree_backend *b, const struct embree_context *context, const struct RTCHit *hit,
                      struct kiln_vec3 direction, bool back)
{
    struct RTCHit other = *hit;
    return find_face(b, context, 0, back, direction, &other);
}

/* Replaces a hit on the back of a single-sided surface by a coincident front (KILN_COINCIDENT), if there is one.
 * `lane`: index of the context's seeds. Returns whether there is one. */
static bool prefer_front(const struct embree_backend *b, const struct embree_context *context, uint32_t lane,
                         struct kiln_vec3 direction, struct RTCHit *hit)
{
    const uint32_t triangle = embree_triangle(b, hit->geomID, hit->primID);
    if ((b->params.geometry->records[triangle].material & KILN_RECORD_DOUBLE_SIDED) != 0)
        return false;
    const bool place_first = is_place_first(b, triangle);
    if (!place_first && !may_coincide(b, triangle))
        return false;
    struct RTCHit front = *hit;
    if (!find_face(b, context, lane, false, direction, &front) || (place_first && !may_coincide(b, triangle)))
        return false;
    *hit = front;
    return true;
}

void embree_prefer_front1(const struct embree_backend *b, const struct embree_context *context, struct RTCRayHit *r)
{
    const struct kiln_vec3 d = vec3(r->ray.dir_x, r->ray.dir_y, r->ray.dir_z);
    if (r->hit.geomID != RTC_INVALID_GEOMETRY_ID && vec3_dot(vec3(r->hit.Ng_x, r->hit.Ng_y, r->hit.Ng_z), d) > 0.0f)
        (void)prefer_front(b, context, 0, d, &r->hit);
}

void embree_prefer_front8(const struct embree_backend *b, const struct embree_context *context, const int *valid,
                          struct RTCRayHit8 *r)
{
    for (uint32_t i = 0; i < PACKET; i++) {
        const struct kiln_vec3 d = vec3(r->ray.dir_x[i], r->ray.dir_y[i], r->ray.dir_z[i]);
        if (valid[i] == 0 || r->hit.geomID[i] == RTC_INVALID_GEOMETRY_ID ||
            !(vec3_dot(vec3(r->hit.Ng_x[i], r->hit.Ng_y[i], r->hit.Ng_z[i]), d) > 0.0f))
            continue;
        struct RTCHit hit = {
            .u = r->hit.u[i], .v = r->hit.v[i], .primID = r->hit.primID[i], .geomID = r->hit.geomID[i]};
        if (!prefer_front(b, context, i, d, &hit))
            continue;
        r->hit.Ng_x[i] = hit.Ng_x, r->hit.Ng_y[i] = hit.Ng_y, r->hit.Ng_z[i] = hit.Ng_z;
        r->hit.u[i] = hit.u, r->hit.v[i] = hit.v;
        r->hit.primID[i] = hit.primID;
        r->hit.geomID[i] = hit.geomID;
    }
}
