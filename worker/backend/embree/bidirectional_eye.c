/* Paths from the camera of the bidirectional pass (worker/pass/bidirectional.h), and what they are connected to. */
#include <math.h>
#include <string.h>

#include "worker/backend/embree/bidirectional_subpaths.h"
#include "worker/backend/embree/camera_ray.h"
#include "worker/backend/embree/light_samples.h"
#include "worker/backend/embree/shadow.h"
#include "worker/scene/texture.h"

/* A path from the camera on its way. */
struct eye {
    struct subpaths *w;
    struct kiln_vec3 origin, direction;
    float weight[3];
    struct kiln_path_sums sums;
    uint32_t surface; /* number of the one under way */
    uint32_t bounces, chain;
    bool last_diffuse; /* the last event was diffuse; it does not count as a bounce if a light comes next */
};

/* Whether light that the path hits is weighted against other techniques: all of them find it (bdpt, vcm). In ppm the
 * camera's light samples do not find it. */
static bool weighs(const struct bidirectional *all) { return all->connects; }

static void add(struct eye *e, const float weight[3], const double rgb[3], double factor)
{
    for (int c = 0; c < 3; c++)
        e->w->radiance[c] += (double)weight[c] * rgb[c] * factor;
}

/* Adds light with the values of subpaths_products. */
static void add_counted(struct eye *e, const float weight[3], const double rgb[3], const double last[3], double factor)
{
    add(e, weight, rgb, factor);
    for (int c = 0; c < 3 && e->w->all->from_points; c++)
        e->w->last[c] += (double)weight[c] * last[c] * factor;
}

/* Adds light that the path itself hits. */
static void add_met(struct eye *e, const float weight[3], const float rgb[3], double factor)
{
    const double met[3] = {(double)rgb[0], (double)rgb[1], (double)rgb[2]}, none[3] = {0.0, 0.0, 0.0};
    add_counted(e, weight, met, (int64_t)e->bounces == e->w->all->most ? met : none, factor);
}

/* ---- lights that the path meets ---- */

/* Whether the next vertex of the path may be a light. */
static bool may_meet(const struct eye *e)
{
    const bool others = e->surface == 0 || e->w->all->parameters->method != KILN_BIDIRECTIONAL_LIGHT;
    const bool spared = e->last_diffuse && !e->w->all->from_points;
    return others && (int64_t)e->bounces - (spared ? 1 : 0) <= e->w->all->most &&
           subpaths_allow(e->w->all, e->surface + 1);
}

static void meet_environment(struct eye *e, const struct vertex *before)
{
    const struct kiln_emission *emission = e->w->all->emission;
    float rgb[3];
    double weight = 1.0;
    if (!may_meet(e))
        return;
    kiln_environment_radiance(emission->lights, dvec3_of(e->direction), rgb);
    if (before != NULL && weighs(e->w->all) && emission->lights->environment) {
        const uint32_t light = kiln_emission_environment(emission);
        const struct kiln_dvec3 from = dvec3_of(vec3_scale(e->direction, -1.0f));
        const double connect = kiln_emission_connect(emission, light, dvec3_of(before->m.position),
                                                     subpaths_light_normal(before), from, from);
        weight = kiln_path_weight_met(&e->sums, connect, kiln_emission_density(emission, light, 1.0, from));
    }
    add_met(e, e->weight, rgb, weight);
}

/* Weight of an emitter that the path has hit after another surface. */
static double weigh_emitter(const struct eye *e, const struct vertex *before, const struct vertex *v)
{
    const struct kiln_emission *emission = e->w->all->emission;
    const uint32_t light = kiln_emission_at(emission, v->m.triangle, (double)v->m.u, (double)v->m.v);
    if (light == KILN_NONE || (v->m.back && !emission->lights->areas[light].two_sided))
        return 1.0;
    const struct kiln_dvec3 place = dvec3_of(v->m.position), direction = dvec3_of(v->from);
    const double cosine = fabs((double)vec3_dot(v->m.normal, v->from));
    const double connect = kiln_emission_connect(emission, light, dvec3_of(before->m.position),
                                                 subpaths_light_normal(before), place, direction);
    return kiln_path_weight_met(&v->sums, connect, kiln_emission_density(emission, light, cosine, direction));
}

