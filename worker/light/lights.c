#include "worker/light/lights.h"

#include <math.h>
#include <string.h>

#include "shaders/shared/area_light.h"
#include "shaders/shared/environment.h"
#include "shaders/shared/punctual_light.h"
#include "shaders/shared/warp.h"
#include "worker/base/memory.h"
#include "worker/light/environment.h"
#include "worker/light/tree.h"
#include "worker/sampling/sequence.h"
#include "worker/scene/texture.h"

static struct kiln_dvec3 unit(struct kiln_dvec3 a)
{
    const double length = dvec3_length(a);
    return length > 0.0 ? dvec3_scale(a, 1.0 / length) : a;
}

/* Which mesh a world triangle belongs to. */
static const struct kiln_mesh *mesh_of(const struct kiln_scene *scene, const struct kiln_geometry *geometry,
                                       uint32_t triangle)
{
    return &scene->meshes[scene->objects[geometry->records[triangle].object].mesh];
}

static bool make_area_light(const struct kiln_scene *scene, const struct kiln_geometry *geometry, uint32_t triangle,
                            struct kiln_area_light *light)
{
    const uint32_t material = geometry->records[triangle].material & KILN_RECORD_MATERIAL;
    const struct kiln_material *m = &scene->materials[material];
    struct kiln_vec3 corner[3];
    kiln_geometry_corners(geometry, triangle, corner);
    *light = (struct kiln_area_light){.p0 = dvec3_of(corner[0]), .triangle = triangle};
    light->e1 = dvec3_sub(dvec3_of(corner[1]), light->p0);
    light->e2 = dvec3_sub(dvec3_of(corner[2]), light->p0);
    const struct kiln_dvec3 cross = dvec3_cross(light->e1, light->e2);
    light->area = 0.5 * dvec3_length(cross);
    light->normal = unit(cross);
    for (int c = 0; c < 3; c++)
        light->rounding =
            fmax(light->rounding,
                 8.0 * 0x1p-24 * (double)fmaxf(fabsf(corner[c].x), fmaxf(fabsf(corner[c].y), fabsf(corner[c].z))));
    light->two_sided = m->double_sided != 0;
    light->textured = m->emission_texture != KILN_NONE;
    kiln_triangle_mean_emission(scene, mesh_of(scene, geometry, triangle), geometry->stored_triangle[triangle],
                                light->radiance);
    return light->area > 0.0 && kiln_luminance_of_floats(light->radiance) > 0.0;
}

/* Consecutive triangles that one thread takes at a time: where their area lights begin in the list, and how many there
 * are. */
struct area_block {
    size_t first, count;
};
enum { BLOCK = 1 << 12 };

static bool may_be_area_light(const struct kiln_lights *lights, size_t triangle)
{
    const struct kiln_hit_record *record = &lights->geometry->records[triangle];
    return (record->material & KILN_RECORD_EMITS) != 0 &&
           (lights->scene->objects[record->object].flags & KILN_OBJECT_RECEIVER_ONLY) == 0;
}

static size_t block_end(const struct kiln_lights *lights, size_t block)
{
    const size_t end = (block + 1) * BLOCK, count = lights->geometry->triangle_count;
    return end < count ? end : count;
}

static size_t count_block(const struct kiln_lights *lights, size_t block)
{
    size_t count = 0;
    for (size_t t = block * BLOCK; t < block_end(lights, block); t++)
        count += may_be_area_light(lights, t) ? 1 : 0;
    return count;
}

static size_t make_block(const struct kiln_lights *lights, size_t block, struct kiln_area_light *areas)
{
    size_t count = 0;
    for (size_t t = block * BLOCK; t < block_end(lights, block); t++)
        if (may_be_area_light(lights, t) &&
            make_area_light(lights->scene, lights->geometry, (uint32_t)t, areas + count))
            count++;
    return count;
}

