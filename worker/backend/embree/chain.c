#include "worker/backend/embree/chain.h"

#include <string.h>

#include "shaders/shared/chain.h"
#include "worker/backend/embree/light_samples.h"
#include "worker/backend/embree/lookup.h"

/* A chain under way. */
struct chain {
    struct walk *walk;
    struct chain_found *found;
    float weight[3]; /* what of the radiance that comes now reaches the chain's begin */
    float seen[3];   /* the same of what the next surface emits: 0 where samples of lights have brought that */
    bool radiosity;
};

static float mean_of(const float rgb[3]) { return (rgb[0] + rgb[1] + rgb[2]) * (1.0f / 3.0f); }

static float most_of(const float rgb[3])
{
    const float most = rgb[0] > rgb[1] ? rgb[0] : rgb[1];
    return most > rgb[2] ? most : rgb[2];
}

static void multiply(struct chain *c, const float factor[3])
{
    for (int i = 0; i < 3; i++) {
        c->weight[i] *= factor[i];
        c->seen[i] *= factor[i];
    }
}

/* Adds radiosity that the ray has met on a side that has points, `out` of which leaves towards it, of light of which
 * the surface takes up `in`. */
static void add_radiosity(struct chain *c, const struct RTCRayHit *ray, uint32_t triangle, float in, float out)
{
    const struct embree_backend *b = c->walk->b;
    float rgb[3];
    for (int i = 0; i < 3; i++)
        c->found->gloss[i] -= c->weight[i] * in;
    if (!c->radiosity)
        return;
    kiln_radiosity_unpack(embree_radiosity(b, triangle, ray->hit.u, ray->hit.v, meeting_is_back(ray)), rgb);
    for (int i = 0; i < 3; i++)
        c->found->radiosity[i] += c->weight[i] * out * rgb[i];
}

/* What of diffuse light and of lamps the surface sends to the chain. */
static void meet(struct chain *c, const struct RTCRayHit *ray, const struct meeting *m, uint32_t surface)
{
    const bool has_points =
        !m->back || (c->walk->b->params.geometry->records[m->triangle].material & KILN_RECORD_DOUBLE_SIDED) != 0;
    if (has_points && m->lobes.matt > 0.0f)
        add_radiosity(c, ray, m->triangle, kiln_diffuse_in(m->lobes, m->o.z), kiln_diffuse_out(m->lobes, m->o.z));
    if (c->walk->choices == NULL)
        return;
    if (surface > 0)
        walk_emission(c->walk, m, c->seen, c->found->light);
    walk_lights(c->walk, m, surface, m->others, c->weight, c->found->light);
}

/* Draws the way on from surface number `surface`; false: the chain ends. */
static bool send(struct chain *c, const struct meeting *m, uint32_t surface, struct kiln_vec3 *direction)
{
    const uint32_t length = c->walk->b->params.chain_length;
    double u, v, pick, chance;
    float weight[3], sharp[3];
    walk_draw(c->walk, kiln_path_use(surface, KILN_PATH_BOUNCE), &u, &v);
    walk_draw(c->walk, kiln_path_use(surface, KILN_PATH_LOBE), &pick, &chance);
    if (!meeting_send(m, m->others, (float)pick, (float)u, (float)v, direction, weight, sharp))
        return false;
    for (int i = 0; i < 3; i++)
        weight[i] *= c->weight[i];
    const float most = most_of(weight),
                goes_on = kiln_chain_chance(surface, length != 0 ? length : KILN_CHAIN_LENGTH, most);
    if (!(most > 0.0f) || !(chance < (double)goes_on))
        return false;
    for (int i = 0; i < 3; i++) {
        c->weight[i] = weight[i] / goes_on;
        c->seen[i] = c->weight[i] * sharp[i];
    }
    return true;
}

/* The ray goes on to the next surface that is not only diffuse; false: the chain has ended. */
static bool go_on(struct chain *c, const struct meeting *m, uint32_t surface, struct RTCRayHit *ray)
{
    const struct embree_backend *b = c->walk->b;
    struct kiln_vec3 direction;
    float tint[3] = {1.0f, 1.0f, 1.0f};
    if (!send(c, m, surface, &direction))
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
            walk_environment(c->walk, direction, light_sky_is_constant(b->params.lights) ? c->weight : c->seen,
                             c->found->light);
        return false;
    }
    return true;
}

/* The chain's last surface, which is only diffuse. */
static void end(struct chain *c, const struct RTCRayHit *ray)
{
    const struct embree_backend *b = c->walk->b;
    const uint32_t triangle = embree_triangle(b, ray->hit.geomID, ray->hit.primID);
    add_radiosity(c, ray, triangle, 1.0f, 1.0f);
    if (c->walk->choices != NULL && (meeting_record(b, ray)->material & KILN_RECORD_EMITS) != 0) {
        const struct meeting m = meeting_make(b, ray);
        walk_emission(c->walk, &m, c->seen, c->found->light);
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
        struct meeting m = meeting_make(walk->b, &next);
        float share[3];
        meeting_face(walk->b, false, vec3(next.ray.dir_x, next.ray.dir_y, next.ray.dir_z), &m);
        if (meeting_attenuation(&m, next.ray.tfar, share))
            multiply(&c, share);
        meet(&c, &next, &m, surface);
        if (!go_on(&c, &m, surface, &next))
            return;
    }
}
