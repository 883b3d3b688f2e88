/* Paths of light of the bidirectional pass (worker/pass/bidirectional.h), and their vertices that the camera sees. */
#include <math.h>

#include "shaders/shared/area_light.h"
#include "shaders/shared/punctual_light.h"
#include "worker/backend/embree/bidirectional_subpaths.h"
#include "worker/base/memory.h"
#include "worker/scene/footprint.h"

/* ---- what both subpaths do ---- */

bool subpaths_survives(const struct subpaths *w, uint32_t surface, uint32_t chain, const float share[3],
                       float weight[3])
{
    const bool endless = w->all->parameters->camera.bounces == KILN_PATH_ALL_BOUNCES || chain >= KILN_PATH_CHAIN;
    double u, v;
    if (!endless || surface < KILN_PATH_CERTAIN)
        return true;
    const float chance = kiln_path_chance(share[0], share[1], share[2]);
    subpaths_draw(w, kiln_path_use(surface, KILN_PATH_END), &u, &v);
    for (int c = 0; c < 3; c++)
        weight[c] /= chance;
    return u < (double)chance;
}

bool subpaths_leave(const struct subpaths *w, const struct vertex *v, bool of_light, uint32_t lobes, uint32_t surface,
                    struct vertex_way *way)
{
    double numbers[4];
    subpaths_draw(w, kiln_path_use(surface, KILN_PATH_LOBE), &numbers[0], &numbers[1]);
    subpaths_draw(w, kiln_path_use(surface, KILN_PATH_BOUNCE), &numbers[2], &numbers[3]);
    return vertex_leave(w->all->b, v, of_light, lobes, numbers, way);
}

bool subpaths_connect(struct subpaths *w, struct kiln_vec3 from, struct kiln_vec3 to, double through[3])
{
    w->rays++;
    return passage_between(w->all->b, &w->context, from, to, through);
}

void subpaths_product(const struct vertex_scatter *a, bool a_counts, const struct vertex_scatter *b, bool b_counts,
                      int64_t allowed, double product[3])
{
    for (int c = 0; c < 3; c++) {
        const double a_one = a_counts ? a->diffuse[c] : 0.0, b_one = b_counts ? b->diffuse[c] : 0.0,
                     a_none = a->all[c] - a_one, b_none = b->all[c] - b_one;
        product[c] = allowed < 0 ? 0.0 : a_none * b_none;
        if (allowed >= 1)
            product[c] += a_one * b_none + a_none * b_one;
        if (allowed >= 2)
            product[c] += a_one * b_one;
    }
}

void subpaths_products(const struct vertex_scatter *a, bool a_counts, const struct vertex_scatter *b, bool b_counts,
                       int64_t allowed, double product[3], double last[3])
{
    double less[3];
    subpaths_product(a, a_counts, b, b_counts, allowed, product);
    subpaths_product(a, a_counts, b, b_counts, allowed - 1, less);
    for (int c = 0; c < 3; c++)
        last[c] = product[c] - less[c];
}

void subpaths_release(struct subpaths *w)
{
    kiln_free(&w->light);
    kiln_free(&w->photons.photons);
}

/* ---- the camera ---- */

/* Projects a point to the picture, as seen from `origin`: x and y are -1 to 1. */
static bool picture_place(const struct kiln_path_parameters *c, struct kiln_vec3 origin, struct kiln_vec3 place,
                          double *x, double *y)
{
    struct kiln_dvec3 to = dvec3_of(vec3_sub(place, origin));
    const struct kiln_dvec3 right = dvec3_of(c->right), up = dvec3_of(c->up);
    const double depth = dvec3_dot(to, dvec3_of(c->forward));
    double over = c->orthographic ? 1.0 : depth;
    if (!(depth > 0.0))
        return false;
    if (c->lens_radius > 0.0f) { /* by the intersection of the ray with the focal plane, seen from the lens' centre */
        over = (double)c->focus_distance;
        to = dvec3_add(dvec3_scale(to, over / depth), dvec3_of(vec3_sub(origin, c->position)));
    }
    *x = dvec3_dot(to, right) / (dvec3_dot(right, right) * over);
    *y = dvec3_dot(to, up) / (dvec3_dot(up, up) * over);
    return true;
}