static void meet_emitter(struct eye *e, const struct vertex *before, const struct vertex *v)
{
    const struct embree_backend *b = e->w->all->b;
    float rgb[3];
    if ((b->params.geometry->records[v->m.triangle].material & KILN_RECORD_EMITS) == 0 || !may_meet(e))
        return;
    kiln_surface_emission(b->params.scene, v->m.mesh, v->m.stored, v->m.b1, v->m.b2, rgb);
    const double weight = before != NULL && weighs(e->w->all) ? weigh_emitter(e, before, v) : 1.0;
    add_met(e, v->weight, rgb, weight);
}

/* ---- samples of lights ---- */

/* Adds the light of a sample. `light`: index of its light. */
static void add_sample(struct eye *e, const struct vertex *v, const struct kiln_light_choice *choice, uint32_t light,
                       struct kiln_light_sample *sample)
{
    struct subpaths *w = e->w;
    const struct bidirectional *all = w->all;
    const struct kiln_dvec3 place = dvec3_of(v->m.position);
    const struct kiln_vec3 direction = vec3_of(sample->direction);
    const struct kiln_dvec3 end = isfinite(sample->distance)
                                      ? dvec3_add(place, dvec3_scale(sample->direction, sample->distance))
                                      : place,
                            down = dvec3_scale(sample->direction, -1.0);
    struct vertex_scatter s;
    if (!vertex_scatter(all->b, v, v->from, direction, KILN_LOBE_ALL, &s))
        return;
    const double squared = isfinite(sample->distance) ? sample->distance * sample->distance : 1.0;
    const bool area = light < all->emission->lights->area_count;
    const double cosine = area ? fabs(dvec3_dot(all->emission->lights->areas[light].normal, sample->direction)) : 1.0;
    const double connect = kiln_emission_connect(all->emission, light, place, subpaths_light_normal(v), end, down),
                 emission = kiln_emission_density(all->emission, light, cosine, down);
    const struct kiln_vec3 start = vertex_start(v, direction);
    w->rays++;
    shadow_aim(sample, place, dvec3_of(start));
    if (!(connect > 0.0) || !light_arrives(all->b, &w->context, start, choice, sample))
        return;
    const double hit = sample->has_extent ? s.to_light * cosine / squared : 0.0;
    const double weight =
        kiln_path_weight_sampled(&all->techniques, &v->sums, connect, emission, s.landing_i / squared, hit, s.to_eye);
    const struct vertex_scatter none = {.all = {1.0, 1.0, 1.0}};
    double rgb[3] = {s.all[0], s.all[1], s.all[2]}, last[3] = {0.0, 0.0, 0.0};
    if (all->from_points)
        subpaths_products(&s, true, &none, false, all->most - (int64_t)v->bounces, rgb, last);
    for (int c = 0; c < 3; c++) {
        rgb[c] = sample->value[c] * (rgb[c] * s.cosine_i);
        last[c] = sample->value[c] * (last[c] * s.cosine_i);
    }
    add_counted(e, v->weight, rgb, last, weight);
}

static void sample_tree(struct eye *e, const struct vertex *v)
{
    const struct kiln_lights *lights = e->w->all->emission->lights;
    const struct kiln_light_choice choice = {.kind = KILN_CHOICE_LIGHT_NODE, .samples = 1};
    struct kiln_light_sample sample = {0};
    double u, t, pick, rest;
    if (lights->node_count == 0)
        return;
    subpaths_draw(e->w, kiln_path_use(e->surface, KILN_PATH_LIGHT), &u, &t);
    subpaths_draw(e->w, kiln_path_use(e->surface, KILN_PATH_PICK), &pick, &rest);
    const struct kiln_dvec3 n = subpaths_light_normal(v);
    if (kiln_lights_sample(lights, &choice, 0, dvec3_of(v->m.position), n, n, pick, u, t, &sample))
        add_sample(e, v, &choice, sample.light, &sample);
}

