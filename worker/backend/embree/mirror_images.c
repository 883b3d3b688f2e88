#include "worker/backend/embree/mirror_images.h"

#include <math.h>
#include <string.h>

#include "shaders/shared/punctual_light.h"
#include "worker/backend/embree/light_samples.h"

/* One position on a point, and the sums that it adds to. */
struct place {
    struct kiln_vec3 position, normal, shading; /* position: offset included */
    uint32_t chance, k;
    double *irradiance, *incident;
};

/* Pairs of a plane and a lamp that a point may see mirrored in it, in the order of the planes. */
struct pairs {
    uint32_t count;
    struct {
        uint32_t plane, lamp;
    } of[KILN_IMAGES_MOST];
};

/* Irradiance of a lamp by a mirror, W/m2 on a plane perpendicular to the ray, after `beyond` more metres. `m`: the
 * point on the mirror. `way`: from m to the lamp. */
static struct kiln_light_sample look(const struct kiln_mirror_images *images, const struct kiln_mirror_lamp *lamp,
                                     struct kiln_dvec3 m, double beyond)
{
    struct kiln_light_sample s = {.direction = lamp->place, .distance = (double)INFINITY};
    double factor = 1.0;
    if (lamp->outside) {
        for (int c = 0; c < 3; c++)
            s.value[c] = (double)images->lights->directionals[lamp->index].irradiance[c];
        return s;
    }
    const struct kiln_point_light *p = &images->lights->points[lamp->index];
    const struct kiln_dvec3 way = dvec3_sub(lamp->place, m);
    s.distance = dvec3_length(way);
    if (!(s.distance > 0.0))
        return s;
    s.direction = dvec3_scale(way, 1.0 / s.distance);
    factor = kiln_punctual_share(p, dvec3_scale(s.direction, -1.0), s.distance, 1.0) /
             ((s.distance + beyond) * (s.distance + beyond));
    for (int c = 0; c < 3; c++)
        s.value[c] = (double)p->intensity[c] * factor;
    return s;
}

/* Multiplies by the mirror's reflectance towards the origin of the ray. */
static void reflect(const struct meeting *m, double value[3])
{
    const struct kiln_bsdf_choice choice = kiln_bsdf_choice_of(m->shares, KILN_LOBE_GLOSS);
    const struct kiln_bsdf_drawn d = kiln_bsdf_propose(m->lobes, choice, m->o, 0.0f, 0.5f, 0.5f, KILN_RADIANCE);
    const bool same = (d.i.z > 0.0f) == (m->o.z > 0.0f);
    value[0] *= same ? (double)(d.weight.x * d.density) : 0.0;
    value[1] *= same ? (double)(d.weight.y * d.density) : 0.0;
    value[2] *= same ? (double)(d.weight.z * d.density) : 0.0;
}

/* Follows the ray to the mirror and on to the lamp; false: it is blocked. `value`: arriving light, W/m2 on a plane
 * perpendicular to the ray. */
static bool follow(struct walk *w, const struct kiln_mirror_images *images, uint32_t plane,
                   const struct kiln_mirror_lamp *lamp, const struct place *p, struct kiln_vec3 direction,
                   double value[3])
{
    static const struct kiln_light_choice one = {.samples = 1};
    struct RTCRayHit ray;
    float tint[3] = {1.0f, 1.0f, 1.0f};
    w->rays++;
    if (!walk_trace(w, p->position, direction, kiln_path_use(plane, KILN_PATH_CHANCE), tint, &ray))
        return false;
    struct meeting m = meeting_make(w->b, &ray);
    if (images->plane_of[m.triangle] != plane || m.back)
        return false;
    meeting_face(w->b, true, direction, &m);
    struct kiln_light_sample s = look(images, lamp, dvec3_of(m.position), (double)ray.ray.tfar);
    for (int c = 0; c < 3; c++)
        s.value[c] *= (double)tint[c];
    reflect(&m, s.value);
    if (!(s.value[0] > 0.0 || s.value[1] > 0.0 || s.value[2] > 0.0))
        return false;
    const struct kiln_vec3 start = vec3_madd(m.position, m.normal, m.offset);
    if (!lamp->outside) { /* from where the ray starts */
        const struct kiln_dvec3 to = dvec3_sub(lamp->place, dvec3_of(start));
        s.distance = dvec3_length(to);
        s.direction = dvec3_scale(to, 1.0 / s.distance);
    }
    w->rays++;
    if (!light_arrives(w->b, w->context, start, &one, &s))
        return false;
    memcpy(value, s.value, sizeof s.value);
    return true;
}

