#include "worker/backend/embree/chain.h"

#include <string.h>

#include "shaders/shared/chain.h"
#include "worker/backend/embree/kept_chains.h"
#include "worker/backend/embree/light_samples.h"
#include "worker/backend/embree/lookup.h"

/* A chain under way. */
struct chain {
    struct walk *walk;
    struct chain_found *found;
    float weight[3]; /* weight of incoming radiance at the chain's beginning */
    float seen[3];   /* weight for the next surface's emission: 0 if light samples have accounted for it */
    bool radiosity;
};

static float mean_of(const float rgb[3]) { return (rgb[0] + rgb[1] + rgb[2]) * (1.0f / 3.0f); }

static void multiply(struct chain *c, const float factor[3])
{
    for (int i = 0; i < 3; i++) {
        c->weight[i] *= factor[i];
        c->seen[i] *= factor[i];
    }
}

/* Adds the radiosity at the ray's hit, on a side with surface points. `out`: share that leaves towards the ray; `in`:
 * share of incoming light that the surface takes up. */
static void add_radiosity(struct chain *c, const struct RTCRayHit *ray, uint32_t triangle, float in, float out)
{
    const struct embree_backend *b = c->walk->b;
    float rgb[3], weight[3];
    for (int i = 0; i < 3; i++)
        c->found->gloss[i] -= c->weight[i] * in;
    if (!c->radiosity)
        return;
    const uint64_t point = embree_point(b, triangle, ray->hit.u, ray->hit.v, meeting_is_back(ray)).at;
    if (point == KILN_NO_POINT)
        return;
    kiln_radiosity_unpack(b->radiosity[point], rgb);
    for (int i = 0; i < 3; i++) {
        weight[i] = c->weight[i] * out;
        c->found->radiosity[i] += weight[i] * rgb[i];
    }
    if (c->walk->notes != NULL)
        kept_chains_answer(c->walk->notes, (uint32_t)point, weight);
}

/* Adds the diffuse light that the surface sends along the chain. */
static void meet(struct chain *c, const struct RTCRayHit *ray, const struct meeting *m)
{
    const bool has_points =
        !m->back || (c->walk->b->params.geometry->records[m->triangle].material & KILN_RECORD_DOUBLE_SIDED) != 0;
    if (has_points && m->lobes.matt > 0.0f)
        add_radiosity(c, ray, m->triangle, kiln_diffuse_in(m->lobes, m->o), kiln_diffuse_out(m->lobes, m->o));
}

bool chain_survives(const struct walk *walk, const struct meeting *m, uint32_t surface, float weight[3], float *pick)
{
    const uint32_t length = walk->b->params.chain_length;
    const float left = kiln_chain_left(m->albedo, vec3(weight[0], weight[1], weight[2])),
                goes_on = kiln_chain_chance(surface, length != 0 ? length : KILN_CHAIN_LENGTH, left);
    double lobe, chance;
    walk_draw(walk, kiln_path_use(surface, KILN_PATH_LOBE), &lobe, &chance);
    *pick = (float)lobe;
    if (!(goes_on > 0.0f) || !(chance < (double)goes_on))
        return false;
    for (int i = 0; i < 3; i++)
        weight[i] /= goes_on;
    return true;
}

/* Draws the direction from surface number `surface`; false: it contributes nothing. */
static bool send(struct chain *c, const struct meeting *m, uint32_t surface, float pick, struct kiln_vec3 *direction)
{
    double u, v;
    float weight[3], sharp[3];
    walk_draw(c->walk, kiln_path_use(surface, KILN_PATH_BOUNCE), &u, &v);
    if (!meeting_send(m, m->others, pick, (float)u, (float)v, direction, weight, sharp))
        return false;
    for (int i = 0; i < 3; i++) {
        c->weight[i] *= weight[i];
        c->seen[i] = c->weight[i] * sharp[i];
    }
    return c->weight[0] > 0.0f || c->weight[1] > 0.0f || c->weight[2] > 0.0f;
}