static void sample_environment(struct eye *e, const struct vertex *v)
{
    const struct kiln_emission *emission = e->w->all->emission;
    const struct kiln_light_choice choice = {.kind = KILN_CHOICE_ENVIRONMENT, .samples = 1};
    struct kiln_light_sample sample = {.distance = (double)INFINITY, .has_extent = true};
    float rgb[3];
    double u, t, density;
    if (!emission->lights->environment)
        return;
    subpaths_draw(e->w, kiln_path_use(e->surface, KILN_PATH_SKY), &u, &t);
    sample.direction = kiln_environment_sample(emission->lights, u, t, &density);
    kiln_environment_radiance(emission->lights, sample.direction, rgb);
    for (int c = 0; c < 3; c++)
        sample.value[c] = (double)rgb[c] / density;
    if (density > 0.0)
        add_sample(e, v, &choice, kiln_emission_environment(emission), &sample);
}

static void sample_lights(struct eye *e, const struct vertex *v)
{
    const struct kiln_emission *emission = e->w->all->emission;
    sample_tree(e, v);
    for (size_t i = 0; i < emission->lights->directional_count; i++) {
        const struct kiln_light_choice choice = {.kind = KILN_CHOICE_DIRECTIONAL, .index = (uint32_t)i, .samples = 1};
        struct kiln_light_sample sample = {0};
        const struct kiln_dvec3 n = subpaths_light_normal(v);
        if (kiln_lights_sample(emission->lights, &choice, 0, dvec3_of(v->m.position), n, n, 0.5, 0.5, 0.5, &sample))
            add_sample(e, v, &choice, kiln_emission_directional(emission, i), &sample);
    }
    sample_environment(e, v);
}

/* ---- vertices of light ---- */

static void connect(struct eye *e, const struct vertex *v, const struct vertex *light, bool light_is_first)
{
    const struct bidirectional *all = e->w->all;
    const struct kiln_vec3 way = vec3_sub(light->m.position, v->m.position);
    const double squared = (double)vec3_dot(way, way);
    const int64_t allowed = all->most - (int64_t)v->bounces - (int64_t)light->bounces;
    struct vertex_scatter near, far;
    double rgb[3], last[3], through[3];
    if (allowed < 0 || !(squared > 0.0))
        return;
    const struct kiln_vec3 direction = vec3_normalize(way), back = vec3_scale(direction, -1.0f);
    if (!vertex_scatter(all->b, v, v->from, direction, KILN_LOBE_ALL, &near) ||
        !vertex_scatter(all->b, light, back, light->from, KILN_LOBE_ALL, &far))
        return;
    subpaths_products(&near, true, &far, !light_is_first || all->from_points, allowed, rgb, last);
    if (!(rgb[0] > 0.0 || rgb[1] > 0.0 || rgb[2] > 0.0) ||
        !subpaths_connect(e->w, vertex_start(v, direction), vertex_start(light, back), through))
        return;
    const double weight =
        kiln_path_weight_connected(&all->techniques, &v->sums, &light->sums, near.to_light * far.landing_o / squared,
                                   far.to_light, far.to_eye * near.landing_i / squared, near.to_eye);
    float arriving[3] = {light->weight[0], light->weight[1], light->weight[2]};
    vertex_attenuate(light, back, (float)sqrt(squared), arriving);
    for (int c = 0; c < 3; c++) {
        const double way_there = through[c] * (double)arriving[c] * near.cosine_i * far.cosine_o / squared;
        rgb[c] *= way_there;
        last[c] *= way_there;
    }
    add_counted(e, v->weight, rgb, last, weight);
}

/* ---- merging ---- */

struct merging {
    struct eye *e;
    const struct vertex *v;
    uint32_t lobes;
    double rgb[3], last[3];
};

