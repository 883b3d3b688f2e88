/* The shapes pass (worker/pass/shapes.h). */
#include "worker/pass/shapes.h"

#include <math.h>

#include "worker/backend/embree/frame.h"
#include "worker/backend/embree/tile_runs.h"
#include "worker/base/memory.h"
#include "worker/light/lamp_textures.h"

static int work_create(void **work, const struct embree_backend *b, const void *parameters,
                       const struct kiln_batch *part, struct kiln_error *error)
{
    (void)b, (void)parameters, (void)part;
    struct tile_run_frame *frame = NULL;
    const int status = kiln_allocate(&frame, 1, sizeof *frame, "the shapes of patches", error);
    *work = frame;
    return status;
}

static void work_destroy(void **work) { kiln_free(work); }

enum { SIDE = 8, PLACES = SIDE * SIDE };

static float number(uint32_t i) { return ((float)i + 0.5f) / SIDE; }

/* Whether one of the point's triangles emits light. */
static bool emits(const struct tile_run_frame *f, const struct embree_backend *b, uint32_t j)
{
    const struct kiln_footprint *footprint = &f->footprint[j];
    for (uint32_t i = 0; i < footprint->piece_count; i++) {
        const uint64_t stored = b->params.geometry->stored_triangle[footprint->pieces[i]];
        const float *e = b->params.scene->materials[b->params.scene->triangle_materials[stored]].emission;
        if (e[0] != 0.0f || e[1] != 0.0f || e[2] != 0.0f)
            return true;
    }
    return false;
}

enum { CELLS = 8 }; /* of lamps' textures, along a piece of a texel */

/* Adds the emission of a polygon of a triangle. `share`: its share of the point's area. */
static void add_emission(const struct embree_backend *b, uint32_t triangle, const double (*polygon)[2],
                         uint32_t corners, double share, double sum[3])
{
    double mean[3], square;
    if (!(share > 0.0) || (b->params.geometry->records[triangle].material & KILN_RECORD_EMITS) == 0)
        return;
    kiln_lamp_mean(b->params.lights->textures, triangle, polygon, corners, CELLS, mean, &square);
    for (int c = 0; c < 3; c++)
        sum[c] += share * mean[c];
}

static void add_whole(const struct embree_backend *b, const struct kiln_footprint *p, double sum[3])
{
    double polygon[4][2];
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < 2; k++)
            polygon[i][k] = (double)p->whole.b[k] + (i == 1 || i == 2 ? (double)p->whole.b_du[k] : 0.0) +
                            (i >= 2 ? (double)p->whole.b_dv[k] : 0.0);
    add_emission(b, p->pieces[0], (const double(*)[2])polygon, 4, 1.0, sum);
}

/* Emission of the point, W/m2, averaged over the existing part of its texel. */
static void find_emission(const struct tile_run_frame *f, const struct embree_backend *b, uint32_t j, float emission[3])
{
    const struct kiln_footprint *p = &f->footprint[j];
    double sum[3] = {0.0, 0.0, 0.0}, before = 0.0;
    if (p->kind == KILN_FOOTPRINT_WHOLE)
        add_whole(b, p, sum);
    for (uint32_t i = 0; i < p->piece_count && p->kind != KILN_FOOTPRINT_WHOLE; i++) {
        struct kiln_footprint_triangle triangles[KILN_FOOTPRINT_TRIANGLES];
        const uint32_t count = kiln_footprint_triangles(p, i, triangles);
        for (uint32_t k = 0; k < count; k++) {
            const struct kiln_footprint_triangle *t = &triangles[k];
            const double polygon[3][2] = {{t->b1[0], t->b2[0]}, {t->b1[1], t->b2[1]}, {t->b1[2], t->b2[2]}};
            add_emission(b, t->triangle, polygon, 3, t->until - before, sum);
            before = t->until;
        }
    }
    for (int c = 0; c < 3 && f->present[j] > 0.0f; c++)
        emission[c] = (float)(KILN_PI * sum[c] / (double)f->present[j]);
}

/* ---- points other than a square on a single triangle ---- */

enum { FINE = 16, SPOTS = FINE * FINE };
#define ALIKE 0.7f /* cosine: a surface at a larger angle is another one in the same texel */
#define FLAT 0.9999f
#define APART 4.0 /* as a multiple of sqrt(area): a surface farther away is another one, too */

/* Sample of a point's surface; weighted sums of positions and their squares over spots are integrals over it. */
struct spot {
    struct kiln_vec3 at, normal;
    double weight;
};

struct spots {
    uint32_t count;
    double area; /* m2, of the point */
    struct spot of[SPOTS];
};

static void add_spot(struct spots *spots, struct kiln_vec3 at, struct kiln_vec3 normal, double weight)
{
    if (weight > 0.0 && spots->count < SPOTS)
        spots->of[spots->count++] = (struct spot){at, normal, weight};
}

