#include "coordinator/output/vertex_light.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/mpi/agree.h"
#include "worker/base/arena.h"
#include "worker/base/color.h"
#include "worker/base/memory.h"
#include "worker/base/stop.h"
#include "worker/scene/footprint.h"

/* Weight of the second term. */
static const double LAMBDA = 1e-4;
/* Conjugate gradients end at this residual, relative to the right side. */
static const double RESIDUAL = 1e-7;
enum { ITERATIONS = 1000, BLOCK_TRIANGLES = 1 << 16 };

/* Sums over a triangle's points: integrals of phi_i phi_j (00 11 22 01 02 12), of phi_i E (channel by channel), and of
 * the squared luminance. They are relative to the triangle's area and the brightest point's light. They are integers,
 * in steps of 1 / STEPS, so that the order of points does not matter. */
enum { MASSES = 6, LIGHTS = 9, SQUARE = MASSES + LIGHTS, SUMS };
#define STEPS 0x1p58
struct triangle_sums {
    int64_t of[SUMS];
};

struct fit {
    const struct kiln_bake_result *result;
    size_t field;        /* of irradiance */
    double unit;         /* a power of two above the light of all points */
    uint32_t *tile_runs; /* own ones of fronts, by object */
    size_t *object_runs; /* object_count + 1: where an object's tile runs begin */
    struct kiln_vertex_light *light;
};

static uint64_t triangles_of(const struct fit *f, size_t object)
{
    const struct kiln_object_range *r = &f->result->geometry->ranges[object];
    return r->opaque_count + r->alpha_count;
}

static uint64_t own_number(const struct kiln_object_range *range, uint64_t triangle)
{
    return triangle - range->opaque_first < range->opaque_count ? triangle - range->opaque_first
                                                                : range->opaque_count + (triangle - range->alpha_first);
}

static uint64_t world_number(const struct kiln_object_range *range, uint64_t own)
{
    return own < range->opaque_count ? range->opaque_first + own : range->alpha_first + (own - range->opaque_count);
}

/* ---- sums over points ---- */

static void add_sum(int64_t *sum, double value) { *sum += (int64_t)llrint(value * STEPS); }

/* Adds a flat piece of a triangle: a triangle of area `share` x the whole one's, with corners in weights b1, b2. */
static void add_piece(struct triangle_sums *sums, double share, const double b1[3], const double b2[3],
                      const double light[3])
{
    double phi[3][3], total[3] = {0};
    for (int k = 0; k < 3; k++) {
        phi[k][0] = 1.0 - b1[k] - b2[k];
        phi[k][1] = b1[k];
        phi[k][2] = b2[k];
        for (int i = 0; i < 3; i++)
            total[i] += phi[k][i];
    }
    static const int pairs[MASSES][2] = {{0, 0}, {1, 1}, {2, 2}, {0, 1}, {0, 2}, {1, 2}};
    for (int m = 0; m < MASSES; m++) {
        const int i = pairs[m][0], j = pairs[m][1];
        double mixed = total[i] * total[j];
        for (int k = 0; k < 3; k++)
            mixed += phi[k][i] * phi[k][j];
        add_sum(&sums->of[m], share / 12.0 * mixed);
    }
    for (int i = 0; i < 3; i++)
        for (int c = 0; c < 3; c++)
            add_sum(&sums->of[MASSES + 3 * i + c], share / 3.0 * total[i] * light[c]);
    add_sum(&sums->of[SQUARE], share * kiln_luminance(light) * kiln_luminance(light));
}

/* Adds a texel's parallelogram that one triangle covers, as two triangles. */
static void add_whole(const struct fit *f, const struct kiln_footprint *p, double area, struct triangle_sums *sums,
                      const double light[3])
{
    static const double s[2][3] = {{0, 1, 1}, {0, 1, 0}}, t[2][3] = {{0, 0, 1}, {0, 1, 1}};
    const double whole = kiln_geometry_triangle_area(f->result->geometry, p->pieces[0]);
    for (int half = 0; half < 2 && whole > 0.0; half++) {
        double b1[3], b2[3];
        for (int k = 0; k < 3; k++) {
            b1[k] =
                (double)p->whole.b[0] + s[half][k] * (double)p->whole.b_du[0] + t[half][k] * (double)p->whole.b_dv[0];
            b2[k] =
                (double)p->whole.b[1] + s[half][k] * (double)p->whole.b_du[1] + t[half][k] * (double)p->whole.b_dv[1];
        }
        add_piece(sums, 0.5 * area / whole, b1, b2, light);
    }
}

