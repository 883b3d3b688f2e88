#include "worker/backend/particle.h"

#include <math.h>

#include "shaders/shared/area_light.h"
#include "shaders/shared/chain.h"
#include "worker/sampling/sequence.h"
#include "worker/scene/footprint.h"

static const struct kiln_hit_record *record_of(const struct kiln_backend_params *params, const struct kiln_hit *hit)
{
    return &params->geometry->records[hit->triangle];
}

static bool has_points(const struct kiln_backend_params *params, const struct kiln_hit *hit)
{
    return !hit->back || (record_of(params, hit)->material & KILN_RECORD_DOUBLE_SIDED) != 0;
}

bool kiln_particle_turns(const struct kiln_backend_params *params, const struct kiln_hit *hit)
{
    if (params->scene->taken == NULL || hit->triangle == KILN_NONE)
        return false;
    const struct kiln_gloss *gloss =
        kiln_gloss_taken(params->scene, record_of(params, hit)->material & KILN_RECORD_MATERIAL);
    return gloss != NULL && (has_points(params, hit) || gloss->transmission > 0.0f);
}

/* Shading normal of the mesh, flipped to the geometric normal's side of the ray. */
static struct kiln_vec3 shading_normal(const struct kiln_particle_place *p, const struct kiln_mesh *mesh,
                                       struct kiln_vec3 back)
{
    if ((mesh->flags & KILN_MESH_SMOOTH) == 0)
        return p->normal;
    const struct kiln_vec3 s =
        kiln_triangle_shading_normal(p->params->scene, p->params->geometry, p->hit.triangle, p->hit.u, p->hit.v);
    return vec3_dot(s, p->normal) > 0.0f && (vec3_dot(s, back) > 0.0f) == (vec3_dot(p->normal, back) > 0.0f)
               ? s
               : p->normal;
}

struct kiln_particle_place kiln_particle_place(const struct kiln_backend_params *params,
                                               const struct kiln_gloss_lobes *lobes, const struct kiln_hit *hit,
                                               struct kiln_vec3 direction)
{
    const struct kiln_scene *scene = params->scene;
    const struct kiln_geometry *g = params->geometry;
    const struct kiln_object *object = &scene->objects[record_of(params, hit)->object];
    const struct kiln_mesh *mesh = &scene->meshes[object->mesh];
    const uint64_t stored = g->stored_triangle[hit->triangle];
    const uint32_t material = record_of(params, hit)->material & KILN_RECORD_MATERIAL;
    struct kiln_particle_place p = {
        .params = params, .hit = *hit, .gloss = kiln_gloss_taken(scene, material), .arrives = {1.0f, 1.0f, 1.0f}};
    struct kiln_vec3 corner[3];
    float b1, b2;
    kiln_geometry_corners(g, hit->triangle, corner);
    kiln_geometry_stored_barycentrics(scene, g, hit->triangle, hit->u, hit->v, &b1, &b2);
    const int second = object->flipped != 0 ? 1 : 2;
    const struct kiln_vec3 edge[2] = {vec3_sub(corner[3 - second], corner[0]), vec3_sub(corner[second], corner[0])},
                           back = vec3_scale(direction, -1.0f);
    p.position = kiln_triangle_position(g, hit->triangle, hit->u, hit->v);
    p.normal = kiln_triangle_exact_normal(scene, g, hit->triangle);
    p.frame = kiln_surface_frame(scene, p.gloss, mesh, stored, b1, b2, shading_normal(&p, mesh, back), edge);
    p.lobes = kiln_surface_lobes(scene, &lobes[material], mesh, stored, b1, b2, false);
    p.o = kiln_into_frame(&p.frame, back);
    p.others = KILN_LOBE_GLOSS | (p.lobes.coat.strength > 0.0f ? KILN_LOBE_COAT : 0u);
    p.choice = kiln_bsdf_choose(p.lobes, p.o, p.others);
    if (hit->back && (p.gloss->flags & KILN_GLOSS_VOLUME) != 0)
        kiln_gloss_attenuation(p.gloss, hit->distance, p.arrives);
    return p;
}

/* Start of a ray that leaves the place in this direction. */
static struct kiln_vec3 start_of(const struct kiln_particle_place *p, struct kiln_vec3 direction)
{
    const float side = vec3_dot(p->normal, direction) > 0.0f ? 1.0f : -1.0f;
    return kiln_offset_origin(p->position, vec3_scale(p->normal, side), p->params->geometry, p->hit.triangle);
}

