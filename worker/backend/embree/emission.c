/* Light traced from the lights, for the energy ledger: what share of it meets front faces, back faces, nothing. It shares no
 * code with the direct pass but the lights' description, so that agreement of the two means something. */
#include <math.h>
#include <omp.h>
#include <string.h>

#include "shaders/random.h"
#include "worker/backend/embree/embree.h"
#include "worker/sampling/sequence.h"
#include "worker/scene/footprint.h"
#include "worker/scene/texture.h"

enum { GROUPS = 16 }; /* independent parts, whose spread gives the error */

/* One particle: where it starts, where it goes, the flux it carries (W, RGB). */
struct particle {
    struct kiln_vec3 origin;
    struct kiln_dvec3 direction;
    double flux[3];
    const struct kiln_point_light *ranged; /* its range cuts the flux down at the hit */
};

/* Total flux of each light, W of luminance: what particles are shared out by. */
struct emitters {
    const struct embree_backend *b;
    double radius; /* of the sphere about the scene */
    struct kiln_vec3 centre;
    size_t count;
};

static double area_flux(const struct kiln_area_light *a) { return KILN_PI * a->area * (a->two_sided ? 2.0 : 1.0); }
static double solid_angle(const struct kiln_point_light *l) { return l->spot ? 2.0 * KILN_PI * (1.0 - l->cos_outer) : 4.0 * KILN_PI; }

/* Luminance of the flux of light i (areas, points, directionals, environment), the one weight that all use. */
static double flux_of(const struct emitters *e, size_t i)
{
    const struct kiln_lights *l = e->b->params.lights;
    if (i < l->area_count)
        return area_flux(&l->areas[i]) * kiln_luminance(l->areas[i].radiance);
    i -= l->area_count;
    if (i < l->point_count)
        return solid_angle(&l->points[i]) * kiln_luminance(l->points[i].intensity);
    i -= l->point_count;
    const double disk = KILN_PI * e->radius * e->radius;
    if (i < l->directional_count)
        return disk * kiln_luminance(l->directionals[i].irradiance);
    return 4.0 * KILN_PI * disk * kiln_luminance(l->environment_mean);
}

static struct kiln_dvec3 turn(struct kiln_dvec3 local, struct kiln_dvec3 axis)
{
    struct kiln_vec3 t, b;
    kiln_basis(vec3_of(axis), &t, &b);
    return dvec3_add(dvec3_add(dvec3_scale(dvec3_of(t), local.x), dvec3_scale(dvec3_of(b), local.y)), dvec3_scale(axis, local.z));
}

static void from_area(const struct emitters *e, const struct kiln_area_light *a, const double r[5], struct particle *p)
{
    const struct kiln_backend_params *params = &e->b->params;
    const double root = sqrt(r[0]), b1 = root * (1.0 - r[1]), b2 = root * r[1];
    const double side = a->two_sided && r[4] < 0.5 ? -1.0 : 1.0;
    const struct kiln_dvec3 normal = dvec3_scale(a->normal, side);
    const struct kiln_dvec3 at = dvec3_add(a->p0, dvec3_add(dvec3_scale(a->e1, b1), dvec3_scale(a->e2, b2)));
    p->origin = kiln_offset_origin(vec3_of(at), vec3_of(normal), params->geometry, a->triangle);
    p->direction = turn(kiln_cosine_direction(r[2], r[3]), normal);
    float rgb[3];
    memcpy(rgb, a->radiance, sizeof rgb);
    if (a->textured) {
        const struct kiln_object *object = &params->scene->objects[params->geometry->records[a->triangle].object];
        kiln_surface_emission(params->scene, &params->scene->meshes[object->mesh], params->geometry->stored_triangle[a->triangle],
                              (float)(object->flipped ? b2 : b1), (float)(object->flipped ? b1 : b2), rgb);
    }
    for (int c = 0; c < 3; c++)
        p->flux[c] = (double)rgb[c] * area_flux(a);
}

static void from_point(const struct kiln_point_light *l, const double r[5], struct particle *p)
{
    const double lowest = l->spot ? l->cos_outer : -1.0, z = 1.0 - r[2] * (1.0 - lowest), s = sqrt(fmax(0.0, 1.0 - z * z));
    const double phi = 2.0 * KILN_PI * r[3];
    p->direction = turn(dvec3(s * cos(phi), s * sin(phi), z), l->spot ? l->direction : dvec3(0.0, 0.0, 1.0));
    p->origin = vec3_of(l->position);
    const double factor = solid_angle(l) * kiln_point_light_cone(l, p->direction);
    for (int c = 0; c < 3; c++)
        p->flux[c] = (double)l->intensity[c] * factor;
    p->ranged = l->range > 0.0 ? l : NULL;
}

/* From outside: a point of the disk that the sphere shows to the direction. */
static void from_outside(const struct emitters *e, struct kiln_dvec3 towards, const double r[5], struct particle *p)
{
    const double radius = e->radius * sqrt(r[0]), phi = 2.0 * KILN_PI * r[1];
    const struct kiln_dvec3 disk = turn(dvec3(radius * cos(phi), radius * sin(phi), e->radius), towards);
    p->origin = vec3_of(dvec3_add(dvec3_of(e->centre), disk));
    p->direction = dvec3_scale(towards, -1.0);
}

