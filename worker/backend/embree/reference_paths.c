#include "worker/backend/embree/reference_paths.h"

#include <math.h>
#include <string.h>

#include "shaders/shared/bidirectional.h"
#include "worker/base/memory.h"

/* ---- what all threads share ---- */

static uint64_t paths_of(const struct embree_backend *b, const struct kiln_reference_parameters *p)
{
    return p->method == KILN_REFERENCE_VCM ? kiln_reference_paths(b->surface->point_count) : 0;
}

static struct bidirectional make(const struct reference_paths *paths, const struct embree_backend *b,
                                 const struct kiln_reference_parameters *p)
{
    const uint32_t low = (uint32_t)b->params.seed, high = (uint32_t)(b->params.seed >> 32);
    return (struct bidirectional){
        .b = b,
        .parameters = &paths->parameters,
        .emission = paths->emission,
        .paths = paths->count,
        .most = p->bounces == KILN_PATH_ALL_BOUNCES ? INT64_MAX / 2 : (int64_t)p->bounces + 1, /* and the point's own */
        .from_points = true,
        .light_seed = kiln_hash2(low, high ^ KILN_REFERENCE_LIGHT_SEED),
        .connects = true,
        .merges = paths->count > 0,
        .merged_paths = (double)paths->count};
}

/* Traces the light paths for the samples of quarter q, and makes their grid. The number of the quarter's first sample,
 * which no other quarter has, selects their random numbers. */
static int trace_quarter(struct reference_paths *paths, struct subpaths *walks, uint32_t q, struct kiln_error *error)
{
    struct bidirectional *all = &paths->of[q];
    const uint32_t before = paths->first_sample / paths->samples * RAY_QUARTERS + q,
                   first = paths->first_sample + (uint32_t)((uint64_t)q * paths->samples / RAY_QUARTERS);
    all->radius = kiln_merge_radius(paths->parameters.radius, before);
    const double area = KILN_PI * all->radius * all->radius * all->merged_paths;
    all->techniques = (struct kiln_path_techniques){.merges = area, .connections = 1.0 / area};
    for (uint32_t t = 0; t < all->b->threads; t++)
        walks[t].all = all;
    const int status = subpaths_trace_photons(all, walks, first, &paths->grids[q], error);
    all->grid = paths->grids[q];
    return status;
}

static int trace_light(struct reference_paths *paths, struct embree_backend *b, struct kiln_error *error)
{
    struct subpaths *walks = NULL;
    int status = kiln_allocate(&walks, b->threads, sizeof *walks, "paths of light", error);
    if (status != KILN_OK)
        return status;
    for (uint32_t t = 0; t < b->threads; t++)
        embree_context(b, &walks[t].context);
    for (uint32_t q = 0; q < RAY_QUARTERS && status == KILN_OK; q++)
        status = trace_quarter(paths, walks, q, error);
    for (uint32_t t = 0; t < b->threads; t++) {
        b->thread_seconds += walks[t].seconds;
        subpaths_release(&walks[t]);
    }
    kiln_free(&walks);
    return status;
}

static int make_paths(struct reference_paths *paths, struct embree_backend *b,
                      const struct kiln_reference_parameters *p, const struct kiln_batch *part,
                      struct kiln_error *error)
{
    paths->wanted = *p;
    paths->count = paths_of(b, p);
    paths->samples = part->samples;
    paths->first_sample = part->first_sample;
    const int status = kiln_emission_create(&paths->emission, b->params.lights, error);
    if (status != KILN_OK)
        return status;
    paths->parameters.method = p->method == KILN_REFERENCE_VCM ? KILN_BIDIRECTIONAL_VCM : KILN_BIDIRECTIONAL_BDPT;
    paths->parameters.camera.bounces = p->bounces;
    paths->parameters.radius = p->radius;
    if (paths->count > 0 && !(p->radius > 0.0))
        return kiln_fail(error, KILN_USAGE, "the reference pass: vcm merges within %g m, which must be above 0",
                         p->radius);
    for (uint32_t q = 0; q < RAY_QUARTERS; q++)
        paths->of[q] = make(paths, b, p);
    return paths->count > 0 ? trace_light(paths, b, error) : KILN_OK;
}