bool kiln_particle_is_smooth(const struct kiln_particle_place *p)
{
    const struct kiln_bsdf_choice *c = &p->choice;
    const bool base_is_mirror = p->lobes.base_is_mirror != 0 && p->lobes.p.model == KILN_BSDF_LAYERS;
    return c->near == 0.0f && c->far == 0.0f && (c->gloss == 0.0f || base_is_mirror) &&
           (c->coat == 0.0f || p->lobes.coat_is_mirror != 0);
}

bool kiln_particle_shows(const struct kiln_particle_place *p, struct kiln_vec3 *origin, struct kiln_vec3 *direction,
                         float share[3])
{
    const struct kiln_bsdf_choice *c = &p->choice;
    if (p->lobes.matt > 0.0f || !(c->gloss > 0.0f) || !kiln_particle_is_smooth(p))
        return false;
    const float back = kiln_bsdf_split_at(p->lobes, p->o.z > 0.0f, fabsf(p->o.z)).chance;
    const float part = c->coat + c->gloss * back >= 0.5f ? 0.5f * back : 0.5f + 0.5f * back;
    const struct kiln_bsdf_drawn d =
        kiln_bsdf_propose(p->lobes, *c, p->o, c->coat + c->gloss * part, 0.5f, 0.5f, KILN_RADIANCE);
    if (d.i.z == 0.0f || !kiln_shading_agrees(d.i, kiln_into_frame(&p->frame, p->normal)))
        return false;
    const bool green = p->lobes.disperses != 0 && d.i.z * p->o.z < 0.0f && p->lobes.p.thin_wall == 0;
    share[0] = (green ? d.weight.y : d.weight.x) * d.density * p->arrives[0];
    share[1] = d.weight.y * d.density * p->arrives[1];
    share[2] = (green ? d.weight.y : d.weight.z) * d.density * p->arrives[2];
    *direction = kiln_out_of_frame(&p->frame, d.i);
    *origin = start_of(p, *direction);
    return true;
}

struct kiln_bsdf_value kiln_particle_scatter(const struct kiln_particle_place *p, struct kiln_vec3 direction)
{
    const struct kiln_vec3 i = kiln_into_frame(&p->frame, direction);
    if (!kiln_shading_agrees(i, kiln_into_frame(&p->frame, p->normal)))
        return (struct kiln_bsdf_value){.density = 0.0f};
    return kiln_bsdf_evaluate_chosen(p->lobes, p->choice, p->o, i, KILN_RADIANCE, p->others);
}

void kiln_particle_draw(const struct kiln_particle_chance *chance, uint32_t use, double *u, double *v)
{
    uint32_t a, b;
    kiln_path_numbers(kiln_path_key(chance->key, kiln_path_use(chance->surface, use)), chance->number, &a, &b);
    *u = kiln_unit_double(a);
    *v = kiln_unit_double(b);
}

/* Draws a direction in the frame, with its weight; false: nothing continues. */
static bool send(const struct kiln_particle_place *p, const struct kiln_particle_chance *chance, float pick,
                 uint32_t mode, struct kiln_bsdf_drawn *d)
{
    double u, v;
    kiln_particle_draw(chance, KILN_PATH_BOUNCE, &u, &v);
    *d = kiln_bsdf_propose(p->lobes, p->choice, p->o, pick, (float)u, (float)v, mode);
    if (d->i.z == 0.0f)
        return false;
    if (!d->delta) {
        const struct kiln_bsdf_value f = kiln_bsdf_evaluate_chosen(p->lobes, p->choice, p->o, d->i, mode, p->others);
        if (!(f.density > 0.0f))
            return false;
        d->weight = vec3_scale(f.value, 1.0f / f.density);
        d->density = f.density;
    }
    const struct kiln_vec3 front = kiln_into_frame(&p->frame, p->normal);
    if (mode == KILN_IMPORTANCE)
        d->weight = vec3_scale(d->weight, kiln_shading_correction(p->o, d->i, front));
    return kiln_shading_agrees(d->i, front);
}

/* Factor on the survival probability of rays from the eye, relative to light traced from lamps: dark surfaces are seen
 * mostly by what they mirror. */
static const float weight_of_rays = 8.0f;

/* Continues with `share` of the arriving light in a direction, times `factor`, which does not affect the survival
 * probability. */
static void go_on(const struct kiln_particle_place *p, const float weight[3], const struct kiln_particle_chance *chance,
                  double rest, struct kiln_vec3 share, float factor, uint32_t mode, struct kiln_particle_turn *turn)
{
    const uint32_t wanted = p->params->chain_length, length = wanted != 0 ? wanted : KILN_CHAIN_LENGTH;
    const float on[3] = {p->arrives[0] * share.x, p->arrives[1] * share.y, p->arrives[2] * share.z};
    float most = 0.0f;
    for (int c = 0; c < 3; c++)
        most = float_max(most, weight[c] * on[c]);
    if (mode == KILN_RADIANCE)
        most *= weight_of_rays;
    const float goes_on = kiln_chain_chance(chance->surface, length, most);
    if (!(rest < (double)goes_on))
        return;
    for (int c = 0; c < 3; c++)
        turn->goes_on[c] = factor * on[c] / goes_on;
    turn->origin = start_of(p, turn->direction);
}

