#include "worker/backend/embree/meeting.h"

#include "worker/scene/footprint.h"

bool meeting_trace(const struct embree_backend *b, struct embree_context *context, struct kiln_vec3 origin,
                   struct kiln_vec3 direction, float limit, uint32_t chance, struct RTCRayHit *ray, float tint[3])
{
    tint[0] = tint[1] = tint[2] = 1.0f;
    *ray = (struct RTCRayHit){.ray = {.org_x = origin.x,
                                      .org_y = origin.y,
                                      .org_z = origin.z,
                                      .dir_x = direction.x,
                                      .dir_y = direction.y,
                                      .dir_z = direction.z,
                                      .tfar = limit,
                                      .mask = ~0u},
                              .hit = {.geomID = RTC_INVALID_GEOMETRY_ID, .instID = {RTC_INVALID_GEOMETRY_ID}}};
    embree_nearest1(b, context, ray, chance, tint);
    return ray->hit.geomID != RTC_INVALID_GEOMETRY_ID;
}

bool meeting_is_seen(const struct embree_backend *b, uint32_t triangle, bool back)
{
    const struct kiln_hit_record *record = &b->params.geometry->records[triangle];
    const bool hidden = (b->params.scene->objects[record->object].flags & KILN_OBJECT_CASTER_ONLY) != 0 &&
                        (record->material & KILN_RECORD_EMITS) == 0;
    return !hidden && meeting_has_side(b, record, back);
}

bool meeting_look(const struct embree_backend *b, struct embree_context *context, struct kiln_vec3 origin,
                  struct kiln_vec3 direction, float limit, uint32_t chance, struct RTCRayHit *ray, float tint[3])
{
    float part[3];
    tint[0] = tint[1] = tint[2] = 1.0f;
    for (uint32_t i = 0; i <= KILN_PATH_UNSEEN; i++) {
        const bool meets = meeting_trace(b, context, origin, direction, limit, chance, ray, part);
        for (int c = 0; c < 3; c++)
            tint[c] *= part[c];
        if (!meets)
            return false;
        if (meeting_is_seen(b, embree_triangle(b, ray->hit.geomID, ray->hit.primID), meeting_is_back(ray)))
            return true;
        const float beyond = kiln_path_beyond(ray->ray.tfar, b->params.geometry->extent);
        origin = vec3_madd(origin, direction, beyond);
        limit -= beyond;
    }
    return false;
}

bool meeting_is_back(const struct RTCRayHit *r)
{
    return r->hit.Ng_x * r->ray.dir_x + r->hit.Ng_y * r->ray.dir_y + r->hit.Ng_z * r->ray.dir_z > 0.0f;
}

const struct kiln_gloss *meeting_gloss(const struct embree_backend *b, const struct kiln_hit_record *record)
{
    return kiln_gloss_taken(b->params.scene, record->material & KILN_RECORD_MATERIAL);
}

bool meeting_has_side(const struct embree_backend *b, const struct kiln_hit_record *record, bool back)
{
    if (!back || (record->material & KILN_RECORD_DOUBLE_SIDED) != 0)
        return true;
    const struct kiln_gloss *gloss = meeting_gloss(b, record);
    return gloss != NULL && gloss->transmission > 0.0f;
}

/* All but where it is. */
static struct meeting touch(const struct embree_backend *b, const struct RTCRayHit *r)
{
    const struct kiln_geometry *g = b->params.geometry;
    const struct kiln_scene *scene = b->params.scene;
    struct meeting m = {.triangle = embree_triangle(b, r->hit.geomID, r->hit.primID),
                        .u = r->hit.u,
                        .v = r->hit.v,
                        .back = meeting_is_back(r)};
    m.stored = g->stored_triangle[m.triangle];
    m.gloss = meeting_gloss(b, &g->records[m.triangle]);
    m.mesh = &scene->meshes[scene->objects[g->records[m.triangle].object].mesh];
    kiln_geometry_stored_barycentrics(scene, g, m.triangle, m.u, m.v, &m.b1, &m.b2);
    m.normal = kiln_triangle_exact_normal(scene, g, m.triangle);
    m.shading = m.normal;
    return m;
}