bool subpaths_view(const struct bidirectional *all, struct kiln_vec3 place, const double lens[2],
                   struct subpath_view *view)
{
    const struct kiln_path_parameters *c = &all->parameters->camera;
    double x, y;
    view->origin = c->position;
    if (c->lens_radius > 0.0f)
        view->origin =
            vec3_add(c->position, kiln_path_lens(c->right, c->up, c->lens_radius, (float)lens[0], (float)lens[1]));
    if (!picture_place(c, view->origin, place, &x, &y))
        return false;
    const double column = floor(0.5 * (x + 1.0) * c->width), row = floor(0.5 * (1.0 - y) * c->height);
    if (!(column >= 0.0) || !(row >= 0.0) || !(column < c->width) || !(row < c->height))
        return false;
    view->pixel = (uint64_t)row * c->width + (uint64_t)column;
    if (c->orthographic)
        view->origin = vec3_madd(vec3_madd(c->position, c->right, (float)x), c->up, (float)y);
    const struct kiln_vec3 back = vec3_sub(view->origin, place);
    view->distance = vec3_length(back);
    view->towards = vec3_scale(back, 1.0f / view->distance);
    return view->distance > 0.0f;
}

double subpaths_camera_density(const struct bidirectional *all, const struct subpath_view *view, double cosine)
{
    const struct kiln_path_parameters *c = &all->parameters->camera;
    return kiln_camera_density(c->orthographic, view->towards, c->forward, (double)view->distance, cosine, all->pixel);
}

/* ---- paths of light ---- */

struct kiln_dvec3 subpaths_light_normal(const struct vertex *v)
{
    const bool either = v->m.coarse || (v->m.gloss != NULL && v->m.lobes.glass > 0.0f);
    return either ? dvec3(0.0, 0.0, 0.0) : dvec3_of(v->m.normal);
}

static struct kiln_vec3 start_of(const struct subpaths *w, const struct kiln_emitted *ray)
{
    const struct kiln_lights *lights = w->all->emission->lights;
    const struct kiln_vec3 origin = vec3_of(ray->origin);
    if (ray->light >= lights->area_count)
        return origin;
    const struct kiln_area_light *light = &lights->areas[ray->light];
    const bool back = dvec3_dot(ray->direction, light->normal) < 0.0;
    return kiln_offset_origin(origin, vec3_of(dvec3_scale(light->normal, back ? -1.0 : 1.0)),
                              w->all->b->params.geometry, light->triangle);
}

/* Attenuates light at its first surface by the range of its lamp. */
static void limit_range(const struct subpaths *w, const struct kiln_emitted *ray, struct vertex *v)
{
    const struct kiln_lights *lights = w->all->emission->lights;
    const size_t point = ray->light - lights->area_count;
    if (ray->light < lights->area_count || point >= lights->point_count)
        return;
    const double distance = dvec3_length(dvec3_sub(dvec3_of(v->m.position), ray->origin));
    for (int c = 0; c < 3; c++)
        v->weight[c] *= (float)kiln_light_range(lights->points[point].range, distance);
}

static void begin_sums(const struct subpaths *w, const struct kiln_emitted *ray, struct vertex *v)
{
    const double connect = kiln_emission_connect(w->all->emission, ray->light, dvec3_of(v->m.position),
                                                 subpaths_light_normal(v), ray->origin, ray->direction);
    v->sums = kiln_path_begin_light(&w->all->techniques, connect, ray->density, ray->cosine, ray->is_point);
}

static struct vertex *push(struct subpaths *w, const struct vertex *v)
{
    struct kiln_error error;
    const int status = kiln_grow(&w->light, &w->light_capacity, w->light_count + 1, sizeof *w->light,
                                 "the vertices of a path of light", &error);
    if (status != KILN_OK) {
        w->error = w->status == KILN_OK ? error : w->error;
        w->status = w->status == KILN_OK ? status : w->status;
        return NULL;
    }
    w->light[w->light_count] = *v;
    return &w->light[w->light_count++];
}

/* A path of light on its way. */
struct ray_of_light {
    struct kiln_vec3 origin, direction;
    float weight[3], scale; /* W; the largest component at the light */
    struct kiln_path_sums sums;
    uint32_t bounces, chain;
};