static bool fits(const struct reference_paths *paths, const struct embree_backend *b,
                 const struct kiln_reference_parameters *p, const struct kiln_batch *part)
{
    return paths->wanted.method == p->method && paths->wanted.bounces == p->bounces &&
           paths->wanted.radius == p->radius && paths->count == paths_of(b, p) && paths->samples == part->samples &&
           paths->first_sample == part->first_sample;
}

int reference_paths_want(struct embree_backend *b, const struct kiln_reference_parameters *p,
                         const struct kiln_batch *part, struct kiln_error *error)
{
    if (b->reference != NULL && fits(b->reference, b, p, part))
        return KILN_OK;
    reference_paths_destroy(&b->reference);
    int status = kiln_allocate(&b->reference, 1, sizeof *b->reference, "paths of light", error);
    if (status == KILN_OK)
        status = make_paths(b->reference, b, p, part, error);
    if (status != KILN_OK)
        reference_paths_destroy(&b->reference);
    return status;
}

void reference_paths_destroy(struct reference_paths **paths)
{
    if (*paths == NULL)
        return;
    for (uint32_t q = 0; q < RAY_QUARTERS; q++)
        photon_grid_destroy(&(*paths)->grids[q]);
    kiln_emission_destroy(&(*paths)->emission);
    kiln_free(paths);
}

/* ---- a sample's surface point ---- */

/* Position of a sample as the end of paths. Its own diffuse event is the first that counts. */
struct end {
    struct subpaths *w;
    const struct tile_run_frame *frame;
    struct reference_found *found;
    struct kiln_vec3 position, normal, shading, axis; /* m, offset included; unit */
    uint32_t j;                                       /* point of the frame */
    bool lands;                                       /* paths of light may be merged here */
};

/* Adds light from direction i: radiance times solid angle, W/m2 on a plane perpendicular to i, by colour. */
static void add(struct end *x, struct kiln_vec3 i, const double rgb[3], const double last[3])
{
    const float shading = vec3_dot(x->shading, i),
                taken_up = vec3_dot(x->normal, i) * frame_taken_up(x->frame, x->j, shading);
    for (int c = 0; c < 3; c++) {
        x->found->irradiance[c] += fmax(0.0, (double)shading) * rgb[c];
        x->found->incident[c] += (double)taken_up * rgb[c];
        x->found->last_incident[c] += (double)taken_up * last[c];
    }
}

/* Density of the point's own rays, 1/sr. */
static double density(const struct end *x, struct kiln_vec3 i)
{
    return fmax(0.0, (double)vec3_dot(x->axis, i)) / KILN_PI;
}

/* Connects the point to a vertex of its light path. Light can reach the point only by such connections, its rays and,
 * where paths land, by merging: the path sums of the point itself are 0. */
static void connect(struct end *x, const struct vertex *light)
{
    static const struct kiln_path_sums none = {0.0, 0.0, 0.0};
    static const struct vertex_scatter one = {.all = {1.0, 1.0, 1.0}};
    const struct bidirectional *all = x->w->all;
    const struct kiln_vec3 way = vec3_sub(light->m.position, x->position), direction = vec3_normalize(way),
                           back = vec3_scale(direction, -1.0f);
    const double squared = (double)vec3_dot(way, way), above = (double)vec3_dot(x->normal, direction);
    struct vertex_scatter far;
    double rgb[3], last[3], through[3];
    if (!(squared > 0.0) || !(above > 0.0) || !vertex_scatter(all->b, light, back, light->from, KILN_LOBE_ALL, &far))
        return;
    subpaths_products(&one, false, &far, true, all->most - 1 - (int64_t)light->bounces, rgb, last);
    if (!(rgb[0] > 0.0 || rgb[1] > 0.0 || rgb[2] > 0.0) ||
        !subpaths_connect(x->w, x->position, vertex_start(light, back), through))
        return;
    const double weight = kiln_path_weight_connected(&all->techniques, &none, &light->sums,
                                                     density(x, direction) * far.landing_o / squared, far.to_light,
                                                     x->lands ? far.to_eye * above / squared : 0.0, 0.0);
    float arriving[3] = {light->weight[0], light->weight[1], light->weight[2]};
    vertex_attenuate(light, back, (float)sqrt(squared), arriving);
    for (int c = 0; c < 3; c++) {
        const double there = weight * through[c] * (double)arriving[c] * far.cosine_o / squared;
        rgb[c] *= there;
        last[c] *= there;
    }
    add(x, direction, rgb, last);
}