/* Adds a point to the sums of its triangles. `of_object`: the sums of its object's triangles. */
static void add_point(const struct fit *f, const struct kiln_point_cursor *at, struct triangle_sums *of_object)
{
    const struct kiln_bake_result *r = f->result;
    const struct kiln_object_range *range = &r->geometry->ranges[at->object];
    const double area = (double)r->surface->area[at->point.at];
    float floats[KILN_FIELD_COMPONENTS_MAX];
    double light[3];
    struct kiln_footprint p;
    kiln_rank_floats(r->data, r->fields, f->field, at->point, floats);
    for (int c = 0; c < 3; c++)
        light[c] = (double)floats[c] / f->unit;
    kiln_footprint_prepare(&p, r->scene, r->geometry, r->surface, at);
    if (p.kind == KILN_FOOTPRINT_WHOLE) {
        add_whole(f, &p, area, &of_object[own_number(range, p.pieces[0])], light);
        return;
    }
    double before = 0.0;
    for (uint32_t piece = 0; piece < p.piece_count; piece++) {
        struct kiln_footprint_triangle triangles[KILN_FOOTPRINT_TRIANGLES];
        const uint32_t count = kiln_footprint_triangles(&p, piece, triangles);
        const double whole = kiln_geometry_triangle_area(r->geometry, p.pieces[piece]);
        for (uint32_t k = 0; k < count; k++) {
            const double share = (triangles[k].until - before) * area;
            before = triangles[k].until;
            if (whole > 0.0 && share > 0.0)
                add_piece(&of_object[own_number(range, p.pieces[piece])], share / whole, triangles[k].b1,
                          triangles[k].b2, light);
        }
    }
}

static void add_object(const struct fit *f, size_t object, struct triangle_sums *sums)
{
    const struct kiln_surface *s = f->result->surface;
    for (size_t i = f->object_runs[object]; i < f->object_runs[object + 1]; i++) {
        struct kiln_point_cursor at = kiln_point_first(s, f->tile_runs[i]);
        for (uint32_t k = 0; k < s->tile_runs[f->tile_runs[i]].count; k++, kiln_point_next(s, &at))
            if (kiln_point_valid(s, at.point))
                add_point(f, &at, sums);
    }
}

/* ---- vertices that share one unknown ---- */

/* A vertex by its key for comparison; `number`: in the mesh. */
struct corner {
    float position[3], normal[3];
    uint32_t number;
};

static int by_place(const void *a, const void *b)
{
    const struct corner *x = a, *y = b;
    const int order = memcmp(x->position, y->position, sizeof x->position + sizeof x->normal);
    return order != 0 ? order : (x->number > y->number) - (x->number < y->number);
}

/* Writes to unknown[vertex] the number of the mesh's first vertex with an equal key. */
static int weld(const struct kiln_scene *scene, const struct kiln_mesh *mesh, uint32_t *unknown,
                struct kiln_error *error)
{
    struct corner *corners = NULL;
    const int status = kiln_allocate(&corners, mesh->vertex_count, sizeof *corners, "an object's vertices", error);
    if (status != KILN_OK)
        return status;
    for (uint64_t v = 0; v < mesh->vertex_count; v++) {
        const struct kiln_vec3 p = scene->positions[mesh->vertex_first + v], n = scene->normals[mesh->vertex_first + v];
        corners[v] = (struct corner){
            {p.x + 0.0f, p.y + 0.0f, p.z + 0.0f}, {n.x + 0.0f, n.y + 0.0f, n.z + 0.0f}, (uint32_t)v}; /* no -0 */
    }
    qsort(corners, mesh->vertex_count, sizeof *corners, by_place);
    for (uint64_t v = 0; v < mesh->vertex_count; v++) {
        const bool same = v > 0 && memcmp(corners[v].position, corners[v - 1].position,
                                          sizeof corners->position + sizeof corners->normal) == 0;
        unknown[corners[v].number] = same ? unknown[corners[v - 1].number] : corners[v].number;
    }
    kiln_free(&corners);
    return KILN_OK;
}

/* ---- least squares ---- */

/* A triangle's part of the normal equations of an object: a symmetric 3 x 3 matrix, and its three unknowns. */
struct element {
    double matrix[MASSES];
    uint32_t unknown[3];
};

struct system {
    struct element *elements;
    size_t element_count, vertex_count;
    double *right, *diagonal;                     /* 3 and 1 a vertex */
    double *value, *residual, *direction, *image; /* 1 a vertex, of the channel in hand */
    uint32_t *unknown;                            /* of a vertex */
    double square, area, light;                   /* integrals of the points' squared luminance, 1 and luminance */
    struct kiln_arena arena;
};

