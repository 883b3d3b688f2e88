#include "worker/backend/embree/passage.h"

#include <math.h>
#include <string.h>

#include "shaders/shared/area_light.h"
#include "shaders/shared/passage.h"
#include "shaders/shared/surface.h"
#include "worker/backend/embree/coincident.h"
#include "worker/scene/footprint.h"
#include "worker/scene/texture.h"

static const double DEPTH_UNIT = 0x1p-40;
static const int64_t DEEPEST = (int64_t)KILN_DEPTH_MOST << 40; /* 2^-48 and less is nothing */

/* Offsets of fields in RTCRayN and RTCHitN, whose accessors exist in C++ only: both have N values of each field one
 * after the other (rtcore_ray.h). */
enum { RAY_DIRECTION = 4, RAY_ID = 10, HIT_NORMAL = 0, HIT_U = 3, HIT_V = 4, HIT_PRIMITIVE = 5 };

/* A hit on a triangle that is not opaque, by the stored triangle and its barycentrics. */
struct place {
    const struct kiln_mesh *mesh;
    uint32_t triangle, stored;
    float b1, b2;
    float cosine; /* absolute cosine of the ray to the normal; 1 where nothing depends on it */
};

static struct kiln_vec3 vector_of(const float *fields, size_t n, unsigned i)
{
    return vec3(fields[i], fields[n + i], fields[2 * n + i]);
}

static float cosine_of(const struct RTCFilterFunctionNArguments *arguments, unsigned i)
{
    const size_t n = arguments->N;
    const struct kiln_vec3 normal = vector_of((const float *)arguments->hit + HIT_NORMAL * n, n, i),
                           direction = vector_of((const float *)arguments->ray + RAY_DIRECTION * n, n, i);
    const float lengths = vec3_length(normal) * vec3_length(direction);
    return lengths > 0.0f ? fminf(fabsf(vec3_dot(normal, direction)) / lengths, 1.0f) : 1.0f;
}

static struct place place_of(const struct embree_backend *b, const struct RTCFilterFunctionNArguments *arguments,
                             unsigned i)
{
    const struct kiln_geometry *g = b->params.geometry;
    const struct kiln_scene *scene = b->params.scene;
    const float *hits = (const float *)arguments->hit;
    const size_t n = arguments->N;
    const uint32_t triangle = embree_triangle(b, 1, ((const uint32_t *)arguments->hit)[HIT_PRIMITIVE * n + i]);
    const struct kiln_hit_record *record = &g->records[triangle];
    struct place p = {.mesh = &scene->meshes[scene->objects[record->object].mesh],
                      .triangle = triangle,
                      .stored = g->stored_triangle[triangle],
                      .cosine = g->passage >= KILN_PASSAGE_PANE ? cosine_of(arguments, i) : 1.0f};
    kiln_geometry_stored_barycentrics(scene, g, triangle, hits[HIT_U * n + i], hits[HIT_V * n + i], &p.b1, &p.b2);
    return p;
}

/* Whether a ray that searches for solids passes the triangle. */
static bool is_clear(const struct embree_backend *b, uint32_t triangle)
{
    return (b->params.geometry->records[triangle].material & KILN_RECORD_CLEAR) != 0;
}

/* Scenes with masks alone. */
static void filter_masked(const struct RTCFilterFunctionNArguments *arguments)
{
    const struct embree_backend *b = arguments->geometryUserPtr;
    const bool solid = ((const struct embree_context *)arguments->context)->question == EMBREE_SOLID;
    for (unsigned i = 0; i < arguments->N; i++) {
        if (arguments->valid[i] != -1)
            continue;
        const struct place p = place_of(b, arguments, i);
        if (solid ? is_clear(b, p.triangle)
                  : !(kiln_surface_opacity(b->params.scene, p.mesh, p.stored, p.b1, p.b2) > 0.0f))
            arguments->valid[i] = 0;
    }
}

static struct kiln_passage passage_at(const struct embree_backend *b, const struct place *p)
{
    struct kiln_passage passage;
    if (embree_tints(b)) {
        kiln_surface_passage(b->params.scene, p->mesh, p->stored, p->b1, p->b2, p->cosine, &passage);
        return passage;
    }
    passage.opacity = kiln_surface_opacity(b->params.scene, p->mesh, p->stored, p->b1, p->b2);
    passage.through[0] = passage.through[1] = passage.through[2] = 1.0f - passage.opacity;
    return passage;
}

static int64_t depth_of(float through)
{
    const double depth = through < 1.0f ? -log2((double)through) / DEPTH_UNIT : 0.0;
    return depth < (double)DEEPEST ? (int64_t)(depth + 0.5) : DEEPEST;
}

