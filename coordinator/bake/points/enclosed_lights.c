#include "coordinator/bake/points/enclosed_lights.h"

#include <math.h>
#include <stdio.h>

#include "worker/base/memory.h"
#include "worker/base/text.h"
#include "worker/sampling/sequence.h"
#include "worker/scene/footprint.h"
#include "worker/scene/gloss.h"

/* rays of a lamp; rays of the first test; stride that spreads the first ones over all directions */
enum { RAYS = 256, FIRST = 32, STRIDE = 97 };
static const double CLOSE = 0.03;              /* size of a bulb or shade, as a fraction of the scene's diagonal */
static const double TURN = 2.3999632297286533; /* the golden angle: directions that fill a sphere evenly */

/* The rays of one lamp. */
struct lamp {
    struct kiln_vec3 origins[RAYS], directions[RAYS];
    struct kiln_hit hits[RAYS];
};

struct search {
    struct kiln_backend *backend;
    const struct kiln_backend_params *params;
    double reach; /* m: what is nearer is close by */
    struct lamp *lamp;
    struct kiln_enclosed_light *list;
    size_t count, capacity;
};

/* Returns unit direction i of a spiral about `axis`; z: its cosine with the axis. */
static struct kiln_vec3 around(struct kiln_vec3 axis, double z, size_t i)
{
    const double s = sqrt(fmax(0.0, 1.0 - z * z)), phi = TURN * (double)i;
    struct kiln_vec3 t, b;
    kiln_basis(axis, &t, &b);
    const struct kiln_vec3 side = vec3_add(vec3_scale(t, (float)(s * cos(phi))), vec3_scale(b, (float)(s * sin(phi))));
    return vec3_madd(side, axis, (float)z);
}

static void aim_point(const struct kiln_scene *scene, const struct kiln_light *light, struct lamp *lamp)
{
    const double *centre = scene->header->centre;
    const bool spot = light->kind == KILN_LIGHT_SPOT;
    const struct kiln_vec3 at = {(float)(light->position[0] - centre[0]), (float)(light->position[1] - centre[1]),
                                 (float)(light->position[2] - centre[2])},
                           axis =
                               spot ? (struct kiln_vec3){light->direction[0], light->direction[1], light->direction[2]}
                                    : (struct kiln_vec3){0.0f, 1.0f, 0.0f};
    const double lowest = spot ? (double)light->cos_outer : -1.0;
    for (size_t i = 0; i < RAYS; i++) {
        const size_t k = i * STRIDE % RAYS;
        lamp->origins[i] = at;
        lamp->directions[i] = around(axis, 1.0 - (1.0 - lowest) * ((double)k + 0.5) / RAYS, k);
    }
}

/* Sets the lamp's rays: cosine-distributed, from `count` emitting triangles. */
static void aim_areas(const struct kiln_geometry *geometry, const struct kiln_area_light *areas, size_t count,
                      struct lamp *lamp)
{
    for (size_t i = 0; i < RAYS; i++) {
        const struct kiln_area_light *a = &areas[count < RAYS ? i % count : i * (count / RAYS)];
        const double u = kiln_unit_double(kiln_sobol((uint32_t)i, 0)), v = kiln_unit_double(kiln_sobol((uint32_t)i, 1)),
                     root = sqrt(u), z = sqrt(kiln_unit_double(kiln_sobol((uint32_t)i, 2)));
        const float side = a->two_sided && i % 2 == 1 ? -1.0f : 1.0f;
        const struct kiln_vec3 normal = vec3_scale(vec3_of(a->normal), side),
                               at = kiln_triangle_position(geometry, a->triangle, (float)(root * (1.0 - v)),
                                                           (float)(root * v));
        lamp->origins[i] = kiln_offset_origin(at, normal, geometry, a->triangle);
        lamp->directions[i] = around(normal, z, i);
    }
}

/* Whether a ray, and the light along it, ends at the hit. */
static bool ends(const struct search *s, const struct kiln_hit *hit)
{
    if (hit->triangle == KILN_NONE)
        return false;
    const uint32_t material = s->params->geometry->records[hit->triangle].material & KILN_RECORD_MATERIAL;
    const struct kiln_gloss *gloss = kiln_gloss_find(s->params->scene, material);
    return gloss == NULL || gloss->transmission == 0.0f;
}

static uint32_t object_of(const struct search *s, const struct kiln_hit *hit)
{
    return s->params->geometry->records[hit->triangle].object;
}

/* The object that most rays end on. */
static uint32_t most_met(const struct search *s)
{
    uint32_t best = KILN_NONE;
    size_t most = 0;
    for (size_t i = 0; i < RAYS; i++) {
        size_t votes = 0;
        for (size_t j = 0; j < RAYS; j++)
            votes += object_of(s, &s->lamp->hits[j]) == object_of(s, &s->lamp->hits[i]);
        if (votes > most) {
            most = votes;
            best = object_of(s, &s->lamp->hits[i]);
        }
    }
    return best;
}