static void system_release(struct system *y)
{
    kiln_free(&y->diagonal);
    kiln_free(&y->value);
    kiln_free(&y->residual);
    kiln_free(&y->direction);
    kiln_free(&y->image);
    kiln_arena_release(&y->arena);
}

static int system_create(struct system *y, size_t triangles, size_t vertices, struct kiln_error *error)
{
    static const char what[] = "irradiance at vertices";
    *y = (struct system){.element_count = triangles, .vertex_count = vertices};
    double **const arrays[] = {&y->diagonal, &y->value, &y->residual, &y->direction, &y->image};
    int status;
    KILN_TRY(kiln_arena_allocate(&y->arena, &y->elements, triangles, sizeof *y->elements, what, error));
    KILN_TRY(kiln_arena_allocate(&y->arena, &y->unknown, vertices, sizeof *y->unknown, what, error));
    KILN_TRY(kiln_arena_allocate(&y->arena, &y->right, vertices, 3 * sizeof *y->right, what, error));
    for (size_t i = 0; i < sizeof arrays / sizeof *arrays; i++)
        KILN_TRY(kiln_allocate(arrays[i], vertices, sizeof **arrays[i], what, error));
end:
    return status;
}

/* Adds a triangle of this area to the equations. */
static void add_element(struct system *y, struct element *e, double area, const struct triangle_sums *sums)
{
    for (int m = 0; m < MASSES; m++)
        e->matrix[m] = area * ((double)sums->of[m] / STEPS + LAMBDA * (m < 3 ? 2.0 : -1.0));
    for (int i = 0; i < 3; i++) {
        y->diagonal[e->unknown[i]] += e->matrix[i];
        double rgb[3];
        for (int c = 0; c < 3; c++) {
            rgb[c] = area * (double)sums->of[MASSES + 3 * i + c] / STEPS;
            y->right[3 * e->unknown[i] + (size_t)c] += rgb[c];
        }
        y->light += kiln_luminance(rgb);
    }
    for (int m = 0; m < MASSES; m++)
        y->area += area * (double)sums->of[m] / STEPS * (m < 3 ? 1.0 : 2.0);
    y->square += area * (double)sums->of[SQUARE] / STEPS;
}

static void multiply(const struct system *y, const double *x, double *image)
{
    memset(image, 0, y->vertex_count * sizeof *image);
    for (size_t t = 0; t < y->element_count; t++) {
        const double *m = y->elements[t].matrix;
        const uint32_t *u = y->elements[t].unknown;
        image[u[0]] += m[0] * x[u[0]] + m[3] * x[u[1]] + m[4] * x[u[2]];
        image[u[1]] += m[3] * x[u[0]] + m[1] * x[u[1]] + m[5] * x[u[2]];
        image[u[2]] += m[4] * x[u[0]] + m[5] * x[u[1]] + m[2] * x[u[2]];
    }
}

/* residual . residual / diagonal */
static double length2(const struct system *y)
{
    double sum = 0.0;
    for (size_t v = 0; v < y->vertex_count; v++)
        sum += y->diagonal[v] > 0.0 ? y->residual[v] * y->residual[v] / y->diagonal[v] : 0.0;
    return sum;
}

/* Conjugate gradients with the diagonal as preconditioner, from 0, for one channel. */
static void solve(struct system *y, size_t channel)
{
    for (size_t v = 0; v < y->vertex_count; v++) {
        y->value[v] = 0.0;
        y->residual[v] = y->right[3 * v + channel];
        y->direction[v] = y->diagonal[v] > 0.0 ? y->residual[v] / y->diagonal[v] : 0.0;
    }
    const double begin = length2(y);
    double now = begin;
    for (int k = 0; k < ITERATIONS && now > RESIDUAL * RESIDUAL * begin; k++) {
        multiply(y, y->direction, y->image);
        double curve = 0.0;
        for (size_t v = 0; v < y->vertex_count; v++)
            curve += y->direction[v] * y->image[v];
        if (!(curve > 0.0))
            return;
        for (size_t v = 0; v < y->vertex_count; v++) {
            y->value[v] += now / curve * y->direction[v];
            y->residual[v] -= now / curve * y->image[v];
        }
        const double next = length2(y);
        for (size_t v = 0; v < y->vertex_count; v++)
            y->direction[v] =
                (y->diagonal[v] > 0.0 ? y->residual[v] / y->diagonal[v] : 0.0) + next / now * y->direction[v];
        now = next;
    }
}