/* Adds the midpoints of a triangle's sides, which integrate squares exactly. */
static void add_triangle(struct spots *spots, const struct tile_run_frame *f, const struct kiln_geometry *g,
                         const struct kiln_footprint_triangle *t)
{
    struct kiln_vec3 c[3], n = kiln_triangle_normal(g, t->triangle);
    n = f->back ? vec3_scale(n, -1.0f) : n;
    for (int i = 0; i < 3; i++)
        c[i] = kiln_offset_origin(kiln_triangle_position(g, t->triangle, (float)t->b1[i], (float)t->b2[i]), n, g,
                                  t->triangle);
    const double area = (double)vec3_length(vec3_cross(vec3_sub(c[1], c[0]), vec3_sub(c[2], c[0])));
    for (int i = 0; i < 3; i++)
        add_spot(spots, vec3_scale(vec3_add(c[i], c[(i + 1) % 3]), 0.5f), n, area);
}

/* Adds spots for all pieces of the point. False: the point is partly buried or transparent, or has too many pieces. */
static bool add_pieces(struct spots *spots, const struct tile_run_frame *f, const struct embree_backend *b, uint32_t j)
{
    const struct kiln_footprint *p = &f->footprint[j];
    struct kiln_footprint_triangle triangles[KILN_FOOTPRINT_TRIANGLES];
    if (f->partly_buried[j] || f->mask[j].count > 0 || 3 * KILN_FOOTPRINT_TRIANGLES * p->piece_count > SPOTS)
        return false;
    for (uint32_t i = 0; i < p->piece_count; i++) {
        const uint32_t count = kiln_footprint_triangles(p, i, triangles);
        for (uint32_t k = 0; k < count; k++)
            add_triangle(spots, f, b->params.geometry, &triangles[k]);
    }
    return spots->count > 0;
}

/* Adds those of FINE x FINE positions that are not buried. */
static void add_positions(struct spots *spots, struct tile_run_frame *f, const struct embree_backend *b, uint32_t j)
{
    const bool buried = f->partly_buried[j];
    for (uint32_t i = 0; i < SPOTS; i++) {
        struct kiln_vec3 at, normal;
        f->partly_buried[j] = false; /* what is buried is not drawn again */
        (void)frame_position(f, b, j, ((float)(i % FINE) + 0.5f) / FINE, ((float)(i / FINE) + 0.5f) / FINE, &at,
                             &normal);
        f->partly_buried[j] = buried;
        if (!buried || !frame_buried(b, at, normal))
            add_spot(spots, at, normal, 1.0);
    }
}

static bool are_alike(const struct spots *spots, const struct spot *a, const struct spot *b)
{
    return vec3_dot(a->normal, b->normal) > ALIKE &&
           (double)vec3_length(vec3_sub(a->at, b->at)) < APART * sqrt(spots->area);
}

/* Keeps only the surface that covers most of the point. */
static void keep_largest(struct spots *spots)
{
    uint32_t best = 0, count = 0;
    double most = -1.0;
    for (uint32_t i = 0; i < spots->count; i++) {
        double weight = 0.0;
        for (uint32_t k = 0; k < spots->count; k++)
            weight += are_alike(spots, &spots->of[i], &spots->of[k]) ? spots->of[k].weight : 0.0;
        if (weight > most)
            most = weight, best = i;
    }
    const struct spot leader = spots->of[best];
    for (uint32_t i = 0; i < spots->count; i++)
        if (are_alike(spots, &leader, &spots->of[i]))
            spots->of[count++] = spots->of[i];
    spots->count = count;
}

/* Middle and normal. */
static void find_middle(const struct spots *spots, struct kiln_patch *patch)
{
    double sum = 0.0;
    struct kiln_dvec3 at = dvec3(0.0, 0.0, 0.0), normal = dvec3(0.0, 0.0, 0.0);
    bool flat = true;
    for (uint32_t i = 0; i < spots->count; i++) {
        const struct spot *s = &spots->of[i];
        sum += s->weight;
        at = dvec3_add(at, dvec3_scale(dvec3_of(s->at), s->weight));
        normal = dvec3_add(normal, dvec3_scale(dvec3_of(s->normal), s->weight));
        flat = flat && vec3_dot(s->normal, spots->of[0].normal) > FLAT;
    }
    patch->centre = vec3_of(dvec3_scale(at, 1.0 / sum));
    patch->normal = flat ? spots->of[0].normal : vec3_normalize(vec3_of(normal));
}

/* Finds the position nearest to the middle. */
static void find_place(struct tile_run_frame *f, const struct embree_backend *b, uint32_t j, const struct spots *spots,
                       struct kiln_patch *patch)
{
    float least = INFINITY;
    patch->place = patch->centre;
    if (f->footprint[j].piece_count == 1 && !f->partly_buried[j] && f->mask[j].count == 0)
        return;
    for (uint32_t i = 0; i < PLACES + spots->count; i++) {
        struct spot s;
        if (i < PLACES)
            (void)frame_position(f, b, j, number(i % SIDE), number(i / SIDE), &s.at, &s.normal);
        else
            s = spots->of[i - PLACES];
        const float distance = vec3_length(vec3_sub(s.at, patch->centre));
        if (!(distance < least) || !are_alike(spots, &s, &spots->of[0]) ||
            (f->partly_buried[j] && frame_buried(b, s.at, s.normal)))
            continue;
        least = distance;
        patch->place = s.at;
    }
}