static void add(const struct tile_run_frame *frame, uint32_t j, const struct place *p, struct kiln_vec3 direction,
                const double value[3])
{
    const double cosine = (double)vec3_dot(p->normal, direction), shading = (double)vec3_dot(p->shading, direction),
                 taken_up = (double)frame_taken_up(frame, j, (float)shading);
    for (int c = 0; c < 3; c++) {
        p->irradiance[c] += value[c] * fmax(0.0, shading);
        p->incident[c] += value[c] * cosine * taken_up;
    }
}

/* For all places of the point. */
static void find_pairs(const struct walk *w, const struct kiln_mirror_images *images, struct tile_run_rays *r,
                       uint32_t j, struct pairs *pairs)
{
    struct kiln_vec3 low = {INFINITY, INFINITY, INFINITY}, high = {-INFINITY, -INFINITY, -INFINITY};
    for (uint32_t k = 0; k < r->samples; k++) {
        struct kiln_vec3 p, normal;
        (void)rays_place(r, w->b, j, k, &p, &normal);
        low = (struct kiln_vec3){p.x < low.x ? p.x : low.x, p.y < low.y ? p.y : low.y, p.z < low.z ? p.z : low.z};
        high =
            (struct kiln_vec3){p.x > high.x ? p.x : high.x, p.y > high.y ? p.y : high.y, p.z > high.z ? p.z : high.z};
    }
    const double extent = (double)images->lights->geometry->extent;
    pairs->count = 0;
    for (uint32_t i = 0; i < images->plane_count; i++)
        for (uint32_t l = 0; l < images->lamp_count; l++)
            if (kiln_mirror_may_show(&images->planes[i], &images->lamps[l], dvec3_of(low), dvec3_of(high), extent)) {
                pairs->of[pairs->count].plane = i;
                pairs->of[pairs->count++].lamp = l;
            }
}

static void light_place(struct walk *w, const struct kiln_mirror_images *images, const struct pairs *pairs,
                        const struct tile_run_frame *frame, uint32_t j, const struct place *p)
{
    w->k = p->k;
    for (uint32_t i = 0; i < pairs->count; i++) {
        const uint32_t plane = pairs->of[i].plane, lamp = pairs->of[i].lamp;
        struct kiln_dvec3 direction;
        double value[3];
        if (!kiln_mirror_image(&images->planes[plane], &images->lamps[lamp], dvec3_of(p->position), &direction) ||
            !(dvec3_dot(dvec3_of(p->normal), direction) > 0.0))
            continue;
        w->key = kiln_hash2(p->chance, lamp);
        if (follow(w, images, plane, &images->lamps[lamp], p, vec3_of(direction), value))
            add(frame, j, p, vec3_of(direction), value);
    }
}

void images_light(struct walk *w, const struct kiln_mirror_images *images, struct tile_run_rays *r, uint32_t j,
                  struct image_light *light)
{
    const uint32_t count = r->samples;
    double quarter[RAY_QUARTERS] = {0.0}, before = 0.0, mean = 0.0, square = 0.0;
    struct pairs pairs;
    memset(light, 0, sizeof *light);
    find_pairs(w, images, r, j, &pairs);
    if (pairs.count == 0)
        return;
    for (uint32_t k = 0; k < count; k++) {
        struct place p = {.chance = r->chance[j],
                          .k = r->first_sample + k,
                          .irradiance = light->irradiance,
                          .incident = light->incident};
        (void)rays_place(r, w->b, j, k, &p.position, &p.normal);
        p.shading = frame_shading(&r->frame, j, p.normal);
        light_place(w, images, &pairs, &r->frame, j, &p);
        quarter[(uint64_t)k * RAY_QUARTERS / count] += kiln_luminance(light->irradiance) - before;
        before = kiln_luminance(light->irradiance);
    }
    for (int c = 0; c < 3; c++) {
        light->irradiance[c] /= (double)count;
        light->incident[c] /= (double)count;
    }
    for (int i = 0; i < RAY_QUARTERS; i++)
        mean += quarter[i] / RAY_QUARTERS;
    for (int i = 0; i < RAY_QUARTERS; i++)
        square += (quarter[i] - mean) * (quarter[i] - mean);
    if (count >= RAY_QUARTERS)
        light->error = sqrt(square * RAY_QUARTERS / (RAY_QUARTERS - 1)) / (double)count;
}