/* Has room for every triangle that may be a light, and closes the gaps that the dark ones leave. */
static int make_blocks(struct kiln_lights *lights, struct area_block *blocks, size_t count, struct kiln_error *error)
{
    size_t most = 0;
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < count; i++)
        blocks[i].count = count_block(lights, i);
    for (size_t i = 0; i < count; i++) {
        blocks[i].first = most;
        most += blocks[i].count;
    }
    const int status = kiln_allocate_bare(&lights->areas, most, sizeof *lights->areas, "the emissive triangles", error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for schedule(dynamic)
    for (size_t i = 0; i < count; i++)
        if (blocks[i].count > 0)
            blocks[i].count = make_block(lights, i, lights->areas + blocks[i].first);
    for (size_t i = 0; i < count; i++) {
        if (lights->area_count < blocks[i].first)
            memmove(lights->areas + lights->area_count, lights->areas + blocks[i].first,
                    blocks[i].count * sizeof *lights->areas);
        lights->area_count += blocks[i].count;
    }
    return KILN_OK;
}

static int gather_area_lights(struct kiln_lights *lights, struct kiln_error *error)
{
    const size_t count = (lights->geometry->triangle_count + BLOCK - 1) / BLOCK;
    struct area_block *blocks = NULL;
    int status = kiln_allocate(&blocks, count, sizeof *blocks, "the emissive triangles", error);
    if (status == KILN_OK)
        status = make_blocks(lights, blocks, count, error);
    kiln_free(&blocks);
    return status;
}

static int gather_punctual_lights(struct kiln_lights *lights, struct kiln_error *error)
{
    const struct kiln_scene *scene = lights->scene;
    int status = kiln_allocate(&lights->points, scene->light_count, sizeof *lights->points, "the point lights", error);
    if (status == KILN_OK)
        status = kiln_allocate(&lights->directionals, scene->light_count, sizeof *lights->directionals,
                               "the directional lights", error);
    if (status != KILN_OK)
        return status;
    const double *centre = scene->header->centre;
    for (size_t i = 0; i < scene->light_count; i++) {
        const struct kiln_light *l = &scene->lights[i];
        const struct kiln_dvec3 direction =
            unit(dvec3((double)l->direction[0], (double)l->direction[1], (double)l->direction[2]));
        if (kiln_luminance_of_floats(l->intensity) <= 0.0)
            continue;
        if (l->kind == KILN_LIGHT_DIRECTIONAL) {
            struct kiln_directional_light *d = &lights->directionals[lights->directional_count++];
            d->towards = dvec3_scale(direction, -1.0);
            memcpy(d->irradiance, l->intensity, sizeof d->irradiance);
        } else {
            struct kiln_point_light *p = &lights->points[lights->point_count++];
            p->position = dvec3(l->position[0] - centre[0], l->position[1] - centre[1], l->position[2] - centre[2]);
            p->direction = direction;
            memcpy(p->intensity, l->intensity, sizeof p->intensity);
            p->range = (double)l->range;
            p->spot = l->kind == KILN_LIGHT_SPOT;
            p->cos_inner = (double)l->cos_inner;
            p->cos_outer = (double)l->cos_outer;
        }
    }
    return KILN_OK;
}

static int create(struct kiln_lights **lights, const struct kiln_scene *scene, const struct kiln_geometry *geometry,
                  bool areas, struct kiln_error *error)
{
    *lights = NULL;
    struct kiln_lights *l = NULL;
    int status = kiln_allocate(&l, 1, sizeof *l, "the lights", error);
    if (status != KILN_OK)
        return status;
    l->scene = scene;
    l->geometry = geometry;
    if (areas)
        status = gather_area_lights(l, error);
    if (status == KILN_OK)
        status = gather_punctual_lights(l, error);
    if (status == KILN_OK && l->area_count + l->point_count > UINT32_MAX / 2)
        status =
            kiln_fail(error, KILN_BAD_INPUT, "the scene has %zu emissive triangles and lights; kiln takes at most %u",
                      l->area_count + l->point_count, UINT32_MAX / 2);
    if (status == KILN_OK)
        status = kiln_light_tree_build(l, error);
    if (status == KILN_OK)
        status = kiln_environment_build(l, error);
    if (status != KILN_OK) {
        kiln_lights_destroy(&l);
        return status;
    }
    *lights = l;
    return KILN_OK;
}

int kiln_lights_create(struct kiln_lights **lights, const struct kiln_scene *scene,
                       const struct kiln_geometry *geometry, struct kiln_error *error)
{
    return create(lights, scene, geometry, true, error);
}