/* Merges a photon near the point. Light that comes directly from a lamp is left out. */
static void merge(void *context, const struct photon *p)
{
    static const struct kiln_path_sums none = {0.0, 0.0, 0.0};
    struct end *x = context;
    const struct bidirectional *all = x->w->all;
    const int64_t left = all->most - 1 - (int64_t)p->bounces;
    const double above = (double)vec3_dot(x->normal, p->from);
    if (p->number == 0 || left < 0 || !(above > 0.0) ||
        !(x->frame->present[x->j] > 0.0f)) /* 0: all of it is cut away */
        return;
    const struct kiln_path_sums light = {.vcm = (double)p->vcm, .vm = (double)p->vm};
    const double weight = kiln_path_weight_merged(&all->techniques, &none, &light, density(x, p->from), 0.0),
                 area = KILN_PI * all->radius * all->radius * all->merged_paths * (double)x->frame->present[x->j];
    double rgb[3], last[3];
    for (int c = 0; c < 3; c++) {
        rgb[c] = weight * (double)p->flux[c] / (area * above);
        last[c] = left == 0 ? rgb[c] : 0.0;
    }
    add(x, p->from, rgb, last);
}

/* Continues the point's path from its ray's hit. */
static void follow_ray(const struct end *x, struct kiln_vec3 direction, const struct RTCRayHit *ray)
{
    const struct bidirectional *all = x->w->all;
    const struct vertex before = {.m = {.position = x->position, .normal = x->normal}};
    struct kiln_path_sums sums = {0.0, 0.0, 0.0};
    const double forward = density(x, direction);
    if (!(forward > 0.0))
        return;
    kiln_path_leave(&all->techniques, &sums, (double)vec3_dot(x->normal, direction), forward, 0.0, false);
    if (!x->lands)
        sums.vc = sums.vm = 0.0;
    subpaths_follow_eye(x->w, &before, &sums, ray);
    for (int c = 0; c < 3; c++) {
        x->found->radiance[c] = (float)x->w->radiance[c];
        x->found->last[c] = (float)x->w->last[c];
    }
}

void reference_follow(struct subpaths *w, struct reference_paths *paths, const struct tile_run_rays *r, uint32_t step,
                      uint32_t l, bool receives_only, const struct RTCRayHit *ray, struct reference_found *found)
{
    const uint32_t k = rays_sample(r, step, l), j = r->point[l],
                   key = kiln_hash1(r->chance[l] + KILN_REFERENCE_LIGHT_SEED);
    const struct kiln_vec3 normal = vec3(r->facet[0][l], r->facet[1][l], r->facet[2][l]);
    struct end x = {.w = w,
                    .frame = &r->frame,
                    .found = found,
                    .position = vec3(r->origin[0][l], r->origin[1][l], r->origin[2][l]),
                    .normal = normal,
                    .shading = frame_shading(&r->frame, j, normal),
                    .axis = vec3(r->axis[0][l], r->axis[1][l], r->axis[2][l]),
                    .j = j,
                    .lands = !receives_only && (!r->frame.glossy[j] || r->frame.lobes[j].matt > 0.0f)};
    memset(found, 0, sizeof *found);
    w->all = &paths->of[r->quarter_of[step * r->copies + r->copy[l]]];
    subpaths_trace_light_by(w, kiln_hash2(key, w->all->light_seed), k);
    for (size_t i = 0; i < w->light_count; i++)
        if (!w->light[i].is_delta)
            connect(&x, &w->light[i]);
    if (w->all->merges && x.lands)
        photon_grid_near(w->all->grid, x.position, merge, &x);
    w->key = key;
    w->k = k;
    if (ray != NULL)
        follow_ray(&x, vec3(r->direction[0][l], r->direction[1][l], r->direction[2][l]), ray);
}