static void place(const struct embree_backend *b, struct meeting *m)
{
    const struct kiln_geometry *g = b->params.geometry;
    m->position = kiln_triangle_position(g, m->triangle, m->u, m->v);
    m->offset = kiln_offset_distance(g, m->triangle, m->normal);
}

struct meeting meeting_make(const struct embree_backend *b, const struct RTCRayHit *r)
{
    struct meeting m = touch(b, r);
    place(b, &m);
    return m;
}

static void shade(const struct embree_backend *b, struct meeting *m)
{
    if ((m->mesh->flags & KILN_MESH_SMOOTH) == 0)
        return;
    m->shading = kiln_triangle_shading_normal(b->params.scene, b->params.geometry, m->triangle, m->u, m->v);
    if (!(vec3_dot(m->shading, m->normal) > 0.0f))
        m->shading = m->normal;
}

struct kiln_frame meeting_frame(const struct embree_backend *b, const struct meeting *m, struct kiln_vec3 normal)
{
    const struct kiln_scene *scene = b->params.scene;
    const struct kiln_geometry *g = b->params.geometry;
    struct kiln_vec3 corner[3];
    kiln_geometry_corners(g, m->triangle, corner);
    const int second = scene->objects[g->records[m->triangle].object].flipped != 0 ? 1 : 2;
    const struct kiln_vec3 edge[2] = {vec3_sub(corner[3 - second], corner[0]), vec3_sub(corner[second], corner[0])};
    return kiln_surface_frame(scene, m->gloss, m->mesh, m->stored, m->b1, m->b2, normal, edge);
}

/* Finds the lobes of a surface that is not only diffuse; normals are those of the front. Of o only z is set, unless the
 * diffuse part depends on the azimuth. */
static void find_lobes(const struct embree_backend *b, struct kiln_vec3 direction, bool colored, struct meeting *m)
{
    const uint32_t material = b->params.geometry->records[m->triangle].material & KILN_RECORD_MATERIAL;
    const struct kiln_vec3 back = vec3_scale(direction, -1.0f);
    /* with a shading normal on the other side of the ray, front and back would be exchanged */
    if ((vec3_dot(m->shading, back) > 0.0f) != (vec3_dot(m->normal, back) > 0.0f))
        m->shading = m->normal;
    m->lobes = kiln_surface_lobes(b->params.scene, &b->lobes[material], m->mesh, m->stored, m->b1, m->b2, colored);
    m->o = vec3(0.0f, 0.0f, vec3_dot(m->shading, back));
    if (kiln_bsdf_has_table(m->lobes)) {
        m->frame = meeting_frame(b, m, m->shading);
        m->o = kiln_into_frame(&m->frame, back);
    }
    m->albedo = kiln_bsdf_albedo_of(m->lobes, m->o);
}

/* Finds the rest of the surface's scattering, and the frame. */
static void find_frame(const struct embree_backend *b, struct kiln_vec3 direction, struct meeting *m)
{
    m->frame = meeting_frame(b, m, m->shading);
    m->o = kiln_into_frame(&m->frame, vec3_scale(direction, -1.0f));
    m->shares = kiln_bsdf_shares_of(m->albedo);
    m->others = KILN_LOBE_GLOSS | (m->lobes.coat.strength > 0.0f ? KILN_LOBE_COAT : 0u);
    m->sharp =
        m->others & kiln_path_sharp(m->lobes.alpha_x, m->lobes.alpha_y, m->lobes.p.coat_alpha, m->lobes.glass > 0.0f);
}

static void turn(struct meeting *m)
{
    if (m->back) {
        m->normal = vec3_scale(m->normal, -1.0f);
        m->shading = vec3_scale(m->shading, -1.0f);
    }
}

void meeting_face(const struct embree_backend *b, bool smooth, struct kiln_vec3 direction, struct meeting *m)
{
    if (smooth || m->gloss != NULL)
        shade(b, m);
    if (m->gloss != NULL) {
        find_lobes(b, direction, true, m);
        find_frame(b, direction, m);
    }
    turn(m);
}