static struct kiln_particle_turn taken_up(const struct kiln_particle_place *p)
{
    struct kiln_particle_turn turn = {.mirrored = false};
    for (int c = 0; c < 3 && has_points(p->params, &p->hit); c++)
        turn.taken_up[c] = p->arrives[c] * kiln_chain_taken_up(p->lobes, p->o.z);
    return turn;
}

struct kiln_particle_turn kiln_particle_turn(const struct kiln_particle_place *p, const float weight[3],
                                             const struct kiln_particle_chance *chance, uint32_t mode)
{
    struct kiln_particle_turn turn = taken_up(p);
    struct kiln_bsdf_drawn d;
    double pick, rest;
    kiln_particle_draw(chance, KILN_PATH_LOBE, &pick, &rest);
    if (!send(p, chance, (float)pick, mode, &d))
        return turn;
    turn.mirrored = d.delta;
    turn.density = d.density;
    turn.direction = kiln_out_of_frame(&p->frame, d.i);
    go_on(p, weight, chance, rest, d.weight, 1.0f, mode, &turn);
    return turn;
}

struct kiln_particle_turn kiln_particle_turn_to(const struct kiln_particle_place *p, const float weight[3],
                                                const struct kiln_particle_chance *chance, struct kiln_vec3 direction,
                                                float density)
{
    struct kiln_particle_turn turn = taken_up(p);
    double pick, rest;
    kiln_particle_draw(chance, KILN_PATH_LOBE, &pick, &rest);
    const struct kiln_bsdf_value f = kiln_particle_scatter(p, direction);
    if (!(f.density > 0.0f))
        return turn;
    turn.density = density;
    turn.direction = direction;
    go_on(p, weight, chance, rest, vec3_scale(f.value, 1.0f / f.density), f.density / density, KILN_RADIANCE, &turn);
    return turn;
}

bool kiln_particle_part(const struct kiln_particle_place *p, const struct kiln_particle_chance *chance,
                        struct kiln_particle_turn turns[2])
{
    const bool two = p->lobes.p.model == KILN_BSDF_LAYERS && p->lobes.base_is_mirror != 0 && p->lobes.glass > 0.0f &&
                     p->choice.gloss > 0.0f && p->choice.coat + p->choice.near + p->choice.far == 0.0f;
    const float reflected = two ? kiln_bsdf_split_at(p->lobes, p->o.z > 0.0f, float_abs(p->o.z)).chance : 0.0f;
    double color, rest;
    if (!(reflected > 0.0f && reflected < 1.0f))
        return false;
    kiln_particle_draw(chance, KILN_PATH_LOBE, &color, &rest);
    for (int k = 0; k < 2; k++) {
        const float share = k == 0 ? reflected : 1.0f - reflected,
                    pick = k == 0 ? 0.5f * reflected : reflected + (float)color * share;
        struct kiln_bsdf_drawn d;
        turns[k] = taken_up(p);
        if (!send(p, chance, pick * p->choice.gloss, KILN_RADIANCE, &d))
            continue;
        turns[k].mirrored = true;
        turns[k].direction = kiln_out_of_frame(&p->frame, d.i);
        turns[k].origin = start_of(p, turns[k].direction);
        turns[k].goes_on[0] = p->arrives[0] * share * d.weight.x;
        turns[k].goes_on[1] = p->arrives[1] * share * d.weight.y;
        turns[k].goes_on[2] = p->arrives[2] * share * d.weight.z;
    }
    return true;
}

float kiln_particle_shadow(const struct kiln_particle_place *p, const struct kiln_light_sample *sample,
                           struct kiln_vec3 *origin, struct kiln_vec3 *direction)
{
    *direction = vec3_of(sample->direction);
    *origin = start_of(p, *direction);
    if (!isfinite(sample->distance))
        return INFINITY;
    const struct kiln_dvec3 place = dvec3_add(dvec3_of(p->position), dvec3_scale(sample->direction, sample->distance)),
                            to = dvec3_sub(dvec3_of(*origin), place);
    const double distance = dvec3_length(to), left = (distance - sample->backoff) * KILN_SHADOW_LENGTH;
    const struct kiln_dvec3 down = dvec3_scale(to, 1.0 / distance);
    *origin = vec3_of(dvec3_add(place, dvec3_scale(down, distance - left)));
    *direction = vec3_of(down);
    return (float)left;
}