static void merge(void *context, const struct photon *p)
{
    struct merging *m = context;
    const struct bidirectional *all = m->e->w->all;
    const int64_t allowed = all->most - (int64_t)m->v->bounces - (int64_t)p->bounces;
    const struct vertex_scatter none = {.all = {1.0, 1.0, 1.0}};
    struct vertex_scatter s;
    double rgb[3], last[3];
    if (!subpaths_allow(all, m->e->surface + p->number + 2) ||
        !vertex_scatter(all->b, m->v, m->v->from, p->from, m->lobes, &s) || !(s.landing_i > 0.0))
        return;
    subpaths_products(&s, p->number > 0 || all->from_points, &none, false, allowed, rgb, last);
    const struct kiln_path_sums light = {.vcm = (double)p->vcm, .vm = (double)p->vm};
    const double weight =
        all->connects ? kiln_path_weight_merged(&all->techniques, &m->v->sums, &light, s.to_light, s.to_eye) : 1.0;
    for (int c = 0; c < 3; c++) {
        m->rgb[c] += rgb[c] * (double)p->flux[c] * weight;
        m->last[c] += last[c] * (double)p->flux[c] * weight;
    }
}

static void merge_all(struct eye *e, const struct vertex *v, uint32_t lobes)
{
    const struct bidirectional *all = e->w->all;
    struct merging m = {.e = e, .v = v, .lobes = lobes};
    if (all->own_alone) {
        for (size_t i = 0; i < e->w->photons.count; i++) {
            const struct kiln_vec3 d = vec3_sub(e->w->photons.photons[i].position, v->m.position);
            if ((double)vec3_dot(d, d) <= all->radius * all->radius)
                merge(&m, &e->w->photons.photons[i]);
        }
    } else {
        photon_grid_near(all->grid, v->m.position, merge, &m);
    }
    /* both subpaths have hit the surface at random */
    add_counted(e, v->weight, m.rgb, m.last,
                1.0 / (KILN_PI * all->radius * all->radius * all->merged_paths * (double)v->opacity));
}

/* ---- the path ---- */

static void camera_ray(struct eye *e, uint64_t pixel)
{
    const struct kiln_path_parameters *c = &e->w->all->parameters->camera;
    double place[2], lens[2] = {0.0, 0.0};
    subpaths_draw(e->w, 0, &place[0], &place[1]);
    if (c->lens_radius > 0.0f)
        subpaths_draw(e->w, KILN_PATH_LENS, &lens[0], &lens[1]);
    embree_camera_ray(c, pixel, place, lens, &e->origin, &e->direction);
}

/* Initializes the sums of the first vertex, whose density per m2 is that of camera rays. */
static void begin_sums(const struct eye *e, const struct kiln_vec3 eye_place, struct vertex *v, double cosine)
{
    const struct bidirectional *all = e->w->all;
    const struct subpath_view view = {.towards = v->from, .distance = vec3_length(vec3_sub(v->m.position, eye_place))};
    v->sums = (struct kiln_path_sums){.vcm = (double)all->paths / subpaths_camera_density(all, &view, cosine)};
}

/* Makes the vertex of the ray's hit; false: the path ends. `before`: the previous vertex; NULL: the camera. */
static bool arrive_at(struct eye *e, const struct vertex *before, const struct RTCRayHit *ray, struct vertex *v)
{
    const struct embree_backend *b = e->w->all->b;
    float share[3];
    if (before != NULL && !meeting_has_side(b, meeting_record(b, ray), meeting_is_back(ray)))
        return false;
    *v = vertex_make(b, ray, before == NULL);
    const double cosine = fabs((double)vec3_dot(v->m.normal, v->from));
    if (!(cosine > 0.0))
        return false;
    const bool body = meeting_attenuation(&v->m, ray->ray.tfar, share);
    for (int c = 0; c < 3; c++)
        v->weight[c] = body ? e->weight[c] * share[c] : e->weight[c];
    v->bounces = e->bounces;
    if (before == NULL) {
        begin_sums(e, e->origin, v, cosine);
        return true;
    }
    const struct kiln_vec3 way = vec3_sub(v->m.position, before->m.position);
    v->sums = e->sums;
    kiln_path_arrive(&v->sums, (double)vec3_dot(way, way), cosine);
    return true;
}