void meeting_lift(const struct embree_backend *b, bool smooth, struct meeting *m)
{
    struct kiln_lift lift;
    if ((m->mesh->flags & KILN_MESH_SMOOTH) == 0 || (m->gloss != NULL && m->gloss->transmission > 0.0f) ||
        !kiln_triangle_lift(b->params.scene, b->params.geometry, m->triangle, m->back, &lift))
        return;
    m->coarse = true;
    m->lifted = smooth;
    const float most = smooth ? kiln_lift_at(lift, m->u, m->v) : 0.0f;
    if (most > 0.0f)
        m->lift = embree_clear_lift(b, vec3_madd(m->position, m->normal, m->offset), m->normal, most);
}

struct meeting meeting_begin(const struct embree_backend *b, const struct RTCRayHit *r)
{
    struct meeting m = touch(b, r);
    shade(b, &m);
    find_lobes(b, vec3(r->ray.dir_x, r->ray.dir_y, r->ray.dir_z), false, &m);
    return m;
}

void meeting_end(const struct embree_backend *b, const struct RTCRayHit *r, struct meeting *m)
{
    place(b, m);
    find_frame(b, vec3(r->ray.dir_x, r->ray.dir_y, r->ray.dir_z), m);
    turn(m);
}

bool meeting_attenuation(const struct meeting *m, float distance, float share[3])
{
    if (m->gloss == NULL || !m->back || (m->gloss->flags & KILN_GLOSS_VOLUME) == 0)
        return false;
    kiln_gloss_attenuation(m->gloss, distance, share);
    return true;
}

struct kiln_bsdf_value meeting_evaluate(const struct meeting *m, struct kiln_vec3 i, uint32_t lobes)
{
    return kiln_bsdf_evaluate_chosen(m->lobes, kiln_bsdf_choice_of(m->shares, lobes), m->o, i, KILN_RADIANCE, lobes);
}

/* Computes the weight of a direction drawn from `lobes`, and the share of sharp lobes in it, by colour. */
static void weigh(const struct meeting *m, uint32_t lobes, struct kiln_bsdf_drawn *d, float share[3])
{
    const uint32_t sharp = m->sharp & lobes;
    share[0] = share[1] = share[2] = d->delta || sharp == lobes ? 1.0f : 0.0f;
    if (d->delta || d->i.z == 0.0f)
        return;
    const struct kiln_bsdf_value all = meeting_evaluate(m, d->i, lobes);
    d->weight = all.density > 0.0f ? vec3_scale(all.value, 1.0f / all.density) : vec3(0.0f, 0.0f, 0.0f);
    if (sharp == 0 || sharp == lobes)
        return;
    const struct kiln_vec3 part = meeting_evaluate(m, d->i, sharp).value;
    share[0] = all.value.x > 0.0f ? part.x / all.value.x : 0.0f;
    share[1] = all.value.y > 0.0f ? part.y / all.value.y : 0.0f;
    share[2] = all.value.z > 0.0f ? part.z / all.value.z : 0.0f;
}

bool meeting_send(const struct meeting *m, uint32_t lobes, float pick, float u, float v, struct kiln_vec3 *direction,
                  float weight[3], float sharp[3])
{
    struct kiln_bsdf_drawn d =
        kiln_bsdf_propose(m->lobes, kiln_bsdf_choice_of(m->shares, lobes), m->o, pick, u, v, KILN_RADIANCE);
    weigh(m, lobes, &d, sharp);
    weight[0] = d.weight.x;
    weight[1] = d.weight.y;
    weight[2] = d.weight.z;
    *direction = kiln_out_of_frame(&m->frame, d.i);
    const bool same = (d.i.z > 0.0f) == (m->o.z > 0.0f); /* in truth as by the shading normal */
    return d.i.z != 0.0f && (m->lifted ? same : (vec3_dot(m->normal, *direction) > 0.0f) == same);
}