static double share_of(int64_t depth) { return depth < DEEPEST ? exp2(-(double)depth * DEPTH_UNIT) : 0.0; }

/* Adds optical depth: of each colour through / whole is left. Returns whether nothing is. */
static bool deepen(int64_t depth[3], const float through[3], float whole)
{
    bool dark = true;
    for (int c = 0; c < 3; c++) {
        depth[c] += c > 0 && through[c] == through[0] ? depth_of(through[0] / whole) : depth_of(through[c] / whole);
        dark = dark && depth[c] >= DEEPEST;
    }
    return dark;
}

/* Whether the surface ends the ray. */
static bool stops(struct embree_context *context, uint32_t lane, uint32_t triangle, const struct kiln_passage *p)
{
    const float passed = 1.0f - p->opacity;
    if (context->question == EMBREE_THROUGH)
        return deepen(context->depth[lane], p->through, 1.0f);
    const bool there = kiln_is_there(context->seed[lane], triangle, p->opacity);
    if (context->question == EMBREE_BY_CHANCE) {
        context->tinted[lane] |= !there && (p->through[0] < passed || p->through[1] < passed || p->through[2] < passed);
        return there;
    }
    if (!there)
        (void)deepen(context->depth[lane], p->through, passed);
    return false;
}

/* Scenes with more than masks. */
static void filter_partial(const struct RTCFilterFunctionNArguments *arguments)
{
    const struct embree_backend *b = arguments->geometryUserPtr;
    struct embree_context *context = (struct embree_context *)arguments->context;
    const uint32_t *ids = (const uint32_t *)arguments->ray + (size_t)RAY_ID * arguments->N;
    for (unsigned i = 0; i < arguments->N; i++) {
        if (arguments->valid[i] != -1)
            continue;
        const struct place p = place_of(b, arguments, i);
        if (context->question == EMBREE_SOLID) {
            arguments->valid[i] = is_clear(b, p.triangle) ? 0 : -1;
            continue;
        }
        const struct kiln_passage passage = passage_at(b, &p);
        if (!stops(context, ids[i], p.triangle, &passage))
            arguments->valid[i] = 0;
    }
}

void embree_set_filters(const struct embree_backend *b, RTCGeometry geometry)
{
    const RTCFilterFunctionN filter = embree_blends(b) ? filter_partial : filter_masked;
    rtcSetGeometryUserData(geometry, (void *)(uintptr_t)b);
    rtcSetGeometryIntersectFilterFunction(geometry, filter);
    rtcSetGeometryOccludedFilterFunction(geometry, filter);
}

void embree_context(const struct embree_backend *b, struct embree_context *context)
{
    *context = (struct embree_context){.question = EMBREE_BY_CHANCE};
    rtcInitIntersectContext(&context->rtc);
    context->rtc.flags = b->coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
}

/* Finds the tints of rays that have passed coloured surfaces; those of others are 1. */
static void find_tints8(const struct embree_backend *b, struct embree_context *context, const int *valid,
                        const struct RTCRayHit8 *rays, float tint[PACKET][3])
{
    struct RTCRayHit8 again = *rays;
    int wanted[PACKET] __attribute__((aligned(32)));
    bool any = false;
    for (uint32_t i = 0; i < PACKET; i++) {
        wanted[i] = valid[i] != 0 && context->tinted[i] ? -1 : 0;
        any = any || wanted[i] != 0;
        again.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
    }
    memset(context->depth, 0, sizeof context->depth);
    context->question = EMBREE_TINT;
    if (any)
        rtcIntersect8(wanted, b->scene, &context->rtc, &again);
    for (int i = 0; i < PACKET; i++)
        for (int c = 0; c < 3; c++)
            tint[i][c] = (float)share_of(context->depth[i][c]);
}

static void ask_by_chance(struct embree_context *context, struct RTCRay8 *rays, const uint32_t seed[PACKET])
{
    context->question = EMBREE_BY_CHANCE;
    memcpy(context->seed, seed, sizeof context->seed);
    memset(context->tinted, 0, sizeof context->tinted);
    for (uint32_t i = 0; i < PACKET; i++)
        rays->id[i] = i;
}

void embree_nearest8(const struct embree_backend *b, struct embree_context *context, const int *valid,
                     struct RTCRayHit8 *rays, const uint32_t seed[PACKET], float tint[PACKET][3])
{
    if (embree_blends(b))
        ask_by_chance(context, &rays->ray, seed);
    rtcIntersect8(valid, b->scene, &context->rtc, rays);
    if (b->coincides != NULL)
        embree_prefer_front8(b, context, valid, rays);
    if (embree_tints(b))
        find_tints8(b, context, valid, rays, tint);
}