/* Adds the environment where the chain's ray has escaped. */
static void look_out(struct chain *c, struct kiln_vec3 direction)
{
    const bool even = light_sky_is_constant(c->walk->b->params.lights);
    if (even || (c->walk->leaves & KILN_LEAVES_IMAGE) == 0)
        walk_environment(c->walk, direction, even ? c->weight : c->seen, c->found->light);
}

/* Adds the emission of a surface that the chain has hit. */
static void look_at(struct chain *c, const struct meeting *m)
{
    if ((c->walk->leaves & KILN_LEAVES_AREAS) == 0)
        walk_emission(c->walk, m, c->seen, c->found->light);
}

/* Traces the ray to the next surface; false: the chain has ended. */
static bool go_on(struct chain *c, const struct meeting *m, uint32_t surface, float pick, struct RTCRayHit *ray)
{
    const struct embree_backend *b = c->walk->b;
    struct kiln_vec3 direction;
    float tint[3] = {1.0f, 1.0f, 1.0f};
    if (!send(c, m, surface, pick, &direction))
        return false;
    const float side = vec3_dot(m->normal, direction) > 0.0f ? m->offset : -m->offset;
    const bool meets = walk_trace(c->walk, vec3_madd(m->position, m->normal, side), direction,
                                  kiln_path_use(surface, KILN_PATH_CHANCE), tint, ray);
    multiply(c, tint);
    float *lost = NULL;
    if (!meets)
        lost = &c->found->escaped;
    else if (!meeting_has_side(b, meeting_record(b, ray), meeting_is_back(ray)))
        lost = &c->found->blocked;
    if (lost != NULL) {
        *lost += mean_of(c->weight);
        for (int i = 0; i < 3; i++)
            c->found->gloss[i] -= mean_of(c->weight);
        if (!meets && c->walk->choices != NULL)
            look_out(c, direction);
        return false;
    }
    return true;
}

/* Ends the chain at a diffuse surface. */
static void end(struct chain *c, const struct RTCRayHit *ray)
{
    const struct embree_backend *b = c->walk->b;
    const uint32_t triangle = embree_triangle(b, ray->hit.geomID, ray->hit.primID);
    add_radiosity(c, ray, triangle, 1.0f, 1.0f);
    if (c->walk->choices != NULL && (meeting_record(b, ray)->material & KILN_RECORD_EMITS) != 0) {
        const struct meeting m = meeting_make(b, ray);
        look_at(c, &m);
    }
}

void chain_follow(struct walk *walk, uint32_t chance, uint32_t k, const struct RTCRayHit *ray, bool radiosity,
                  struct chain_found *found)
{
    struct chain c = {.walk = walk, .found = found, .weight = {1.0f, 1.0f, 1.0f}, .radiosity = radiosity};
    struct RTCRayHit next = *ray;
    *found = (struct chain_found){.gloss = {1.0f, 1.0f, 1.0f}};
    walk->key = kiln_chain_key(chance);
    walk->k = k;
    for (uint32_t surface = 0;; surface++) {
        if ((meeting_record(walk->b, &next)->material & KILN_RECORD_GLOSS) == 0) {
            end(&c, &next);
            return;
        }
        struct meeting m = meeting_begin(walk->b, &next);
        float share[3], pick;
        if (meeting_attenuation(&m, next.ray.tfar, share))
            multiply(&c, share);
        meet(&c, &next, &m);
        if (walk->choices != NULL && surface > 0)
            look_at(&c, &m);
        if (!chain_survives(walk, &m, surface, c.weight, &pick))
            return;
        meeting_end(walk->b, &next, &m);
        if (walk->choices != NULL)
            walk_lights(walk, &m, surface, m.others, c.weight, found->light);
        if (!go_on(&c, &m, surface, pick, &next))
            return;
    }
}