/* Traces the ray to surface number `surface`; NULL: the path ends. */
static struct vertex *arrive(struct subpaths *w, const struct kiln_emitted *emitted, struct ray_of_light *r,
                             uint32_t surface)
{
    const struct embree_backend *b = w->all->b;
    struct RTCRayHit ray;
    float tint[3];
    w->rays++;
    if (!meeting_trace(b, &w->context, r->origin, r->direction, INFINITY, subpaths_chance(w, surface), &ray, tint) ||
        !meeting_has_side(b, &b->params.geometry->records[embree_triangle(b, ray.hit.geomID, ray.hit.primID)],
                          meeting_is_back(&ray)))
        return NULL;
    struct vertex v = vertex_make(b, &ray, false);
    const struct kiln_vec3 begin = surface == 0 ? vec3_of(emitted->origin) : w->light[surface - 1].m.position;
    const struct kiln_vec3 way = vec3_sub(v.m.position, begin);
    const double cosine = fabs((double)vec3_dot(v.m.normal, v.from));
    if (!(cosine > 0.0))
        return NULL;
    for (int c = 0; c < 3; c++)
        v.weight[c] = r->weight[c] * tint[c];
    v.sums = r->sums;
    v.bounces = r->bounces;
    if (surface == 0) {
        limit_range(w, emitted, &v);
        begin_sums(w, emitted, &v);
    } else {
        vertex_attenuate(&w->light[surface - 1], r->direction, ray.ray.tfar, v.weight);
    }
    kiln_path_arrive(&v.sums, surface > 0 || emitted->has_place ? (double)vec3_dot(way, way) : 1.0, cosine);
    return push(w, &v);
}

/* Continues from the vertex, which is surface number `surface`. */
static bool go_on(struct subpaths *w, const struct vertex *v, struct ray_of_light *r, uint32_t surface)
{
    struct vertex_way way;
    float share[3];
    if (!subpaths_leave(w, v, true, KILN_LOBE_ALL, surface, &way))
        return false;
    for (int c = 0; c < 3; c++) {
        r->weight[c] = v->weight[c] * way.factor[c];
        share[c] = r->weight[c] / r->scale;
    }
    r->bounces = v->bounces + (way.diffuse && (surface > 0 || w->all->from_points) ? 1 : 0);
    r->chain = way.diffuse ? 0 : r->chain + 1;
    r->sums = v->sums;
    r->origin = vertex_start(v, way.direction);
    r->direction = way.direction;
    kiln_path_leave(&w->all->techniques, &r->sums, way.landing, way.forward, way.backward, way.delta);
    return r->bounces <= w->all->most && (share[0] > 0.0f || share[1] > 0.0f || share[2] > 0.0f) &&
           subpaths_survives(w, surface, r->chain, share, r->weight);
}

void subpaths_trace_light(struct subpaths *w, uint64_t i, uint32_t k)
{
    subpaths_trace_light_by(w, kiln_hash2(w->all->light_seed, k), (uint32_t)i);
}

void subpaths_trace_light_by(struct subpaths *w, uint32_t key, uint32_t k)
{
    double pick, rest, u, v, s, t;
    struct kiln_emitted emitted;
    w->light_count = 0;
    w->key = key;
    w->k = k;
    subpaths_draw(w, KILN_EMISSION_USE, &pick, &rest);
    subpaths_draw(w, KILN_EMISSION_USE + 1, &u, &v);
    subpaths_draw(w, KILN_EMISSION_USE + 2, &s, &t);
    if (!kiln_emission_draw(w->all->emission, pick, u, v, s, t, &emitted))
        return;
    struct ray_of_light r = {.origin = start_of(w, &emitted), .direction = vec3_of(emitted.direction)};
    for (int c = 0; c < 3; c++) {
        r.weight[c] = (float)emitted.flux[c];
        r.scale = r.weight[c] > r.scale ? r.weight[c] : r.scale;
    }
    for (uint32_t surface = 0; subpaths_allow(w->all, surface + 2); surface++) {
        const struct vertex *vertex = arrive(w, &emitted, &r, surface);
        if (vertex == NULL || !go_on(w, vertex, &r, surface))
            return;
    }
}