void embree_blocked8(const struct embree_backend *b, struct embree_context *context, const int *valid,
                     struct RTCRay8 *rays, const uint32_t seed[PACKET])
{
    if (embree_blends(b))
        ask_by_chance(context, rays, seed);
    rtcOccluded8(valid, b->scene, &context->rtc, rays);
}

void embree_nearest1(const struct embree_backend *b, struct embree_context *context, struct RTCRayHit *ray,
                     uint32_t seed, float tint[3])
{
    context->question = EMBREE_BY_CHANCE;
    context->seed[0] = seed;
    context->tinted[0] = false;
    ray->ray.id = 0;
    rtcIntersect1(b->scene, &context->rtc, ray);
    if (b->coincides != NULL)
        embree_prefer_front1(b, context, ray);
    if (!embree_tints(b))
        return;
    memset(context->depth[0], 0, sizeof context->depth[0]);
    context->question = EMBREE_TINT;
    struct RTCRayHit again = *ray;
    again.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    if (context->tinted[0])
        rtcIntersect1(b->scene, &context->rtc, &again);
    for (int c = 0; c < 3; c++)
        tint[c] = (float)share_of(context->depth[0][c]);
}

void embree_context_solid(struct embree_context *context)
{
    *context = (struct embree_context){.question = EMBREE_SOLID};
    rtcInitIntersectContext(&context->rtc);
}

void embree_through8(const struct embree_backend *b, struct embree_context *context, const int *valid,
                     struct RTCRay8 *rays, double through[PACKET][3])
{
    const enum RTCIntersectContextFlags flags = context->rtc.flags;
    if (embree_blends(b)) {
        context->question = EMBREE_THROUGH;
        context->rtc.flags = RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
        memset(context->depth, 0, sizeof context->depth);
        for (uint32_t i = 0; i < PACKET; i++)
            rays->id[i] = i;
    }
    rtcOccluded8(valid, b->scene, &context->rtc, rays);
    context->rtc.flags = flags;
    for (int i = 0; i < PACKET && embree_blends(b); i++)
        for (int c = 0; c < 3; c++)
            through[i][c] = share_of(context->depth[i][c]);
}

void embree_through1(const struct embree_backend *b, struct embree_context *context, struct RTCRay *ray,
                     double through[3])
{
    context->question = EMBREE_THROUGH;
    memset(context->depth[0], 0, sizeof context->depth[0]);
    ray->id = 0;
    rtcOccluded1(b->scene, &context->rtc, ray);
    for (int c = 0; c < 3 && embree_blends(b); c++)
        through[c] = share_of(context->depth[0][c]);
}

bool passage_between(const struct embree_backend *b, struct embree_context *context, struct kiln_vec3 from,
                     struct kiln_vec3 to, double through[3])
{
    const struct kiln_vec3 d = vec3_sub(to, from);
    const float length = vec3_length(d);
    const struct kiln_vec3 direction = vec3_scale(d, 1.0f / length);
    struct RTCRay ray = {.org_x = from.x,
                         .org_y = from.y,
                         .org_z = from.z,
                         .dir_x = direction.x,
                         .dir_y = direction.y,
                         .dir_z = direction.z,
                         .mask = ~0u,
                         .tfar = (float)((double)length * KILN_SHADOW_LENGTH)};
    through[0] = through[1] = through[2] = 1.0;
    embree_through1(b, context, &ray, through);
    return !(ray.tfar < 0.0f);
}

float embree_clear_lift(const struct embree_backend *backend, struct kiln_vec3 p, struct kiln_vec3 n, float lift)
{
    struct embree_context context;
    struct RTCRayHit ray = {.ray = {.org_x = p.x,
                                    .org_y = p.y,
                                    .org_z = p.z,
                                    .dir_x = n.x,
                                    .dir_y = n.y,
                                    .dir_z = n.z,
                                    .tfar = lift / KILN_LIFT_CLEAR,
                                    .mask = ~0u},
                            .hit = {.geomID = RTC_INVALID_GEOMETRY_ID, .instID = {RTC_INVALID_GEOMETRY_ID}}};
    embree_context_solid(&context);
    rtcIntersect1(backend->scene, &context.rtc, &ray);
    return ray.hit.geomID == RTC_INVALID_GEOMETRY_ID ? lift : KILN_LIFT_CLEAR * ray.ray.tfar;
}