int kiln_lights_create_without_areas(struct kiln_lights **lights, const struct kiln_scene *scene,
                                     const struct kiln_geometry *geometry, struct kiln_error *error)
{
    return create(lights, scene, geometry, false, error);
}

void kiln_lights_destroy(struct kiln_lights **lights)
{
    struct kiln_lights *l = *lights;
    if (l == NULL)
        return;
    kiln_free(&l->areas);
    kiln_free(&l->points);
    kiln_free(&l->directionals);
    kiln_free(&l->nodes);
    kiln_free(&l->marginal);
    kiln_free(&l->conditional);
    kiln_free(lights);
}

/* The most important cluster of a cut that can be split and is worth it (KILN_CUT_SHARE); `count`: there is none. */
static size_t cut_best(const struct kiln_lights *lights, const struct kiln_light_choice *choices, size_t count)
{
    size_t best = count;
    double total = 0.0;
    for (size_t i = 0; i < count; i++) {
        total += choices[i].importance;
        if (lights->nodes[choices[i].index].left != KILN_NONE &&
            (best == count || choices[i].importance > choices[best].importance))
            best = i;
    }
    return best < count && choices[best].importance > KILN_CUT_SHARE * total ? best : count;
}

/* Splits the most important inner cluster until there is room for no more or none is worth it. */
static size_t cut_tree(const struct kiln_lights *lights, struct kiln_dvec3 p, double spread, struct kiln_dvec3 n,
                       size_t limit, struct kiln_light_choice *choices)
{
    if (lights->node_count == 0)
        return 0;
    double importance = kiln_light_node_importance(&lights->nodes[0], p, spread, n);
    if (importance <= 0.0)
        return 0;
    size_t count = 1;
    choices[0] = (struct kiln_light_choice){KILN_CHOICE_NODE, 0, 0, importance};
    while (count < limit) {
        const size_t best = cut_best(lights, choices, count);
        if (best == count)
            break;
        const struct kiln_light_node *node = &lights->nodes[choices[best].index];
        const uint32_t child[2] = {node->left, node->right};
        size_t kept = 0;
        for (int c = 0; c < 2; c++) {
            importance = kiln_light_node_importance(&lights->nodes[child[c]], p, spread, n);
            if (importance <= 0.0)
                continue;
            choices[kept == 0 ? best : count] = (struct kiln_light_choice){KILN_CHOICE_NODE, child[c], 0, importance};
            count += kept;
            kept++;
        }
        if (kept == 0) { /* the parent's bound was loose: the cluster is behind the point's horizon after all */
            choices[best] = choices[--count];
            if (count == 0)
                break;
        }
    }
    return count;
}

size_t kiln_lights_choices(const struct kiln_lights *lights, struct kiln_dvec3 p, double spread, struct kiln_dvec3 n,
                           size_t node_limit, struct kiln_light_choice *choices)
{
    const bool probe = kiln_any_direction(n);
    size_t count = cut_tree(lights, p, spread, n, node_limit, choices);
    for (size_t i = 0; i < lights->directional_count; i++) {
        const double cosine = probe ? 1.0 : dvec3_dot(n, lights->directionals[i].towards);
        const double importance =
            kiln_sun_importance(kiln_luminance_of_floats(lights->directionals[i].irradiance), cosine);
        if (cosine > 0.0)
            choices[count++] = (struct kiln_light_choice){KILN_CHOICE_DIRECTIONAL, (uint32_t)i, 0, importance};
    }
    if (lights->environment)
        choices[count++] = (struct kiln_light_choice){
            KILN_CHOICE_ENVIRONMENT, 0, 0, kiln_sky_importance(kiln_luminance_of_floats(lights->environment_mean))};
    return count;
}

uint32_t kiln_lights_allot(struct kiln_light_choice *choices, size_t count, uint32_t samples)
{
    double total = 0.0;
    for (size_t i = 0; i < count; i++)
        total += choices[i].importance;
    uint32_t given = 0;
    for (size_t i = 0; i < count; i++) {
        const double part = total > 0.0 ? choices[i].importance / total : 1.0 / (double)count;
        choices[i].samples = kiln_choice_samples(part, samples);
        given += choices[i].samples;
    }
    return given;
}

