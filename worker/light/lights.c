#include "worker/light/lights.h"

#include <math.h>
#include <string.h>

#include "worker/base/memory.h"
#include "worker/light/access.h"
#include "worker/light/environment.h"
#include "worker/light/lamp_parts.h"
#include "worker/light/lamp_textures.h"
#include "worker/light/tree.h"

static bool make_area_light(const struct kiln_lights *lights, uint32_t triangle, struct kiln_area_light *light)
{
    static const double corners[3][2] = {{0.0, 0.0}, {1.0, 0.0}, {0.0, 1.0}};
    const struct kiln_scene *scene = lights->scene;
    const struct kiln_geometry *geometry = lights->geometry;
    const uint32_t material = geometry->records[triangle].material & KILN_RECORD_MATERIAL;
    const struct kiln_material *m = &scene->materials[material];
    struct kiln_vec3 corner[3];
    kiln_geometry_corners(geometry, triangle, corner);
    *light = (struct kiln_area_light){.p0 = dvec3_of(corner[0]), .triangle = triangle};
    light->e1 = dvec3_sub(dvec3_of(corner[1]), light->p0);
    light->e2 = dvec3_sub(dvec3_of(corner[2]), light->p0);
    const struct kiln_dvec3 cross = dvec3_cross(light->e1, light->e2);
    light->area = 0.5 * dvec3_length(cross);
    light->normal = real_unit_vector(cross);
    for (int c = 0; c < 3; c++)
        light->rounding =
            fmax(light->rounding,
                 8.0 * 0x1p-24 * (double)fmaxf(fabsf(corner[c].x), fmaxf(fabsf(corner[c].y), fabsf(corner[c].z))));
    light->two_sided = m->double_sided != 0;
    light->textured = kiln_lamp_is_uneven(scene, geometry, triangle);
    light->at[1][0] = light->at[2][1] = 1.0f;
    if (light->textured) /* its radiance is that of its parts */
        return light->area > 0.0;
    double mean[3], square;
    kiln_lamp_mean(lights->textures, triangle, corners, 3, 1, mean, &square);
    for (int c = 0; c < 3; c++)
        light->radiance[c] = (float)mean[c];
    return light->area > 0.0 && kiln_luminance_of_floats(light->radiance) > 0.0;
}

/* Range of triangles that one thread processes at a time: where its area lights begin in the list, and their number. */
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
        if (may_be_area_light(lights, t) && make_area_light(lights, (uint32_t)t, areas + count))
            count++;
    return count;
}

/* Reserves room for every triangle that may be a light, and then closes the gaps left by dark ones. */
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
    int status;
    KILN_TRY(kiln_allocate(&blocks, count, sizeof *blocks, "the emissive triangles", error));
    KILN_TRY(kiln_lamp_textures_create(&lights->textures, lights->scene, lights->geometry, error));
    KILN_TRY(make_blocks(lights, blocks, count, error));
end:
    kiln_free(&blocks);
    return status == KILN_OK ? kiln_lamp_parts_cut(lights, error) : status;
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
            real_unit_vector(dvec3((double)l->direction[0], (double)l->direction[1], (double)l->direction[2]));
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
    KILN_TRY(status);
    KILN_TRY(gather_punctual_lights(l, error));
    if (l->area_count + l->point_count > UINT32_MAX / 2)
        KILN_TRY(kiln_fail(error, KILN_BAD_INPUT,
                           "the scene has %zu emissive triangles and lights; kiln takes at most %u",
                           l->area_count + l->point_count, UINT32_MAX / 2));
    KILN_TRY(kiln_light_tree_build(l, error));
    KILN_TRY(kiln_environment_build(l, error));
end:
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

bool kiln_lights_are_none(const struct kiln_lights *lights)
{
    return lights->area_count + lights->point_count + lights->directional_count == 0 &&
           !(lights->environment && kiln_luminance_of_floats(lights->environment_mean) > 0.0);
}

void kiln_lights_destroy(struct kiln_lights **lights)
{
    struct kiln_lights *l = *lights;
    if (l == NULL)
        return;
    kiln_lamp_textures_destroy(&l->textures);
    kiln_free(&l->areas);
    kiln_free(&l->points);
    kiln_free(&l->directionals);
    kiln_free(&l->nodes);
    kiln_free(&l->marginal);
    kiln_free(&l->conditional);
    kiln_free(lights);
}

size_t kiln_lights_choices(const struct kiln_lights *lights, struct kiln_dvec3 p, double spread, struct kiln_dvec3 n,
                           size_t node_limit, struct kiln_light_choice *choices)
{
    size_t count = lights->node_count > 0 ? kiln_cut_tree(lights, choices, p, spread, n, (uint32_t)node_limit) : 0;
    for (size_t i = 0; i < lights->directional_count; i++) {
        const double importance = kiln_sun_importance_at(lights, (uint32_t)i, n);
        if (importance > 0.0)
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

void kiln_area_light_radiance(const struct kiln_lights *lights, const struct kiln_area_light *light, double b1,
                              double b2, float rgb[3])
{
    if (!light->textured) {
        memcpy(rgb, light->radiance, 3 * sizeof *rgb);
        return;
    }
    double at[2];
    for (int k = 0; k < 2; k++)
        at[k] = (double)light->at[0][k] + b1 * (double)(light->at[1][k] - light->at[0][k]) +
                b2 * (double)(light->at[2][k] - light->at[0][k]);
    kiln_lamp_radiance(lights->scene, lights->geometry, light->triangle, at[0], at[1], rgb);
}

uint32_t kiln_lights_strategies(const struct kiln_lights *lights, const struct kiln_light_choice *choice,
                                struct kiln_dvec3 n)
{
    return kiln_choice_strategies(lights, choice, n);
}

bool kiln_lights_sample(const struct kiln_lights *lights, const struct kiln_light_choice *choice, uint32_t index,
                        struct kiln_dvec3 p, struct kiln_dvec3 n, struct kiln_dvec3 shading, double pick, double u,
                        double v, struct kiln_light_sample *sample)
{
    return kiln_sample_choice(lights, choice, index, p, n, shading, pick, u, v, sample);
}