/* Traces the ray to the next vertex; result as of arrive_at. */
static bool arrive(struct eye *e, const struct vertex *before, struct vertex *v)
{
    struct subpaths *w = e->w;
    const struct embree_backend *b = w->all->b;
    struct RTCRayHit ray;
    float tint[3];
    w->rays++;
    const bool meets = (before == NULL ? meeting_look : meeting_trace)(
        b, &w->context, e->origin, e->direction, INFINITY, subpaths_chance(w, e->surface), &ray, tint);
    for (int c = 0; c < 3; c++)
        e->weight[c] *= tint[c];
    if (!meets) {
        meet_environment(e, before);
        return false;
    }
    return arrive_at(e, before, &ray, v);
}

/* Adds all light that the vertex sends to the camera. */
static void gather(struct eye *e, const struct vertex *v)
{
    const struct bidirectional *all = e->w->all;
    if (v->is_delta)
        return;
    if (all->connects) {
        sample_lights(e, v);
        for (size_t j = 0; j < e->w->light_count && subpaths_allow(all, e->surface + (uint32_t)j + 3); j++)
            if (!e->w->light[j].is_delta)
                connect(e, v, &e->w->light[j], j == 0);
    }
    if (all->merges)
        merge_all(e, v, all->connects ? KILN_LOBE_ALL : KILN_LOBE_ALL & ~v->mirrors);
}

/* Continues from the vertex; false: the path ends. */
static bool go_on(struct eye *e, const struct vertex *v)
{
    const struct bidirectional *all = e->w->all;
    struct vertex_way way;
    const uint32_t lobes = all->connects ? KILN_LOBE_ALL : v->mirrors;
    if (lobes == 0 || !subpaths_leave(e->w, v, false, lobes, e->surface, &way) || (!all->connects && !way.delta))
        return false;
    for (int c = 0; c < 3; c++)
        e->weight[c] = v->weight[c] * way.factor[c];
    e->origin = vertex_start(v, way.direction);
    e->direction = way.direction;
    e->sums = v->sums;
    kiln_path_leave(&all->techniques, &e->sums, way.landing, way.forward, way.backward, way.delta);
    e->bounces = v->bounces + (way.diffuse ? 1 : 0);
    e->last_diffuse = way.diffuse;
    e->chain = way.diffuse ? 0 : e->chain + 1;
    const float *x = e->weight;
    return (x[0] > 0.0f || x[1] > 0.0f || x[2] > 0.0f) && subpaths_survives(e->w, e->surface, e->chain, x, e->weight);
}

void subpaths_trace_eye(struct subpaths *w, uint64_t pixel, uint32_t k)
{
    const struct bidirectional *all = w->all;
    struct eye e = {.w = w, .weight = {1.0f, 1.0f, 1.0f}};
    struct vertex v, before;
    w->key = kiln_hash2(kiln_hash2(all->seed, (uint32_t)pixel), (uint32_t)(pixel >> 32));
    w->k = all->parameters->method == KILN_BIDIRECTIONAL_PPM ? 0 : k;
    w->radiance[0] = w->radiance[1] = w->radiance[2] = 0.0;
    camera_ray(&e, pixel);
    for (;; e.surface++) {
        if (!arrive(&e, e.surface == 0 ? NULL : &before, &v))
            return;
        meet_emitter(&e, e.surface == 0 ? NULL : &before, &v);
        if (all->parameters->method == KILN_BIDIRECTIONAL_LIGHT || (int64_t)v.bounces > all->most ||
            !subpaths_allow(all, e.surface + 2))
            return;
        gather(&e, &v);
        if (!go_on(&e, &v))
            return;
        before = v;
    }
}

void subpaths_follow_eye(struct subpaths *w, const struct vertex *before, const struct kiln_path_sums *sums,
                         const struct RTCRayHit *ray)
{
    struct eye e = {.w = w, .weight = {1.0f, 1.0f, 1.0f}, .sums = *sums, .surface = 1, .bounces = 1};
    struct vertex v, last;
    memset(w->radiance, 0, sizeof w->radiance);
    memset(w->last, 0, sizeof w->last);
    bool arrives = arrive_at(&e, before, ray, &v);
    while (arrives && (int64_t)v.bounces <= w->all->most) {
        gather(&e, &v);
        if (!go_on(&e, &v))
            return;
        last = v;
        e.surface++;
        arrives = arrive(&e, &last, &v);
        if (arrives)
            meet_emitter(&e, &last, &v);
    }
}