double kiln_point_light_cone(const struct kiln_point_light *light, struct kiln_dvec3 direction)
{
    if (!light->spot)
        return 1.0;
    return kiln_spot_cone(dvec3_dot(light->direction, direction), light->cos_outer,
                          light->cos_inner - light->cos_outer);
}

static bool sample_point_light(const struct kiln_point_light *light, struct kiln_dvec3 p, double weight,
                               struct kiln_light_sample *s)
{
    const struct kiln_dvec3 to = dvec3_sub(light->position, p);
    const double distance = dvec3_length(to);
    if (!(distance > 0.0))
        return false;
    s->direction = dvec3_scale(to, 1.0 / distance);
    s->distance = distance;
    s->backoff = 0.0;
    s->has_extent = false;
    const double factor = weight * kiln_point_light_cone(light, dvec3_scale(s->direction, -1.0)) *
                          kiln_light_range(light->range, distance) / (distance * distance);
    for (int c = 0; c < 3; c++)
        s->value[c] = (double)light->intensity[c] * factor;
    return factor > 0.0;
}

void kiln_area_light_radiance(const struct kiln_lights *lights, const struct kiln_area_light *light, double b1,
                              double b2, float rgb[3])
{
    memcpy(rgb, light->radiance, 3 * sizeof *rgb);
    if (!light->textured)
        return;
    const uint32_t object = lights->geometry->records[light->triangle].object;
    if (lights->scene->objects[object].flipped) { /* stored corners 1 and 2 stand the other way round */
        const double t = b1;
        b1 = b2;
        b2 = t;
    }
    kiln_surface_emission(lights->scene, mesh_of(lights->scene, lights->geometry, light->triangle),
                          lights->geometry->stored_triangle[light->triangle], (float)b1, (float)b2, rgb);
}

static bool sample_area_light(const struct kiln_lights *lights, const struct kiln_area_light *light,
                              struct kiln_dvec3 p, double weight, double u, double v, struct kiln_light_sample *s)
{
    const struct kiln_dvec3 to0 = dvec3_sub(light->p0, p);
    const double side = -dvec3_dot(to0, light->normal), height = fabs(side); /* of p above the front face */
    if ((light->two_sided ? height : side) <= KILN_AREA_LIGHT_HEIGHT * light->rounding)
        return false;
    const struct kiln_spherical_triangle t = kiln_spherical_triangle_of(to0, light->e1, light->e2, light->area, height);
    const bool spherical = kiln_spherical_triangle_wanted(t);
    struct kiln_dvec3 to;
    if (spherical) {
        const struct kiln_dvec3 direction = kiln_spherical_triangle_direction(t, u, v);
        to = dvec3_scale(direction, height / fabs(dvec3_dot(direction, light->normal)));
    } else {
        to = dvec3_add(to0, kiln_triangle_place(light->e1, light->e2, u, v));
    }
    s->distance = dvec3_length(to);
    if (!(s->distance > 0.0) || !isfinite(s->distance))
        return false;
    s->direction = dvec3_scale(to, 1.0 / s->distance);
    const double seen = height / s->distance; /* cosine at the light */
    s->backoff = kiln_light_backoff(light->rounding, s->distance, seen);
    s->has_extent = true;
    float rgb[3];
    double b1 = 0.0, b2 = 0.0;
    if (light->textured)
        kiln_triangle_weights(light->e1, light->e2, dvec3_sub(to, to0), &b1, &b2);
    kiln_area_light_radiance(lights, light, b1, b2, rgb);
    const double inverse_density = spherical ? t.omega : seen * light->area / (s->distance * s->distance);
    for (int i = 0; i < 3; i++)
        s->value[i] = (double)rgb[i] * weight * inverse_density;
    return true;
}

/* Walks from a cluster down to one light, each child by its importance for p; gives 1 / probability. */
static bool pick_light(const struct kiln_lights *lights, uint32_t node, struct kiln_dvec3 p, struct kiln_dvec3 n,
                       double pick, uint32_t *light, double *weight)
{
    *weight = 1.0;
    while (lights->nodes[node].left != KILN_NONE) {
        const uint32_t left = lights->nodes[node].left, right = lights->nodes[node].right;
        const double a = kiln_light_node_importance(&lights->nodes[left], p, 0.0, n);
        const double b = kiln_light_node_importance(&lights->nodes[right], p, 0.0, n);
        if (a + b <= 0.0)
            return false;
        node = kiln_light_tree_step(a / (a + b), &pick, weight) ? left : right;
    }
    *light = lights->nodes[node].right;
    return true;
}