void subpaths_keep_photons(struct subpaths *w, uint64_t i)
{
    for (size_t j = 0; j < w->light_count && w->status == KILN_OK; j++) {
        const struct vertex *v = &w->light[j];
        if (v->is_delta)
            continue;
        const struct photon photon = {.position = v->m.position,
                                      .from = v->from,
                                      .flux = {v->weight[0], v->weight[1], v->weight[2]},
                                      .vcm = (float)v->sums.vcm,
                                      .vm = (float)v->sums.vm,
                                      .bounces = v->bounces,
                                      .path = (uint32_t)i,
                                      .number = (uint32_t)j};
        w->status = photon_add(&w->photons, &photon, &w->error);
    }
}

/* ---- vertices that the camera sees ---- */

/* Adds to a pixel of the film. The light of one path is limited to the largest double that is an integer. */
static void add(struct subpaths *w, uint64_t pixel, const double rgb[3])
{
    const struct kiln_splat_film *film = w->all->parameters->film;
    for (int c = 0; c < 3; c++) {
        const double units = nearbyint(rgb[c] / film->unit);
        if (!(units < 0x1p53)) {
            w->status = kiln_fail(&w->error, KILN_BAD_INPUT,
                                  "one path of light brings %g W/(m2 sr) to a pixel, more than the sums of such paths "
                                  "hold; --method path has no such limit",
                                  rgb[c]);
            return;
        }
#pragma omp atomic
        film->sums[3 * pixel + (size_t)c] += (int64_t)units;
    }
}

/* Whether the camera sees the vertex: nothing visible to the camera blocks the ray. Also finds the light let through.
 */
static bool sees(struct subpaths *w, const struct vertex *v, const struct subpath_view *view, uint32_t number,
                 float rgb[3])
{
    struct meeting m = v->m;
    m.lift = 0.0f; /* the camera's rays end at the surface */
    const struct kiln_vec3 d = vec3_sub(meeting_start(&m, view->towards), view->origin);
    const float length = vec3_length(d);
    struct RTCRayHit ray;
    float tint[3];
    w->rays++;
    if (meeting_look(w->all->b, &w->context, view->origin, vec3_scale(d, 1.0f / length),
                     (float)((double)length * KILN_SHADOW_LENGTH), ~subpaths_chance(w, number), &ray, tint))
        return false;
    for (int c = 0; c < 3; c++)
        rgb[c] *= tint[c];
    return true;
}

static void splat(struct subpaths *w, const struct vertex *met, uint32_t number)
{
    const struct bidirectional *all = w->all;
    struct subpath_view view;
    struct vertex_scatter s;
    double lens[2] = {0.0, 0.0};
    if (all->parameters->camera.lens_radius > 0.0f)
        subpaths_draw(w, kiln_path_use(number, KILN_LENS_USE), &lens[0], &lens[1]);
    if (!subpaths_view(all, met->m.position, lens, &view) ||
        !meeting_is_seen(all->b, met->m.triangle, vec3_dot(met->front, view.towards) < 0.0f))
        return;
    const struct vertex v = vertex_as_first(all->b, met);
    if (!vertex_scatter(all->b, &v, view.towards, v.from, KILN_LOBE_ALL, &s) || !(s.landing_o > 0.0))
        return;
    const int64_t allowed = all->most - v.bounces;
    const struct vertex_scatter none = {.all = {1.0, 1.0, 1.0}};
    double rgb[3];
    float arriving[3] = {1.0f, 1.0f, 1.0f};
    subpaths_product(&s, number > 0, &none, false, allowed, rgb);
    const double density = subpaths_camera_density(all, &view, s.cosine_o) / (double)all->paths;
    const double weight = all->connects ? kiln_path_weight_seen(&all->techniques, &v.sums, density, s.to_light) : 1.0;
    if (!(rgb[0] > 0.0 || rgb[1] > 0.0 || rgb[2] > 0.0) || !sees(w, &v, &view, number, arriving))
        return;
    vertex_attenuate(&v, view.towards, view.distance, arriving);
    for (int c = 0; c < 3; c++)
        rgb[c] *= (double)v.weight[c] * (double)arriving[c] * density * weight;
    add(w, view.pixel, rgb);
}

void subpaths_splat(struct subpaths *w)
{
    for (size_t j = 0; j < w->light_count && w->status == KILN_OK; j++)
        if (!w->light[j].is_delta)
            splat(w, &w->light[j], (uint32_t)j);
}