/* Whether the light of the first rays stays where it is. */
static bool is_enclosed(const struct search *s, size_t rays)
{
    size_t lost = 0, close = 0;
    for (size_t i = 0; i < rays; i++) {
        const struct kiln_hit *hit = &s->lamp->hits[i];
        if (!ends(s, hit))
            return false;
        lost += hit->back && (s->params->geometry->records[hit->triangle].material & KILN_RECORD_DOUBLE_SIDED) == 0;
        close += (double)hit->distance < s->reach;
    }
    return lost == rays || close == rays;
}

/* Traces the rays of the lamp; adds it to the list if it is enclosed. */
static int look(struct search *s, uint32_t light, uint32_t source, struct kiln_error *error)
{
    struct lamp *lamp = s->lamp;
    int status = kiln_backend_intersect(s->backend, lamp->origins, lamp->directions, FIRST, lamp->hits, error);
    if (status != KILN_OK || !is_enclosed(s, FIRST))
        return status;
    status = kiln_backend_intersect(s->backend, lamp->origins + FIRST, lamp->directions + FIRST, RAYS - FIRST,
                                    lamp->hits + FIRST, error);
    if (status != KILN_OK || !is_enclosed(s, RAYS))
        return status;
    status = kiln_grow(&s->list, &s->capacity, s->count + 1, sizeof *s->list, "the enclosed lights", error);
    if (status == KILN_OK)
        s->list[s->count++] = (struct kiln_enclosed_light){light, source, most_met(s)};
    return status;
}

static int look_at_points(struct search *s, struct kiln_error *error)
{
    const struct kiln_scene *scene = s->params->scene;
    int status = KILN_OK;
    for (uint32_t i = 0; i < scene->light_count && status == KILN_OK; i++) {
        const struct kiln_light *light = &scene->lights[i];
        if (light->kind == KILN_LIGHT_DIRECTIONAL ||
            !(light->intensity[0] + light->intensity[1] + light->intensity[2] > 0.0f))
            continue;
        aim_point(scene, light, s->lamp);
        status = look(s, i, KILN_NONE, error);
    }
    return status;
}

/* Tests emitting triangles as lamps, those of one object together. */
static int look_at_areas(struct search *s, struct kiln_error *error)
{
    const struct kiln_lights *lights = s->params->lights;
    const struct kiln_hit_record *records = s->params->geometry->records;
    int status = KILN_OK;
    for (size_t i = 0, end; i < lights->area_count && status == KILN_OK; i = end) {
        const uint32_t object = records[lights->areas[i].triangle].object;
        for (end = i + 1; end < lights->area_count && records[lights->areas[end].triangle].object == object;)
            end++;
        if (s->count > 0 && s->list[s->count - 1].source == object)
            continue;
        aim_areas(s->params->geometry, &lights->areas[i], end - i, s->lamp);
        status = look(s, KILN_NONE, object, error);
    }
    return status;
}

int kiln_enclosed_lights_find(struct kiln_enclosed_light **list, size_t *count, struct kiln_backend *backend,
                              struct kiln_error *error)
{
    struct search s = {.backend = backend, .params = &backend->params};
    const struct kiln_geometry *g = s.params->geometry;
    s.reach = CLOSE * (double)vec3_length(vec3_sub(g->bounds_max, g->bounds_min));
    int status;
    KILN_TRY(kiln_allocate(&s.lamp, 1, sizeof *s.lamp, "the rays of a lamp", error));
    if (g->triangle_count > 0)
        KILN_TRY(look_at_points(&s, error));
    if (g->triangle_count > 0)
        KILN_TRY(look_at_areas(&s, error));
end:
    kiln_free(&s.lamp);
    if (status != KILN_OK)
        kiln_free(&s.list);
    *list = s.list;
    *count = status == KILN_OK ? s.count : 0;
    return status;
}

const char *kiln_enclosed_light_name(const struct kiln_enclosed_light *light, const struct kiln_scene *scene)
{
    return kiln_scene_string(scene, light->light != KILN_NONE ? scene->lights[light->light].name
                                                              : scene->objects[light->source].original_name);
}

void kiln_enclosed_light_text(const struct kiln_enclosed_light *light, const struct kiln_scene *scene, char *text,
                              size_t size)
{
    char name[128];
    kiln_text_plain(name, sizeof name, kiln_scene_string(scene, scene->objects[light->object].original_name));
    (void)snprintf(text, size,
                   "it is enclosed in mesh '%s', which is opaque: its light stays in there; give that mesh a material "
                   "that lets light through, or role: receiver-only, or move the light out",
                   name);
}