/* Relative error of the fit: root mean square of fit - E over the mean of E, in luminance. The integral of (fit - E)²
 * is fit M fit - 2 fit b + integral of E², plus the small second term of the minimum. */
static float fit_error(struct system *y, float (*fit)[3], double unit)
{
    double square = y->square;
    for (size_t v = 0; v < y->vertex_count; v++) {
        const float *own = fit[y->unknown[v]];
        const double rgb[3] = {(double)own[0] / unit, (double)own[1] / unit, (double)own[2] / unit};
        y->value[v] = kiln_luminance(rgb);
    }
    multiply(y, y->value, y->image);
    for (size_t v = 0; v < y->vertex_count; v++)
        if (y->unknown[v] == v)
            square += y->value[v] * (y->image[v] - 2.0 * kiln_luminance(&y->right[3 * v]));
    const double mean = y->area > 0.0 ? y->light / y->area : 0.0;
    return mean > 0.0 ? (float)(sqrt(fmax(square, 0.0) / y->area) / mean) : 0.0f;
}

/* ---- objects ---- */

static int fit_object(const struct fit *f, size_t object, const struct triangle_sums *sums, struct kiln_error *error)
{
    const struct kiln_bake_result *r = f->result;
    const struct kiln_mesh *mesh = &r->scene->meshes[r->scene->objects[object].mesh];
    const struct kiln_object_range *range = &r->geometry->ranges[object];
    struct system y;
    int status;
    KILN_TRY(system_create(&y, triangles_of(f, object), mesh->vertex_count, error));
    KILN_TRY(weld(r->scene, mesh, y.unknown, error));
    for (size_t t = 0; t < y.element_count; t++) {
        const uint64_t world = world_number(range, t);
        uint64_t vertex[3];
        kiln_geometry_stored_vertices(r->scene, r->geometry, world, vertex);
        for (int i = 0; i < 3; i++)
            y.elements[t].unknown[i] = y.unknown[vertex[i] - mesh->vertex_first];
        add_element(&y, &y.elements[t], kiln_geometry_triangle_area(r->geometry, world), &sums[t]);
    }
    float(*to)[3] = f->light->irradiance + f->light->first[object];
    for (size_t c = 0; c < 3; c++) {
        solve(&y, c);
        for (size_t v = 0; v < mesh->vertex_count; v++)
            to[v][c] = (float)(fmax(y.value[y.unknown[v]], 0.0) * f->unit);
    }
    f->light->error[object] = fit_error(&y, to, f->unit);
end:
    system_release(&y);
    return status;
}

/* Fits objects [first, end) on all threads of rank 0, which has their sums. `place`: where each object's sums begin. */
static int fit_objects(const struct fit *f, size_t first, size_t end, const struct triangle_sums *sums,
                       const uint64_t *place, struct kiln_error *error)
{
    int status = KILN_OK;
#pragma omp parallel for schedule(dynamic, 1)
    for (size_t object = first; object < end; object++) {
        struct kiln_error own = {""};
        const int one = fit_object(f, object, sums + place[object - first], &own);
        if (one != KILN_OK) {
#pragma omp critical(kiln_vertex_light)
            {
                status = one;
                *error = own;
            }
        }
    }
    return status;
}

/* Collective. Sums up objects [first, end), which have `triangles` triangles, and fits their vertices on rank 0. */
static int fit_block(const struct fit *f, size_t first, size_t end, uint64_t triangles, int rank,
                     struct kiln_error *error)
{
    struct triangle_sums *sums = NULL;
    uint64_t *place = NULL;
    int status;
    KILN_TRY(kiln_allocate(&sums, triangles, sizeof *sums, "the light of triangles", error));
    KILN_TRY(kiln_allocate(&place, end - first + 1, sizeof *place, "the light of triangles", error));
    if (kiln_stop_asked(f->result->stop))
        KILN_TRY(kiln_give_up(error));
    for (size_t o = first; o < end; o++) {
        place[o - first + 1] = place[o - first] + triangles_of(f, o);
        add_object(f, o, sums + place[o - first]);
    }
end:
    status = kiln_agree(f->result->communicator, status, error);
    for (uint64_t done = 0; status == KILN_OK && done < triangles;) {
        enum { MOST = 1 << 20 };
        const uint64_t some = triangles - done < MOST ? triangles - done : MOST;
        (void)MPI_Reduce(rank == 0 ? MPI_IN_PLACE : &sums[done], rank == 0 ? &sums[done] : NULL, (int)(some * SUMS),
                         MPI_INT64_T, MPI_SUM, 0, f->result->communicator);
        done += some;
    }
    if (status == KILN_OK && rank == 0)
        status = fit_objects(f, first, end, sums, place, error);
    kiln_free(&place);
    kiln_free(&sums);
    return kiln_agree(f->result->communicator, status, error);
}