/* An image is sampled in turn by its own luminance and by the cosine, weighted by the balance heuristic; a constant
 * sky, or a lone sample, by the cosine only (a probe: by the sky only). Half of the directions by the cosine are about
 * the shading normal where that is another (kiln_sky_two_cosines). */
uint32_t kiln_lights_strategies(const struct kiln_lights *lights, const struct kiln_light_choice *choice,
                                struct kiln_dvec3 n)
{
    const bool probe = kiln_any_direction(n);
    return choice->kind == KILN_CHOICE_ENVIRONMENT && lights->conditional != NULL && choice->samples >= 2 && !probe ? 2
                                                                                                                    : 1;
}

static struct kiln_dvec3 cosine_direction(struct kiln_dvec3 n, double u, double v)
{
    const struct kiln_dvec3 local = kiln_cosine_direction(u, v);
    struct kiln_vec3 t, b;
    kiln_basis(vec3_of(n), &t, &b);
    return unit(dvec3_add(dvec3_add(dvec3_scale(dvec3_of(t), local.x), dvec3_scale(dvec3_of(b), local.y)),
                          dvec3_scale(n, local.z)));
}

static bool sample_environment(const struct kiln_lights *lights, const struct kiln_light_choice *choice, uint32_t index,
                               struct kiln_dvec3 n, struct kiln_dvec3 shading, double pick, double u, double v,
                               struct kiln_light_sample *s)
{
    const bool two = shading.x != n.x || shading.y != n.y || shading.z != n.z;
    const bool probe = kiln_any_direction(n);
    const bool both = kiln_lights_strategies(lights, choice, n) == 2;
    const bool by_sky = probe || (both && (index & 1u) == 1u);
    double density;
    s->direction = by_sky ? kiln_environment_sample(lights, u, v, &density)
                          : cosine_direction(two && pick < 0.5 ? shading : n, u, v);
    s->distance = (double)INFINITY;
    s->backoff = 0.0;
    s->has_extent = true;
    const double cosine = probe ? 1.0 : dvec3_dot(n, s->direction);
    if (!(cosine > 0.0))
        return false;
    if (!probe) {
        density = (two ? kiln_sky_two_cosines(cosine, dvec3_dot(shading, s->direction)) : cosine) / KILN_PI;
        if (both)
            density = kiln_sky_cosine_density(choice->samples, kiln_environment_density(lights, s->direction), density);
    }
    float rgb[3];
    kiln_environment_radiance(lights, s->direction, rgb);
    for (int c = 0; c < 3; c++)
        s->value[c] = (double)rgb[c] / density;
    return true;
}

bool kiln_lights_sample(const struct kiln_lights *lights, const struct kiln_light_choice *choice, uint32_t index,
                        struct kiln_dvec3 p, struct kiln_dvec3 n, struct kiln_dvec3 shading, double pick, double u,
                        double v, struct kiln_light_sample *sample)
{
    sample->light = KILN_NONE;
    if (choice->kind == KILN_CHOICE_ENVIRONMENT)
        return sample_environment(lights, choice, index, n, shading, pick, u, v, sample);
    if (choice->kind == KILN_CHOICE_DIRECTIONAL) {
        const struct kiln_directional_light *d = &lights->directionals[choice->index];
        sample->direction = d->towards;
        sample->distance = (double)INFINITY;
        sample->backoff = 0.0;
        sample->has_extent = false;
        for (int c = 0; c < 3; c++)
            sample->value[c] = (double)d->irradiance[c];
        return true;
    }
    uint32_t light;
    double weight;
    if (!pick_light(lights, choice->index, p, n, pick, &light, &weight))
        return false;
    sample->light = light;
    if (light < lights->area_count)
        return sample_area_light(lights, &lights->areas[light], p, weight, u, v, sample);
    return sample_point_light(&lights->points[light - lights->area_count], p, weight, sample);
}