static void make_particle(const struct emitters *e, size_t i, const double r[5], struct particle *p)
{
    const struct kiln_lights *l = e->b->params.lights;
    *p = (struct particle){0};
    if (i < l->area_count) {
        from_area(e, &l->areas[i], r, p);
        return;
    }
    i -= l->area_count;
    if (i < l->point_count) {
        from_point(&l->points[i], r, p);
        return;
    }
    i -= l->point_count;
    const double disk = KILN_PI * e->radius * e->radius;
    if (i < l->directional_count) {
        from_outside(e, l->directionals[i].towards, r, p);
        for (int c = 0; c < 3; c++)
            p->flux[c] = (double)l->directionals[i].irradiance[c] * disk;
        return;
    }
    double density;
    const struct kiln_dvec3 towards = kiln_environment_sample(l, r[2], r[3], &density);
    from_outside(e, towards, r, p);
    float rgb[3];
    kiln_environment_radiance(l, towards, rgb);
    for (int c = 0; c < 3; c++)
        p->flux[c] = (double)rgb[c] * disk / density;
}

static void land(const struct emitters *e, struct RTCIntersectContext *context, const struct particle *p, double scale,
                 struct kiln_emission_result *out)
{
    const struct embree_backend *b = e->b;
    struct RTCRayHit r = {.ray = {.org_x = p->origin.x, .org_y = p->origin.y, .org_z = p->origin.z, .dir_x = (float)p->direction.x,
                                  .dir_y = (float)p->direction.y, .dir_z = (float)p->direction.z, .tfar = INFINITY, .mask = ~0u},
                          .hit = {.geomID = RTC_INVALID_GEOMETRY_ID, .instID = {RTC_INVALID_GEOMETRY_ID}}};
    rtcIntersect1(b->scene, context, &r);
    double *target = out->escaped, kept = 1.0;
    if (r.hit.geomID != RTC_INVALID_GEOMETRY_ID) {
        const uint32_t triangle = embree_triangle(b, r.hit.geomID, r.hit.primID);
        const bool back = r.hit.Ng_x * r.ray.dir_x + r.hit.Ng_y * r.ray.dir_y + r.hit.Ng_z * r.ray.dir_z > 0.0f;
        const bool double_sided = (b->params.geometry->records[triangle].material & KILN_RECORD_DOUBLE_SIDED) != 0;
        target = !back ? out->received : double_sided ? out->behind : out->blocked;
        if (p->ranged != NULL)
            kept = kiln_point_light_range(p->ranged, (double)r.ray.tfar);
    }
    for (int c = 0; c < 3; c++) {
        const double flux = p->flux[c] * scale;
        out->emitted[c] += flux;
        target[c] += flux * kept;
        out->ranged[c] += flux * (1.0 - kept);
    }
}

/* Group g's particles, light after light, each light its share; sums in a fixed order. */
static void trace_group(const struct emitters *e, uint32_t group, uint32_t samples, double total, struct kiln_emission_result *out)
{
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    const uint64_t seed = e->b->params.seed;
    const uint32_t base = kiln_hash2(kiln_hash2((uint32_t)seed, (uint32_t)(seed >> 32)), 0x656d6974u + group);
    /* Systematic choice: light i gets the particles whose place on the line of fluxes is its own. */
    const double step = total / samples, start = kiln_unit_double(kiln_hash1(base)) * step;
    double reached = 0.0;
    uint32_t next = 0;
    for (size_t i = 0; i < e->count; i++) {
        const double flux = flux_of(e, i);
        reached += flux;
        for (uint32_t k = 0; next < samples && start + next * step < reached; next++, k++) {
            double r[KILN_DIMENSIONS];
            for (uint32_t d = 0; d < KILN_DIMENSIONS; d++)
                r[d] = kiln_unit_double(kiln_owen_scramble(kiln_sobol(k, d), kiln_hash2(kiln_hash2(base, (uint32_t)i + 1u), d)));
            struct particle p;
            make_particle(e, i, r, &p);
            land(e, &context, &p, step / flux, out);
        }
    }
}

int embree_emission(struct kiln_backend *backend, uint32_t samples, struct kiln_emission_result *result, struct kiln_error *error)
{
    (void)error;
    const struct embree_backend *b = (const struct embree_backend *)backend;
    const struct kiln_lights *l = b->params.lights;
    const struct kiln_geometry *g = b->params.geometry;
    struct emitters e = {.b = b, .count = l->area_count + l->point_count + l->directional_count + (l->environment ? 1 : 0)};
    e.centre = vec3_scale(vec3_add(g->bounds_min, g->bounds_max), 0.5f);
    e.radius = 0.5 * (double)vec3_length(vec3_sub(g->bounds_max, g->bounds_min)) * 1.0001;
    *result = (struct kiln_emission_result){0};
    double total = 0.0;
    for (size_t i = 0; i < e.count; i++)
        total += flux_of(&e, i);
    if (!(total > 0.0))
        return KILN_OK;
    const uint32_t part = samples / GROUPS < 1 ? 1 : samples / GROUPS;
    struct kiln_emission_result groups[GROUPS] = {0};
#pragma omp parallel num_threads((int)b->threads)
    {
        const unsigned saved = embree_enter();
#pragma omp for schedule(dynamic, 1)
        for (uint32_t i = 0; i < GROUPS; i++)
            trace_group(&e, i, part, total, &groups[i]);
        embree_leave(saved);
    }
    for (int c = 0; c < 3; c++) {
        double square = 0.0;
        for (int i = 0; i < GROUPS; i++) {
            result->emitted[c] += groups[i].emitted[c] / GROUPS;
            result->received[c] += groups[i].received[c] / GROUPS;
            result->blocked[c] += groups[i].blocked[c] / GROUPS;
            result->behind[c] += groups[i].behind[c] / GROUPS;
            result->escaped[c] += groups[i].escaped[c] / GROUPS;
            result->ranged[c] += groups[i].ranged[c] / GROUPS;
        }
        for (int i = 0; i < GROUPS; i++)
            square += (groups[i].received[c] - result->received[c]) * (groups[i].received[c] - result->received[c]);
        result->error[c] = sqrt(square / (GROUPS * (GROUPS - 1)));
    }
    return KILN_OK;
}