/* ---- what there is ---- */

/* Sorts the own tile runs of fronts by object. */
static int sort_tile_runs(struct fit *f, struct kiln_error *error)
{
    const struct kiln_surface *s = f->result->surface;
    const size_t objects = f->result->scene->object_count;
    int status = kiln_allocate(&f->tile_runs, s->tile_run_count, sizeof *f->tile_runs, "tile runs of objects", error);
    if (status == KILN_OK)
        status = kiln_allocate(&f->object_runs, objects + 2, sizeof *f->object_runs, "tile runs of objects", error);
    if (status != KILN_OK)
        return status;
    size_t *next = f->object_runs + 1; /* counts are stored one entry ahead, so that filling leaves the beginnings */
    for (size_t i = 0; i < s->tile_run_count; i++)
        if (!kiln_map_back(s, s->tile_runs[i].map))
            next[kiln_map_object(s, s->tile_runs[i].map) + 1]++;
    for (size_t o = 0; o < objects; o++)
        next[o + 1] += next[o];
    for (size_t i = 0; i < s->tile_run_count; i++)
        if (!kiln_map_back(s, s->tile_runs[i].map))
            f->tile_runs[next[kiln_map_object(s, s->tile_runs[i].map)]++] = (uint32_t)i;
    return KILN_OK;
}

/* Collective. Returns a power of two above the light of all points. */
static double find_unit(const struct fit *f)
{
    const struct kiln_surface *s = f->result->surface;
    double most = 0.0;
    int power = 0;
    for (uint64_t i = 0; i < s->count; i++) {
        float floats[KILN_FIELD_COMPONENTS_MAX];
        kiln_rank_floats(f->result->data, f->result->fields, f->field, (struct kiln_own_point){i}, floats);
        for (int c = 0; c < 3; c++)
            most = fmax(most, (double)floats[c]);
    }
    (void)MPI_Allreduce(MPI_IN_PLACE, &most, 1, MPI_DOUBLE, MPI_MAX, f->result->communicator);
    (void)frexp(most, &power);
    return most > 0.0 ? ldexp(1.0, power) : 1.0;
}

static int make_room(struct kiln_vertex_light *light, const struct kiln_scene *scene, struct kiln_error *error)
{
    static const char what[] = "irradiance at vertices";
    int status;
    KILN_TRY(
        kiln_arena_allocate(&light->arena, &light->first, scene->object_count + 1, sizeof *light->first, what, error));
    KILN_TRY(kiln_arena_allocate(&light->arena, &light->error, scene->object_count, sizeof *light->error, what, error));
    for (size_t o = 0; o < scene->object_count; o++)
        light->first[o + 1] = light->first[o] + scene->meshes[scene->objects[o].mesh].vertex_count;
end:
    light->object_count = scene->object_count;
    if (status == KILN_OK)
        status = kiln_arena_allocate(&light->arena, &light->irradiance, light->first[scene->object_count],
                                     sizeof *light->irradiance, what, error);
    return status;
}

int kiln_vertex_light_fit(struct kiln_vertex_light *light, const struct kiln_bake_result *result,
                          struct kiln_error *error)
{
    struct fit f = {.result = result, .light = light, .field = kiln_field_set_find(result->fields, "total")};
    int rank = 0;
    *light = (struct kiln_vertex_light){0};
    (void)MPI_Comm_rank(result->communicator, &rank);
    int status = sort_tile_runs(&f, error);
    if (status == KILN_OK && rank == 0)
        status = make_room(light, result->scene, error);
    status = kiln_agree(result->communicator, status, error);
    if (status == KILN_OK)
        f.unit = find_unit(&f);
    const size_t objects = result->scene->object_count;
    for (size_t first = 0, end; status == KILN_OK && first < objects; first = end) {
        uint64_t triangles = triangles_of(&f, first);
        for (end = first + 1; end < objects && triangles + triangles_of(&f, end) <= BLOCK_TRIANGLES; end++)
            triangles += triangles_of(&f, end);
        status = fit_block(&f, first, end, triangles, rank, error);
    }
    kiln_free(&f.tile_runs);
    kiln_free(&f.object_runs);
    if (status != KILN_OK)
        kiln_vertex_light_release(light);
    return status;
}

void kiln_vertex_light_release(struct kiln_vertex_light *light)
{
    kiln_arena_release(&light->arena);
    *light = (struct kiln_vertex_light){0};
}