/* Finds the rectangle about the middle with the aspect ratio of the surface's covariance. */
static void find_rectangle(const struct spots *spots, struct kiln_patch *patch)
{
    const struct kiln_vec3 n = patch->normal,
                           side = fabsf(n.x) < 0.5f ? vec3(1.0f, 0.0f, 0.0f) : vec3(0.0f, 1.0f, 0.0f),
                           u = vec3_normalize(vec3_cross(n, side)), v = vec3_cross(n, u);
    double xx = 0.0, xy = 0.0, yy = 0.0;
    for (uint32_t i = 0; i < spots->count; i++) {
        const struct kiln_vec3 d = vec3_sub(spots->of[i].at, patch->centre);
        const double x = (double)vec3_dot(d, u), y = (double)vec3_dot(d, v), weight = spots->of[i].weight;
        xx += weight * x * x, xy += weight * x * y, yy += weight * y * y;
    }
    const double turn = 0.5 * atan2(2.0 * xy, xx - yy), middle = 0.5 * (xx + yy), spread = hypot(0.5 * (xx - yy), xy),
                 longer = sqrt(middle + spread), shorter = sqrt(fmax(middle - spread, 0.0));
    /* a line or a single position gives no aspect ratio */
    const double ratio = shorter > 0.01 * longer && longer > 0.0 ? sqrt(longer / shorter) : 1.0;
    const double length = sqrt((double)patch->area);
    const struct kiln_vec3 along = vec3_madd(vec3_scale(u, (float)cos(turn)), v, (float)sin(turn));
    patch->edge_s = vec3_scale(along, (float)(length * ratio));
    patch->edge_t = vec3_scale(vec3_cross(n, along), (float)(length / ratio));
}

/* Finds the shape of a point that is not flat. One that is buried everywhere is treated as not buried. */
static void find_bent(struct tile_run_frame *f, const struct embree_backend *b, uint32_t j, struct kiln_patch *patch)
{
    struct spots spots = {.area = (double)patch->area};
    if (!add_pieces(&spots, f, b, j))
        add_positions(&spots, f, b, j);
    if (spots.count == 0) {
        struct kiln_vec3 at, normal;
        (void)frame_position(f, b, j, 0.5f, 0.5f, &at, &normal);
        add_spot(&spots, at, normal, 1.0);
    }
    keep_largest(&spots);
    find_middle(&spots, patch);
    find_place(f, b, j, &spots, patch);
    find_rectangle(&spots, patch);
}

static void find_shape(struct tile_run_frame *f, const struct embree_backend *b, uint32_t j, double area,
                       struct kiln_patch *patch)
{
    patch->area = (float)area;
    if (!f->whole[j]) {
        find_bent(f, b, j, patch);
        return;
    }
    (void)frame_position(f, b, j, 0.5f, 0.5f, &patch->place, &patch->normal);
    patch->centre = patch->place;
    patch->edge_s = vec3(f->edge_s[0][j], f->edge_s[1][j], f->edge_s[2][j]);
    patch->edge_t = vec3(f->edge_t[0][j], f->edge_t[1][j], f->edge_t[2][j]);
}

static void shapes_tile_run(void *work, const struct embree_backend *b, struct embree_context *context, size_t tile_run,
                            void *results, uint64_t *rays)
{
    (void)context, (void)rays;
    struct tile_run_frame *f = work;
    const struct kiln_surface *s = b->surface;
    const struct kiln_tile_run *run = &s->tile_runs[tile_run];
    const bool is_met = (b->params.scene->objects[kiln_map_object(s, run->map)].flags & KILN_OBJECT_RECEIVER_ONLY) == 0;
    frame_build(f, b, tile_run, UINT64_MAX, 0);
    for (uint32_t j = 0; j < f->count; j++) {
        struct kiln_shape_result *r = (struct kiln_shape_result *)results + f->place[j];
        const struct kiln_own_point own = {kiln_own_of_global(s, run->first).at + f->place[j]};
        const double lit = kiln_lit_area(s, own, f->present[j]);
        /* a fully transparent point sends no light, but light falls on it, so it needs a shape */
        find_shape(f, b, j, lit > 0.0 ? lit : kiln_lit_area(s, own, 1.0f), &r->patch);
        if (!is_met || !(lit > 0.0))
            r->patch.area = 0.0f;
        if (emits(f, b, j))
            find_emission(f, b, j, r->emission);
    }
}

int embree_shapes(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                  uint64_t *rays, struct kiln_error *error)
{
    static const struct tile_run_pass pass = {work_create, work_destroy, shapes_tile_run,
                                              sizeof(struct kiln_shape_result)};
    return embree_each_tile_run(b, &pass, parameters, part, results, rays, error);
}
